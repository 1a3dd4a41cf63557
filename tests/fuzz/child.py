"""Reads cases in a process of its own: lines of "kind<TAB>seed<TAB>number" in, an outcome as a line of JSON out.

What the USD library writes to stderr is an outcome, and so is memory: the peak of what the process, and any process
that it started, had resident.
"""

import json
import os
import resource
import sys
import tempfile
import time
import warnings
from dataclasses import asdict, replace
from pathlib import Path

from cases import judge, make_case
from kinds import KINDS

from lookdev.processes import end_with_parent

MEMORY = 2 << 30  # bytes
SECONDS = 10.0  # of processor time
_MOST = 3 * MEMORY  # of addresses: the machine is safe, and no library meets the limit where it would tell of one


def main() -> None:
    """Answer each line of stdin."""
    end_with_parent()
    warnings.simplefilter("error")
    resource.setrlimit(resource.RLIMIT_AS, (_MOST, _MOST))
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
                case = make_case(KINDS[kind], int(seed), int(number), Path(folder))
                started = time.process_time()
                Path("/proc/self/clear_refs").write_text("5")  # the peak from here on
                outcome = judge(case)
                outcome = replace(outcome, seconds=time.process_time() - started, peak=_peak())
                if outcome.seconds > SECONDS:
                    outcome = replace(outcome, outcome="hang", text=f"{outcome.seconds:.0f} s; {outcome.outcome}")
                if outcome.peak > MEMORY:
                    outcome = replace(outcome, outcome="memory", text=f"{outcome.peak >> 20} MiB; {outcome.outcome}")
                sys.stderr.flush()
                written.seek(0)
                if text := written.read().decode(errors="replace"):
                    outcome = replace(outcome, outcome="stderr", text=f"{outcome.outcome}: {text}")
            answers.write(json.dumps(asdict(outcome)) + "\n")


def _peak() -> int:
    """Return the most that this process, or one that it waited for, had resident, in bytes."""
    status = Path("/proc/self/status").read_text()
    own = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM"))
    return max(own, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss) * 1024


if __name__ == "__main__":
    main()
