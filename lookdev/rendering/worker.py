"""Supervision of a render worker: a child process that renders one frame at a time; every answer is checked.

The worker reads one JSON line per frame from stdin, and answers in JSON lines on stdout. While the worker starts, this
process can send it a line with a scene, which the worker prepares without an answer. All other output, including
Blender's, goes to a log file. The worker ends when its stdin ends, so it does not outlive a crash of this process.
"""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path
from types import MappingProxyType
from typing import Self

from pydantic import ValidationError

from lookdev.arrays import Floats32
from lookdev.errors import OutputError, RenderError, WorkerError
from lookdev.rendering import wire
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.derivatives import DerivativeTask
from lookdev.rendering.results import (
    MESSAGES,
    FailureMessage,
    ProgressMessage,
    ReadyMessage,
    ResultMessage,
    WorkerFrame,
    WorkerMessage,
    load_arrays,
    load_result,
)
from lookdev.rendering.task import FrameTask, SceneTask
from lookdev.rendering.threads import pin_to_cores

ANSWER_TIMEOUT = 600.0
"""Seconds without an answer after which a worker counts as hung. A slow round of samples takes less."""

_FRAME_LINE = "lookdev: frame "
"""The start of the line in a log that precedes the output of a frame. The frame's digest and file follow."""

MAX_MESSAGE_BYTES = 1 << 20
"""The most bytes of a line from the worker. A longer line is an error; otherwise it could fill the memory."""


