"""The schema of a job file: strict, frozen models with a hard range for every number.

A rule of two keys is in the later key's validator, which has the earlier ones in `info.data`, so that it is reported
with every other fault. For the same reason `lookdev.job.load` checks in the raw tables that names are unique.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    PrivateAttr,
    Tag,
    ValidationInfo,
    create_model,
    field_validator,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from lookdev.asset import BUILTINS
from lookdev.errors import nearest_hint
from lookdev.light import BUILTIN_LIGHTS
from lookdev.output import OUTPUTS, Output
from lookdev.output.display import VIEWS
from lookdev.render.backends import BACKENDS, job_backends
from lookdev.scene import SAMPLE_CAP, Sampling

# Names become folders and file names: no separator, and no leading dot, which marks our temporary files.
NAME = r"^[A-Za-z0-9_-][A-Za-z0-9._-]*$"
PRIM_PATH = r"^(/[^/\s]+)+$"
PATTERNS: dict[str, str] = {
    NAME: "letters, digits, '_', '-' and '.', which is not the first",
    PRIM_PATH: "an absolute prim path, like '/Paint'",
}
"""The hint for a string that does not match a pattern."""

DEFAULT_FOCAL_LENGTH = 50.0


def _wrong(what: str, hint: str = "") -> PydanticCustomError:
    return PydanticCustomError("lookdev", "{what}", {"what": what, "hint": hint})


@dataclass(frozen=True)
class _OneOf:
    """The annotation of a name in a registry; the registry is read with each job."""

    names: Callable[[], Iterable[str]]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self._known, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return handler(schema) | {"enum": list(self.names())}

    def _known(self, name: str) -> str:
        known = list(self.names())
        if name not in known:
            raise _wrong(f"unknown value '{name}'", nearest_hint(name, known))
        return name


def _devices() -> dict[str, None]:
    return {device: None for backend in job_backends().values() for device in backend.devices}


BuiltinAsset = Annotated[str, _OneOf(lambda: BUILTINS)]
BuiltinIbl = Annotated[str, _OneOf(lambda: BUILTIN_LIGHTS)]
BackendName = Annotated[str, _OneOf(job_backends)]
Device = Annotated[str, _OneOf(_devices)]
View = Annotated[str, _OneOf(lambda: VIEWS)]


def _resolve(value: object, info: ValidationInfo[dict[str, Path]]) -> Path:
    if not isinstance(value, str) or not value or "\0" in value:
        raise _wrong("should be a path in quotes")
    return Path(os.path.normpath(info.context["file"].parent / value))


def _readable(*suffixes: str) -> AfterValidator:
    def check(path: Path) -> Path:
        if path.suffix.lower() not in suffixes:
            raise _wrong(f"'{path.name}' is of no known kind", f"known: {', '.join(suffixes)}")
        if not (os.access(path, os.R_OK) and path.is_file()):
            raise _wrong(f"no readable file {path}", "paths are relative to the job file")
        return path

    return AfterValidator(check)


def _folder(path: Path) -> Path:
    nearest = next(place for place in (path, *path.parents) if place.exists())
    if not nearest.is_dir():
        raise _wrong(f"{nearest} is not a folder", "name a folder; it is made if it does not exist")
    return path


JobPath = Annotated[Path, BeforeValidator(_resolve)]
UsdFile = Annotated[JobPath, _readable(".usd", ".usda", ".usdc", ".usdz")]
IblFile = Annotated[JobPath, _readable(".exr", ".hdr")]
PrimPath = Annotated[str, Field(pattern=PRIM_PATH)]
Name = Annotated[str, Field(pattern=NAME, max_length=100)]
Text = Annotated[str, Field(min_length=1)]
Degrees = Annotated[float, Field(ge=-36000.0, le=36000.0)]
Channel = Annotated[float, Field(ge=0.0, le=1e6)]
Pixels = Annotated[int, Field(ge=4, le=16384)]  # Blender renders nothing smaller
Background = Annotated[
    Annotated[Literal["black", "ibl"], Tag("name")] | Annotated[tuple[Channel, Channel, Channel], Tag("rgb")],
    Discriminator(lambda value: "name" if isinstance(value, str) else "rgb"),
]


class Table(BaseModel):
    """A table of the job file."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False)


