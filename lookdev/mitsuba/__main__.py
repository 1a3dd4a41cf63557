"""The worker: tasks in on standard input, results out on standard output, one JSON object a line.

The end of the input, also by the death of the parent, ends the process at once.
"""

from __future__ import annotations

import os
import queue
import sys
import threading
import traceback

from lookdev.lifetime import end_with_parent
from lookdev.render.answers import Answers, save_arrays


def _read_requests(requests: queue.Queue[str]) -> None:
    for line in sys.stdin:
        requests.put(line)
    os._exit(0)


def main() -> None:
    """Serve frame tasks until the input ends."""
    end_with_parent()
    answers = Answers()
    requests: queue.Queue[str] = queue.Queue()
    threading.Thread(target=_read_requests, args=(requests,), daemon=True).start()
    from importlib.metadata import version

    answers.ready(f"mitsuba {version('mitsuba')}")
    from lookdev.cache import take_notes
    from lookdev.errors import LookdevError
    from lookdev.mitsuba.load import load_mitsuba
    from lookdev.mitsuba.render import MitsubaScene
    from lookdev.render.wire import decode

    scene: MitsubaScene | None = None
    while True:
        task = decode(requests.get())

        def progress(samples: int, of: int, relmse: float | None, digest: str = task.digest) -> None:
            answers.progress(digest, samples, of, relmse)

        try:
            if scene is None or not scene.fits(task.scene):
                scene = MitsubaScene(load_mitsuba(task.scene.device), task.scene, scene)
            frame = scene.render(task, progress)
            arrays = save_arrays(frame.a, frame.b, frame.alpha, frame.raw, frame.passes, frame.names)
        except (LookdevError, RuntimeError, OSError, MemoryError) as error:
            scene = None
            traceback.print_exc()  # Dr.Jit's errors are about those before them
            answers.failed(task.digest, error)
            continue
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


if __name__ == "__main__":
    main()