class Worker:
    """A render process. `start` starts it, and starts it again after it was killed.

    Parameters
    ----------
    command
        The program and its arguments.
    log
        The file for the stderr of the process. It is emptied here, and every start appends to it.
    scratch
        An existing folder for the temporary files of the process (``TMPDIR``), including its results. The caller
        removes it.
    timeout
        Seconds without an answer after which the process counts as hung.
    variables
        Environment variables of the process, in addition to the variables of this process.
    cores
        The cores that the process may run on. By default, the process may run on the cores of this process.
    """

    def __init__(
        self,
        command: Sequence[str],
        log: Path,
        scratch: Path,
        timeout: float = ANSWER_TIMEOUT,
        variables: Mapping[str, str] = MappingProxyType({}),
        cores: frozenset[int] | None = None,
    ) -> None:
        self.log = log
        self._command = tuple(command)
        self._environment = os.environ | {"TMPDIR": str(scratch), **variables}
        # By this variable, Blender would read its colour spaces from the studio's OCIO config. That config is for
        # viewing, not for rendering.
        self._environment.pop("OCIO", None)
        self._timeout = timeout
        self._cores = cores
        self._process: subprocess.Popen[bytes] | None = None
        self._scene_sender: threading.Thread | None = None  # writes the scene of `prepare` to the process
        self._ready = False
        self._blender = ""
        log.write_bytes(b"")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.kill()

    @property
    def pid(self) -> int | None:
        """The id of the process, or None if no process runs."""
        return None if self._process is None else self._process.pid

    def launch(self) -> None:
        """Start the process unless it runs, without waiting for it; raises WorkerError where that fails."""
        if self._process is not None:
            return
        with self.log.open("ab") as log, nullcontext() if self._cores is None else pin_to_cores(self._cores):
            try:
                # The worker gets a session of its own, so that Ctrl-C in the terminal interrupts this process only.
                self._process = subprocess.Popen(
                    self._command,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=log,
                    env=self._environment,
                    start_new_session=True,
                )
            except OSError as error:
                raise WorkerError(f"the render worker {self._command[0]} cannot be started: {error}") from error

    def prepare(self, scene: SceneTask) -> None:
        """Send a scene to a launched process that is not ready yet, so that frames with the scene's looks start sooner.

        Does nothing if the process is ready or not launched, or if a scene was sent already.
        """
        process = self._process
        if process is None or self._ready or self._scene_sender is not None:
            return

        def send() -> None:
            with suppress(WorkerError):  # if the worker has died, the first frame reports that
                self._send(process, wire.encode_task(scene))

        # This thread does not wait: a scene can be larger than the pipe's buffer, and writing it then takes until the
        # process reads.
        self._scene_sender = threading.Thread(target=send, daemon=True)
        self._scene_sender.start()

    def start(self) -> None:
        """Start the process unless it runs, and wait until it is ready; raises WorkerError where that fails."""
        self.launch()
        if self._ready:
            return
        assert self._process is not None
        with self._kill_on_error():
            message = self._receive(self._process)
            if not isinstance(message, ReadyMessage):
                raise WorkerError(f"the render worker answered '{message.type}' before it was ready")
            self._ready, self._blender = True, message.blender
            if self._scene_sender is not None:
                self._scene_sender.join()

    def render(self, task: FrameTask, progress: Callable[[ProgressMessage], None]) -> WorkerFrame:
        """Render one frame on a started worker.

        Raises RenderError where the worker cannot render the frame, and OutputError where it cannot write a file, as on
        a full disk. The worker keeps running after these errors. Raises WorkerError where the worker died, hung or sent
        an invalid answer, and kills the worker.
        """
        with self._kill_on_error():
            return load_result(self._exchange(task, progress), task.scene, self._blender)

    def cancel(self, digest: str) -> None:
        """Ask the process to end the frame with a digest soon; `render` then raises RenderError.

        The process keeps running. Any thread may call this. It has no effect on a frame that has ended or was not sent.
        """
        process = self._process
        if process is None or process.stdin is None:
            return
        with suppress(OSError, ValueError):  # the process has died: the thread that waits for the frame reports that
            process.stdin.write(wire.encode_cancel(digest))
            process.stdin.flush()

    def render_derivatives(self, task: DerivativeTask, progress: Callable[[ProgressMessage], None]) -> Floats32:
        """Return two halves of a picture and of its derivatives, (2, 1 + P, H, W, 4); raises as `render`.

        The axes are the half, the picture followed by its P derivatives, row, column, and the channels RGB and alpha.
        """
        width, height = task.scene.resolution
        shape = (2, 1 + len(task.symbols), height, width, 4)
        with self._kill_on_error():
            return load_arrays(self._exchange(task, progress), {"slopes": shape})[0]["slopes"]

    def _exchange(self, task: FrameTask | DerivativeTask, progress: Callable[[ProgressMessage], None]) -> ResultMessage:
        """Send a task, and return its final answer."""
        if self._process is None:
            raise WorkerError("the render worker is not running: start it first")
        with self.log.open("a") as log:
            log.write(f"{_FRAME_LINE}{task.digest} {' '.join(map(str, task.files[:1]))}\n")
        with self._kill_on_error():
            self._send(self._process, wire.encode_task(task))
            while isinstance(message := self._receive(self._process), ProgressMessage):
                self._check_digest(message.digest, task)
                progress(message)
            if isinstance(message, ReadyMessage):
                raise WorkerError("the render worker answered 'ready' in the middle of a frame")
            self._check_digest(message.digest, task)
            if isinstance(message, FailureMessage):
                raise OutputError(message.message) if message.unwritable else RenderError(message.message)
            return message

    def stop(self) -> None:
        """Kill the process and its children, from any thread. A thread that waits for a frame gets an error."""
        process = self._process
        if process is not None and process.returncode is None:
            kill_group(process)

    def kill(self) -> None:
        """Kill the process and its children, wait for its end, and close its pipes; `start` can start it again."""
        process, self._process, self._ready = self._process, None, False
        if process is None:
            return
        kill_group(process)
        process.wait()
        if self._scene_sender is not None:
            self._scene_sender.join()
            self._scene_sender = None
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with suppress(BrokenPipeError):  # bytes that the dead worker never read
                    pipe.close()

    @contextmanager
    def _kill_on_error(self) -> Iterator[None]:
        """Kill the worker after an error in the block: its next line could be an answer for the failed frame."""
        try:
            yield
        except (RenderError, OutputError):
            raise  # these are complete answers of the worker, which can take the next frame
        except BaseException:
            self.kill()
            raise

    @contextmanager
    def _kill_when_silent(self, process: subprocess.Popen[bytes]) -> Iterator[threading.Event]:
        """Kill the process if the block takes longer than the timeout; a blocked call on its pipes then returns.

        Yields an event that is set before the kill.
        """
        hung = threading.Event()

        def give_up() -> None:
            hung.set()
            kill_group(process)

        timer = threading.Timer(self._timeout, give_up)
        timer.daemon = True
        timer.start()
        try:
            yield hung
        finally:
            timer.cancel()
            timer.join()  # otherwise it could kill a later process group with the same id

    def _send(self, process: subprocess.Popen[bytes], line: str) -> None:
        """Write a line to the process; raises WorkerError where it has ended or hangs."""
        assert process.stdin is not None
        with self._kill_when_silent(process) as hung:
            try:
                process.stdin.write(line.encode() + b"\n")
                process.stdin.flush()
            except BrokenPipeError:
                raise WorkerError(self._end_of_process(process, hung)) from None

    def _receive(self, process: subprocess.Popen[bytes]) -> WorkerMessage:
        """Return the next answer; raises WorkerError where the process ends or hangs, or the answer is invalid."""
        assert process.stdout is not None
        with self._kill_when_silent(process) as hung:
            line = process.stdout.readline(MAX_MESSAGE_BYTES)
            if not line.endswith(b"\n") and len(line) < MAX_MESSAGE_BYTES:
                raise WorkerError(self._end_of_process(process, hung))
        try:
            return MESSAGES.validate_json(line)
        except ValidationError:
            excerpt = line[:80].decode(errors="replace").strip()
            raise WorkerError(f"the render worker sent an invalid message: {excerpt!r}") from None

    def _end_of_process(self, process: subprocess.Popen[bytes], hung: threading.Event) -> str:
        """Return a description of how the process ended."""
        if hung.is_set():
            return f"the render worker was silent for {self._timeout:g} s and was killed"
        try:
            code = process.wait(timeout=1.0)
        except subprocess.TimeoutExpired:
            return "the render worker closed its pipe"
        if code < 0:
            return f"the render worker died of {signal.Signals(-code).name}"
        line = last_line(self.log)
        return f"the render worker ended with exit code {code}" + (f": {line}" if line else "")

    @staticmethod
    def _check_digest(digest: str, task: FrameTask | DerivativeTask) -> None:
        if digest != task.digest:
            raise WorkerError(f"the render worker answered for frame {digest[:12]}, asked for {task.digest[:12]}")


