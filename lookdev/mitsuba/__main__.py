"""The worker process of backend `mitsuba`, started as ``python -m lookdev.mitsuba``.

It reads tasks from standard input and writes answers to standard output, one JSON object per line. It ends at once when
its input ends, or when its parent dies.

A task is a frame (`FrameTask`) or a picture with derivatives (`DerivativeTask`). Any other task is an error: this
backend does not prepare scenes before their first frame (`Backend.can_prepare`).
"""

from __future__ import annotations

import gc
import time
import traceback
from typing import TYPE_CHECKING

from lookdev.processes import end_with_parent, exit_after_block
from lookdev.rendering.answers import AnswerStream

if TYPE_CHECKING:
    from lookdev.mitsuba.derivatives import DerivativeScene
    from lookdev.mitsuba.render import MitsubaScene
    from lookdev.rendering.derivatives import DerivativeTask
    from lookdev.rendering.task import FrameTask
    from lookdev.rendering.wire import TaskQueue


class _Scenes:
    """Renders tasks, and keeps two scenes: of the latest frame, and of the latest picture with derivatives.

    Most tasks have the same scene as the task before.
    """

    def __init__(self, answers: AnswerStream, requests: TaskQueue) -> None:
        self._answers = answers
        self._requests = requests
        self.scene: MitsubaScene | None = None
        self.derivative_scene: DerivativeScene | None = None

    def render(self, task: FrameTask) -> None:
        """Render a frame and send the answer."""
        from lookdev.cache import take_notes
        from lookdev.mitsuba.load import load_mitsuba
        from lookdev.mitsuba.render import MitsubaScene

        def progress(samples: int, planned: int, relmse: float | None) -> None:
            self._requests.check_cancelled(task.digest)
            self._answers.send_progress(task.digest, samples, planned, relmse)

        if self.scene is None:
            gc.freeze()  # excludes the imported modules' objects, which live to the end, from garbage collections
        if self.scene is None or not (self.scene.matches(task.scene) or self.scene.update(task.scene)):
            self.scene = MitsubaScene(load_mitsuba(task.scene.device), task.scene, self.scene)
        self._answers.send_frame(task.digest, self.scene.render(task, progress), take_notes())

    def render_derivatives(self, task: DerivativeTask) -> None:
        """Render a picture with derivatives and send the answer; its relMSE is not estimated, and sent as 0."""
        from lookdev.mitsuba.derivatives import DerivativeScene
        from lookdev.mitsuba.load import load_mitsuba

        start = time.perf_counter()
        if self.derivative_scene is None or self.derivative_scene.task != task.scene:
            self.derivative_scene = DerivativeScene(load_mitsuba(task.scene.device), task.scene)
        halves = self.derivative_scene.render(
            task, lambda finished, planned: self._answers.send_progress(task.digest, finished, planned, None)
        )
        seconds = time.perf_counter() - start
        self._answers.send_arrays(
            task.digest, {"slopes": halves}, samples=2 * task.samples, seconds=seconds, relmse=0.0
        )


def main() -> None:
    """Serve tasks until the input ends."""
    end_with_parent()
    with exit_after_block():
        _serve(AnswerStream())


def _serve(answers: AnswerStream) -> None:
    """Read tasks and answer them; does not return, as the process ends when the input ends."""
    # Imports come late in this function, so that the input is read and the ready message is sent before them.
    from lookdev.rendering.wire import FrameCancelled, TaskQueue

    requests = TaskQueue.from_input()
    from importlib.metadata import version

    answers.send_ready(f"mitsuba {version('mitsuba')}")
    from lookdev.errors import LookdevError, WorkerError
    from lookdev.rendering.derivatives import DerivativeTask
    from lookdev.rendering.task import FrameTask

    scenes = _Scenes(answers, requests)
    while True:
        task = requests.next()
        try:
            match task:
                case FrameTask():
                    scenes.render(task)
                case DerivativeTask():
                    scenes.render_derivatives(task)
                case _:
                    raise WorkerError("this worker takes no scenes ahead of their frames")
        except FrameCancelled as error:
            answers.send_failure(getattr(task, "digest", ""), error)
        except (LookdevError, RuntimeError, OSError, MemoryError) as error:
            scenes = _Scenes(answers, requests)
            traceback.print_exc()  # to the log, since the message of an error of Dr.Jit may refer to its causes
            answers.send_failure(getattr(task, "digest", ""), error)


if __name__ == "__main__":
    main()
