"""The schema of a job file: strict, frozen pydantic models with a range for every number.

A rule about two keys is in the validator of the later key, which has the values of the earlier keys in `info.data`. A
fault that this validator finds is reported together with all other faults. A fault that a validator of the whole model
finds would not be. For the same reason, `lookdev.job.load` checks in the raw tables that names are unique.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Discriminator, Field, PrivateAttr, Tag, ValidationInfo, field_validator

from lookdev.job.features import backend_supports, check_feature
from lookdev.job.keys import (
    Degrees,
    Exposure,
    IblFile,
    JobFolder,
    JobTable,
    KeyName,
    OneOf,
    PrimPath,
    UsdFile,
    alternative_to,
    key,
    key_error,
    reject_key,
)
from lookdev.job.outputs import JobOutputs
from lookdev.job.parts import JobAsset, JobLook
from lookdev.job.surroundings import JobCharts, JobGround
from lookdev.job.wedge import JobWedge
from lookdev.light import BUILTIN_LIGHTS
from lookdev.rendering.backends import job_backends
from lookdev.rendering.passes import ALWAYS_WRITTEN, PASSES
from lookdev.scene import Sampling
from lookdev.scene.framing import DEFAULT_FILL
from lookdev.scene.scene import SAMPLE_CAP
from lookdev.shipped import BUILTIN_RIGS
from lookdev.space import REC709, Space

BuiltinIbl = Annotated[str, OneOf(lambda: BUILTIN_LIGHTS)]
BuiltinRig = Annotated[str, OneOf(lambda: BUILTIN_RIGS)]
BackendName = Annotated[str, OneOf(job_backends)]
Device = Annotated[str, OneOf(lambda: {device: None for entry in job_backends().values() for device in entry.devices})]
PassName = Annotated[str, OneOf(lambda: (*PASSES, *ALWAYS_WRITTEN))]
PixelCount = Annotated[int, Field(ge=4, le=16384)]  # Blender renders nothing smaller
ChannelValue = Annotated[float, Field(ge=0.0, le=1e6)]
Background = Annotated[
    Annotated[Literal["black", "ibl"], Tag("name")]
    | Annotated[tuple[ChannelValue, ChannelValue, ChannelValue], Tag("rgb")],
    Discriminator(lambda value: "name" if isinstance(value, str) else "rgb"),
]

DEFAULT_FOCAL_LENGTH = 50.0
"""Millimetres."""

MAX_FRAMES = 250_000
"""The maximum number of frame files of a job. A plan of this size takes at most 1.6 GB of memory and half a minute."""


_EXPOSURE = "Exposure in stops: radiance is multiplied by 2^exposure."
_ROTATION = "Degrees about the up axis, added to the lighting angle of every pose."


class JobIbl(JobTable):
    """One image-based light: a lat-long file or a built-in environment."""

    name: KeyName = Field(description="The light's name, unique; it becomes a folder of the output.")
    file: IblFile | None = key(None, "A lat-long environment map, .exr or .hdr.")
    builtin: Annotated[BuiltinIbl | None, alternative_to("file")] = Field(
        default=None, validate_default=True, description="A built-in environment, instead of a file."
    )
    exposure: Exposure = key(0.0, _EXPOSURE)
    rotation: Degrees = key(0.0, _ROTATION)


class JobRig(JobTable):
    """One rig: the lights of a USD file, or a built-in rig."""

    name: KeyName = Field(
        description="The rig's name, unique among rigs and lights; it becomes a folder of the output."
    )
    usd: UsdFile | None = key(None, "A USD file (.usd, .usda, .usdc, .usdz) with lights.")
    builtin: Annotated[BuiltinRig | None, alternative_to("usd")] = Field(
        default=None, validate_default=True, description="A built-in rig, instead of a file."
    )
    prim: PrimPath | None = key(
        None, "Only the lights at and below this prim; default: the file's default prim, else all."
    )
    exposure: Exposure = key(0.0, _EXPOSURE)
    rotation: Degrees = key(0.0, _ROTATION)


class JobTurntable(JobTable):
    """One turntable: the asset turns under a still light, or the light about a still asset."""

    kind: Literal["element", "lighting"] = Field(description="What turns: the asset or the light.")
    name: KeyName = Field(
        default_factory=lambda data: data.get("kind", ""),
        description="The turntable's name, unique, the stem of its files; default: its kind.",
    )
    frames: Annotated[int, Field(ge=1, le=9999)] = Field(description="How many frames a turntable has.")
    start: Degrees = key(0.0, "The first frame's angle, degrees.")
    degrees: Degrees = key(360.0, "The whole turn, degrees: frame i of N stands at start + degrees i / N.")


class JobCamera(JobTable):
    """A camera that frames the asset throughout its turn, or a camera of a USD file."""

    usd: PrimPath | None = key(
        None,
        "A camera of the asset's USD file, as '/Cameras/shot', which must stand still: its place, focal "
        "length, aperture, offsets, focus and f-stop. It takes the place of all other keys but 'file'.",
    )
    file: UsdFile | None = key(None, "The USD file of that camera, instead of the asset's.")
    fov: Annotated[float, Field(ge=0.1, le=170.0)] | None = key(
        None, "Horizontal angle of view, degrees, instead of a focal length."
    )
    focal_length: Annotated[float, Field(ge=1.0, le=5000.0)] | None = key(
        None, f"Focal length, mm; default {DEFAULT_FOCAL_LENGTH:g}."
    )
    sensor_width: Annotated[float, Field(ge=1.0, le=200.0)] = key(
        36.0, "Width of the sensor that the focal length belongs to, mm."
    )
    elevation: Annotated[float, Field(ge=-90.0, le=90.0)] = key(
        10.0, "Degrees that the camera stands above the horizon."
    )
    azimuth: Degrees = key(0.0, "Degrees that the camera stands about the up axis.")
    fill: Annotated[float, Field(ge=0.05, le=1.0)] | None = key(
        None,
        "The part of the frame's width or height, whichever is reached first, that the asset covers while "
        f"it turns; default {DEFAULT_FILL:g}.",
    )
    margin: Annotated[float, Field(ge=1.0, le=10.0)] | None = key(
        None, "Instead of 'fill': the frame holds the bounding sphere times this."
    )
    framing: Literal["job", "each"] = key(
        "job", "'job': one camera frames what all looks show; 'each': each look has its own."
    )

    _require_usd = field_validator("file")(reject_key("without", "usd", "usd = '/Cameras/shot'"))

    @field_validator("fov", "focal_length", "sensor_width", "elevation", "azimuth", "fill", "margin", "framing")
    @classmethod
    def _reject_beside_usd(cls, value: object, info: ValidationInfo) -> object:
        if info.data.get("usd") is not None:
            raise key_error("has no meaning beside 'usd'", "the camera of the file decides it")
        return value

    _reject_beside_fov = field_validator("focal_length", "sensor_width")(
        reject_key("beside", "fov", "give either 'fov' or 'focal_length'")
    )
    _reject_beside_fill = field_validator("margin")(reject_key("beside", "fill", "give either 'fill' or 'margin'"))

    @property
    def horizontal_fov(self) -> float:
        """The horizontal angle of view in degrees, from `fov` or from the focal length."""
        if self.fov is not None:
            return self.fov
        focal_length = DEFAULT_FOCAL_LENGTH if self.focal_length is None else self.focal_length
        return math.degrees(2.0 * math.atan(self.sensor_width / (2.0 * focal_length)))


class JobRender(JobTable):
    """How frames are rendered."""

    resolution: tuple[PixelCount, PixelCount] = key((512, 512), "Width and height, pixels.")
    backend: BackendName = key(
        "exact", ". ".join(f"{name}: {backend.help}" for name, backend in job_backends().items()) + "."
    )
    device: Annotated[Device, backend_supports("device")] = key(
        "cpu", "Cycles' device; exact runs on cpu only, the other backends on any."
    )
    error: Annotated[float, Field(gt=0.0, le=1.0)] | None = key(
        Sampling.error, "Target relMSE of a frame: samples are added until its estimate is at most this."
    )
    samples: Annotated[int, Field(ge=2, le=2**20, multiple_of=2)] = Field(
        default_factory=lambda data: Sampling.samples if data.get("error") is None else SAMPLE_CAP,
        description="Samples a pixel, even, best a power of two; with 'error', the most that are taken. "
        f"Default {Sampling.samples}, with 'error' {SAMPLE_CAP}.",
    )
    bounces: Annotated[int, Field(ge=0, le=64)] = key(Sampling.bounces, "Indirect bounces; 0: only direct light.")
    # The minimum is 1, because narrow lobes and indirect light are sampled only by directions of the BRDF.
    brdf_samples: Annotated[int, Field(ge=1, le=64), backend_supports("light integrals")] | None = key(
        None, "Directions drawn from the BRDF per shading point, by the exact backend; default: by the look."
    )
    ibl_samples: Annotated[int, Field(ge=0, le=64), backend_supports("light integrals")] | None = key(
        None, "Directions drawn from the light per shading point, by the exact backend; default: by the look."
    )
    # A frame has 64 seeds for its rounds and halves, so the shader gets up to 64 times this seed, as a float32. The
    # limit keeps the number exact.
    seed: Annotated[int, Field(ge=0, le=2**18 - 1)] = key(Sampling.seed, "Seed of all random choices.")
    denoise: Annotated[Literal["off", "measured"], backend_supports("denoise")] = key(
        Sampling.denoise,
        "'measured': by Open Image Denoise, mixed with the raw picture so that no frame is worse; the "
        "error is that of the result, bias included. Exact backend only.",
    )
    space: Annotated[Space, backend_supports("space")] = key(
        REC709,
        "The space of light, and of the EXRs: linear 'rec709', or 'acescg', to which looks and lights are "
        "converted. Backends exact and mitsuba.",
    )
    passes: tuple[PassName, ...] = key(
        (),
        "Further layers of the EXR: "
        + "; ".join(f"{entry.name}: {entry.help}" for entry in PASSES.values())
        + f". Every frame has {', '.join(ALWAYS_WRITTEN[:-1])} and {ALWAYS_WRITTEN[-1]}.",
    )
    background: Background = key("black", "Behind the asset: 'black', 'ibl' (the light itself), or a linear [r, g, b].")

    @field_validator("passes")
    @classmethod
    def _check_passes(cls, value: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
        value = tuple(name for name in value if name not in ALWAYS_WRITTEN)
        check_feature("passes", info.data.get("backend", ""), value)
        # The order is always as in `PASSES`, so that frames with the same passes have the same digest.
        return tuple(name for name in PASSES if name in value)

    @property
    def sampling(self) -> Sampling:
        """The keys of this table that are fields of `Sampling`."""
        return Sampling(**{field.name: getattr(self, field.name) for field in fields(Sampling)})


class Job(JobTable):
    """A look-dev job: every look under every light, through every turntable."""

    model_config = ConfigDict(json_schema_extra={"anyOf": [{"required": [key]} for key in ("ibl", "rig")]})

    output: JobFolder = Field(
        description="The output folder; frames are <look>/<ibl or rig>/<turntable>.####.exr in it."
    )
    asset: JobAsset = Field(description="What is turned.")
    look: tuple[JobLook, ...] = Field(min_length=1, description="The looks.")
    ibl: tuple[JobIbl, ...] = key((), "The image-based lights.")
    rig: tuple[JobRig, ...] = Field(
        default=(), validate_default=True, description="The rigs; a job has at least one of them, or of 'ibl'."
    )
    turntable: tuple[JobTurntable, ...] = Field(min_length=1, description="The turntables.")
    wedge: tuple[JobWedge, ...] = key(
        (), "Wedges: looks and lights with other values of one or two parameters, and their sheets."
    )
    camera: JobCamera = Field(default_factory=JobCamera, description="The camera.")
    render: JobRender = Field(default_factory=JobRender, description="Resolution, samples, device, background.")
    charts: JobCharts | None = key(
        None, "A chrome ball, a grey ball and a colour chart beside the asset, where the table is given."
    )
    ground: JobGround | None = key(
        None, "What the asset stands on, where the table is given: a shadow catcher or a plane."
    )
    outputs: JobOutputs = Field(default_factory=dict, validate_default=True, description="Which files are written.")

    _file: Path = PrivateAttr()

    @field_validator("rig")
    @classmethod
    def _require_light(cls, value: tuple[JobRig, ...], info: ValidationInfo) -> tuple[JobRig, ...]:
        if not value and not info.data.get("ibl", ...):
            raise key_error("the job has no light", "write [[ibl]] or [[rig]]")
        return value

    @field_validator("turntable")
    @classmethod
    def _limit_frames(cls, value: tuple[JobTurntable, ...], info: ValidationInfo) -> tuple[JobTurntable, ...]:
        looks, ibls, rigs = (len(info.data.get(key, ())) for key in ("look", "ibl", "rig"))
        if excess := excess_frames_message(looks, ibls + rigs, value):
            raise key_error(excess, SEVERAL_JOBS_HINT)
        return value

    @field_validator("camera")
    @classmethod
    def _check_camera(cls, camera: JobCamera, info: ValidationInfo) -> JobCamera:
        asset = info.data.get("asset")
        if camera.usd is not None and camera.file is None and asset is not None and asset.usd is None:
            raise key_error("a built-in asset has no camera", "name the 'file' of the camera")
        return camera

    @field_validator("charts")
    @classmethod
    def _check_charts(cls, charts: JobCharts | None, info: ValidationInfo) -> JobCharts | None:
        render = info.data.get("render")
        if charts is not None and render is not None:
            looks = (look.name for look in info.data.get("look", ()))
            charts.check(render.resolution, render.backend, looks)
        return charts

    @field_validator("ground")
    @classmethod
    def _check_ground(cls, ground: JobGround | None, info: ValidationInfo) -> JobGround | None:
        render = info.data.get("render")
        if ground is not None and render is not None:
            ground.check(render.backend, render.denoise, render.passes)
        return ground

    def model_post_init(self, context: Any) -> None:
        """Store the path of the job file: the validation context has it, absolute, under the key ``file``."""
        self._file = context["file"]

    @property
    def rigs(self) -> tuple[JobIbl | JobRig, ...]:
        """The image-based lights of the job, then its rigs."""
        return (*self.ibl, *self.rig)

    def key_of_rig(self, rig: str) -> str:
        """Return the key in the job file, such as ``ibl[1]``, of the light or rig with the name `rig`."""
        keys = [f"ibl[{i}]" for i in range(len(self.ibl))] + [f"rig[{i}]" for i in range(len(self.rig))]
        return keys[[entry.name for entry in self.rigs].index(rig)]

    @property
    def file(self) -> Path:
        """The job file, absolute; every path in the job is resolved against its folder."""
        return self._file


SEVERAL_JOBS_HINT = "write several jobs"


def excess_frames_message(looks: int, rigs: int, turntables: Iterable[JobTurntable]) -> str:
    """Return the message about a job with more than `MAX_FRAMES` frames; "" for other jobs."""
    frames = sum(turntable.frames for turntable in turntables)
    count = looks * rigs * frames
    if count <= MAX_FRAMES:
        return ""
    factors = f"{looks} looks under {rigs} lights in turntables of {frames} frames"
    return f"{factors} make {count} frames; at most {MAX_FRAMES} would be right"


LISTS: tuple[tuple[str, ...], ...] = (("look",), ("ibl", "rig"), ("turntable",), ("wedge",))
"""The keys of `Job` that are lists of named tables, in groups; the names of all tables of a group differ."""