def _instead_of(other: str) -> AfterValidator:
    """Return the rule that either a key or an earlier one is given."""

    def check(value: str | None, info: ValidationInfo) -> str | None:
        # A faulty key is absent from info.data, and counts as given.
        if (value is None) == (info.data.get(other, ...) is None):
            raise _wrong(f"give exactly one of '{other}' and '{info.field_name}'")
        return value

    return AfterValidator(check)


class JobAsset(Table):
    """What is turned: a USD file or a built-in asset."""

    usd: UsdFile | None = Field(default=None, description="A USD file (.usd, .usda, .usdc, .usdz) with the geometry.")
    builtin: Annotated[BuiltinAsset | None, _instead_of("usd")] = Field(
        default=None, validate_default=True, description="A built-in asset, instead of a file."
    )
    prim: PrimPath | None = Field(
        default=None, description="Render only what is under this prim of the USD file; default: everything."
    )

    @field_validator("prim")
    @classmethod
    def _prim_of_a_file(cls, value: str, info: ValidationInfo) -> str:
        if info.data.get("builtin") is not None:
            raise _wrong("a built-in asset has no prims to choose from", "'prim' goes with 'usd'")
        return value


class JobLook(Table):
    """One look: a material for the asset."""

    name: Name = Field(description="The look's name, unique; it becomes a folder of the output.")
    material: UsdFile = Field(description="A USD file with the look, a UsdShade material.")
    prim: PrimPath | None = Field(
        default=None, description="The material's prim; default: the file's default prim, or its only material."
    )
    variants: dict[Text, Text] = Field(
        default_factory=dict,
        description="The variant chosen in each variant set: { wear = 'dirty' }. '*' makes a look of each: "
        "{ wear = '*' } of 'paint' gives 'paint_clean', 'paint_dirty'.",
    )
    parts: Annotated[tuple[Text, ...], Field(min_length=1)] | None = Field(
        default=None,
        description="Globs over the asset's parts (paths of meshes and subsets) that the look covers, "
        "whatever is bound to them; default: every part that has no look bound to it.",
    )


class JobIbl(Table):
    """One image-based light: a lat-long file or a built-in environment."""

    name: Name = Field(description="The light's name, unique; it becomes a folder of the output.")
    file: IblFile | None = Field(default=None, description="A lat-long environment map, .exr or .hdr.")
    builtin: Annotated[BuiltinIbl | None, _instead_of("file")] = Field(
        default=None, validate_default=True, description="A built-in environment, instead of a file."
    )
    exposure: Annotated[float, Field(ge=-30.0, le=30.0)] = Field(
        default=0.0, description="Exposure in stops: radiance is multiplied by 2^exposure."
    )
    rotation: Degrees = Field(
        default=0.0, description="Degrees about the up axis, added to the lighting angle of every pose."
    )


class JobTurntable(Table):
    """One turntable: the asset turns under a still light, or the light about a still asset."""

    kind: Literal["element", "lighting"] = Field(description="What turns: the asset or the light.")
    name: Name = Field(
        default_factory=lambda data: data.get("kind", ""),
        description="The turntable's name, unique, the stem of its files; default: its kind.",
    )
    frames: Annotated[int, Field(ge=1, le=9999)] = Field(description="How many frames a turntable has.")
    start: Degrees = Field(default=0.0, description="The first frame's angle, degrees.")
    degrees: Degrees = Field(
        default=360.0, description="The whole turn, degrees: frame i of N stands at start + degrees i / N."
    )


