"""The table ``[outputs]`` of a job: the files that are written, and the views of pictures.

An *output* is a kind of file, such as PNGs or a contact sheet. The registry `lookdev.output.OUTPUTS` has all outputs.
Each output adds keys to the table.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from pydantic import Field, ValidationInfo, create_model, field_validator

from lookdev.errors import OutputError, nearest_hint
from lookdev.job.keys import JobTable, OcioConfig, Text, default_config, key, key_error
from lookdev.output import OUTPUTS
from lookdev.output.color import SHIPPED, DisplayView, default_display, default_view
from lookdev.output.record import Output


class OutputsTable(JobTable):
    """The files that are written; `JobOutputs` adds the keys of `OUTPUTS`."""

    exr: bool = key(True, "Float EXR frames; always on, a run resumes by their headers.")
    ocio: OcioConfig = Field(
        default_factory=default_config,
        validate_default=True,
        description="The OpenColorIO config that pictures are shown by: a file, 'ocio://' and the name of one that is "
        "built into OpenColorIO, or 'lookdev', which ships; default: $OCIO, else 'lookdev'.",
    )
    ocio_space: Text | None = key(
        None, "The config's colour space of linear Rec.709; default: found by the config's interchange roles."
    )
    display: Text | None = key(None, "The display of pictures; default: that of the config.")
    view: Text | None = Field(
        default=None,
        validate_default=True,
        description="The view of pictures; default: that of the display, 'lookdev' in the config that ships.",
    )
    displays: dict[Text, Text] = Field(
        default_factory=dict, description="Other displays of single outputs, by their names: { sheet = '...' }."
    )
    views: dict[Text, Text] = Field(
        default_factory=dict, validate_default=True, description="Other views of single outputs: { png = 'Raw' }."
    )

    burn_in: tuple[Text, ...] = key(
        (),
        "Outputs into whose frames text is burned: job, look, rig, frame, samples, error, resolution, "
        "view, version and date: ['movie'].",
    )

    @field_validator("exr")
    @classmethod
    def _require_exr(cls, value: bool) -> bool:
        if not value:
            raise key_error("the EXR cannot be left out: its header records which frames are done", "exr = true")
        return value

    @field_validator("burn_in")
    @classmethod
    def _check_burn_in(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        burning = [name for name, output in OUTPUTS.items() if output.can_burn_in]
        for name in value:
            if name not in burning:
                raise key_error(f"no text can be burned into '{name}'", nearest_hint(name, burning))
        return value

    @field_validator("ocio")
    @classmethod
    def _check_config(cls, value: str) -> str:
        with _prefix_errors("$OCIO: " if value == default_config() else ""):
            default_display(value)
        return value

    @field_validator("display")
    @classmethod
    def _check_display(cls, value: str, info: ValidationInfo) -> str:
        with _prefix_errors():
            default_view(info.data.get("ocio", SHIPPED), value)
        return value

    @field_validator("view")
    @classmethod
    def _check_view(cls, value: str | None, info: ValidationInfo) -> str | None:
        with _prefix_errors():
            _display_view(info.data, value).check()
        return value

    @field_validator("displays", "views")
    @classmethod
    def _check_output_names(cls, value: dict[str, str], info: ValidationInfo) -> dict[str, str]:
        for name in value:
            if name not in OUTPUTS:
                raise key_error(f"no output is called '{name}'", nearest_hint(name, list(OUTPUTS)))
        if info.field_name == "views":
            for name in {**info.data.get("displays", {}), **value}:
                with _prefix_errors(f"{name}: "):
                    _display_view(info.data, value.get(name, info.data.get("view")), name).check()
        return value

    @field_validator("*")
    @classmethod
    def _check_option(cls, value: object, info: ValidationInfo) -> object:
        owners = [name for name, output in OUTPUTS.items() if info.field_name in output.options]
        if owners and all(info.data.get(name) is False for name in owners):
            alternatives = " or ".join(f"'{name}'" for name in owners)
            raise key_error(f"has no meaning without {alternatives}", f"{owners[0]} = true")
        return value

    @field_validator("*")
    @classmethod
    def _require_module(cls, value: object, info: ValidationInfo) -> object:
        output = OUTPUTS.get(info.field_name or "")
        if value is True and output and output.extra and find_spec(output.extra[1]) is None:
            extra, module = output.extra
            raise key_error(f"needs the module '{module}', which is not installed", f"pip install 'lookdev[{extra}]'")
        return value

    def display_view(self, output: str = "") -> DisplayView:
        """Return the display and view for the output with this name; for "", those that apply to all outputs."""
        return _display_view(self.__dict__, self.views.get(output, self.view), output)

    @property
    def enabled_outputs(self) -> tuple[Output, ...]:
        """The outputs that the job writes."""
        return tuple(output for name, output in OUTPUTS.items() if getattr(self, name))

    @property
    def frame_suffixes(self) -> tuple[str, ...]:
        """The suffixes of the files that are written beside the EXR of each frame."""
        return tuple(output.suffix for output in self.enabled_outputs if output.scope == "frame")


def _display_view(keys: Mapping[str, Any], view: str | None, output: str = "") -> DisplayView:
    """Return a view, with the display of an output; `view` is the name of the view, None for the display's default.

    `keys` has the values of the table's keys. A key with a fault is absent, and its default is used.
    """
    config = keys.get("ocio", SHIPPED)
    display = keys.get("displays", {}).get(output) or keys.get("display") or default_display(config)
    space = keys.get("ocio_space") or ""
    return DisplayView(view or default_view(config, display), display, config, space)


@contextmanager
def _prefix_errors(prefix: str = "") -> Iterator[None]:
    """Turn an OutputError that is raised in the context into a key error, whose message has a prefix."""
    try:
        yield
    except OutputError as error:
        raise key_error(f"{prefix}{error}") from None


if TYPE_CHECKING:  # a type checker does not see keys that come from a registry
    JobOutputs = OutputsTable
else:
    _keys = {name: (bool, Field(default=output.default, description=output.help)) for name, output in OUTPUTS.items()}
    _keys |= {name: key for output in OUTPUTS.values() for name, key in output.options.items()}
    JobOutputs = create_model("JobOutputs", __base__=OutputsTable, __doc__="The files that are written.", **_keys)
