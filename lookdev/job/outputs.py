"""The table of a job about what is written; the keys of outputs are those of a registry."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from pydantic import Field, ValidationInfo, create_model, field_validator

from lookdev.errors import OutputError, nearest_hint
from lookdev.job.keys import OcioConfig, Table, Text, default_config, wrong
from lookdev.output import OUTPUTS, Output
from lookdev.output.color import SHIPPED, DisplayView, default_display, default_view


class OutputsTable(Table):
    """What is written; `JobOutputs` adds the keys of `OUTPUTS`."""

    exr: bool = Field(default=True, description="Float EXR frames; always on, a run resumes by their headers.")
    ocio: OcioConfig = Field(
        default_factory=default_config,
        validate_default=True,
        description="The OpenColorIO config that pictures are shown by: a file, 'ocio://' and the name of one that is "
        "built into OpenColorIO, or 'lookdev', which ships; default: $OCIO, else 'lookdev'.",
    )
    ocio_space: Text | None = Field(
        default=None,
        description="The config's colour space of linear Rec.709; default: found by the config's interchange roles.",
    )
    display: Text | None = Field(default=None, description="The display of pictures; default: that of the config.")
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

    burn_in: tuple[Text, ...] = Field(
        default=(),
        description="Outputs into whose frames text is burned: job, look, rig, frame, samples, error, resolution, "
        "view, version and date: ['movie'].",
    )

    @field_validator("exr")
    @classmethod
    def _exr_is_kept(cls, value: bool) -> bool:
        if not value:
            raise wrong("the EXR cannot be left out: its header records which frames are done", "exr = true")
        return value

    @field_validator("burn_in")
    @classmethod
    def _of_frames(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        burning = [name for name, output in OUTPUTS.items() if output.burns]
        for name in value:
            if name not in burning:
                raise wrong(f"no text can be burned into '{name}'", nearest_hint(name, burning))
        return value

    @field_validator("ocio")
    @classmethod
    def _readable_config(cls, value: str) -> str:
        with _named_fault("$OCIO: " if value == default_config() else ""):
            default_display(value)
        return value

    @field_validator("display")
    @classmethod
    def _known_display(cls, value: str, info: ValidationInfo) -> str:
        with _named_fault():
            default_view(info.data.get("ocio", SHIPPED), value)
        return value

    @field_validator("view")
    @classmethod
    def _known_view(cls, value: str | None, info: ValidationInfo) -> str | None:
        with _named_fault():
            _shown(info.data, value).check()
        return value

    @field_validator("displays", "views")
    @classmethod
    def _of_outputs(cls, value: dict[str, str], info: ValidationInfo) -> dict[str, str]:
        for name in value:
            if name not in OUTPUTS:
                raise wrong(f"no output is called '{name}'", nearest_hint(name, list(OUTPUTS)))
        if info.field_name == "views":
            for name in {**info.data.get("displays", {}), **value}:
                with _named_fault(f"{name}: "):
                    _shown(info.data, value.get(name, info.data.get("view")), name).check()
        return value

    @field_validator("*")
    @classmethod
    def _option_of_an_output(cls, value: object, info: ValidationInfo) -> object:
        owners = [name for name, output in OUTPUTS.items() if info.field_name in output.options]
        if owners and all(info.data.get(name) is False for name in owners):
            raise wrong("has no meaning without " + " or ".join(f"'{name}'" for name in owners), f"{owners[0]} = true")
        return value

    @field_validator("*")
    @classmethod
    def _installed(cls, value: object, info: ValidationInfo) -> object:
        output = OUTPUTS.get(info.field_name or "")
        if value is True and output and output.extra and find_spec(output.extra[1]) is None:
            extra, module = output.extra
            raise wrong(f"needs the module '{module}', which is not installed", f"pip install 'lookdev[{extra}]'")
        return value

    def shown(self, output: str = "") -> DisplayView:
        """Return the view of an output, by its name."""
        return _shown(self.__dict__, self.views.get(output, self.view), output)

    @property
    def wanted(self) -> tuple[Output, ...]:
        """The outputs that are on."""
        return tuple(output for name, output in OUTPUTS.items() if getattr(self, name))

    @property
    def beside(self) -> tuple[str, ...]:
        """The suffixes of the files that are made of each frame."""
        return tuple(output.suffix for output in self.wanted if output.of == "frame")


def _shown(given: Mapping[str, Any], view: str | None, output: str = "") -> DisplayView:
    """Return a view of the display of an output; a faulty key is absent from those given, and counts as default."""
    config = given.get("ocio", SHIPPED)
    display = given.get("displays", {}).get(output) or given.get("display") or default_display(config)
    space = given.get("ocio_space") or ""
    return DisplayView(view or default_view(config, display), display, config, space)


@contextmanager
def _named_fault(what: str = "") -> Iterator[None]:
    try:
        yield
    except OutputError as error:
        raise wrong(f"{what}{error}") from None


if TYPE_CHECKING:  # a type checker does not see keys that come from a registry
    JobOutputs = OutputsTable
else:
    _keys = {name: (bool, Field(default=each.default, description=each.help)) for name, each in OUTPUTS.items()}
    _keys |= {name: key for each in OUTPUTS.values() for name, key in each.options.items()}
    JobOutputs = create_model("JobOutputs", __base__=OutputsTable, __doc__="What is written.", **_keys)
