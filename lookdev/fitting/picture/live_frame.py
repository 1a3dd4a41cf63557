"""A frame of a job whose look has live inputs, and what renders it with its derivatives by them."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.errors import LookdevError, WorkerError, nearest_hint
from lookdev.fitting.picture import Unknown
from lookdev.job import Job, JobTurntable
from lookdev.job.parts import JobLook
from lookdev.material import Look
from lookdev.material.change import live_look
from lookdev.output.frame_name import FrameName
from lookdev.plan import Setup, make_setup
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.scene import SceneTasks
from lookdev.rendering.slopes import SlopeTask, live_inputs
from lookdev.rendering.task import SceneTask
from lookdev.rendering.worker import Worker, last_line
from lookdev.scene import Pose, Scene

Floats = NDArray[np.float64]

BACKEND = "mitsuba"


@dataclass(frozen=True, eq=False)
class JobFrame:
    """A frame of a job: its look, its light, its turntable and pose."""

    table: JobLook
    rig: Any
    turntable: JobTurntable
    number: int
    scene: Scene

    @classmethod
    def named(cls, name: str, job: Job, scenes: Mapping[tuple[str, str], Scene]) -> JobFrame:
        """Return the frame of a name, or of its beginning; raises LookdevError where there is none."""
        look, light, last = (*name.split("/"), "", "")[:3] if name.count("/") < 3 else ("", "", "")
        stem, _, digits = last.rpartition(".") if last.rpartition(".")[2].isdigit() else (last, "", "1")
        looks = {each.name: each for each in job.look}
        rigs = {each.name: each for each in job.rigs}
        turntables = {each.name: each for each in job.turntable}
        chosen = []
        for what, given, known in (("look", look, looks), ("light", light, rigs), ("turntable", stem, turntables)):
            if given and given not in known:
                raise LookdevError(f"{job.file}: has no {what} '{given}' ({nearest_hint(given, list(known))})")
            chosen.append(given or next(iter(known)))
        turntable, number = turntables[chosen[2]], int(digits)
        if not 1 <= number <= turntable.frames:
            raise LookdevError(f"{job.file}: turntable '{chosen[2]}' has frames 1 to {turntable.frames}, not {number}")
        scene = scenes[chosen[0], chosen[1]]
        return cls(looks[chosen[0]], rigs[chosen[1]], turntable, number, scene)

    @property
    def name(self) -> str:
        return str(FrameName(self.table.name, self.rig.name, self.turntable.name, self.number))

    @property
    def gain(self) -> float:
        """The exposure of the light, which renders lack."""
        return float(2.0**self.rig.exposure)


class LiveFrame:
    """A worker, and a frame whose look has live inputs by numbers of the unknowns."""

    def __init__(self, worker: Worker, setup: Setup, pose: Pose, unknowns: tuple[Unknown, ...]) -> None:
        self._worker, self._setup, self._pose = worker, setup, pose
        self._own = {str(n): each for n, each in enumerate(unknowns) if not each.is_exposure}
        self._live = live_inputs(setup.task)
        self._numbers = itertools.count()
        self.given = {each.name: each.constant.value for each in self._own.values()}

    def scene_of(self, size: tuple[int, int], block: int) -> SceneTask:
        """Return the scene with blocks of pixels as its pixels."""
        return replace(self._setup.task, resolution=(size[0] // block, size[1] // block))

    def render(
        self,
        scene: SceneTask,
        values: Mapping[str, tuple[float, ...]],
        slopes: bool,
        samples: int,
        seeds: tuple[int, int],
    ) -> Floats:
        """Return halves (2, 1 + P, H, W, 4), with zeros for numbers that no look reads."""
        bindings = {key: self._live[key] for key in self._own if key in self._live}
        given = {binding.parameter: values[self._own[key].name] for key, binding in bindings.items()}
        symbols = [symbol for binding in bindings.values() for symbol in binding.symbols] if slopes else []
        digest = f"picture {next(self._numbers)}"
        task = SlopeTask(scene, self._pose, given, tuple(symbols), samples, seeds, digest)
        try:
            found = self._worker.slopes(task, lambda progress: None).astype(np.float64)
        except WorkerError as error:
            raise WorkerError(f"{error}\n{last_line(self._worker.log)}") from error
        if not slopes or len(bindings) == len(self._own):
            return found
        parts, place = [found[:, :1]], 1
        for key, each in self._own.items():
            read = key in bindings
            parts.append(found[:, place : place + each.width] if read else np.zeros((2, each.width, *found.shape[2:])))
            place += each.width * read
        return np.concatenate(parts, axis=1)


@contextmanager
def live_frame(job: Job, frame: JobFrame, look: Look, unknowns: tuple[Unknown, ...]) -> Iterator[LiveFrame]:
    """Start a worker for a frame whose look's unknowns are inputs; raises RenderError where none can be had."""
    constants = {str(n): each.constant for n, each in enumerate(unknowns) if not each.is_exposure}
    live = live_look(look, constants)
    wears = {path: live if each is look else each for path, each in frame.scene.wears.items()}
    scene = replace(frame.scene, wears=wears)
    sampling = replace(job.render.sampling, denoise="off", error=None, passes=())
    backend = BACKENDS[BACKEND]
    device = job.render.device if job.render.device in backend.devices else "cpu"
    backend.check_device(device)
    setup = make_setup(frame.table.name, frame.rig.name, scene, sampling, SceneTasks(BACKEND, device))
    setup = replace(setup, exposure=frame.rig.exposure, rotation=frame.rig.rotation)
    pose = setup.poses(frame.turntable, job.camera.azimuth)[frame.number - 1]
    with (
        tempfile.TemporaryDirectory(prefix="lookdev-worker-") as scratch,
        Worker(backend.command, Path(scratch, "worker.log"), Path(scratch)) as worker,
    ):
        worker.start()
        yield LiveFrame(worker, setup, pose, unknowns)
