"""The worker process of the backends on Cycles, started as ``python -m lookdev.cycles``.

It reads tasks from standard input and writes answers to standard output, one JSON object per line. A `FrameTask` is
rendered. A `SceneTask` prepares a scene for later frames and has no answer; if this fails, the first frame of the scene
reports the error.

Blender prints to standard output. `AnswerStream` therefore duplicates standard output before Blender is loaded, and
everything that Blender prints goes to standard error. The process exits at once when its input ends, which also happens
when the parent dies.
"""

from __future__ import annotations

import ctypes
import os
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

from lookdev.processes import end_with_parent, exit_after_block
from lookdev.rendering.answers import AnswerStream

_MAX_LOG_GROWTH = 1 << 20
"""The most bytes of log since the last error. When frames without an error have added more, these bytes are removed.

A frame logs about 10 kB."""


def _serve(answers: AnswerStream) -> None:
    """Read tasks and answer them; does not return, as the process ends when the input ends."""
    from lookdev.cache import take_notes
    from lookdev.cycles import version
    from lookdev.cycles.progress import refine_progress
    from lookdev.cycles.render import render_frame
    from lookdev.cycles.scene import BlenderScene
    from lookdev.errors import LookdevError
    from lookdev.rendering.task import FrameTask, SceneTask
    from lookdev.rendering.wire import FrameCancelled, TaskQueue

    requests = TaskQueue.from_input()
    answers.send_ready(version.VERSION)
    scene: BlenderScene | None = None
    log_start = _log_size()
    while True:
        task = requests.next()
        if isinstance(task, SceneTask):
            scene = None
            with suppress(LookdevError, RuntimeError, OSError, MemoryError):
                prepared = BlenderScene(task)
                prepared.compile_shaders()
                scene = prepared
            continue
        assert isinstance(task, FrameTask), "pictures with derivatives are of another backend"

        def progress(samples: int, total: int, relmse: float | None, digest: str = task.digest) -> None:
            requests.check_cancelled(digest)
            answers.send_progress(digest, samples, total, relmse)

        try:
            if scene is None or not scene.can_show(task.scene):
                scene = BlenderScene(task.scene)
            scene.show(task.scene)
            with refine_progress(task.scene.sampling.samples, progress) as report:
                frame = render_frame(scene, task, report)
            if _log_size() > log_start + _MAX_LOG_GROWTH:
                os.ftruncate(2, log_start)
            answers.send_frame(task.digest, frame, take_notes())
        except (LookdevError, RuntimeError, OSError, MemoryError) as error:
            if not isinstance(error, FrameCancelled):
                scene = None
            log_start = _log_size()
            answers.send_failure(task.digest, error)


def _log_size() -> int:
    """Return the size in bytes of the log, which is the file of the error stream; 0 if the stream is not a file."""
    # The C streams of Blender are buffered if they are written to a file.
    ctypes.CDLL(None).fflush(None)
    return os.fstat(2).st_size


def _run_command(arguments: list[str], answers: AnswerStream) -> None:
    """Run the command that the arguments of this process name, instead of serving tasks."""
    match arguments:
        case ["--self-test"]:
            from lookdev.cycles.points import run_self_test

            answers.send(**run_self_test())
        case ["--points", request]:
            from lookdev.cycles.points import evaluate_file

            evaluate_file(Path(request))
        case ["--export-blend", request]:
            from lookdev.cycles.export_blend import export_file

            answers.send(**export_file(Path(request)))
        case other:
            raise SystemExit(f"lookdev.cycles: unknown arguments {other}")


def main() -> None:
    """Serve tasks; with ``--self-test``, ``--points FILE`` or ``--export-blend FILE``, run one command instead."""
    end_with_parent()
    answers = AnswerStream()
    with exit_after_block():
        if arguments := sys.argv[1:]:
            # Blender does not remove its temporary folder. For `_serve`, the parent removes it.
            with tempfile.TemporaryDirectory(prefix="lookdev-") as scratch:
                os.environ["TMPDIR"] = scratch
                _run_command(arguments, answers)
        else:
            _serve(answers)


if __name__ == "__main__":
    main()
