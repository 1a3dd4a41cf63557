"""A process that evaluates points inside Cycles for a whole run: starting Blender takes longer than most evaluations.

The fixture `warm_points` lets `lookdev.checks.evaluate` and what is built on it use that process in place of one for each
stack. As a program it reads paths of requests, a line each, and answers each with a line.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

_ANSWER = "points: "


class PointsProcess:
    """The process, started when first needed."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None

    def run(self, command: list[str], **options: Any) -> subprocess.CompletedProcess[str]:
        """Do what `subprocess.run` does with a command of `lookdev.checks.evaluate.evaluate_cycles`."""
        if self._process is None:
            program, pipe = [sys.executable, __file__], subprocess.PIPE
            self._process = subprocess.Popen(program, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True)
        assert self._process.stdin
        assert self._process.stdout
        print(command[-1], file=self._process.stdin, flush=True)
        answer = next((line for line in self._process.stdout if line.startswith(_ANSWER)), f"{_ANSWER}it ended")
        failure = answer.removeprefix(_ANSWER).strip()
        return subprocess.CompletedProcess(command, 1 if failure else 0, "", failure)

    def close(self) -> None:
        if self._process is not None:
            self._process.communicate()
            self._process = None


@pytest.fixture(scope="session")
def points_process() -> Iterator[PointsProcess]:
    process = PointsProcess()
    yield process
    process.close()


@pytest.fixture
def warm_points(points_process: PointsProcess, monkeypatch: pytest.MonkeyPatch) -> None:
    run_in_it = SimpleNamespace(run=points_process.run)
    monkeypatch.setattr("lookdev.checks.evaluate.subprocess", run_in_it)


def main() -> None:
    from lookdev.cycles.points import evaluate_file

    for line in sys.stdin:
        failure = ""
        try:
            evaluate_file(Path(line.strip()))
        except Exception as error:  # noqa: BLE001  (whatever it is, the test that asked is to see it)
            failure = f"{type(error).__name__}: {error}".replace("\n", " ")
        print(_ANSWER + failure, flush=True)


if __name__ == "__main__":
    import bpy  # noqa: F401  (brings the modules of Cycles)

    from lookdev.lifetime import end_with_parent, leaving

    end_with_parent()
    with leaving():
        main()
