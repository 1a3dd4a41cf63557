"""The worker: tasks in on standard input, results out on standard output, one JSON object a line.

The end of the input, also by the death of the parent, ends the process at once.
"""

from __future__ import annotations

import gc
import os
import sys
import threading
import time
import traceback
from typing import TYPE_CHECKING

from lookdev.lifetime import end_with_parent, leaving
from lookdev.rendering.answers import Answers, save_arrays, save_named

if TYPE_CHECKING:
    from lookdev.mitsuba.render import MitsubaScene
    from lookdev.mitsuba.slopes import SlopeScene
    from lookdev.rendering.slopes import SlopeTask
    from lookdev.rendering.task import FrameTask
    from lookdev.rendering.wire import Requests


def _read_requests(requests: Requests) -> None:
    requests.read(sys.stdin)
    os._exit(0)


class _Scenes:
    """The scenes of the last tasks: those of the next ones are mostly the same."""

    def __init__(self, answers: Answers, requests: Requests) -> None:
        self._answers = answers
        self._requests = requests
        self.shown: MitsubaScene | None = None
        self.derived: SlopeScene | None = None

    def render(self, task: FrameTask) -> None:
        """Render a frame and answer it."""
        from lookdev.cache import take_notes
        from lookdev.mitsuba.load import load_mitsuba
        from lookdev.mitsuba.render import MitsubaScene

        def progress(samples: int, of: int, relmse: float | None) -> None:
            self._requests.check(task.digest)
            self._answers.progress(task.digest, samples, of, relmse)

        if self.shown is None:
            gc.freeze()  # what was imported stays: collections, one a frame, need not look through it
        if self.shown is None or not (self.shown.fits(task.scene) or self.shown.take(task.scene)):
            self.shown = MitsubaScene(load_mitsuba(task.scene.device), task.scene, self.shown)
        frame = self.shown.render(task, progress)
        self._answers.done(
            task.digest,
            save_arrays(frame.a, frame.b, frame.alpha, frame.raw, frame.passes, frame.names),
            samples=frame.samples,
            seconds=frame.seconds,
            relmse=frame.relmse,
            raw_relmse=frame.raw_relmse,
            raw_seconds=frame.raw_seconds,
            notes=take_notes(),
        )

    def derive(self, task: SlopeTask) -> None:
        """Render a picture with derivatives and answer it; its relMSE is not estimated."""
        from lookdev.mitsuba.load import load_mitsuba
        from lookdev.mitsuba.slopes import SlopeScene

        started = time.perf_counter()
        if self.derived is None or self.derived.task != task.scene:
            self.derived = SlopeScene(load_mitsuba(task.scene.device), task.scene)
        halves = self.derived.render(task, lambda done, of: self._answers.progress(task.digest, done, of, None))
        seconds = time.perf_counter() - started
        arrays = save_named({"slopes": halves})
        self._answers.done(task.digest, arrays, samples=2 * task.samples, seconds=seconds, relmse=0.0)


def main() -> None:
    """Serve tasks until the input ends."""
    end_with_parent()
    with leaving():
        _serve(Answers())


def _serve(answers: Answers) -> None:
    from lookdev.rendering.wire import Cancelled, Requests

    requests = Requests()
    threading.Thread(target=_read_requests, args=(requests,), daemon=True).start()
    from importlib.metadata import version

    answers.ready(f"mitsuba {version('mitsuba')}")
    from lookdev.errors import LookdevError, WorkerError
    from lookdev.rendering.slopes import SlopeTask
    from lookdev.rendering.task import FrameTask

    scenes = _Scenes(answers, requests)
    while True:
        task = requests.next()
        try:
            match task:
                case FrameTask():
                    scenes.render(task)
                case SlopeTask():
                    scenes.derive(task)
                case _:
                    raise WorkerError("this worker takes no scenes ahead of their frames")
        except Cancelled as error:
            answers.failed(getattr(task, "digest", ""), error)
        except (LookdevError, RuntimeError, OSError, MemoryError) as error:
            scenes = _Scenes(answers, requests)
            traceback.print_exc()  # Dr.Jit's errors are about those before them
            answers.failed(getattr(task, "digest", ""), error)


if __name__ == "__main__":
    main()
