"""A worker that is kept from run to run: a server with a renderer, at a socket, and the executor that uses it.

A run speaks to it as to a worker of its own, through `lookdev.rendering.executors.relay`. The first line of a
connection states who asks. A run that ends in the middle of a frame leaves a renderer in an unknown state: it is
replaced.
"""

from __future__ import annotations

import json
import os
import selectors
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from lookdev.cache import package_digest
from lookdev.errors import LookdevError, WorkerError
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.executors.local import LocalExecutor
from lookdev.rendering.executors.protocol import Place
from lookdev.rendering.task import SceneTask

IDLE = 900
"""Seconds without a run after which a kept worker ends."""

_LOOK = 2.0  # seconds between looks at whether the socket's file is there
_STARTS = 30.0  # seconds until the server answers
_LONGEST = 100  # bytes of a path that a socket may have (sockaddr_un)


class WarmExecutor(LocalExecutor):
    """The worker that is kept at a socket."""

    def __init__(self, place: Place, at: Path) -> None:
        _ask(at, {"ping": True})
        super().__init__(replace(place, command=relay_command(at, place.command)))

    def prepare(self, scene: SceneTask) -> None:
        """Do nothing: what it has compiled serves, and another scene would replace it."""


def relay_command(at: Path, command: tuple[str, ...]) -> tuple[str, ...]:
    """Return the command that speaks to the worker at a socket, which `command` would start."""
    return (sys.executable, "-m", "lookdev.rendering.executors.relay", str(at), json.dumps(command))


def start(at: Path, backend: str, idle: int = IDLE) -> None:
    """Start a server at a socket, and its renderer, and return when it answers.

    Raises LookdevError where there is one already or the path does not serve, WorkerError where it does not start.
    """
    if backend not in BACKENDS:
        raise LookdevError(f"unknown backend '{backend}'; known: {', '.join(BACKENDS)}")
    if len(os.fsencode(at.absolute())) > _LONGEST:
        raise LookdevError(f"{at}: a socket's path has at most {_LONGEST} bytes: choose a shorter one")
    with suppress(WorkerError):
        _ask(at, {"ping": True})
        raise LookdevError(f"{at}: a worker is kept there already; 'lookdev warm stop {at}' ends it")
    log = at.with_name(at.name + ".log")
    try:
        at.parent.mkdir(parents=True, exist_ok=True)
        at.unlink(missing_ok=True)  # of one that was killed
        with log.open("ab") as stream, Path(os.devnull).open("rb") as nothing:
            # Not by Popen, whose object minds that the process outlives it.
            arguments = ["-m", "lookdev.rendering.executors.warm", str(at.absolute()), backend, str(idle)]
            server = os.posix_spawn(
                sys.executable,
                [sys.executable, *arguments],
                os.environ,
                file_actions=[
                    (os.POSIX_SPAWN_DUP2, each.fileno(), number)
                    for number, each in enumerate((nothing, stream, stream))
                ],
                setsid=True,
            )
    except OSError as error:
        raise WorkerError(f"{error.filename or at}: a worker cannot be kept there: {error.strerror}") from error
    until = time.monotonic() + _STARTS
    while os.waitpid(server, os.WNOHANG) == (0, 0) and time.monotonic() < until:
        with suppress(WorkerError):
            _ask(at, {"ping": True})
            return
        time.sleep(0.05)
    raise WorkerError(f"{at}: the worker does not start (log: {log})")


def stop(at: Path) -> bool:
    """End the server at a socket; return whether there was one."""
    try:
        _ask(at, {"stop": True})
    except WorkerError:
        return False
    until = time.monotonic() + _STARTS
    while at.exists() and time.monotonic() < until:
        time.sleep(0.02)
    return True


def _ask(at: Path, question: dict[str, Any]) -> None:
    try:
        with socket.socket(socket.AF_UNIX) as connection:
            connection.settimeout(_STARTS)
            connection.connect(str(at))
            connection.sendall(json.dumps(question).encode() + b"\n")
            connection.recv(1)
    except OSError as error:
        raise WorkerError(
            f"no worker is kept at {at}: {error.strerror or error}; start one: lookdev warm start {at}"
        ) from error


