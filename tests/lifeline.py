"""Run a program for as long as standard input is open: ``python lifeline.py PROGRAM ARGUMENTS``.

`chromium.py` starts the browser with it. A test process that is killed cannot end the programs that it has started. But
its end closes the standard input of this process, which then kills the program with all of its descendants, and removes
their temporary files. A descendant whose own parent has ended becomes a child of this process (Linux calls this process
a "subreaper"), so none is missed.
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
    """Kill all descendants of this process: the children of a killed child become its children, and are killed next."""
    with contextlib.suppress(ChildProcessError):
        while True:
            for child in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split():
                os.kill(int(child), signal.SIGKILL)
            os.waitpid(-1, 0)


def main() -> None:
    """Run the program until it ends, standard input is closed, or SIGTERM arrives; then kill its descendants."""
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1)
    ended, wakeup = os.pipe()
    os.set_blocking(wakeup, False)
    signal.set_wakeup_fd(wakeup)
    signal.signal(signal.SIGTERM, lambda *_: None)  # SIGTERM wakes `select`, and does not interrupt the clean-up
    # The folder has no prefix, because its path must be short: Chromium's sockets add 46 characters, and the path of a
    # socket has at most 107.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        try:
            program = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL, env=os.environ | {"TMPDIR": folder})
            select.select([sys.stdin, ended, os.pidfd_open(program.pid)], [], [])
        finally:
            kill_descendants()


if __name__ == "__main__":
    main()
