"""Renders a frame of a job, and its derivatives with respect to parameters of its look, for the fit to a picture.

The parameters are live inputs of the look: their values can change between renders without new code. A worker of the
backend ``mitsuba`` renders.
"""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lookdev.arrays import Floats
from lookdev.errors import LookdevError, WorkerError, nearest_hint
from lookdev.fitting.picture.unknowns import Unknown
from lookdev.job import Job, JobTurntable
from lookdev.job.parts import JobLook
from lookdev.job.schema import JobIbl, JobRig
from lookdev.material import Look
from lookdev.material.change import look_with_live_inputs
from lookdev.output.frame_name import FrameName
from lookdev.plan import Setup, make_setup
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.derivatives import DerivativeTask, live_inputs
from lookdev.rendering.scene import SceneTasks
from lookdev.rendering.task import SceneTask
from lookdev.rendering.worker import Worker, last_line
from lookdev.scene import Pose, Scene

BACKEND = "mitsuba"


@dataclass(frozen=True, eq=False)
class JobFrame:
    """A frame of a job.

    `job_look`, `rig` and `turntable` are the tables of its look, light and turntable in the job file. `number` is its
    number in the turntable, from 1.
    """

    job_look: JobLook
    rig: JobIbl | JobRig
    turntable: JobTurntable
    number: int
    scene: Scene

    @classmethod
    def from_name(cls, name: str, job: Job, scenes: Mapping[tuple[str, str], Scene]) -> JobFrame:
        """Return the frame with a name like ``look/light/turntable.0001``.

        If parts are missing at the end of the name, the first look, light, turntable or frame of the job is taken.
        `scenes` has the scene of each pair of look and light. Raises LookdevError if there is no such frame.
        """
        if name.count("/") > 2:
            raise LookdevError(
                f"{job.file}: '{name}' is not the name of a frame; LOOK/LIGHT/TURNTABLE.NUMBER would be right"
            )
        look, light, last = (*name.split("/"), "", "")[:3]
        stem, _, digits = last.rpartition(".") if last.rpartition(".")[2].isdigit() else (last, "", "1")
        looks = {look.name: look for look in job.look}
        rigs = {rig.name: rig for rig in job.rigs}
        turntables = {turntable.name: turntable for turntable in job.turntable}
        names = []
        for kind, requested, by_name in (
            ("look", look, looks),
            ("light", light, rigs),
            ("turntable", stem, turntables),
        ):
            if requested and requested not in by_name:
                raise LookdevError(
                    f"{job.file}: has no {kind} '{requested}' ({nearest_hint(requested, list(by_name))})"
                )
            names.append(requested or next(iter(by_name)))
        turntable, number = turntables[names[2]], int(digits)
        if not 1 <= number <= turntable.frames:
            raise LookdevError(f"{job.file}: turntable '{names[2]}' has frames 1 to {turntable.frames}, not {number}")
        scene = scenes[names[0], names[1]]
        return cls(looks[names[0]], rigs[names[1]], turntable, number, scene)

    @property
    def name(self) -> str:
        return str(FrameName(self.job_look.name, self.rig.name, self.turntable.name, self.number))

    @property
    def gain(self) -> float:
        """The factor 2^exposure of the light, which renders do not include."""
        return float(2.0**self.rig.exposure)


class LiveFrame:
    """A frame whose look has the unknowns as live inputs, and the worker that renders it.

    The name of a live input is the number of the unknown, as text. `initial_values` has the values of the unknowns in
    the look, by name.
    """

    def __init__(self, worker: Worker, setup: Setup, pose: Pose, unknowns: tuple[Unknown, ...]) -> None:
        self._worker, self._setup, self._pose = worker, setup, pose
        self._unknowns = {str(n): unknown for n, unknown in enumerate(unknowns) if not unknown.is_exposure}
        self._live = live_inputs(setup.task)
        self._numbers = itertools.count()
        self.initial_values = {unknown.name: unknown.constant.value for unknown in self._unknowns.values()}

    def scene_at(self, size: tuple[int, int], block: int) -> SceneTask:
        """Return the scene with a resolution of `size` divided by `block`, the side of a block of pixels."""
        return replace(self._setup.task, resolution=(size[0] // block, size[1] // block))

    def render(
        self,
        scene: SceneTask,
        values: Mapping[str, tuple[float, ...]],
        with_derivatives: bool,
        samples: int,
        seeds: tuple[int, int],
    ) -> Floats:
        """Return two halves, (2, 1 + P, H, W, 4): independent renders of the picture and of its P derivatives.

        The last axis is RGB and alpha. Derivatives with respect to numbers that the look does not read are 0. The
        arguments after `scene` are those of `search.RenderLook`.
        """
        bindings = {key: self._live[key] for key in self._unknowns if key in self._live}
        live_values = {binding.parameter: values[self._unknowns[key].name] for key, binding in bindings.items()}
        symbols = [symbol for binding in bindings.values() for symbol in binding.symbols] if with_derivatives else []
        digest = f"picture {next(self._numbers)}"
        task = DerivativeTask(scene, self._pose, live_values, tuple(symbols), samples, seeds, digest)
        try:
            halves = self._worker.render_derivatives(task, lambda progress: None).astype(np.float64)
        except WorkerError as error:
            raise WorkerError(f"{error}\n{last_line(self._worker.log)}") from error
        if not with_derivatives or len(bindings) == len(self._unknowns):
            return halves
        # The worker has rendered derivatives for the unknowns that the look reads. The other derivatives are 0.
        parts, first = [halves[:, :1]], 1
        for key, unknown in self._unknowns.items():
            is_read = key in bindings
            parts.append(
                halves[:, first : first + unknown.width] if is_read else np.zeros((2, unknown.width, *halves.shape[2:]))
            )
            first += unknown.width * is_read
        return np.concatenate(parts, axis=1)


@contextmanager
def live_frame(job: Job, frame: JobFrame, look: Look, unknowns: tuple[Unknown, ...]) -> Iterator[LiveFrame]:
    """Start a worker for a frame whose look has the unknowns as live inputs; end the worker with the context.

    Raises RenderError if the worker cannot start.
    """
    constants = {str(n): unknown.constant for n, unknown in enumerate(unknowns) if not unknown.is_exposure}
    live = look_with_live_inputs(look, constants)
    looks = {path: live if assigned is look else assigned for path, assigned in frame.scene.look_of_slot.items()}
    scene = replace(frame.scene, look_of_slot=looks)
    sampling = replace(job.render.sampling, denoise="off", error=None, passes=())
    backend = BACKENDS[BACKEND]
    device = job.render.device if job.render.device in backend.devices else "cpu"
    backend.check_device(device)
    setup = make_setup(frame.job_look.name, frame.rig.name, scene, sampling, SceneTasks(BACKEND, device))
    setup = replace(setup, exposure=frame.rig.exposure, rotation=frame.rig.rotation)
    pose = setup.poses(frame.turntable, job.camera.azimuth)[frame.number - 1]
    with (
        tempfile.TemporaryDirectory(prefix="lookdev-worker-") as scratch,
        Worker(backend.command, Path(scratch, "worker.log"), Path(scratch)) as worker,
    ):
        worker.start()
        yield LiveFrame(worker, setup, pose, unknowns)
