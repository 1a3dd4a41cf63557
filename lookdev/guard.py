"""The program in a child process: a file that crashes, stalls or swells what reads it ends the child with a message.

The libraries that read USD files and images trust their input: a damaged file can crash the process, and one of a few
bytes can compose to any number of prims. `run_supervised` runs a program in a child. Where the program reads files of
others, it says so by `reading`; its parent then knows the file to name, and bounds time and memory until it is read.
Outside of `run_supervised`, as in a program of a user's own, `reading` does nothing.
"""

from __future__ import annotations

import faulthandler
import json
import os
import re
import select
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from lookdev.errors import LookdevError, shorten
from lookdev.lifetime import end_with_parent

MEMORY_VARIABLE = "LOOKDEV_READ_MEMORY"
"""Environment variable: MiB of memory that reading a file may take, beside `_MEMORY_EACH` of its bytes."""

SECONDS_VARIABLE = "LOOKDEV_READ_SECONDS"
"""Environment variable: seconds that reading a file may take, beside `_SECONDS_EACH` for each of its MiB."""

DEFAULT_MEMORY = 1536
DEFAULT_SECONDS = 15

_MEMORY_EACH = 128  # MiB for each MiB of the files read so far
_SECONDS_EACH = 10
_MIB = 1 << 20
_PERIOD = 0.05  # seconds between looks at a child that reads
_TICKS = os.sysconf("SC_CLK_TCK")

_PASSED_ON = (signal.SIGINT, signal.SIGTERM)

_reports: int | None = None  # the pipe to the parent
_lock = threading.Lock()  # lines longer than PIPE_BUF could mix


class ReadingError(LookdevError):
    """A file crashed what read it, or takes more time or memory than it may."""


class KilledError(LookdevError):
    """The system killed the program."""


class NativeCrash(Exception):
    """A signal ended the program, and no file is to blame: a defect, which a report file describes."""


@contextmanager
def reading(file: Path) -> Iterator[None]:
    """Tell the parent, if there is one, that a file of any content is read in the block."""
    if _reports is None:
        yield
        return
    _report(reads=str(file))
    opened(file)
    try:
        yield
    finally:
        _report(read=str(file))


def opened(file: Path) -> None:
    """Tell the parent of a file that is read too, as a layer of another: its size allows more memory and time."""
    if _reports is not None and file.is_file():
        _report(opened=str(file), bytes=file.stat().st_size)


def _report(**message: object) -> None:
    assert _reports is not None
    with _lock:
        os.write(_reports, json.dumps(message).encode() + b"\n")


def run_supervised(program: Callable[[], None]) -> int:
    """Run a program in a child process, from a process without threads, and return its exit code.

    SIGTERM and SIGINT are passed on. The program returns, or leaves with SystemExit.

    Raises
    ------
    ReadingError
        The child ended while it read a file, or took more time or memory than a file may; the message names it.
    KilledError
        SIGKILL ended the child.
    NativeCrash
        Another signal ended the child, with the traceback of its Python code.
    LookdevError
        A limit in the environment is no number.
    """
    global _reports
    limits = _Limits(_given(MEMORY_VARIABLE, DEFAULT_MEMORY), _given(SECONDS_VARIABLE, DEFAULT_SECONDS))
    parent, trace = os.getpid(), os.memfd_create("traceback")
    reader, writer = os.pipe()
    signal.pthread_sigmask(signal.SIG_BLOCK, _PASSED_ON)  # until there is a child to pass them on to
    child = os.fork()
    if child == 0:
        os.close(reader)
        end_with_parent()
        if os.getppid() != parent:
            os._exit(128 + signal.SIGKILL)
        faulthandler.enable(trace)
        _reports = writer
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _PASSED_ON)
        _end_with(program)
    os.close(writer)
    kept = {number: signal.signal(number, lambda number, _: os.kill(child, number)) for number in _PASSED_ON}
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _PASSED_ON)
    state = _State(child, limits)
    try:
        reason = _watch(state, reader)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)
        os.close(reader)
    if reason:
        raise ReadingError(reason)
    if code >= 0 or -code in _PASSED_ON:
        return code if code >= 0 else 128 - code
    how, file = signal.Signals(-code).name, shorten(state.files[-1], 4096) if state.files else ""
    if code == -signal.SIGKILL:
        while_reading = f" while it read {file}" if file else ""
        raise KilledError(f"the system killed the program{while_reading} ({how}), as it does where memory is short")
    if file:
        raise ReadingError(f"{file}: reading it crashed ({how}); it is damaged: write it anew")
    os.lseek(trace, 0, os.SEEK_SET)
    raise NativeCrash(f"{how}\n{os.read(trace, _MIB).decode(errors='replace')}")


