"""The sandbox: the program runs in a child process, so that a file that crashes its reader ends only the child.

The libraries that read USD files and images trust their input: a damaged file can crash the process, and a file of a
few bytes can compose to any number of prims. `run_supervised` runs the program in a child process. Before the child
reads a file that a user gives, it reports the file to its parent by `report_reading`. So the parent knows which file to
name in a message, and it ends the child if reading takes too much time or memory. Outside of `run_supervised`, as in a
user's Python program, `report_reading` does nothing.
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
from lookdev.processes import end_with_parent

MEMORY_VARIABLE = "LOOKDEV_READ_MEMORY"
"""Environment variable: MiB of memory for reading a file; `_MEMORY_PER_MIB` is added for each MiB of the file."""

SECONDS_VARIABLE = "LOOKDEV_READ_SECONDS"
"""Environment variable: seconds for reading a file; `_SECONDS_PER_MIB` is added for each MiB of the file."""

DEFAULT_MEMORY = 1536  # MiB
DEFAULT_SECONDS = 15

_MEMORY_PER_MIB = 128  # MiB of memory for each MiB of the files that were reported so far
_SECONDS_PER_MIB = 10  # seconds for each MiB of these files
_MIB = 1 << 20
_PERIOD = 0.05  # seconds between two measurements of a child that reads
_TICKS = os.sysconf("SC_CLK_TCK")  # units of CPU time in a second, in proc(5)

_FORWARDED_SIGNALS = (signal.SIGINT, signal.SIGTERM)

_pipe_to_parent: int | None = None  # in a child of `run_supervised`, the file descriptor of the pipe
_lock = threading.Lock()  # without it, reports of several threads that are longer than PIPE_BUF could mix


class ReadingError(LookdevError):
    """A file crashes its reader, or takes more time or memory than its limits allow."""


class KilledError(LookdevError):
    """The system killed the program."""


class NativeCrashError(Exception):
    """A signal ended the program while it did not read a file: a defect, for which a report file is written."""


@contextmanager
def report_reading(file: Path) -> Iterator[None]:
    """Report to the parent, if there is one, that the block reads a file whose content is not trusted."""
    if _pipe_to_parent is None:
        yield
        return
    _report(reads=str(file))
    report_opened(file)
    try:
        yield
    finally:
        _report(read=str(file))


def report_opened(file: Path) -> None:
    """Report a further file to the parent, such as a layer of a USD file; its size raises the limits."""
    if _pipe_to_parent is not None and file.is_file():
        _report(opened=str(file), bytes=file.stat().st_size)


def _report(**message: object) -> None:
    """Send a message to the parent, as a line of JSON (see `_ChildState.handle`)."""
    assert _pipe_to_parent is not None
    with _lock:
        os.write(_pipe_to_parent, json.dumps(message).encode() + b"\n")


def run_supervised(program: Callable[[], None]) -> int:
    """Run a program in a child process and return its exit code; the calling process must not have threads.

    The program returns, or raises SystemExit. SIGTERM and SIGINT are forwarded to the child.

    Raises
    ------
    ReadingError
        The child ended while it read a file, or exceeded its limits of time or memory. The message names the file.
    KilledError
        SIGKILL ended the child.
    NativeCrashError
        Another signal ended the child while it did not read a file. The message has the traceback of its Python code.
    LookdevError
        A limit in the environment is not a number.
    """
    global _pipe_to_parent
    memory, seconds = _read_limit(MEMORY_VARIABLE, DEFAULT_MEMORY), _read_limit(SECONDS_VARIABLE, DEFAULT_SECONDS)
    parent, trace = os.getpid(), os.memfd_create("traceback")
    reader, writer = os.pipe()
    signal.pthread_sigmask(signal.SIG_BLOCK, _FORWARDED_SIGNALS)  # until there is a child that can receive them
    child = os.fork()
    if child == 0:
        os.close(reader)
        end_with_parent()
        if os.getppid() != parent:  # the parent ended before `end_with_parent`
            os._exit(128 + signal.SIGKILL)
        faulthandler.enable(trace)
        _pipe_to_parent = writer
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _FORWARDED_SIGNALS)
        _run_and_exit(program)
    os.close(writer)
    handlers = {
        number: signal.signal(number, lambda number, _: os.kill(child, number)) for number in _FORWARDED_SIGNALS
    }
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _FORWARDED_SIGNALS)
    state = _ChildState(child, memory, seconds)
    try:
        reason = _watch(state, reader)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        os.close(reader)
    if reason:
        raise ReadingError(reason)
    if code >= 0 or -code in _FORWARDED_SIGNALS:
        return code if code >= 0 else 128 - code
    signal_name, file = signal.Signals(-code).name, shorten(state.files[-1], 4096) if state.files else ""
    if code == -signal.SIGKILL:
        at = f" while it read {file}" if file else ""
        raise KilledError(f"the system killed the program{at} ({signal_name}), as it does where memory is short")
    if file:
        raise ReadingError(f"{file}: reading it crashed ({signal_name}); it is damaged: write it anew")
    os.lseek(trace, 0, os.SEEK_SET)
    raise NativeCrashError(f"{signal_name}\n{os.read(trace, _MIB).decode(errors='replace')}")


@dataclass(frozen=True)
class _ResourceUse:
    """The resources that a process uses, at a time.

    `memory` is its private memory in MiB, `cpu` the CPU seconds of all its threads so far, and `clock` the time in
    seconds.
    """

    memory: float
    cpu: float
    clock: float

    @classmethod
    def of_process(cls, process: int) -> _ResourceUse:
        """Return the use of a running process, by proc(5)."""
        status = Path(f"/proc/{process}/status").read_text()
        private = re.search(r"^RssAnon:\s*(\d+) kB$", status, re.MULTILINE)
        # The fields utime and stime; the name of the program, in parentheses, may contain spaces.
        times = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[11:13]
        return cls(int(private[1]) / 1024 if private else 0.0, sum(map(int, times)) / _TICKS, time.monotonic())


@dataclass
class _ChildState:
    """The process id of a child (`child`), its limits `memory` in MiB and `seconds`, and the files that it reads.

    `files` are the files that are being read, which are nested: each is read during the reading of the file before it.
    `sizes` has the bytes of all files that were reported. `start` is the use of resources when reading the first of
    `files` began.
    """

    child: int
    memory: int
    seconds: int
    files: list[str] = field(default_factory=list)
    sizes: dict[str, int] = field(default_factory=dict)
    start: _ResourceUse | None = None

    def handle(self, message: dict[str, Any]) -> None:
        """Update the state by a report: the child reads a file, has read a file, or has opened a further file."""
        match message:
            case {"reads": file}:
                self.files.append(file)
            case {"read": file}:
                del self.files[max(index for index, name in enumerate(self.files) if name == file)]
                self.start = self.start if self.files else None
            case {"opened": file, "bytes": size}:
                self.sizes[file] = size

    def check(self) -> str:
        """Measure the child while it reads; return the fault of the first of `files`, or '' within the limits."""
        now = _ResourceUse.of_process(self.child)
        self.start = self.start or now
        size = sum(self.sizes.values()) / _MIB
        memory, seconds = self.memory + _MEMORY_PER_MIB * size, self.seconds + _SECONDS_PER_MIB * size
        if now.memory - self.start.memory > memory:
            limit = f"{MEMORY_VARIABLE}, {self.memory} MiB beside {_MEMORY_PER_MIB} times the size of its files"
            excess = f"{int(memory)} MiB of memory"
        # The clock goes on while a process is stopped; the CPU time of many threads exceeds the clock.
        elif min(now.clock - self.start.clock, now.cpu - self.start.cpu) > seconds:
            limit = f"{SECONDS_VARIABLE}, {self.seconds} s beside {_SECONDS_PER_MIB} s for each MiB of its files"
            excess = f"{int(seconds)} s"
        else:
            return ""
        return f"{shorten(self.files[0], 4096)}: reading it takes more than {excess}; if it is right, raise {limit}"


def _watch(state: _ChildState, reader: int) -> str:
    """Watch a child until it ends; return the reason for which it was killed, or ''.

    `reader` is the pipe of its reports.
    """
    rest, checked = b"", 0.0  # the beginning of an unfinished line, and the time of the last check
    while True:
        if select.select([reader], [], [], _PERIOD if state.files else None)[0]:
            data = os.read(reader, 1 << 16)
            if not data:
                return ""
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                state.handle(json.loads(line))
        if not state.files or time.monotonic() < checked + _PERIOD:
            continue
        checked = time.monotonic()
        if reason := state.check():
            os.kill(state.child, signal.SIGKILL)
            return reason


def _run_and_exit(program: Callable[[], None]) -> NoReturn:
    """Run a program and end this process at once, without unloading: a damaged file can crash USD as it unloads."""
    code = 128 + signal.SIGINT  # stays if a signal interrupts the program, or the handling of an earlier signal
    try:
        program()
        code = 0
    except SystemExit as leave:
        code = leave.code if isinstance(leave.code, int) else int(leave.code is not None)
    except Exception:  # noqa: BLE001  as the interpreter does
        code = 1
        traceback.print_exc()
    finally:
        try:
            for stream in (sys.stdout, sys.stderr):
                with suppress(OSError, ValueError):
                    stream.flush()
        finally:
            os._exit(code)


def _read_limit(variable: str, default: int) -> int:
    """Return the limit in an environment variable, or `default` if it is not set."""
    text = os.environ.get(variable, str(default))
    if not re.fullmatch(r"[1-9][0-9]{0,8}", text):
        raise LookdevError(f"{variable} is {text[:40]!a}; a whole number from 1 to 999999999 is needed")
    return int(text)
