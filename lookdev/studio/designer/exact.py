"""The exact picture of what the page shows: rounds of a supervised renderer, which stays for the next edit.

Each round is a frame of its own, of seeds of its own; their halves, weighted by samples, are those of one longer frame,
whose error they measure. A request replaces the one before: the renderer ends its frame within a launch, and keeps the
scene, so that of an edit only the look is new.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.errors import LookdevError, RenderError, WorkerError
from lookdev.metrics import relmse_of_halves
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.results import Rendered
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import SceneTask, one_frame
from lookdev.rendering.worker import Worker, explained
from lookdev.scene import Camera, Lens, Pose, Sampling, Scene
from lookdev.studio.talk import Cancelled, Ticket

Floats = NDArray[np.float64]

LONGEST_SIDE = {"mitsuba": 640, "exact": 320}
"""Pixels of a picture's longer side: so many take a first round within a second, and end within 200 ms."""

_ANY_SIZE = ("mitsuba",)
_SAMPLES = (2, 2, 4, 8, 16, 32)  # of the first rounds; later ones are like the last
_MOST, _ERROR = 1024, 5e-5  # samples, and relMSE, after which a picture is done
_TRIES = 3  # of a renderer that dies without a round


@dataclass(frozen=True)
class Wanted:
    """What the page shows besides the scene: its camera, turns in degrees, and the size of its picture in pixels."""

    camera: Camera
    pose: Pose
    size: tuple[int, int]


Deliver = Callable[[dict[str, Any], Mapping[str, NDArray[Any]]], None]


@dataclass
class _Sum:
    """The rounds of a picture so far: sums over samples of halves, of what is direct in them, and of coverage."""

    a: Any = 0.0
    b: Any = 0.0
    direct: Any = 0.0
    alpha: Any = 0.0
    samples: int = 0
    rounds: int = 0

    def add(self, found: Rendered) -> None:
        own = found.samples
        self.a, self.b = self.a + own * found.a.astype(np.float64), self.b + own * found.b.astype(np.float64)
        self.alpha = self.alpha + own * found.alpha.astype(np.float64)
        direct = found.passes.get("direct")
        # Without reflected light, all is direct.
        self.direct = self.direct + own * (0.5 * (found.a + found.b) if direct is None else direct).astype(np.float64)
        self.samples += own
        self.rounds += 1

    @property
    def relmse(self) -> float:
        a, b, alpha = (each / self.samples for each in (self.a, self.b, self.alpha))
        return relmse_of_halves(a, b, alpha)

    @property
    def arrays(self) -> dict[str, Floats]:
        return {
            "beauty": 0.5 * (self.a + self.b) / self.samples,
            "direct": self.direct / self.samples,
            "alpha": self.alpha / self.samples,
        }


