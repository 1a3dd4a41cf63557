"""A job up to the first sample of its first frame: ``python -m lookdev.bench.scale_job JOB.toml``.

Lines of JSON go to standard output: one when the frames are planned, and one at the first sample, with the peak memory
of this process and of its worker in bytes.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from lookdev.errors import RenderError
from lookdev.rendering.answers import AnswerStream, peak_memory
from lookdev.run.events import FrameFailed, FrameProgressed, RunStarted
from lookdev.run.render import render_job


def main(job: Path) -> None:
    """Run the job, and end it at the first sample."""
    answers = AnswerStream()

    def report(event: object) -> None:
        match event:
            case RunStarted():
                answers.send(reached="planned")
            case FrameProgressed(samples=samples) if samples:
                # The processes that the main thread started; other threads can end while their lists are read.
                children = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
                answers.send(reached="sample", memory=[peak_memory(), *map(peak_memory, children)])
                raise KeyboardInterrupt  # ends the run
            case FrameFailed(reason=reason):
                raise RenderError(reason)

    render_job(job, report=report)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
