"""The worker: tasks in on standard input, results out on standard output, one JSON object a line.

A scene is prepared for frames to come, without an answer: where that fails, a frame of it reports why.

Blender prints to standard output, so `Answers` keeps the real one before Blender is loaded, and all else goes to
standard error. The end of the input, also by the death of the parent, ends the process at once.
"""

from __future__ import annotations

import ctypes
import os
import sys
import tempfile
import threading
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from lookdev.lifetime import end_with_parent, leaving
from lookdev.rendering.answers import Answers, save_arrays

if TYPE_CHECKING:
    from lookdev.rendering.wire import Requests

_LONGEST_CHATTER = 1 << 20
"""Bytes of Blender's log, some 10 kB a frame, that are kept of frames without an error."""


def _read_requests(requests: Requests) -> None:
    requests.read(sys.stdin)
    # There is no parent: a render in progress is dropped. Blender's own exit can hang.
    os._exit(0)


def _serve(answers: Answers) -> None:
    from lookdev.cache import take_notes
    from lookdev.cycles import version
    from lookdev.cycles.progress import finer_progress
    from lookdev.cycles.render import render_frame
    from lookdev.cycles.scene import Scene
    from lookdev.errors import LookdevError
    from lookdev.rendering.task import FrameTask, SceneTask
    from lookdev.rendering.wire import Cancelled, Requests

    requests = Requests()
    threading.Thread(target=_read_requests, args=(requests,), daemon=True).start()
    answers.ready(version.VERSION)
    scene: Scene | None = None
    kept = _log_size()
    while True:
        task = requests.next()
        if isinstance(task, SceneTask):
            scene = None
            with suppress(LookdevError, RuntimeError, OSError, MemoryError):
                made = Scene(task)
                made.compile_shaders()
                scene = made
            continue
        assert isinstance(task, FrameTask), "pictures with derivatives are of another backend"

        def progress(samples: int, of: int, relmse: float | None, digest: str = task.digest) -> None:
            requests.check(digest)
            answers.progress(digest, samples, of, relmse)

        try:
            if scene is None or not scene.fits(task.scene):
                scene = Scene(task.scene)
            scene.show(task.scene)
            with finer_progress(task.scene.sampling.samples, progress) as report:
                frame = render_frame(scene, task, report)
            arrays = save_arrays(frame.a, frame.b, frame.alpha, frame.raw, frame.passes, frame.names)
        except (LookdevError, RuntimeError, OSError, MemoryError) as error:
            if not isinstance(error, Cancelled):
                scene = None
            kept = _log_size()
            answers.failed(task.digest, error)
            continue
        if _log_size() > kept + _LONGEST_CHATTER:
            os.ftruncate(2, kept)
        answers.done(
            task.digest,
            arrays,
            samples=frame.samples,
            seconds=frame.seconds,
            relmse=frame.relmse,
            raw_relmse=frame.raw_relmse,
            raw_seconds=frame.raw_seconds,
            notes=take_notes(),
        )


def _log_size() -> int:
    """Return the size of the log, 0 where the error stream is no file."""
    # Blender's C streams are buffered while the log is a file.
    ctypes.CDLL(None).fflush(None)
    return os.fstat(2).st_size


def _do_once(arguments: list[str], answers: Answers) -> None:
    match arguments:
        case ["--self-test"]:
            from lookdev.cycles.points import self_test

            answers.send(**self_test())
        case ["--points", request]:
            from lookdev.cycles.points import evaluate_file

            evaluate_file(Path(request))
        case ["--export-blend", request]:
            from lookdev.cycles.export_blend import export_file

            answers.send(**export_file(Path(request)))
        case other:
            raise SystemExit(f"lookdev.cycles: unknown arguments {other}")


def main() -> None:
    """Serve frame tasks; with ``--self-test``, ``--points FILE`` or ``--export-blend FILE`` do one thing and leave."""
    end_with_parent()
    answers = Answers()
    with leaving():
        if arguments := sys.argv[1:]:
            # Blender does not remove its temporary folder; the parent removes that of `_serve`.
            with tempfile.TemporaryDirectory(prefix="lookdev-") as scratch:
                os.environ["TMPDIR"] = scratch
                _do_once(arguments, answers)
        else:
            _serve(answers)


if __name__ == "__main__":
    main()
