"""A process with Blender for a whole test run, because starting one takes longer than most tests.

``blender.call("module.function", *arguments)`` runs a function in the process, where it may import bpy, and returns its
result. With the fixture `warm_points`, `lookdev.checks.evaluate` uses this process in place of a new one for each stack
of layers.
"""

import importlib
import os
import pickle
import subprocess
import sys
import threading
import traceback
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

_PATIENCE = 300.0  # seconds without an answer after which the process is killed


class BlenderCallError(Exception):
    """A function has raised an error in the other process. The traceback from there is a note of this error."""


class BlenderProcess:
    """The process with Blender. It is started by the first call, and again if it has ended."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def call(self, function: str, *arguments: Any) -> Any:
        """Run a function in the process with Blender, and return its result.

        `function` is like "module.function"; modules are found with the `sys.path` of this process. Raises
        BlenderCallError if the function raises, or if the process ends.
        """
        if self._process is None:
            program, pipe = [sys.executable, __file__], subprocess.PIPE
            self._process = subprocess.Popen(program, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL)
        process = self._process
        assert process.stdin
        assert process.stdout
        watchdog = threading.Timer(_PATIENCE, process.kill)
        watchdog.start()
        try:
            pickle.dump((sys.path, os.environ["LOOKDEV_CACHE"], function, arguments), process.stdin)
            process.stdin.flush()
            result, message, details = pickle.load(process.stdout)
        except (EOFError, BrokenPipeError) as error:
            self.close()
            raise BlenderCallError(f"{function}: the process ended") from error
        finally:
            watchdog.cancel()
        if message:
            error = BlenderCallError(message)
            error.add_note(details)
            raise error
        return result

    def close(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None


@pytest.fixture(scope="session")
def blender() -> Iterator[BlenderProcess]:
    """The process with Blender for the whole run."""
    process = BlenderProcess()
    yield process
    process.close()


@pytest.fixture
def warm_points(blender: BlenderProcess, monkeypatch: pytest.MonkeyPatch) -> None:
    """Evaluate points in the warm process: `lookdev.checks.evaluate` gets a `subprocess.run` that calls it."""

    def run(command: list[str], **options: Any) -> subprocess.CompletedProcess[str]:
        try:
            blender.call("lookdev.cycles.points.evaluate_file", Path(command[-1]))
        except BlenderCallError as error:
            return subprocess.CompletedProcess(command, 1, "", str(error))
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr("lookdev.checks.evaluate.subprocess", SimpleNamespace(run=run))


def main() -> None:
    """Answer requests from standard input, in the process with Blender, whose output goes to standard error."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    while True:
        try:
            sys.path[:], os.environ["LOOKDEV_CACHE"], function, arguments = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        module, _, name = function.rpartition(".")
        try:
            answer = getattr(importlib.import_module(module), name)(*arguments), "", ""
        except Exception as error:  # noqa: BLE001  (the test that has asked shall see any error)
            answer = None, f"{type(error).__name__}: {error}", traceback.format_exc()
        answers.write(pickle.dumps(answer))
        answers.flush()


if __name__ == "__main__":
    import bpy  # noqa: F401  (brings the modules of Cycles)

    from lookdev.processes import end_with_parent, exit_after_block

    end_with_parent()
    with exit_after_block():
        main()
