"""The runs that write to one output folder, on any number of machines that share the folder.

Each run has a file in ``.lookdev/runs``. The run sets the time of this file again and again: this is its heartbeat. A
run is dead if its process has ended, or if it has had no heartbeat for the time of a lease. Another run then removes
the file of the dead run. If the process of the dead run goes on after all, it notices that its file is gone, and stops.
Clocks of two machines are never compared: any change of the file's time is a heartbeat, and the observer measures the
time between heartbeats by its own clock.

Before a run makes a frame or another file, it claims the name of that file. The claim is a hard link to the run's own
file. Only one run can create this link. Claims of dead runs are void. Claims only save work. They need not protect
files: a file is written completely or not at all, and its content does not depend on the run.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import secrets
import shutil
import socket
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Self

from lookdev.cache import output_errors, process_name, write_file
from lookdev.errors import OutputError, WorkerError
from lookdev.output.manifest import STATE_FOLDER
from lookdev.safe_text import environment_limit, read_json_object

LEASE_VARIABLE = "LOOKDEV_LEASE"
"""The environment variable with the lease: the seconds without a heartbeat after which a run counts as dead."""

DEFAULT_LEASE = 60

_BEATS_PER_LEASE = 6  # heartbeats in the time of a lease
_SCRATCH = "scratch-"  # the start of the names of folders for temporary files
# The pattern of names of temporary files of `lookdev.cache.atomic_path`. The group is the name of the writing process.
_TEMPORARY_NAME = re.compile(r"\..+\.([0-9a-f]+)-[0-9a-f]{8}(?:\.[a-z0-9]+)?")


@dataclass(frozen=True)
class RunInfo:
    """The description of a run, as its file has it."""

    id: str  # begins with the name of the process, `lookdev.cache.process_name`
    host: str
    machine: str  # the ids of the boot and of the process namespace: process ids are unique within these
    process: int  # the process id
    started: str  # the start time of the process, in the kernel's ticks: a later process may have the same id
    since: str  # the start of the run, UTC
    part: str = ""  # the chunk that it renders, such as "2/8"; "" for all frames
    plan: str = ""  # the digest of its plan; "" before it has one

    @classmethod
    def of_this_process(cls, part: str) -> Self:
        """Return the description of a new run of this process."""
        pid, now = os.getpid(), datetime.now(UTC).isoformat(timespec="seconds")
        name = f"{process_name()}{secrets.token_hex(4)}"
        return cls(name, socket.gethostname(), _machine(), pid, _start_time(pid), now, part)

    def __str__(self) -> str:
        return f"process {self.process} on {self.host} (since {self.since})"

    @property
    def has_ended(self) -> bool:
        """Whether the run is a run of this machine whose process has ended."""
        return self.machine == _machine() and not _is_running(self.process, self.started)


class Runs:
    """The runs of an output folder, as one observer sees them; `state` is the state folder, ``.lookdev``.

    The observer stores the last heartbeat of each run, to detect new heartbeats.
    """

    def __init__(self, state: Path) -> None:
        self._folder = state / "runs"
        self._lease = lease_seconds()
        # The time of a run's file at the last heartbeat, and the time when this process noticed it, by the run's id.
        self._heartbeats: dict[str, tuple[int, float]] = {}

    def all(self) -> list[RunInfo]:
        """Return the runs that have files, including dead runs."""
        return [run for file in sorted(self._folder.glob("[!.]*")) if (run := _read_run(file))]

    def alive(self) -> list[RunInfo]:
        """Return the runs that are not known to be dead, and remove the files of dead runs."""
        return [run for run in self.all() if self.is_alive(run)]

    def is_alive(self, run: RunInfo) -> bool:
        """Return whether a run is not known to be dead; remove the file of a dead run."""
        file = self._folder / run.id
        try:
            # A file server is asked for the file's state when the file is opened. Without that, the result of stat may
            # be as old as a minute.
            with file.open("rb") as stream:
                heartbeat = os.fstat(stream.fileno()).st_mtime_ns
        except OSError as error:
            return error.errno not in (errno.ENOENT, errno.ESTALE)
        now = time.monotonic()
        before, since = self._heartbeats.get(run.id, (None, now))
        if heartbeat != before:
            self._heartbeats[run.id] = heartbeat, now
            since = now
        if not run.has_ended and now - since <= self._lease:
            return True
        with suppress(OSError):
            file.unlink()
        return False

    def wait_for_heartbeat(self, run: RunInfo) -> bool:
        """Wait until a run has a heartbeat, which shows that it is alive; return False if it is dead.

        A run of this machine needs no heartbeat: its process is looked up.
        """
        if not self.is_alive(run):
            return False
        first = self._heartbeats[run.id][0] if run.id in self._heartbeats else None
        while self.is_alive(run):
            if run.machine == _machine() or self._heartbeats.get(run.id, (first,))[0] != first:
                return True
            time.sleep(self._lease / _BEATS_PER_LEASE / 4)
        return False


class Run:
    """The run of this process, as a context manager. Until the context ends, a thread gives the run its heartbeat.

    `output` is the output folder. `part` is the chunk that the run renders, "" for all frames.
    """

    def __init__(self, output: Path, part: str = "") -> None:
        self.state = output / STATE_FOLDER
        self.info = RunInfo.of_this_process(part)
        self.runs = Runs(self.state)
        self._lease = lease_seconds()
        self._output = output
        self._file = self.state / "runs" / self.info.id
        self._claims_folder = self.state / "claims"
        self._claim_files: dict[str, Path] = {}  # the files of this run's claims, by `claim_key`
        self._ended, self._is_lost = threading.Event(), False  # a run is lost if other runs have removed its file
        self._heartbeat = threading.Thread(target=self._beat_until_end, daemon=True)

    def __enter__(self) -> Self:
        with output_errors(self._output, "the output folder cannot be written"):
            self._register()
            self._remove_scratch()
        self._heartbeat.start()
        return self

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        self._ended.set()
        self._heartbeat.join()
        try:
            # If this run counts as dead, other runs remove its temporary files, which causes these errors. The error of
            # `check_alive` then states the cause.
            if isinstance(error, OutputError | WorkerError | FileNotFoundError):
                self.check_alive()
        finally:
            self._remove_own_files()

    def _remove_own_files(self) -> None:
        """Remove the files of this run from the state folder. The last run also removes the folders of runs."""
        with suppress(OSError):  # the process ends: other runs ignore its files that could not be removed
            for key in list(self._claim_files):
                self.release(key)
            self._file.unlink(missing_ok=True)
            self._remove_scratch()
            if not self.others():
                self._remove_state()

    def others(self) -> list[RunInfo]:
        """Return the other runs that are not known to be dead."""
        return [run for run in self.runs.alive() if run.id != self.info.id]

    def announce_plan(self, plan: str) -> list[RunInfo]:
        """Write the digest of this run's plan to the file of this run, and return the other runs.

        Raises OutputError where a living run has another plan, because both runs would replace each other's frames.
        """
        self.info = replace(self.info, plan=plan)
        self._write_info()
        for run in self.others():
            if run.plan not in ("", plan) and self.runs.wait_for_heartbeat(run):
                raise OutputError(
                    f"{self._output}: {run} renders another version of this job, or another job, to it, or has another "
                    "version of this program; wait for its end, or choose another output"
                )
        return self.others()

    def check_alive(self) -> None:
        """Raise OutputError if this run counts as dead, because it had no heartbeat for the time of a lease."""
        self._beat()
        if self._is_lost:
            raise OutputError(
                f"{self._output}: this run stood still for more than {self._lease:g} s, and counts as dead: others may "
                "have gone on with its frames; run the same command again to continue"
            )

    def claim(self, name: str) -> bool:
        """Claim a name; return False if another living run has claimed it. Raises as `check_alive`, and OSError.

        The claims of a name are files with consecutive numbers. Only the last claim can be valid: the others are claims
        of dead runs.
        """
        self.check_alive()
        key = claim_key(name)
        number = 0
        while True:
            file = self._claims_folder / f"{key}.{number}"
            if self._link_claim(file):
                self._claim_files[key] = file
                return True
            owner = _read_run(file)
            if owner is not None and owner.id == self.info.id:
                return True
            if owner is not None and self.runs.is_alive(owner):
                return False
            # If a dead run has the claim, the next number is tried. If the claim has been released in the meantime, the
            # same number is tried again.
            number += file.exists()

    def release(self, name: str) -> None:
        """Release this run's claim of a name, or of its key, and remove the earlier claims of dead runs."""
        key = claim_key(name) if name not in self._claim_files else name
        if (file := self._claim_files.pop(key, None)) is None:
            return
        for number in range(int(file.suffix[1:]) + 1):
            (self._claims_folder / f"{key}.{number}").unlink(missing_ok=True)

    @contextmanager
    def scratch_folder(self) -> Iterator[Path]:
        """Yield a folder for temporary files of this run."""
        folder = self.state / f"{_SCRATCH}{self.info.id}-{secrets.token_hex(4)}"
        folder.mkdir()
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def log_file(self, name: str) -> Path:
        """Return a path for a log in the state folder, with the run's id in it if another run uses the plain path."""
        stem = f"{name}.{self.info.part.replace('/', '-')}" if self.info.part else name
        is_free = self.claim(f"log {stem}")
        return self.state / (f"{stem}.log" if is_free else f"{stem}.{self.info.id}.log")

    def remove_logs(self) -> None:
        """Remove the logs of other runs. Call this when all frames are done and no other run is left."""
        for file in self.state.glob("worker*.log"):
            stem = file.name.removesuffix(".log")
            if claim_key(f"log {stem}") not in self._claim_files and self.info.id not in stem:
                file.unlink(missing_ok=True)

    def remove_leftovers(self, folders: Iterable[Path]) -> None:
        """Remove the temporary files of dead runs from some folders."""
        leftovers: list[tuple[Path, str]] = []
        for folder in folders:
            with suppress(FileNotFoundError, NotADirectoryError):
                names = ((path, _TEMPORARY_NAME.fullmatch(path.name)) for path in folder.iterdir())
                leftovers += [(path, match[1]) for path, match in names if match]
        # The runs are listed after the files. A run has a file in the state folder before it writes temporary files, so
        # the list has the runs of all files found above, unless they are dead.
        processes = {run.id[: len(process_name())] for run in self.runs.alive()} if leftovers else set()
        for path, process in leftovers:
            if process not in {*processes, process_name()}:
                path.unlink(missing_ok=True)

    def _link_claim(self, file: Path) -> bool:
        """Create the file of a claim; return False where it exists."""
        try:
            os.link(self._file, file)
        except FileExistsError:
            return False
        except FileNotFoundError:
            self._claims_folder.mkdir(parents=True, exist_ok=True)
            self.check_alive()
            return self._link_claim(file)
        except OSError as error:
            if error.errno not in (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK):
                raise
            return self._create_claim(file)
        return True

    def _create_claim(self, file: Path) -> bool:
        """Create the file of a claim on a file system without hard links; return False where it exists."""
        try:
            with file.open("x") as stream:
                stream.write(self._info_text())
        except FileExistsError:
            # The owner of a claim is unknown until the file has its content, so this waits for up to two seconds.
            with suppress(FileNotFoundError):
                for _ in range(20):
                    if file.stat().st_size:
                        break
                    time.sleep(0.1)
            return False
        return True

    def _info_text(self) -> str:
        """Return the content of this run's file."""
        return json.dumps(asdict(self.info))

    def _register(self) -> None:
        """Create the file of this run, and the folders of the state folder."""
        for tries in range(5):
            self._claims_folder.mkdir(parents=True, exist_ok=True)
            try:
                self._write_info()
            except FileNotFoundError:  # at this moment, the last other run ends and removes the folders
                if tries == 4:
                    raise
            else:
                return

    def _write_info(self) -> None:
        """Write this run's file."""
        write_file(self._file, self._info_text())

    def _beat_until_end(self) -> None:
        """Give the run its heartbeat, in a thread, until its context ends."""
        while not self._ended.wait(self._lease / _BEATS_PER_LEASE):
            self._beat()

    def _beat(self) -> None:
        """Set the time of this run's file; note if the file is gone."""
        try:
            os.utime(self._file)
        except OSError as error:  # another error is reported by the next write of a frame
            self._is_lost = self._is_lost or error.errno in (errno.ENOENT, errno.ESTALE)

    def _remove_scratch(self) -> None:
        """Remove the folders for temporary files of dead runs."""
        folders = list(self.state.glob(f"{_SCRATCH}*"))
        # The runs are listed after the folders, for the reason in `remove_leftovers`.
        living = {run.id for run in self.runs.alive()} | {self.info.id}
        for folder in folders:
            if folder.name.removeprefix(_SCRATCH).partition("-")[0] not in living:
                # The worker of a killed run may still write to the folder. The next run removes such files.
                shutil.rmtree(folder, ignore_errors=True)

    def _remove_state(self) -> None:
        """Remove the folders of runs and claims. A run that starts at this moment creates them again."""
        self.remove_leftovers([self._file.parent])
        for file in self._claims_folder.iterdir():
            file.unlink(missing_ok=True)
        for folder in (self._claims_folder, self._file.parent):
            with suppress(OSError):
                folder.rmdir()


