"""What the renderer is told: one scene, then frames of it. Plain data, nothing of Blender in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lookdev.codegen import NodeSource, Source
from lookdev.light import AnyLight
from lookdev.scene.camera import Camera, Pose
from lookdev.scene.sampling import Sampling


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
    light: AnyLight
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
