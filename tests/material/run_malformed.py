"""Read every malformed look and report the outcome, one JSON line each.

``python tests/material/run_malformed.py FOLDER`` (a new one). A forked process of bounded memory reads one after
the other; when a file kills it, the next one continues after that file.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from malformed import malformed_looks
from malformed_files import Case

from lookdev.errors import LookError
from lookdev.material.usd import read_look
from lookdev.material.validate.examine import examine

SECONDS = 20
"""The time limit of a file."""

MEMORY = 8 << 30
"""Bytes of address space of the process."""


def outcome(case: Case) -> dict[str, object]:
    """Read and examine a look: `read` is what `read_look` raised."""
    start = time.monotonic()
    try:
        read_look(case.file)
        read = ""
    except LookError as error:
        read = str(error)
    middle = time.monotonic()
    report = examine(case.file)
    seconds = (middle - start, time.monotonic() - middle)
    return {"status": 0, "read": read, "errors": report.has_errors, "text": report.text(), "seconds": seconds}


def read_all(cases: Sequence[Case], writer: int, log: Path) -> None:
    """Write the outcome of each case, with its text on stderr."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.dup2(os.open(log, os.O_RDWR | os.O_CREAT | os.O_APPEND), 2)
    for case in cases:
        os.ftruncate(2, 0)
        signal.alarm(SECONDS)
        found = outcome(case) | {"stderr": log.read_text(errors="replace")}
        os.write(writer, (json.dumps(found) + "\n").encode())


def run(cases: Sequence[Case], log: Path) -> list[dict[str, object]]:
    """Return the outcome of cases up to one that killed its reader, and of that its exit status."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        read_all(cases, writer, log)
        sys.stderr.flush()
        os._exit(0)  # USD, damaged by the files, must not crash at exit
    os.close(writer)
    with os.fdopen(reader) as stream:
        found = [json.loads(line) for line in stream]
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if len(found) < len(cases):
        stderr = log.read_text(errors="replace")
        found.append({"status": status, "read": "", "errors": False, "text": "", "stderr": stderr})
    return found


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir()
    remaining = malformed_looks(folder)
    while remaining:
        ended = run(remaining, folder / "stderr.txt")
        for case, found in zip(remaining, ended, strict=False):
            known = {"name": case.name, "file": str(case.file), "expected": case.expected}
            sys.stdout.write(json.dumps(known | found) + "\n")
        remaining = remaining[len(ended) :]
