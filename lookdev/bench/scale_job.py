"""Runs a job up to the first sample of its first frame: ``python -m lookdev.bench.scale_job JOB.toml``.

The benchmark `scale` starts this process and times its output. The process prints a line of JSON when the frames are
planned, and another line at the first sample. The second line has the peak memory of this process and of its worker in
bytes.
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
    """Run a job, and end it at the first sample."""
    answers = AnswerStream()

    def report(event: object) -> None:
        match event:
            case RunStarted():
                answers.send(reached="planned")
            case FrameProgressed(samples=samples) if samples:
                # The worker is a child of the main thread. The lists of other threads are not read: such a thread
                # can end while its list is read.
                children = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
                answers.send(reached="sample", memory=[peak_memory(), *map(peak_memory, children)])
                raise KeyboardInterrupt  # ends the job
            case FrameFailed(reason=reason):
                raise RenderError(reason)

    render_job(job, report=report)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
