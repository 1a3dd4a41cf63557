"""Functions that end processes: a child ends with its parent, and a program ends within two seconds after a signal."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

_GRACE = 1.5  # seconds in which a program may remove its files and end its children after a signal
_REPEAT_PERIOD = 0.02  # seconds until a signal is repeated
_PR_SET_PDEATHSIG = 1  # <linux/prctl.h>: the option that sets the signal at the parent's death


def end_with_parent() -> None:
    """Have the kernel kill this process when the thread that started it ends, however it ends."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


@contextmanager
def exit_after_block() -> Iterator[None]:
    """End the process after the block: with exit code 0, or with 1 and a traceback after an exception.

    The interpreter's own exit can hang where Blender is loaded, or where threads of Dr.Jit or a thread that reads
    remain. SIGINT raises KeyboardInterrupt in the block. It does so even where a shell started the parent in the
    background, and so made it and its children ignore SIGINT.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    except BaseException:  # noqa: BLE001
        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)
    sys.stdout.flush()
    os._exit(0)


def _is_importing(frame: FrameType | None) -> bool:
    """Return whether a module is being imported in a stack frame; C++ libraries would lose a KeyboardInterrupt then."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


@dataclass
class Interruption:
    """The state of an interruption: whether a signal came, and whether KeyboardInterrupt was raised for it.

    These are plain attributes, not a `threading.Event`, which has a lock. A handler that holds the lock can be
    interrupted by the handler of a second signal, which would wait for the lock without end.
    """

    came: bool = False
    raised: bool = False


@contextmanager
def end_at_signals() -> Iterator[Interruption]:
    """Raise KeyboardInterrupt at SIGTERM in the block, as at Ctrl-C.

    If the block goes on for `_GRACE` seconds nevertheless, the process is ended.

    Python runs the handlers of signals between its own instructions. So a library that computes for long would delay
    them, and a wait that begins just after the signal is not interrupted. A second thread reads the signal from a pipe
    at once, and repeats it until KeyboardInterrupt is raised. Only the first signal counts: Ctrl-C may arrive twice,
    from the terminal and from the parent.
    """
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    main = threading.get_ident()

    def watch() -> None:
        """Wait for the first signal, repeat it until it has an effect, and end the process if it goes on."""
        with os.fdopen(reader, "rb", buffering=0) as signals:
            number = signals.read(1)
            deadline = time.monotonic() + _GRACE
            while number and not done.wait(_REPEAT_PERIOD):
                with ending:
                    if not done.is_set() and not interruption.raised:
                        signal.pthread_kill(main, number[0])
                if time.monotonic() > deadline:
                    os._exit(128 + number[0])

    def interrupt(number: int, frame: FrameType | None) -> None:
        """Handle a signal in the main thread: raise KeyboardInterrupt once, but not while a module is imported."""
        interruption.came = True
        if not interruption.raised and not _is_importing(frame):
            interruption.raised = True
            raise KeyboardInterrupt

    done, ending, interruption = threading.Event(), threading.Lock(), Interruption()
    handlers = {number: signal.signal(number, interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
    wakeup_fd = signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    threading.Thread(target=watch, daemon=True).start()
    try:
        yield interruption
    finally:
        with ending:
            done.set()
        signal.set_wakeup_fd(wakeup_fd)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        os.close(writer)