class Server:
    """A renderer and the socket at which runs reach it, one after the other."""

    def __init__(self, at: Path, command: tuple[str, ...], idle: float, scratch: Path) -> None:
        self._at, self._command, self._idle = at, command, idle
        self._environment = os.environ | {"TMPDIR": str(scratch)}
        self._environment.pop("OCIO", None)  # as `Worker` does
        self._process: subprocess.Popen[bytes] | None = None
        self._ready = b""  # the first line of the process

    def serve(self) -> None:
        """Serve runs until one asks for the end, none came for long, or the socket's file is gone."""
        with socket.socket(socket.AF_UNIX) as listening, _private():
            listening.bind(str(self._at))
            listening.listen()
            listening.settimeout(_LOOK)
            last = time.monotonic()
            try:
                self._start()
                while self._at.exists() and time.monotonic() < last + self._idle:
                    with suppress(TimeoutError):
                        connection, _ = listening.accept()
                        with connection:
                            connection.setblocking(True)
                            if not self._meet(connection):
                                return
                        last = time.monotonic()
            finally:
                self._end()
                self._at.unlink(missing_ok=True)

    def _meet(self, connection: socket.socket) -> bool:
        """Serve a connection; return whether to go on."""
        with suppress(OSError, ValueError):  # of one that has gone, or speaks something else
            match json.loads(_first_line(connection)):
                case {"stop": True}:
                    return False
                case {"ping": True}:
                    connection.sendall(b"\n")
                case {"command": command, "code": code}:
                    if problem := self._problem(command, code):
                        connection.sendall(json.dumps({"refused": problem}).encode() + b"\n")
                    else:
                        self._lend(connection)
        return True

    def _problem(self, command: list[str], code: str) -> str:
        """Return why a run cannot have the renderer, or ""."""
        again = f"'lookdev warm stop {self._at}', and start it again"
        if tuple(command) != self._command:
            return f"the worker kept at {self._at} is of another backend, or another installation: {again}"
        return "" if code == package_digest() else f"the worker kept at {self._at} is of another version: {again}"

    def _lend(self, connection: socket.socket) -> None:
        """Pass lines between a run and the renderer until one of them ends; replace one that owes an answer."""
        process = self._start()
        assert process.stdin is not None
        assert process.stdout is not None
        owes, tails = False, {connection.fileno(): b"", process.stdout.fileno(): b""}
        try:
            connection.sendall(self._ready)
            with selectors.DefaultSelector() as selector:
                for descriptor in tails:
                    selector.register(descriptor, selectors.EVENT_READ)
                while True:
                    for key, _ in selector.select():
                        if not (data := os.read(key.fd, 1 << 16)):
                            return
                        *lines, tails[key.fd] = (tails[key.fd] + data).split(b"\n")
                        asked = key.fd == connection.fileno()
                        for message in map(json.loads, lines):
                            if asked:
                                owes = owes or "files" in message
                            else:
                                owes = owes and message["type"] not in ("done", "failed")
                        if asked:
                            process.stdin.write(data)
                        else:
                            connection.sendall(data)
        finally:
            if owes:
                self._end()
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)  # the run need not wait for the next renderer
            self._start()

    def _start(self) -> subprocess.Popen[bytes]:
        """Return the renderer when it is ready, started if there is none."""
        if self._process is None or self._process.poll() is not None:
            self._end()
            self._process = subprocess.Popen(
                self._command, bufsize=0, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=self._environment
            )
            assert self._process.stdout is not None
            self._ready = self._process.stdout.readline()
        return self._process

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    pipe.close()


def _first_line(connection: socket.socket) -> bytes:
    """Return the first line of a connection; what follows is left in it."""
    line = b""
    while not line.endswith(b"\n") and len(line) < 1 << 16 and (byte := connection.recv(1)):
        line += byte
    return line


@contextmanager
def _private() -> Iterator[None]:
    """Let files that are made belong to this user alone."""
    before = os.umask(0o077)
    try:
        yield
    finally:
        os.umask(before)


def main() -> None:
    """Serve at a socket: arguments are its path, a backend, and the seconds without a run until the end."""
    at, backend, idle = sys.argv[1:]
    with tempfile.TemporaryDirectory(prefix="lookdev-warm-") as scratch:
        Server(Path(at), BACKENDS[backend].command, float(idle), Path(scratch)).serve()


if __name__ == "__main__":
    main()
