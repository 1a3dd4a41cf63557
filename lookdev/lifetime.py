"""How long processes live: no longer than the program that started them, and that two seconds after a signal."""

from __future__ import annotations

import ctypes
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_GRACE = 1.5  # seconds in which a program that is told to end may remove its files and end its children
_LATER = 0.02  # seconds until a signal is tried again
_PR_SET_PDEATHSIG = 1  # <linux/prctl.h>


def end_with_parent() -> None:
    """Have the kernel kill this process when the thread that started it ends, however it ends."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def _imports(frame: FrameType | None) -> bool:
    """Return whether a module is being imported: libraries in C++ lose a KeyboardInterrupt then."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


@contextmanager
def ending_at_signals() -> Iterator[threading.Event]:
    """Make SIGTERM a KeyboardInterrupt, as Ctrl-C is, in the block, and end the process if it goes on nevertheless.

    The event is set by a signal.

    Python runs handlers between its own instructions: a library that computes for long would hold them up. Another
    thread sees the signal at once. The first signal counts: Ctrl-C may arrive twice, from the terminal and from the
    parent.
    """
    reader, writer = os.pipe()
    os.set_blocking(writer, False)

    def watch() -> None:
        with os.fdopen(reader, "rb", buffering=0) as signals:
            if number := signals.read(1):
                time.sleep(_GRACE)
                if not done.is_set():
                    os._exit(128 + number[0])

    def interrupt(number: int, frame: FrameType | None) -> None:
        interrupted.set()
        if _imports(frame):
            threading.Timer(_LATER, signal.pthread_kill, (threading.main_thread().ident, number)).start()
            return
        for each in before:
            signal.signal(each, lambda *_: None)
        raise KeyboardInterrupt

    done, interrupted = threading.Event(), threading.Event()
    before = {number: signal.signal(number, interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
    waking = signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    threading.Thread(target=watch, daemon=True).start()
    try:
        yield interrupted
    finally:
        done.set()
        signal.set_wakeup_fd(waking)
        for number, handler in before.items():
            signal.signal(number, handler)
        os.close(writer)
