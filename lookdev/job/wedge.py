"""The table ``[[wedge]]`` of a job: renders looks or lights with a series of values of one or two parameters."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import Discriminator, Field, Tag, TypeAdapter, ValidationError

from lookdev.job.keys import Degrees, Exposure, JobTable, KeyName, Text, alternative_to, key

WedgeNumber = Annotated[float, Field(ge=-1e18, le=1e18)]
WedgeValue = Annotated[
    Annotated[WedgeNumber, Tag("number")]
    | Annotated[tuple[WedgeNumber, WedgeNumber, WedgeNumber], Tag("rgb")]
    | Annotated[Text, Tag("text")],
    Discriminator(lambda value: "text" if isinstance(value, str) else "rgb" if isinstance(value, tuple) else "number"),
]
WedgeInput = float | tuple[float, float, float] | str

LIGHT_KEYS: dict[str, TypeAdapter[float]] = {"exposure": TypeAdapter(Exposure), "rotation": TypeAdapter(Degrees)}
"""The keys of an ``[[ibl]]`` or ``[[rig]]`` that a wedge may vary, with the validators of their values."""


class JobAxis(JobTable):
    """A parameter and its values."""

    parameter: Text = Field(
        description="What varies: an input of a layer, 'roughness' or 'Base.roughness'; 'Coat.mask', or an input of "
        "its expression, 'Coat.mask.amount'; 'exposure' or 'rotation' of the light; or a value of a light of a rig, "
        "'light:Key.intensity'."
    )
    values: Annotated[tuple[WedgeValue, ...], Field(min_length=1, max_length=1000)] | None = key(
        None, "Its values: numbers, linear colours [r, g, b], names, or expressions of a mask."
    )
    range: Annotated[
        tuple[WedgeNumber, WedgeNumber, Annotated[int, Field(ge=2, le=1000)]] | None, alternative_to("values")
    ] = Field(
        default=None,
        validate_default=True,
        description="Instead of 'values': the first value, the last one, and how many there are, evenly spaced.",
    )

    @property
    def steps(self) -> tuple[WedgeInput, ...]:
        """The values of the parameter, one for each step. Values of a range are rounded to 6 significant digits."""
        if self.range is None:
            return self.values or ()
        first, last, count = self.range
        return tuple(float(f"{first + (last - first) * i / (count - 1):.6g}") for i in range(count))

    @property
    def short_name(self) -> str:
        """The name of the parameter as a part of a file name."""
        return re.sub(r"[^A-Za-z0-9._-]+", "_", self.parameter.removeprefix("light:")).strip("_.")

    @property
    def varies_light(self) -> bool:
        """Whether the parameter is a value of lights, not of looks."""
        return self.parameter in ("exposure", "rotation") or self.parameter.startswith("light:")


class JobWedge(JobAxis):
    """A wedge: looks and lights of the job, rendered again with other values of one or two parameters."""

    by: JobAxis | None = key(
        None,
        "A second parameter with its values: { parameter = 'metallic', range = [0, 1, 5] }; all pairs are rendered.",
    )
    look: KeyName | None = key(None, "The look that is varied; default: each look of the job.")
    rig: KeyName | None = key(None, "The light or rig; default: each of the job.")
    name: KeyName | None = key(None, "The name of its sheets, unique; default: made of the parameters.")

    @property
    def axes(self) -> tuple[JobAxis, ...]:
        """The one or two axes of the wedge: first the axis of a contact sheet's rows, then the axis of its columns."""
        return (self,) if self.by is None else (self, self.by)

    @property
    def title(self) -> str:
        """The name of the wedge's contact sheets."""
        return self.name or "_".join(axis.short_name for axis in self.axes)


def light_key_error(key: str, value: WedgeInput) -> str:
    """Return the message about an invalid value of one of `LIGHT_KEYS`; "" if the value is valid."""
    try:
        LIGHT_KEYS[key].validate_python(value, strict=True)
    except ValidationError as error:
        return error.errors()[0]["msg"]
    return ""