class JobCamera(Table):
    """A camera that frames the asset's bounding sphere."""

    fov: Annotated[float, Field(ge=0.1, le=170.0)] | None = Field(
        default=None, description="Horizontal angle of view, degrees, instead of a focal length."
    )
    focal_length: Annotated[float, Field(ge=1.0, le=5000.0)] | None = Field(
        default=None, description=f"Focal length, mm; default {DEFAULT_FOCAL_LENGTH:g}."
    )
    sensor_width: Annotated[float, Field(ge=1.0, le=200.0)] = Field(
        default=36.0, description="Width of the sensor that the focal length belongs to, mm."
    )
    elevation: Annotated[float, Field(ge=-90.0, le=90.0)] = Field(
        default=10.0, description="Degrees that the camera stands above the horizon."
    )
    azimuth: Degrees = Field(default=0.0, description="Degrees that the camera stands about the up axis.")
    margin: Annotated[float, Field(ge=1.0, le=10.0)] = Field(
        default=1.1, description="The frame holds the bounding sphere times this."
    )

    @field_validator("focal_length", "sensor_width")
    @classmethod
    def _lens_or_angle(cls, value: float, info: ValidationInfo) -> float:
        if info.data.get("fov", ...) is not None:
            raise _wrong("has no meaning beside 'fov'", "give either 'fov' or 'focal_length'")
        return value

    @property
    def horizontal_fov(self) -> float:
        """Horizontal angle of view, degrees."""
        if self.fov is not None:
            return self.fov
        focal_length = DEFAULT_FOCAL_LENGTH if self.focal_length is None else self.focal_length
        return math.degrees(2.0 * math.atan(self.sensor_width / (2.0 * focal_length)))


class JobRender(Table):
    """How frames are rendered."""

    resolution: tuple[Pixels, Pixels] = Field(default=(512, 512), description="Width and height, pixels.")
    backend: BackendName = Field(
        default="exact",
        description=". ".join(f"{name}: {backend.help}" for name, backend in job_backends().items()) + ".",
    )
    device: Device = Field(
        default="cpu", description="Cycles' device; exact runs on cpu only, the other backends on any."
    )
    error: Annotated[float, Field(gt=0.0, le=1.0)] | None = Field(
        default=Sampling.error,
        description="Target relMSE of a frame: samples are added until its estimate is at most this.",
    )
    samples: Annotated[int, Field(ge=2, le=2**20, multiple_of=2)] = Field(
        default_factory=lambda data: Sampling.samples if data.get("error") is None else SAMPLE_CAP,
        description="Samples a pixel, even, best a power of two; with 'error', the most that are taken. "
        f"Default {Sampling.samples}, with 'error' {SAMPLE_CAP}.",
    )
    bounces: Annotated[int, Field(ge=0, le=64)] = Field(
        default=Sampling.bounces, description="Indirect bounces; 0: only direct light."
    )
    # At least one: only directions of the BRDF sample narrow lobes and indirect light.
    brdf_samples: Annotated[int, Field(ge=1, le=64)] | None = Field(
        default=None,
        description="Directions drawn from the BRDF per shading point, by the exact backend; default: by the look.",
    )
    ibl_samples: Annotated[int, Field(ge=0, le=64)] | None = Field(
        default=None,
        description="Directions drawn from the light per shading point, by the exact backend; default: by the look.",
    )
    # It reaches the shader as a float32, times 64 for the rounds and halves of a frame, and must be exact.
    seed: Annotated[int, Field(ge=0, le=2**18 - 1)] = Field(
        default=Sampling.seed, description="Seed of all random choices."
    )
    background: Background = Field(
        default="black", description="Behind the asset: 'black', 'ibl' (the light itself), or a linear [r, g, b]."
    )

    @field_validator("device")
    @classmethod
    def _device_of_the_backend(cls, value: str, info: ValidationInfo) -> str:
        backend = BACKENDS.get(info.data.get("backend", ""))
        if backend is not None and value not in backend.devices:
            others = " or ".join(f'"{name}"' for name, each in job_backends().items() if value in each.devices)
            raise _wrong(
                f"backend '{backend.name}' cannot run on '{value}': it is {backend.help}",
                f'device = "{backend.devices[0]}", or backend = {others}',
            )
        return value

    @field_validator("brdf_samples", "ibl_samples")
    @classmethod
    def _directions_of_the_backend(cls, value: int, info: ValidationInfo) -> int:
        backend = BACKENDS.get(info.data.get("backend", ""))
        if backend is not None and not backend.directions:
            others = " or ".join(f'"{name}"' for name, each in job_backends().items() if each.directions)
            raise _wrong(f"has no meaning with backend '{backend.name}'", f"it goes with backend = {others}")
        return value

    @property
    def sampling(self) -> Sampling:
        """Samples, directions and bounces of a frame."""
        return Sampling(**{field.name: getattr(self, field.name) for field in fields(Sampling)})


