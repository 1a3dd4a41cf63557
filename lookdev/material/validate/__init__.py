"""Validation of looks, safe from the file: it is examined in a process of its own, with bounds on memory and time.

USD's readers trust their input: a damaged or hostile file can crash the process, or make it wait or allocate without
end. That too ends in a finding.
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
"""How long a file may take."""

MEMORY = 8 << 30
"""Bytes of address space that the process may have, beside twice what the file has."""

_PROGRAM = (sys.executable, "-m", "lookdev.material.validate")


def validate(
    file: Path, prim: str | None = None, variants: Mapping[str, str] | None = None, *, seconds: float = SECONDS
) -> Report:
    """Find everything wrong with the looks of a file.

    Parameters
    ----------
    file
        Any file USD opens.
    prim
        Path of the only material to examine; all of the file by default.
    variants
        Variant sets and the one variant to try of each; all variants of the others are tried.
    seconds
        How long the file may take.

    Returns
    -------
    Report
        Whatever the file is: that it cannot be read is a finding.
    """
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
    """Bound what this process may take, for the sake of `file`."""
    size = file.stat().st_size if file.is_file() else 0
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY + 2 * size, resource.getrlimit(resource.RLIMIT_AS)[1]))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
