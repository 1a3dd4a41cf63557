"""Setups: a look under a light, ready to be rendered in the poses of all turntables.

A setup has the generated sources of its scene: the code or the nodes that a backend renders for each look.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lookdev.asset import Mesh
from lookdev.codegen.source import AttributeBinding
from lookdev.errors import Fault, FaultsError
from lookdev.job import JobTurntable
from lookdev.output.frame_name import FrameName
from lookdev.plan.poses import canonical_pose, turntable_poses
from lookdev.plan.skips import is_rotation_invariant
from lookdev.rendering.scene import SceneTasks
from lookdev.rendering.task import SceneTask
from lookdev.scene import Pose, Sampling, Scene


@dataclass(frozen=True, eq=False)
class Setup:
    """A look under a light, ready to be rendered.

    `look` and `ibl` are the names of the look and the light, which are the folders of the frames. `ibl` can also be the
    name of a rig. `task` is the scene as a backend renders it, with the generated sources.
    """

    look: str
    ibl: str
    scene: Scene
    task: SceneTask
    requested: Sampling  # the sampling of the job; the sampling of the task may have fewer bounces
    is_rotation_invariant: bool = False  # whether the asset looks the same at all angles: one frame then shows all
    exposure: float = 0.0  # of the light, in stops
    rotation: float = 0.0  # of the light, in degrees: added to its angle in every pose

    def poses(self, turntable: JobTurntable, azimuth: float) -> tuple[Pose, ...]:
        """Return the pose of each frame of a turntable; frames with equal poses show the same picture."""
        poses = turntable_poses(turntable, self.rotation, azimuth)
        return tuple(canonical_pose(pose, self.is_rotation_invariant, self.task.is_light_fixed) for pose in poses)


def make_setup(look: str, ibl: str, scene: Scene, sampling: Sampling, tasks: SceneTasks | None = None) -> Setup:
    """Return the setup of a scene: generate its sources, and determine whether it looks the same all around.

    `look` and `ibl` are the names of the look and the light. `tasks` generates the sources for a backend, by default
    for "exact" on the CPU. Raises the errors of `SceneTasks.task`, and FaultsError if the asset lacks an attribute that
    a look reads.
    """
    task = (tasks or SceneTasks()).task(scene, sampling)
    if faults := tuple(_attribute_faults(scene, task)):
        raise FaultsError(faults)
    # With passes, frames differ even for a surface of revolution, because some passes show positions.
    is_revolved = scene.asset.revolved and _orbits_asset_axis(scene)
    is_invariant = not sampling.passes and is_revolved and is_rotation_invariant(task.shaders)
    return Setup(look, ibl, scene, task, sampling, is_invariant)


@dataclass(frozen=True)
class TurntableFrames:
    """The turntables of a job, its output folder, and the azimuth of its camera in degrees.

    Every setup is shown in all turntables.
    """

    turntables: tuple[JobTurntable, ...]
    output: Path
    azimuth: float = 0.0

    def files(self, look: str, ibl: str, turntable: JobTurntable) -> tuple[Path, ...]:
        """Return the path of the EXR of each frame of a turntable."""
        names = (FrameName(look, ibl, turntable.name, number) for number in range(1, turntable.frames + 1))
        return tuple(name.file(self.output) for name in names)

    def poses(self, setup: Setup) -> tuple[Pose, ...]:
        """Return the distinct poses of a setup, in the order of the turntables."""
        poses = (pose for turntable in self.turntables for pose in setup.poses(turntable, self.azimuth))
        return tuple(dict.fromkeys(poses))


def _orbits_asset_axis(scene: Scene) -> bool:
    """Return whether the camera orbits the vertical axis through the asset's centre.

    A camera that frames several assets may orbit another axis.
    """
    return math.dist(scene.camera.pivot, scene.asset.center[:2]) <= 1e-5 * scene.asset.radius


def _attribute_faults(scene: Scene, task: SceneTask) -> Iterator[Fault]:
    """Yield a fault for each attribute that a source reads and meshes lack or have in another type.

    A missing USD primvar is not a fault, because it has a fallback.
    """
    paths_of_faults: dict[tuple[str, str, str], list[str]] = {}
    has_readers = any(source.attributes for source in task.shaders)
    for mesh in scene.asset.meshes if has_readers else ():
        for slot in np.unique(mesh.face_slots):
            source = task.shaders[task.slot_shaders[slot]]
            for binding in source.attributes:
                if fault := _attribute_fault(mesh, binding):
                    paths_of_faults.setdefault((source.name, *fault), []).append(scene.asset.slots[slot].path)
    for (look, problem, hint), paths in paths_of_faults.items():
        more = f" and {len(paths) - 1} more" if len(paths) > 1 else ""
        yield Fault(scene.asset.name, f"{paths[0]}{more}, look '{look}'", problem, hint)


def _attribute_fault(mesh: Mesh, binding: AttributeBinding) -> tuple[str, str] | None:
    """Return the problem of an attribute of a mesh and a hint; None if a source can read it."""
    name = binding.attribute
    if binding.kind == "uv":
        hint = f"it has: {', '.join(mesh.uvs)}; the look can name one" if mesh.uvs else "it has none at all"
        return None if name in mesh.uvs else (f"no UV set '{name}'", hint)
    is_color = name in mesh.primvars and mesh.primvars[name].ndim == 2
    if name not in mesh.primvars or is_color == (binding.kind == "color"):
        return None
    stored, read = ("colour", "float") if is_color else ("float", "colour")
    return f"primvar '{name}' is a {stored}, the look reads a {read}", ""
