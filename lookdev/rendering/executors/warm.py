"""A renderer that stays alive between runs, so that a run need not start and compile one (`lookdev warm`).

A server process keeps the renderer, and listens at a socket. `WarmExecutor` uses the renderer like a worker of its own:
the worker's process is a relay (`lookdev.rendering.executors.relay`), which forwards all lines to the socket. The first
line of a connection is a request: the command and the code version of a run, a ping, or a request to stop. If a run
ends in the middle of a frame, the state of the renderer is unknown, and the server starts a new one.
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

from lookdev.cache import package_digest
from lookdev.errors import LookdevError, WorkerError
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.executors.local import LocalExecutor
from lookdev.rendering.executors.protocol import WorkerFiles
from lookdev.rendering.task import SceneTask

IDLE_SECONDS = 900
"""Seconds without a run after which the server ends."""

_POLL = 2.0  # seconds between checks whether the socket's file still exists
_START_TIMEOUT = 30.0  # seconds within which the server must answer
_MAX_PATH_BYTES = 100  # the most bytes of a socket's path; sockaddr_un limits it


class WarmExecutor(LocalExecutor):
    """Renders on the warm worker at a socket."""

    def __init__(self, files: WorkerFiles, path: Path) -> None:
        _send_request(path, {"ping": True})
        super().__init__(replace(files, command=relay_command(path, files.command)))

    def prepare(self, scene: SceneTask) -> None:
        """Do nothing: the renderer may have the compiled scene of an earlier run, which `scene` would replace."""


def relay_command(path: Path, command: tuple[str, ...]) -> tuple[str, ...]:
    """Return the command of a relay to the renderer at the socket `path`; `command` is the renderer's own command."""
    return (sys.executable, "-m", "lookdev.rendering.executors.relay", str(path), json.dumps(command))


def start(path: Path, backend: str, idle: int = IDLE_SECONDS) -> None:
    """Start a server with a renderer at a socket, and return when it answers.

    path : the path of the socket; idle : the seconds without a run after which the server ends. Raises LookdevError
    where a server is there already or the path is too long, and WorkerError where the server does not start.
    """
    if backend not in BACKENDS:
        raise LookdevError(f"unknown backend '{backend}'; known: {', '.join(BACKENDS)}")
    if len(os.fsencode(path.absolute())) > _MAX_PATH_BYTES:
        raise LookdevError(f"{path}: a socket's path has at most {_MAX_PATH_BYTES} bytes: choose a shorter one")
    with suppress(WorkerError):
        _send_request(path, {"ping": True})
        raise LookdevError(f"{path}: a worker is kept there already; 'lookdev warm stop {path}' ends it")
    log = path.with_name(path.name + ".log")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)  # the socket of a server that was killed
        with log.open("ab") as log_stream, Path(os.devnull).open("rb") as no_input:
            # Popen is not used here: it warns if its process still runs when the Popen object is deleted.
            arguments = ["-m", "lookdev.rendering.executors.warm", str(path.absolute()), backend, str(idle)]
            server = os.posix_spawn(
                sys.executable,
                [sys.executable, *arguments],
                os.environ,
                file_actions=[
                    (os.POSIX_SPAWN_DUP2, stream.fileno(), number)
                    for number, stream in enumerate((no_input, log_stream, log_stream))
                ],
                setsid=True,
            )
    except OSError as error:
        raise WorkerError(f"{error.filename or path}: a worker cannot be kept there: {error.strerror}") from error
    deadline = time.monotonic() + _START_TIMEOUT
    while os.waitpid(server, os.WNOHANG) == (0, 0) and time.monotonic() < deadline:
        with suppress(WorkerError):
            _send_request(path, {"ping": True})
            return
        time.sleep(0.05)
    raise WorkerError(f"{path}: the worker does not start (log: {log})")


def stop(path: Path) -> bool:
    """End the server at a socket, and return whether there was one."""
    try:
        _send_request(path, {"stop": True})
    except WorkerError:
        return False
    deadline = time.monotonic() + _START_TIMEOUT
    while path.exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    return True


def _send_request(path: Path, request: dict[str, bool]) -> None:
    """Send a request to the server at a socket, and wait for its answer; raises WorkerError where no server answers."""
    try:
        with socket.socket(socket.AF_UNIX) as connection:
            connection.settimeout(_START_TIMEOUT)
            connection.connect(str(path))
            connection.sendall(json.dumps(request).encode() + b"\n")
            connection.recv(1)
    except OSError as error:
        raise WorkerError(
            f"no worker is kept at {path}: {error.strerror or error}; start one: lookdev warm start {path}"
        ) from error


