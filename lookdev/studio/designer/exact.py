"""The exact picture of the Designer's page: Cycles or Mitsuba renders the page's view in rounds of more samples.

A worker process renders, and keeps running for the next edit. Each round is a frame with its own seed. A frame has two
halves, which are independent renders; their difference measures its error. The picture is the mean of all rounds,
weighted by their samples, and so are its halves.

A request cancels the previous one. The worker ends its frame after the current launch, which is a batch of samples. It
keeps the scene, so that after an edit only the look is new.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.arrays import Floats
from lookdev.errors import LookdevError, RenderError, WorkerError
from lookdev.metrics import relmse_of_halves
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import SceneTask, frame_task
from lookdev.rendering.worker import Worker, explain_error
from lookdev.scene import Camera, Lens, Pose, Sampling, Scene
from lookdev.studio.websocket import CancelToken, ComputationCancelled

MAX_SIDE = {"mitsuba": 640, "exact": 320}
"""Longer side of a picture in pixels, by backend: a first round takes less than a second, and cancelling 200 ms."""

_RESIZABLE_BACKENDS = ("mitsuba",)  # backends that change the size of a picture without building the scene anew
_SAMPLES = (2, 2, 4, 8, 16, 32)  # samples per pixel of the first rounds; later rounds have the last number
_MAX_SAMPLES, _TARGET_RELMSE = 1024, 5e-5  # a picture is done at this many samples, or at this relMSE
_TRIES = 3  # failures of the worker in a row, without a finished round, after which a picture fails


@dataclass(frozen=True)
class RequestedView:
    """The view of the page: its camera, the pose of asset and lights, and its size (width, height) in pixels."""

    camera: Camera
    pose: Pose
    size: tuple[int, int]


Deliver = Callable[[dict[str, Any], Mapping[str, NDArray[Any]]], None]
"""A function that receives facts about a picture, and its arrays by name (see `ExactRenderer.render`)."""


@dataclass
class _RoundSum:
    """The sum of a picture's rounds so far, each weighted by its samples.

    `totals` has the sums of the halves ``a`` and ``b`` (h, w, 3), of their ``direct`` light (h, w, 3), and of ``alpha``
    (h, w). `samples` is the sum of the weights, and `rounds` the number of rounds.
    """

    totals: dict[str, Floats] = field(default_factory=dict)
    samples: int = 0
    rounds: int = 0

    def add(self, rendered: WorkerFrame) -> None:
        """Add a round, which is a rendered frame."""
        # A frame lacks the pass of direct light if it has no other light; then its beauty is its direct light.
        direct = rendered.passes.get("direct", 0.5 * (rendered.a + rendered.b))
        for name, picture in {"a": rendered.a, "b": rendered.b, "alpha": rendered.alpha, "direct": direct}.items():
            self.totals[name] = self.totals.get(name, 0.0) + rendered.samples * picture.astype(np.float64)
        self.samples += rendered.samples
        self.rounds += 1

    @property
    def relmse(self) -> float:
        """The relMSE of the picture, estimated from its halves."""
        return relmse_of_halves(*(self.totals[name] / self.samples for name in ("a", "b", "alpha")))

    @property
    def arrays(self) -> dict[str, Floats]:
        """The arrays of the picture, which `ExactRenderer.render` delivers."""
        totals = {**self.totals, "beauty": 0.5 * (self.totals["a"] + self.totals["b"])}
        return {name: totals[name] / self.samples for name in ("beauty", "direct", "alpha")}


class ExactRenderer:
    """The renderer of exact pictures: it renders the newest request only, and ends with `close`."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="lookdev-design-")
        # One persistent thread, since a worker process ends with the thread that started it.
        self.thread = ThreadPoolExecutor(1, "exact")
        self._worker: Worker | None = None
        self._command: tuple[str, ...] = ()  # the command line of the worker
        self._current: CancelToken | None = None  # the picture that is being rendered
        self._digest = ""  # the digest of the frame that is being rendered, by which the worker cancels it
        self._count = 0  # number of frames so far
        self._closed = False

    @property
    def pid(self) -> int | None:
        """The process id of the worker; None if it has not started."""
        return None if self._worker is None else self._worker.pid

    def cancel(self, ticket: CancelToken) -> None:
        """Cancel the picture that has a ticket; the worker soon ends the frame that it renders for this picture."""
        ticket.cancelled.set()
        worker, digest = self._worker, self._digest
        if self._current is ticket and worker is not None and digest:
            worker.cancel(digest)

    def render(self, scene: Scene, view: RequestedView, ticket: CancelToken, deliver: Deliver) -> None:
        """Render rounds of a scene until the error is small, and deliver their mean after each round.

        The caller runs this in `thread`. `deliver` receives facts about the picture, and arrays: ``beauty`` (h, w, 3),
        premultiplied and linear; ``direct`` (h, w, 3), the part of ``beauty`` from light that reaches the surface
        directly; and ``alpha`` (h, w). Row 0 is at the top. Raises ComputationCancelled, the errors of `scene_task`,
        and WorkerError if the worker fails `_TRIES` times in a row.
        """
        ticket.check()
        self._current = ticket
        try:
            self._render(scene, view, ticket, deliver)
        finally:
            self._current, self._digest = None, ""

    def _render(self, scene: Scene, view: RequestedView, ticket: CancelToken, deliver: Deliver) -> None:
        """Do what `render` describes, while `_current` is the ticket."""
        began = time.perf_counter()
        name = fastest_backend(scene)
        task = view_task(scene, view, name)
        ticket.check()
        # The first round has half the size, if the backend is resizable. It appears sooner, and is not part of the sum.
        small = replace(task, resolution=(max(4, task.resolution[0] // 2), max(4, task.resolution[1] // 2)))
        is_first, total, failures = name in _RESIZABLE_BACKENDS, _RoundSum(), 0
        while total.samples < _MAX_SAMPLES and not (total.rounds and total.relmse <= _TARGET_RELMSE):
            samples = _SAMPLES[min(total.rounds, len(_SAMPLES) - 1)]
            try:
                total.add(self._render_round(small if is_first else task, view, samples, total.rounds, ticket, deliver))
            except WorkerError as error:
                ticket.check()
                failures += 1
                message = explain_error(error, self._log)
                if self._closed or failures >= _TRIES:
                    raise WorkerError(message) from error
                deliver({"state": f"{message}; it is started anew"}, {})
                continue
            failures = 0
            facts = {
                "samples": total.samples,
                "relmse": total.relmse,
                "seconds": time.perf_counter() - began,
                "backend": backend_title(name),
                "worker": self.pid,
            }
            deliver(facts, total.arrays)
            if is_first:
                is_first, total = False, _RoundSum()
        deliver({"done": True}, {})

    def _render_round(
        self, task: SceneTask, view: RequestedView, samples: int, number: int, ticket: CancelToken, deliver: Deliver
    ) -> WorkerFrame:
        """Render the round `number`, which is also the seed, with `samples` samples per pixel; return its frame."""
        worker = self._start_worker(task.backend, deliver)
        self._count += 1
        self._digest = f"exact-{self._count}"
        frame = frame_task(task, view.pose, self._digest, samples=samples, seed=number)
        ticket.check()
        try:
            return worker.render(frame, lambda progress: None)
        except RenderError:
            ticket.check()  # the worker raises RenderError for a cancelled frame, too
            raise

    def _start_worker(self, backend: str, deliver: Deliver) -> Worker:
        """Return a worker of a backend that is ready to render; end the worker of another backend."""
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
            raise ComputationCancelled("the server ends")
        return self._worker

    @property
    def _log(self) -> Path:
        """The file to which the worker writes its log."""
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


def fastest_backend(scene: Scene) -> str:
    """Return the name of the fastest backend that renders a scene exactly.

    This is ``mitsuba`` if Mitsuba is installed and supports the scene, else ``exact``, which is Cycles.
    """
    if scene.catchers:
        return "exact"
    try:
        version("mitsuba")
        BACKENDS["mitsuba"].check_device("cpu")
    except (PackageNotFoundError, RenderError):
        return "exact"
    return "mitsuba"


def backend_title(backend: str) -> str:
    """Return the name and version of a backend for the page."""
    title, package = {"mitsuba": ("Mitsuba", "mitsuba"), "exact": ("Cycles", "bpy")}[backend]
    return f"{title} {version(package)}"


def view_task(scene: Scene, view: RequestedView, backend: str) -> SceneTask:
    """Return the render task of a view, scaled down until the longer side is at most `MAX_SIDE` of the backend."""
    scale = min(1.0, MAX_SIDE[backend] / max(view.size))
    width, height = (max(4, round(scale * side)) for side in view.size)
    small_scene = replace(scene, camera=view.camera, film=replace(scene.film, resolution=(width, height)))
    return scene_task(small_scene, Sampling(passes=("direct",)), backend, "cpu")


def parse_view(body: Mapping[str, Any]) -> RequestedView:
    """Return the view in a message of the page; raise LookdevError if the message is not valid."""

    def number(value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e9:
            raise LookdevError("a view has finite numbers")
        return float(value)

    def numbers(value: Any, count: int) -> Any:
        if not isinstance(value, list) or len(value) != count:
            raise LookdevError(f"a view has {count} numbers there")
        return tuple(map(number, value))

    camera = body.get("camera")
    if not isinstance(camera, dict):
        raise LookdevError("a view has a camera")
    lens = camera.get("lens")
    if lens is not None and not isinstance(lens, dict):
        raise LookdevError("a lens has an aperture and a focus")
    parsed_camera = Camera(
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
    if not (0.0 < parsed_camera.fov < 180.0 and parsed_camera.distance > 0.0):
        raise LookdevError("a camera has an angle of view from 0 to 180 degrees, and a distance")
    width, height = (int(side) for side in numbers(body.get("size"), 2))
    if not (1 <= width <= 8192 and 1 <= height <= 8192):
        raise LookdevError("a picture has from 1 to 8192 pixels along a side")
    pose = Pose(number(body.get("element")) % 360.0, number(body.get("lighting")) % 360.0)
    return RequestedView(parsed_camera, pose, (width, height))
