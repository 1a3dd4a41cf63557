"""What the renderer is told: one scene, then frames of it. Plain data, nothing of Blender in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lookdev.codegen import NodeSource, Source
from lookdev.ibl import LightTables


@dataclass(frozen=True, order=True)
class Pose:
    """Where the asset and the light stand: degrees about the world's z axis, in [0, 360).

    The renderer moves no more than it must to show this, so that it keeps every acceleration structure and the map by
    which it samples a light. Our own shaders leave the asset still: the camera orbits by ``-element`` and the light
    turns by ``lighting - element``. Under Cycles' own light that stands still: the asset turns by
    ``element - lighting`` and the camera orbits by ``-lighting``.
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
    """All that stays the same over a sequence: geometry, one source for each slot, light, resolution.

    The sources are all of one kind, which says who lights the scene: of `ShaderSource` the shaders themselves,
    otherwise Cycles by its world. Of the sampling, `brdf_samples` and `ibl_samples` are in the shaders already.

    Raises
    ------
    ValueError
        There is no source, or there are several kinds.
    """

    asset_file: Path
    shaders: tuple[Source, ...]
    light: LightTables
    resolution: tuple[int, int]
    sampling: Sampling
    camera: Camera
    device: str

    def __post_init__(self) -> None:
        """Refuse what no renderer can show."""
        kinds = {(type(source).__name__, isinstance(source, NodeSource) and source.exact) for source in self.shaders}
        if len(kinds) != 1:
            found = ", ".join(name + " that is exact" * exact for name, exact in sorted(kinds)) or "none"
            raise ValueError(f"a scene has one kind of source in all its slots, found: {found}")


@dataclass(frozen=True)
class FrameTask:
    """One frame. `files` are all the paths it is written to (turntables may share a pose)."""

    scene: SceneTask
    pose: Pose
    exposure: float
    digest: str
    files: tuple[Path, ...]
    labels: dict[str, str]