class OutputsTable(Table):
    """What is written; `JobOutputs` adds the keys of `OUTPUTS`."""

    exr: bool = Field(default=True, description="Float EXR frames; always on, a run resumes by their headers.")
    view: View = Field(default=VIEWS[0], description="The OCIO view of pictures and sheets.")

    @field_validator("exr")
    @classmethod
    def _exr_is_kept(cls, value: bool) -> bool:
        if not value:
            raise _wrong("the EXR cannot be left out: its header records which frames are done", "exr = true")
        return value

    @field_validator("*")
    @classmethod
    def _option_of_an_output(cls, value: object, info: ValidationInfo) -> object:
        for name, output in OUTPUTS.items():
            if info.field_name in output.options and info.data.get(name) is False:
                raise _wrong(f"has no meaning without '{name}'", f"{name} = true")
        return value

    @property
    def wanted(self) -> tuple[Output, ...]:
        """The outputs that are on."""
        return tuple(output for name, output in OUTPUTS.items() if getattr(self, name))

    @property
    def beside(self) -> tuple[str, ...]:
        """The suffixes of the files that are made of each frame."""
        return tuple(output.suffix for output in self.wanted if output.of == "frame")


if TYPE_CHECKING:  # a type checker does not see keys that come from a registry
    JobOutputs = OutputsTable
else:
    _keys = {name: (bool, Field(default=each.default, description=each.help)) for name, each in OUTPUTS.items()}
    _keys |= {name: key for each in OUTPUTS.values() for name, key in each.options.items()}
    JobOutputs = create_model("JobOutputs", __base__=OutputsTable, __doc__="What is written.", **_keys)


class Job(Table):
    """A look-dev job: every look under every light, through every turntable."""

    output: Annotated[JobPath, AfterValidator(_folder)] = Field(
        description="The output folder; frames are <look>/<ibl>/<turntable>.####.exr in it."
    )
    asset: JobAsset = Field(description="What is turned.")
    look: tuple[JobLook, ...] = Field(min_length=1, description="The looks.")
    ibl: tuple[JobIbl, ...] = Field(min_length=1, description="The image-based lights.")
    turntable: tuple[JobTurntable, ...] = Field(min_length=1, description="The turntables.")
    camera: JobCamera = Field(default_factory=JobCamera, description="The camera.")
    render: JobRender = Field(default_factory=JobRender, description="Resolution, samples, device, background.")
    outputs: JobOutputs = Field(default_factory=JobOutputs, description="Which files are written.")

    _file: Path = PrivateAttr()

    def model_post_init(self, context: Any) -> None:
        """Keep the job file, whose absolute path is ``file`` of the validation context."""
        self._file = context["file"]

    @property
    def file(self) -> Path:
        """The job file, absolute; every path in the job is resolved against its folder."""
        return self._file


LISTS: tuple[str, ...] = ("look", "ibl", "turntable")
"""The keys of `Job` that are lists of named tables."""