@dataclass(frozen=True)
class _Limits:
    memory: int  # MiB
    seconds: int

    def exceeded(self, start: _Use, now: _Use, size: float) -> str:
        """Return what a reader of files of `size` MiB has exceeded, as the end of a sentence, or ''."""
        memory, seconds = self.memory + _MEMORY_EACH * size, self.seconds + _SECONDS_EACH * size
        if now.memory - start.memory > memory:
            limit = f"{MEMORY_VARIABLE}, {self.memory} MiB beside {_MEMORY_EACH} times the size of its files"
            return f"more than {int(memory)} MiB of memory; if it is right, raise {limit}"
        # Of a stopped process, only the clock goes on; of many threads, their time exceeds it.
        if min(now.clock - start.clock, now.cpu - start.cpu) > seconds:
            limit = f"{SECONDS_VARIABLE}, {self.seconds} s beside {_SECONDS_EACH} s for each MiB of its files"
            return f"more than {int(seconds)} s; if it is right, raise {limit}"
        return ""


@dataclass(frozen=True)
class _Use:
    """What a process has used: MiB of memory of its own now, seconds of its threads, and those on the clock."""

    memory: float
    cpu: float
    clock: float

    @classmethod
    def of(cls, process: int) -> _Use:
        """Return the use of a running process, by proc(5)."""
        status = Path(f"/proc/{process}/status").read_text()
        own = re.search(r"^RssAnon:\s*(\d+) kB$", status, re.MULTILINE)
        times = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[11:13]
        return cls(int(own[1]) / 1024 if own else 0.0, sum(map(int, times)) / _TICKS, time.monotonic())


@dataclass
class _State:
    """What a child has said: the files that it reads, the innermost last, and the sizes of all so far, in bytes."""

    child: int
    limits: _Limits
    files: list[str] = field(default_factory=list)
    sizes: dict[str, int] = field(default_factory=dict)
    start: _Use | None = None

    def take(self, message: dict[str, Any]) -> None:
        match message:
            case {"reads": file}:
                self.files.append(file)
            case {"read": file}:
                del self.files[max(place for place, each in enumerate(self.files) if each == file)]
                self.start = self.start if self.files else None
            case {"opened": file, "bytes": size}:
                self.sizes[file] = size

    def look(self) -> str:
        """Look at the child while it reads; return what is wrong with the file, or ''."""
        now = _Use.of(self.child)
        self.start = self.start or now
        what = self.limits.exceeded(self.start, now, sum(self.sizes.values()) / _MIB)
        return what and f"{shorten(self.files[0], 4096)}: reading it takes {what}"


def _watch(state: _State, reader: int) -> str:
    """Follow a child until it ends; return why it was killed, or ''."""
    rest, looked = b"", 0.0
    while True:
        if select.select([reader], [], [], _PERIOD if state.files else None)[0]:
            data = os.read(reader, 1 << 16)
            if not data:
                return ""
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                state.take(json.loads(line))
        if not state.files or time.monotonic() < looked + _PERIOD:
            continue
        looked = time.monotonic()
        if reason := state.look():
            os.kill(state.child, signal.SIGKILL)
            return reason


def _end_with(program: Callable[[], None]) -> NoReturn:
    """Run a program, and end this process at once: a damaged file can crash USD as it is unloaded."""
    code = 128 + signal.SIGINT  # also where a second signal interrupts what follows the first
    try:
        program()
        code = 0
    except SystemExit as left:
        code = left.code if isinstance(left.code, int) else int(left.code is not None)
    except Exception:  # noqa: BLE001  as Python does it
        code = 1
        traceback.print_exc()
    finally:
        try:
            for stream in (sys.stdout, sys.stderr):
                with suppress(OSError, ValueError):
                    stream.flush()
        finally:
            os._exit(code)


def _given(variable: str, default: int) -> int:
    text = os.environ.get(variable, str(default))
    if not re.fullmatch(r"[1-9][0-9]{0,8}", text):
        raise LookdevError(f"{variable} is {text[:40]!a}; a whole number from 1 to 999999999 is needed")
    return int(text)
