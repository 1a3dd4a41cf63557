"""Read every malformed look and tell how it ended, one JSON line each.

``python tests/material/run_malformed.py FOLDER`` (a new one). A forked process reads one after the other, bounded as
`lookdev.material.validate` bounds its own; when a file kills it, the next one goes on behind that file.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from malformed import malformed_looks
from malformed_files import Case

from lookdev.errors import LookError
from lookdev.material.usd import read_look
from lookdev.material.validate import bound_process
from lookdev.material.validate.examine import examine

SECONDS = 20
"""After which a file has hung its reader."""


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
    """Write the outcome of one case after the other, with what it said on stderr."""
    os.dup2(os.open(log, os.O_RDWR | os.O_CREAT | os.O_APPEND), 2)
    for case in cases:
        os.ftruncate(2, 0)
        bound_process(case.file)
        signal.alarm(SECONDS)
        told = outcome(case)
        os.write(writer, (json.dumps(told | {"said": log.read_text(errors="replace")}) + "\n").encode())


def run(cases: Sequence[Case], log: Path) -> list[dict[str, object]]:
    """Return the outcome of cases up to one that killed its reader, and of that its exit status."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        read_all(cases, writer, log)
        sys.stderr.flush()
        os._exit(0)  # what the files have done to USD must not crash the way out
    os.close(writer)
    with os.fdopen(reader) as stream:
        told = [json.loads(line) for line in stream]
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if len(told) < len(cases):
        told.append(
            {"status": status, "read": "", "errors": False, "text": "", "said": log.read_text(errors="replace")}
        )
    return told


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir()
    remaining = malformed_looks(folder)
    while remaining:
        ended = run(remaining, folder / "stderr.txt")
        for case, told in zip(remaining, ended, strict=False):
            known = {"name": case.name, "file": str(case.file), "expected": case.expected}
            sys.stdout.write(json.dumps(known | told) + "\n")
        remaining = remaining[len(ended) :]
