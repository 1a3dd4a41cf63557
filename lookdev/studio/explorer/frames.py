"""The exact frame of the Explorer: a surface on a sphere, rendered by Cycles in a worker process.

The process keeps running for the next frame.
"""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

from lookdev.asset import load_asset
from lookdev.errors import WorkerError
from lookdev.light import load_environment, prepare_light
from lookdev.material import Look
from lookdev.plotting.figure import PlotValues
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.results import ProgressMessage
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import frame_task
from lookdev.rendering.worker import Worker, explain_error
from lookdev.scene import Sampling, Scene
from lookdev.scene.camera import Pose
from lookdev.studio.explorer.shading import DOME
from lookdev.studio.websocket import CancelToken

BACKEND = "exact"  # Cycles, with the models as published
SIZE = 288
"""Side of a frame, in pixels."""

_SAMPLES = 256  # largest number of samples per pixel
_ERROR = 0.004  # a frame with fewer samples is done if its relMSE is at most this


class ExactFrames:
    """The renderer of exact frames for all pages: it renders one frame at a time, and the other frames wait.

    `_current` is the ticket of the frame that is being rendered, a `CancelToken`. The worker process ends with `close`.
    """

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="lookdev-explore-")
        self._render_lock = threading.Lock()
        self._worker: Worker | None = None
        self._current: CancelToken | None = None

    def render(
        self, look: Look, ticket: CancelToken, report: Callable[[dict[str, object]], None]
    ) -> tuple[dict[str, float], PlotValues]:
        """Render a look on a sphere under the dome `DOME`; return facts about the frame, and its pixels.

        The facts are ``samples``, ``relmse`` and ``seconds``. The pixels are ``beauty`` (h, w, 3), premultiplied and
        linear, and ``alpha`` (h, w); row 0 is at the top. `report` receives the progress. Raises ComputationCancelled
        if `ticket` is cancelled, and the errors of workers.
        """
        report({"state": "waiting"})
        while not self._render_lock.acquire(timeout=0.1):
            ticket.check()
        try:
            ticket.check()
            return self._render_frame(look, ticket, report)
        except WorkerError as error:
            ticket.check()  # a cancelled frame kills its worker, which is not an error
            raise WorkerError(explain_error(error, self._log)) from error
        finally:
            self._current = None
            self._render_lock.release()

    def _render_frame(
        self, look: Look, ticket: CancelToken, report: Callable[[dict[str, object]], None]
    ) -> tuple[dict[str, float], PlotValues]:
        """Do what `render` describes, while no other frame is rendered."""
        began = time.perf_counter()
        report({"state": "starting the renderer" if self._worker is None else "preparing"})
        worker = self._worker
        if worker is None:
            worker = self._worker = Worker(BACKENDS[BACKEND].command, self._log, Path(self._folder.name))
        self._current = ticket
        worker.launch()
        light = prepare_light(load_environment(builtin=DOME))
        scene = Scene.of_look(load_asset(builtin="sphere"), look, light, (SIZE, SIZE))
        sampling = Sampling(samples=_SAMPLES, error=_ERROR)
        task = frame_task(scene_task(scene, sampling, BACKEND, "cpu"), Pose(0.0, 0.0), "explored")
        ticket.check()
        worker.start()

        def forward_progress(state: ProgressMessage) -> None:
            ticket.check()
            report({"state": "rendering", "samples": state.samples, "of": state.of, "relmse": state.relmse})

        done = worker.render(task, forward_progress)
        ticket.check()
        facts = {"samples": done.samples, "relmse": done.relmse, "seconds": time.perf_counter() - began}
        return facts, {"beauty": 0.5 * (done.a + done.b), "alpha": done.alpha}

    @property
    def _log(self) -> Path:
        """The file to which the worker writes its log."""
        return Path(self._folder.name) / "worker.log"

    def cancel(self, ticket: CancelToken) -> None:
        """Cancel the frame of a ticket; if the worker is rendering it, end the worker."""
        ticket.cancelled.set()
        worker = self._worker
        if self._current is ticket and worker is not None:
            self._worker = None
            worker.kill()

    def close(self) -> None:
        """End the worker and remove its files."""
        worker, self._worker = self._worker, None
        if self._current is not None:
            self._current.cancelled.set()
        if worker is not None:
            worker.kill()
        self._folder.cleanup()