class WarmServer:
    """A renderer, and the socket through which runs use it, one after the other.

    Parameters
    ----------
    path
        The path of the socket.
    command
        The command of the renderer.
    idle
        Seconds without a run after which `serve` returns.
    scratch
        The folder for temporary files of the renderer.
    """

    def __init__(self, path: Path, command: tuple[str, ...], idle: float, scratch: Path) -> None:
        self._path, self._command, self._idle = path, command, idle
        self._environment = os.environ | {"TMPDIR": str(scratch)}
        self._environment.pop("OCIO", None)  # for the same reason as in `Worker`
        self._process: subprocess.Popen[bytes] | None = None
        self._ready_line = b""  # the first line that the renderer writes

    def serve(self) -> None:
        """Serve runs until a request to stop, until the idle time is over, or until the socket's file is gone."""
        with socket.socket(socket.AF_UNIX) as listening, _private_files():
            listening.bind(str(self._path))
            listening.listen()
            listening.settimeout(_POLL)
            last = time.monotonic()
            try:
                self._start_renderer()
                while self._path.exists() and time.monotonic() < last + self._idle:
                    with suppress(TimeoutError):
                        connection, _ = listening.accept()
                        with connection:
                            connection.setblocking(True)
                            if not self._serve_connection(connection):
                                return
                        last = time.monotonic()
            finally:
                self._end_renderer()
                self._path.unlink(missing_ok=True)

    def _serve_connection(self, connection: socket.socket) -> bool:
        """Serve a connection until it ends; return whether the server continues."""
        with suppress(OSError, ValueError):  # the client has gone, or its line is not JSON
            match json.loads(_first_line(connection)):
                case {"stop": True}:
                    return False
                case {"ping": True}:
                    connection.sendall(b"\n")
                case {"command": command, "code": code}:
                    if problem := self._refusal(command, code):
                        connection.sendall(json.dumps({"refused": problem}).encode() + b"\n")
                    else:
                        self._relay(connection)
        return True

    def _refusal(self, command: list[str], code: str) -> str:
        """Return why a run cannot use the renderer, or "". `command` and `code` are from the request of the run.

        `code` is the digest of the package's code.
        """
        again = f"'lookdev warm stop {self._path}', and start it again"
        if tuple(command) != self._command:
            return f"the worker kept at {self._path} is of another backend, or another installation: {again}"
        return "" if code == package_digest() else f"the worker kept at {self._path} is of another version: {again}"

    def _relay(self, connection: socket.socket) -> None:
        """Copy lines between a run and the renderer until either ends; then replace the renderer if it is still busy.

        The renderer is busy from the moment it gets a task until its last answer for that task. `tails` has the
        incomplete last line of each side, by the file descriptor of the side.
        """
        process = self._start_renderer()
        assert process.stdin is not None
        assert process.stdout is not None
        answer_due, tails = False, {connection.fileno(): b"", process.stdout.fileno(): b""}
        try:
            connection.sendall(self._ready_line)
            with selectors.DefaultSelector() as selector:
                for descriptor in tails:
                    selector.register(descriptor, selectors.EVENT_READ)
                while True:
                    for key, _ in selector.select():
                        if not (data := os.read(key.fd, 1 << 16)):
                            return
                        *lines, tails[key.fd] = (tails[key.fd] + data).split(b"\n")
                        from_run = key.fd == connection.fileno()
                        for message in map(json.loads, lines):
                            # Only the task of a frame has the key "files".
                            if from_run:
                                answer_due = answer_due or "files" in message
                            else:
                                answer_due = answer_due and message["type"] not in ("done", "failed")
                        if from_run:
                            process.stdin.write(data)
                        else:
                            connection.sendall(data)
        finally:
            if answer_due:
                self._end_renderer()
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)  # so that the run does not wait while a new renderer starts
            self._start_renderer()

    def _start_renderer(self) -> subprocess.Popen[bytes]:
        """Return the running renderer; if none runs, start one and wait until it is ready."""
        if self._process is None or self._process.poll() is not None:
            self._end_renderer()
            self._process = subprocess.Popen(
                self._command, bufsize=0, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=self._environment
            )
            assert self._process.stdout is not None
            self._ready_line = self._process.stdout.readline()
        return self._process

    def _end_renderer(self) -> None:
        """Kill the renderer if there is one, and close its pipes."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    pipe.close()


def _first_line(connection: socket.socket) -> bytes:
    """Return the first line of a connection, and leave the bytes after it unread."""
    line = b""
    while not line.endswith(b"\n") and len(line) < 1 << 16 and (byte := connection.recv(1)):
        line += byte
    return line


@contextmanager
def _private_files() -> Iterator[None]:
    """In the block, create files that only this user can access."""
    before = os.umask(0o077)
    try:
        yield
    finally:
        os.umask(before)


def main() -> None:
    """Run a server; the arguments are the path of its socket, a backend, and the `idle` seconds of `WarmServer`."""
    path, backend, idle = sys.argv[1:]
    with tempfile.TemporaryDirectory(prefix="lookdev-warm-") as scratch:
        WarmServer(Path(path), BACKENDS[backend].command, float(idle), Path(scratch)).serve()


if __name__ == "__main__":
    main()
