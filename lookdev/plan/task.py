"""What the renderer is told: one scene, then frames of it. Plain data, nothing of Blender in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lookdev.codegen import PrincipledSource, ShaderSource
from lookdev.ibl import LightTables


@dataclass(frozen=True, order=True)
class Pose:
    """Where the asset and the light stand: degrees about the world's z axis, in [0, 360).

    The renderer never moves the asset: the camera orbits by ``-element`` and the light turns by
    ``lighting - element`` about it, which shows the same picture and keeps every acceleration structure.
    """

    element: float
    lighting: float


@dataclass(frozen=True)
class Camera:
    """A perspective camera that orbits `target` at `distance`; `fov` is the horizontal angle of view.

    Angles in degrees, lengths in metres. At pose 0 the camera stands at azimuth -90 degrees (on -y, looking
    along +y), raised by `elevation`.
    """

    fov: float
    elevation: float
    target: tuple[float, float, float]
    distance: float


@dataclass(frozen=True)
class Sampling:
    """How much work a frame gets.

    `samples` is per pixel over both halves, even. With `error` set, rounds of growing size are added until the
    estimated relMSE is at most `error` or `samples` is reached. Directions a shading point, `brdf_samples` and
    `ibl_samples`, are chosen for the look where they are None.
    """

    samples: int
    error: float | None
    brdf_samples: int | None
    ibl_samples: int | None
    bounces: int
    seed: int


@dataclass(frozen=True)
class SceneTask:
    """All that stays the same over a sequence: geometry, one shader for each slot, light, resolution.

    With `principled`, that many of Cycles' own BSDF take the place of the shaders and Cycles itself samples the light;
    of the sampling `samples`, `bounces` and `seed` apply.
    """

    asset_file: Path
    shaders: tuple[ShaderSource, ...]
    light: LightTables
    resolution: tuple[int, int]
    sampling: Sampling
    camera: Camera
    device: str
    principled: tuple[PrincipledSource, ...] = ()


@dataclass(frozen=True)
class FrameTask:
    """One frame. `files` are all the paths it is written to (turntables may share a pose)."""

    scene: SceneTask
    pose: Pose
    exposure: float
    digest: str
    files: tuple[Path, ...]
    labels: dict[str, str]
