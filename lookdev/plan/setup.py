"""A look under a light, ready to be rendered at any pose."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from lookdev.codegen import Source
from lookdev.errors import Fault, FaultsError
from lookdev.job import JobTurntable
from lookdev.plan.poses import turntable_poses, unturned
from lookdev.plan.skips import same_all_around
from lookdev.render.scene import scene_task
from lookdev.render.task import SceneTask
from lookdev.scene import Pose, Sampling, Scene


@dataclass(frozen=True, eq=False)
class Setup:
    """A look under a light, by their names, the folders of its frames."""

    look: str
    ibl: str
    scene: Scene
    task: SceneTask
    requested: Sampling  # that of the task may have fewer bounces
    around: bool = False  # the asset looks the same however it is turned: its poses are one frame
    exposure: float = 0.0  # of the light, stops
    rotation: float = 0.0  # of the light, degrees, added to its angle in every pose

    def poses(self, turntable: JobTurntable, azimuth: float) -> tuple[Pose, ...]:
        """Return the pose that shows each frame of a turntable; equal ones show the same picture."""
        poses = turntable_poses(turntable, self.rotation, azimuth)
        return tuple(unturned(pose, self.around, self.task.light.constant) for pose in poses)


def make_setup(
    look: str, ibl: str, scene: Scene, sampling: Sampling, backend: str = "exact", device: str = "cpu"
) -> Setup:
    """Generate the sources of a scene, and decide whether it looks the same all around.

    Raises as `scene_task`, and FaultsError where the asset lacks an attribute that the looks read.
    """
    task = scene_task(scene, sampling, backend, device)
    if faults := tuple(_attribute_faults(scene, task.shaders)):
        raise FaultsError(faults)
    around = scene.asset.revolved and same_all_around(scene.looks, task.shaders)
    return Setup(look, ibl, scene, task, sampling, around)


@dataclass(frozen=True)
class Turns:
    """The turntables that show every setup, and the folder of all their files; azimuth of the camera in degrees."""

    turntables: tuple[JobTurntable, ...]
    output: Path
    azimuth: float = 0.0

    def files(self, look: str, ibl: str, turntable: JobTurntable) -> tuple[Path, ...]:
        """Return each frame's EXR of a turntable: ``<output>/<look>/<ibl>/<turntable>.####.exr``, from 0001."""
        folder = self.output / look / ibl
        return tuple(folder / f"{turntable.name}.{number:04d}.exr" for number in range(1, turntable.frames + 1))

    def poses(self, setup: Setup) -> tuple[Pose, ...]:
        """Return the distinct poses of a setup, in the order of the turntables."""
        return tuple(dict.fromkeys(pose for each in self.turntables for pose in setup.poses(each, self.azimuth)))


def _attribute_faults(scene: Scene, sources: tuple[Source, ...]) -> Iterator[Fault]:
    """Yield attributes that sources read and a mesh lacks; only USD primvars have a fallback."""
    asset = scene.asset
    for slot, source in enumerate(sources):
        for mesh in asset.meshes:
            if not (mesh.face_slots == slot).any():
                continue
            for binding in source.attributes:
                place = f"{asset.slots[slot].path}, look '{source.name}'"
                if binding.kind == "uv":
                    if binding.attribute not in mesh.uvs:
                        known = ", ".join(mesh.uvs)
                        yield Fault(asset.name, place, f"no UV set '{binding.attribute}'", f"it has: {known}")
                elif binding.attribute in mesh.primvars:
                    is_color = mesh.primvars[binding.attribute].ndim == 2
                    if is_color != (binding.kind == "color"):
                        found = "colour" if is_color else "float"
                        what = f"primvar '{binding.attribute}' is a {found}, the look reads a {binding.kind}"
                        yield Fault(asset.name, place, what)
