"""Runs cases in a few processes; one that crashes or stalls costs only its case."""

import json
import os
import select
import signal
import subprocess
import sys
from collections import ChainMap
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

from cases import Outcome

SECONDS = 120.0  # in which a case must have an outcome, and a process have started, on a machine that does more
_PROGRAM = (sys.executable, str(Path(__file__).with_name("child.py")))


class Child:
    """A process that reads cases, started when first needed and again after it ended; `folder` has its files."""

    def __init__(self, folder: Path) -> None:
        self._environment = os.environ | {"TMPDIR": str(folder)}
        self._process: subprocess.Popen[str] | None = None

    def outcome(self, kind: str, seed: int, number: int) -> Outcome:
        """Return what became of a case."""
        if self._process is None:
            self._process = subprocess.Popen(
                _PROGRAM, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=self._environment
            )
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin
        assert stdout
        stdin.write(f"{kind}\t{seed}\t{number}\n")
        stdin.flush()
        if not select.select([stdout], [], [], SECONDS)[0]:
            self.close()
            return Outcome("", (), "hang", f"nothing within {SECONDS:g} s")
        if line := stdout.readline():
            return Outcome(**json.loads(line))
        code = self._process.wait()
        self.close()
        return Outcome("", (), "crash", signal.Signals(-code).name if code < 0 else f"exit status {code}")

    def outcomes(self, kind: str, seed: int, numbers: Sequence[int]) -> dict[int, Outcome]:
        """Return what became of cases, by their numbers."""
        return {number: self.outcome(kind, seed, number) for number in numbers}

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None


def outcomes(kind: str, seed: int, numbers: Sequence[int], folder: Path, processes: int = 2) -> dict[int, Outcome]:
    """Return what became of cases, by their numbers, in a few processes."""

    def read_part(first: int) -> dict[int, Outcome]:
        with closing(Child(folder)) as child:
            return child.outcomes(kind, seed, numbers[first::processes])

    with ThreadPoolExecutor(processes) as threads:
        return dict(ChainMap(*threads.map(read_part, range(processes))))
