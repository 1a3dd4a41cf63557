"""Run a program for as long as standard input is open: ``python lifeline.py PROGRAM ARGUMENTS``.

A test process that is killed ends nothing that it started. Its end closes this process's standard input, and this
process then kills the program with all of its descendants, and removes their temporary files. Descendants whose own
parent has ended are children of this process (Linux's "subreaper"), so none is missed.
"""

import contextlib
import ctypes
import os
import select
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

_PR_SET_CHILD_SUBREAPER = 36  # <linux/prctl.h>


def kill_descendants() -> None:
    """Kill all children of this process; the children of each become its own, and are killed next."""
    with contextlib.suppress(ChildProcessError):
        while True:
            for child in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split():
                os.kill(int(child), signal.SIGKILL)
            os.waitpid(-1, 0)


def main() -> None:
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1)
    ended, wakeup = os.pipe()
    os.set_blocking(wakeup, False)
    signal.set_wakeup_fd(wakeup)
    signal.signal(signal.SIGTERM, lambda *_: None)  # it wakes `select`, and interrupts nothing of what follows
    # No prefix: Chromium's sockets lie 46 characters below it, and no socket's path has more than 107.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        try:
            program = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL, env=os.environ | {"TMPDIR": folder})
            select.select([sys.stdin, ended, os.pidfd_open(program.pid)], [], [])
        finally:
            kill_descendants()


if __name__ == "__main__":
    main()