def lease_seconds() -> float:
    """Return the lease in seconds: `LEASE_VARIABLE`, or the default; raises OutputError for an invalid value."""
    return float(environment_limit(LEASE_VARIABLE, DEFAULT_LEASE, "seconds"))


def read_claims(state: Path) -> dict[str, list[str]]:
    """Return the keys (`claim_key`) of the names that each run in a state folder has claimed, by the id of the run."""
    files = sorted((state / "claims").glob("*.*"), key=lambda file: int(file.suffix[1:]))
    keys: dict[str, list[str]] = {}
    for key, file in {file.stem: file for file in files}.items():  # only the last claim with a key can be valid
        if run := _read_run(file):
            keys.setdefault(run.id, []).append(key)
    return keys


def claim_key(name: str) -> str:
    """Return a hash of a claimed name, which names the claim's file: the name itself may be too long for a file."""
    return hashlib.sha256(name.encode()).hexdigest()[:32]


def _read_run(file: Path) -> RunInfo | None:
    """Return the description of a run in a file, or None if the file is missing or damaged."""
    try:
        return RunInfo(**read_json_object(file))
    except TypeError:
        return None


@cache
def _machine() -> str:
    """Return the ids of this boot and of this process namespace. Process ids are unique within these."""
    boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    return f"{boot} {Path('/proc/self/ns/pid').readlink()}"


def _is_running(process: int, started: str) -> bool:
    """Return whether a process of this machine, by its id and start time, is running.

    A later process may have the same id, but not the same start time.
    """
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # it runs, for another user: /proc may hide its start time
        return True
    return _start_time(process) == started


def _start_time(process: int) -> str:
    """Return the start time of a process, in ticks since boot (proc(5)), or "" if it is missing or a zombie."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return ""
    return "" if fields[0] in "ZX" else fields[19]
