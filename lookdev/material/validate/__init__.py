"""Validation of looks: a file is examined in a process of its own, with bounds on memory and time.

USD's readers trust their input: a damaged or hostile file can crash the process, or make it wait or allocate without
end. That is a finding too.
"""

from __future__ import annotations

import json
import resource
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from lookdev.material.validate.report import Finding, Report

SECONDS = 60.0
"""The time limit of a file."""

_MEMORY = 8 << 30  # bytes of address space of the process, beside twice the size of the file
_PROGRAM = (sys.executable, "-m", "lookdev.material.validate")


def validate(
    file: Path, prim: str | None = None, variants: Mapping[str, str] | None = None, *, seconds: float = SECONDS
) -> Report:
    """Find all faults of the looks of a file, whatever it is, as `examine` does, within a time limit in seconds."""
    request = json.dumps({"file": str(file), "prim": prim, "variants": dict(variants or {})})
    try:
        done = subprocess.run(
            _PROGRAM, input=request, capture_output=True, text=True, errors="replace", timeout=seconds, check=False
        )
    except subprocess.TimeoutExpired:
        return _unreadable(file, f"USD has not read it within {seconds:g} s", "a look is read in an instant")
    answer = done.stdout.rpartition("\n")[2]
    if done.returncode == 0:
        return Report.from_data(json.loads(answer))
    if done.returncode < 0:
        how = signal.Signals(-done.returncode).name
        return _unreadable(file, f"USD crashed reading it ({how})", "the file is damaged; write it anew")
    return _unreadable(file, f"reading it failed: {done.stderr.strip().rpartition(chr(10))[2]}", "please report it")


def _unreadable(file: Path, what: str, hint: str) -> Report:
    return Report(str(file), (Finding("error", "", "", what, hint),))


def bound_process(file: Path) -> None:
    """Bound the memory of this process, which reads `file`."""
    size = file.stat().st_size if file.is_file() else 0
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY + 2 * size, resource.getrlimit(resource.RLIMIT_AS)[1]))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
