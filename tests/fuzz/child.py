"""Reads cases in a process of its own: lines of "kind<TAB>seed<TAB>number" in, an outcome as a line of JSON out.

What the USD library writes to stderr is an outcome; memory is bounded.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import tempfile
import warnings
from dataclasses import asdict, replace
from pathlib import Path

from cases import judged, made
from kinds import KINDS

MEMORY = 2 << 30  # bytes beyond those of the imports


def main() -> None:
    """Answer each line of stdin."""
    warnings.simplefilter("error")
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    with tempfile.TemporaryFile() as written:
        os.dup2(written.fileno(), 1)
        os.dup2(written.fileno(), 2)
        for line in sys.stdin:
            kind, seed, number = line.rstrip("\n").split("\t")
            with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as cache:
                os.environ["LOOKDEV_CACHE"] = cache
                written.seek(0)
                written.truncate()
                outcome = judged(made(KINDS[kind], int(seed), int(number), Path(folder)))
                sys.stderr.flush()
                written.seek(0)
                if text := written.read().decode(errors="replace"):
                    outcome = replace(outcome, outcome="stderr", text=f"{outcome.outcome}: {text}")
            answers.write(json.dumps(asdict(outcome)) + "\n")


if __name__ == "__main__":
    main()