class Exact:
    """Renders one picture at a time, the newest; the renderer ends with `close`."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="lookdev-design-")
        # One thread, which lasts: a renderer ends with the thread that started it.
        self.thread = ThreadPoolExecutor(1, "exact")
        self._worker: Worker | None = None
        self._command: tuple[str, ...] = ()
        self._current: Ticket | None = None
        self._digest = ""
        self._count = 0
        self._closed = False

    @property
    def pid(self) -> int | None:
        """The number of the renderer's process."""
        return None if self._worker is None else self._worker.pid

    def cancel(self, ticket: Ticket) -> None:
        """Have a picture end soon."""
        ticket.cancelled.set()
        worker, digest = self._worker, self._digest
        if self._current is ticket and worker is not None and digest:
            worker.cancel(digest)

    def render(self, scene: Scene, wanted: Wanted, ticket: Ticket, deliver: Deliver) -> None:
        """Render rounds of a scene until they are exact enough, and deliver each with its facts; in `thread`.

        Delivered are ``beauty`` (h, w, 3), premultiplied and linear, ``direct`` (h, w, 3), what of it lights send to
        where it is reflected to the camera, and ``alpha`` (h, w); row 0 is at the top. Raises Cancelled, what
        `scene_task` raises, and what workers raise again and again.
        """
        ticket.check()
        self._current = ticket
        try:
            self._render(scene, wanted, ticket, deliver)
        finally:
            self._current, self._digest = None, ""

    def _render(self, scene: Scene, wanted: Wanted, ticket: Ticket, deliver: Deliver) -> None:
        began = time.perf_counter()
        name = backend_for(scene)
        task = task_of(scene, wanted, name)
        ticket.check()
        # Seen sooner at half the size, where that is no other scene to the renderer.
        small = replace(task, resolution=(max(4, task.resolution[0] // 2), max(4, task.resolution[1] // 2)))
        first, made, failures = name in _ANY_SIZE, _Sum(), 0
        while made.samples < _MOST and not (made.rounds and made.relmse <= _ERROR):
            samples = _SAMPLES[min(made.rounds, len(_SAMPLES) - 1)]
            try:
                made.add(self._round(small if first else task, wanted, samples, made.rounds, ticket, deliver))
            except WorkerError as error:
                ticket.check()
                failures += 1
                said = explained(error, self._log)
                if self._closed or failures >= _TRIES:
                    raise WorkerError(said) from error
                deliver({"state": f"{said}; it is started anew"}, {})
                continue
            failures = 0
            facts = {
                "samples": made.samples,
                "relmse": made.relmse,
                "seconds": time.perf_counter() - began,
                "backend": described(name),
                "worker": self.pid,
            }
            deliver(facts, made.arrays)
            if first:
                first, made = False, _Sum()
        deliver({"done": True}, {})

    def _round(
        self, task: SceneTask, wanted: Wanted, samples: int, number: int, ticket: Ticket, deliver: Deliver
    ) -> Rendered:
        worker = self._started(task.backend, deliver)
        self._count += 1
        self._digest = f"exact-{self._count}"
        frame = one_frame(task, wanted.pose, self._digest, samples=samples, seed=number)
        ticket.check()
        try:
            return worker.render(frame, lambda progress: None)
        except RenderError:
            ticket.check()
            raise

    def _started(self, backend: str, deliver: Deliver) -> Worker:
        command = BACKENDS[backend].command
        if self._worker is not None and self._command != command:
            self._worker.kill()
            self._worker = None
        if self._worker is None:
            self._worker, self._command = Worker(command, self._log, Path(self._folder.name)), command
        if self._worker.pid is None:
            deliver({"state": "starting the renderer…"}, {})
        self._worker.start()
        if self._closed:
            self._worker.kill()
            raise Cancelled("the server ends")
        return self._worker

    @property
    def _log(self) -> Path:
        return Path(self._folder.name) / "worker.log"

    def close(self) -> None:
        """End the renderer and remove its files."""
        self._closed = True
        if self._current is not None:
            self._current.cancelled.set()
        if self._worker is not None:
            self._worker.stop()
        self.thread.shutdown(cancel_futures=True)
        if self._worker is not None:
            self._worker.kill()
        self._folder.cleanup()


def backend_for(scene: Scene) -> str:
    """Return the backend that shows a scene exactly and soonest: Mitsuba where it is installed and shows it all."""
    if scene.catchers:
        return "exact"
    try:
        version("mitsuba")
        BACKENDS["mitsuba"].check_device("cpu")
    except (PackageNotFoundError, RenderError):
        return "exact"
    return "mitsuba"


def described(backend: str) -> str:
    """Return what the page calls a backend."""
    return {
        "mitsuba": lambda: f"Mitsuba {version('mitsuba')}",
        "exact": lambda: f"Cycles {version('bpy')}",
    }[backend]()


def task_of(scene: Scene, wanted: Wanted, backend: str) -> SceneTask:
    """Return the task of a picture, no larger than the backend renders at once."""
    shrink = min(1.0, LONGEST_SIDE[backend] / max(wanted.size))
    width, height = (max(4, round(shrink * each)) for each in wanted.size)
    shown = replace(scene, camera=wanted.camera, film=replace(scene.film, resolution=(width, height)))
    return scene_task(shown, Sampling(passes=("direct",)), backend, "cpu")


def wanted_of(body: Mapping[str, Any]) -> Wanted:
    """Return what a page's message asks for; raises LookdevError where it is not that."""

    def number(given: Any) -> float:
        if isinstance(given, bool) or not isinstance(given, int | float) or not abs(given) < 1e9:
            raise LookdevError("a view has finite numbers")
        return float(given)

    def numbers(given: Any, count: int) -> Any:
        if not isinstance(given, list) or len(given) != count:
            raise LookdevError(f"a view has {count} numbers there")
        return tuple(map(number, given))

    camera = body.get("camera")
    if not isinstance(camera, dict):
        raise LookdevError("a view has a camera")
    lens = camera.get("lens")
    if lens is not None and not isinstance(lens, dict):
        raise LookdevError("a lens has an aperture and a focus")
    made = Camera(
        fov=number(camera.get("fov")),
        elevation=number(camera.get("elevation")),
        target=numbers(camera.get("target"), 3),
        distance=number(camera.get("distance")),
        azimuth=number(camera.get("azimuth")),
        roll=number(camera.get("roll")),
        axis=numbers(camera.get("pivot"), 2),
        shift=numbers(camera.get("shift"), 2),
        lens=None if lens is None else Lens(number(lens.get("aperture")), number(lens.get("focus"))),
    )
    if not (0.0 < made.fov < 180.0 and made.distance > 0.0):
        raise LookdevError("a camera has an angle of view from 0 to 180 degrees, and a distance")
    width, height = (int(each) for each in numbers(body.get("size"), 2))
    if not (1 <= width <= 8192 and 1 <= height <= 8192):
        raise LookdevError("a picture has from 1 to 8192 pixels along a side")
    pose = Pose(number(body.get("element")) % 360.0, number(body.get("lighting")) % 360.0)
    return Wanted(made, pose, (width, height))
