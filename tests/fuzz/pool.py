"""Runs cases in a few processes; one that crashes or stalls costs only its case."""

from __future__ import annotations

import json
import select
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from queue import Empty, SimpleQueue

from cases import Outcome

SECONDS = 20.0  # in which a case must have an outcome
_START = 60.0  # in which a process must have started
_PROGRAM = (sys.executable, str(Path(__file__).with_name("child.py")))


class _Child:
    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None

    def outcome(self, kind: str, seed: int, number: int) -> Outcome:
        """Return what became of a case."""
        fresh = self._process is None
        if self._process is None:
            self._process = subprocess.Popen(_PROGRAM, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin
        assert stdout
        stdin.write(f"{kind}\t{seed}\t{number}\n")
        stdin.flush()
        if not select.select([stdout], [], [], SECONDS + (_START if fresh else 0.0))[0]:
            self.close()
            return Outcome("", (), "hang", f"nothing within {SECONDS:g} s")
        if line := stdout.readline():
            return Outcome(**json.loads(line))
        code = self._process.wait()
        self._process = None
        return Outcome("", (), "crash", signal.Signals(-code).name if code < 0 else f"exit status {code}")

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None


def outcomes(kind: str, seed: int, numbers: Sequence[int], processes: int = 2) -> dict[int, Outcome]:
    """Return what became of cases, by their numbers."""
    waiting: SimpleQueue[int] = SimpleQueue()
    for number in numbers:
        waiting.put(number)

    def worked(_: int) -> Iterator[tuple[int, Outcome]]:
        with closing(_Child()) as child:
            while True:
                try:
                    number = waiting.get_nowait()
                except Empty:
                    return
                yield number, child.outcome(kind, seed, number)

    with ThreadPoolExecutor(processes) as threads:
        return dict(each for found in threads.map(lambda i: list(worked(i)), range(processes)) for each in found)