@contextmanager
def open_renderer(timeout: float = ANSWER_TIMEOUT) -> Iterator[Callable[[FrameTask], WorkerFrame]]:
    """Yield a function that renders a frame with any backend, in workers that end with the context.

    The function raises as `Worker.start` and `Worker.render`. Its WorkerError includes the last line of the log.
    """
    with tempfile.TemporaryDirectory(prefix="lookdev-worker-") as scratch, ExitStack() as stack:
        workers: dict[tuple[str, ...], Worker] = {}

        def render(task: FrameTask) -> WorkerFrame:
            command = BACKENDS[task.scene.backend].command
            if command not in workers:
                log = Path(scratch, f"{len(workers)}.log")
                workers[command] = stack.enter_context(Worker(command, log, Path(scratch), timeout))
            worker = workers[command]
            try:
                worker.start()
                return worker.render(task, lambda progress: None)
            except WorkerError as error:
                # The log is removed at the end of the context, so the message has its last line.
                raise WorkerError(f"{error}\n{last_line(worker.log)}") from error

        yield render


def last_line(log: Path) -> str:
    """Return the last line of a log file that is not blank and not a `_FRAME_LINE`, or an empty string."""
    lines = log.read_text(errors="replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip() and not line.startswith(_FRAME_LINE)), "")


def explain_error(error: Exception, log: Path) -> str:
    """Return the message of an error, with the last line of a worker's log appended if the message lacks it."""
    line = last_line(log)
    return str(error) if line in str(error) else f"{error}: {line}"


def kill_group(process: subprocess.Popen[bytes]) -> None:
    """Kill a process that was started in its own session, and its children; the process may have ended already."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
