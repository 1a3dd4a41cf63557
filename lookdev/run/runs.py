"""The runs that write to one output folder, on any number of machines that share it.

Each run has a file in ``.lookdev/runs`` and sets its time repeatedly: the heartbeat of the run. A run is dead if its
process has ended, or if its heartbeat stops for the time of a lease. Another run then removes its file; if the dead run
continues after all, it stops. Clocks of two machines are never compared: any change of the file's time is a heartbeat,
and the observer measures the time between heartbeats by its own clock.

A run claims a file before it makes it, by a hard link to its own file: one run alone can create the link. Claims of
dead runs are void. Claims only save work: files are written whole, and their content does not depend on the run.
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
"""Environment variable: seconds without a heartbeat after which a run counts as dead."""

DEFAULT_LEASE = 60

_BEATS_PER_LEASE = 6  # heartbeats in the time of a lease
_SCRATCH = "scratch-"
# The temporary names of lookdev.cache.atomic_path.
_TEMPORARY_NAME = re.compile(r"\..+\.([0-9a-f]+)-[0-9a-f]{8}(?:\.[a-z0-9]+)?")


@dataclass(frozen=True)
class RunInfo:
    """A run, as in its file: its id and process, its chunk, and the digest of its plan, "" before it has one."""

    id: str  # begins with the name of its process, as its temporary files do
    host: str
    machine: str  # the ids of the boot and of the process namespace
    process: int
    started: str  # the start time of the process, in the kernel's ticks
    since: str  # UTC
    part: str = ""  # the chunk, as 2/8
    plan: str = ""

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
        """Whether the run was on this machine, and its process has ended."""
        return self.machine == _machine() and not _is_running(self.process, self.started)


class Runs:
    """The runs of an output folder, watched by one observer."""

    def __init__(self, state: Path) -> None:
        self._folder = state / "runs"
        self._lease = lease_seconds()
        self._heartbeats: dict[str, tuple[int, float]] = {}  # the last of each run, and when it was observed

    def all(self) -> list[RunInfo]:
        """Return the runs that have files, including dead runs."""
        return [run for file in sorted(self._folder.glob("[!.]*")) if (run := _read_run(file))]

    def alive(self) -> list[RunInfo]:
        """Return the runs that are not known to be dead; the files of dead runs are removed."""
        return [run for run in self.all() if self.is_alive(run)]

    def is_alive(self, run: RunInfo) -> bool:
        """Return whether a run is not known to be dead; the file of a dead run is removed."""
        file = self._folder / run.id
        try:
            # Opening a file asks the file server for its state; a stat may be as old as a minute.
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
        """Wait for the next heartbeat of a run; return False where the run is dead."""
        if not self.is_alive(run):
            return False
        first = self._heartbeats[run.id][0] if run.id in self._heartbeats else None
        while self.is_alive(run):
            if run.machine == _machine() or self._heartbeats.get(run.id, (first,))[0] != first:
                return True
            time.sleep(self._lease / _BEATS_PER_LEASE / 4)
        return False


class Run:
    """The run of this process, as a context. A thread sets the time of its file until the context ends."""

    def __init__(self, output: Path, part: str = "") -> None:
        self.state = output / STATE_FOLDER
        self.info = RunInfo.of_this_process(part)
        self.runs = Runs(self.state)
        self._lease = lease_seconds()
        self._output = output
        self._file = self.state / "runs" / self.info.id
        self._claims_folder = self.state / "claims"
        self._claim_files: dict[str, Path] = {}
        self._ended, self._is_lost = threading.Event(), False
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
            # Other runs remove the temporary files of a run that counts as dead, which causes such errors.
            if isinstance(error, OutputError | WorkerError | FileNotFoundError):
                self.check_alive()
        finally:
            self._remove_own_files()

    def _remove_own_files(self) -> None:
        """Remove the files of this run from the state folder, and the folders of runs where it is the last run."""
        with suppress(OSError):  # remaining files are void, since the process ends
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
        """Write the digest of this run's plan to its file; return the other runs, which have the same plan.

        Raises OutputError where a living run has another plan: each would replace the frames of the other.
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
        """Raise OutputError where this run had no heartbeat for a lease, so that it counts as dead."""
        self._beat()
        if self._is_lost:
            raise OutputError(
                f"{self._output}: this run stood still for more than {self._lease:g} s, and counts as dead: others may "
                "have gone on with its frames; run the same command again to continue"
            )

    def claim(self, name: str) -> bool:
        """Claim a name; return False where another living run has it. Raises as `check_alive`, and OSError."""
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
            number += file.exists()  # after the claim of a dead run, the next number; a released claim is tried again

    def release(self, name: str) -> None:
        """Release the claim of a name, and remove the claims of dead runs before it."""
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
        """Return the path of a log of this run in the state folder; it has the run's id if another run has the log."""
        stem = f"{name}.{self.info.part.replace('/', '-')}" if self.info.part else name
        is_free = self.claim(f"log {stem}")
        return self.state / (f"{stem}.log" if is_free else f"{stem}.{self.info.id}.log")

    def remove_logs(self) -> None:
        """Remove the logs of other runs; all frames are done, and no other run is left."""
        for file in self.state.glob("worker*.log"):
            stem = file.name.removesuffix(".log")
            if claim_key(f"log {stem}") not in self._claim_files and self.info.id not in stem:
                file.unlink(missing_ok=True)

    def remove_leftovers(self, folders: Iterable[Path]) -> None:
        """Remove the temporary files of dead runs from folders."""
        leftovers: list[tuple[Path, str]] = []
        for folder in folders:
            with suppress(FileNotFoundError, NotADirectoryError):
                names = ((path, _TEMPORARY_NAME.fullmatch(path.name)) for path in folder.iterdir())
                leftovers += [(path, match[1]) for path, match in names if match]
        # The runs are listed after the files: the run that writes a file has joined before.
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
            # Between its creation and its content, the owner of a claim is unknown.
            with suppress(FileNotFoundError):
                for _ in range(20):
                    if file.stat().st_size:
                        break
                    time.sleep(0.1)
            return False
        return True

    def _info_text(self) -> str:
        return json.dumps(asdict(self.info))

    def _register(self) -> None:
        for tries in range(5):
            self._claims_folder.mkdir(parents=True, exist_ok=True)
            try:
                self._write_info()
            except FileNotFoundError:  # the last run ends at this moment and removes the folders
                if tries == 4:
                    raise
            else:
                return

    def _write_info(self) -> None:
        write_file(self._file, self._info_text())

    def _beat_until_end(self) -> None:
        while not self._ended.wait(self._lease / _BEATS_PER_LEASE):
            self._beat()

    def _beat(self) -> None:
        try:
            os.utime(self._file)
        except OSError as error:  # where the file system cannot be written for a while, writing frames reports it
            self._is_lost = self._is_lost or error.errno in (errno.ENOENT, errno.ESTALE)

    def _remove_scratch(self) -> None:
        folders = list(self.state.glob(f"{_SCRATCH}*"))
        # The runs are listed after the folders: the run that makes a folder has joined before.
        living = {run.id for run in self.runs.alive()} | {self.info.id}
        for folder in folders:
            if folder.name.removeprefix(_SCRATCH).partition("-")[0] not in living:
                # The worker of a killed run may still write to it; the next run removes what remains.
                shutil.rmtree(folder, ignore_errors=True)

    def _remove_state(self) -> None:
        """Remove the folders of runs and claims. A run that starts at this moment makes them again."""
        self.remove_leftovers([self._file.parent])
        for file in self._claims_folder.iterdir():
            file.unlink(missing_ok=True)
        for folder in (self._claims_folder, self._file.parent):
            with suppress(OSError):
                folder.rmdir()


def lease_seconds() -> float:
    """Return the seconds in `LEASE_VARIABLE`, or the default; raises OutputError where it is not a number."""
    return float(environment_limit(LEASE_VARIABLE, DEFAULT_LEASE, "seconds"))


def read_claims(state: Path) -> dict[str, list[str]]:
    """Return the keys of the claims of all runs, by the ids of the runs."""
    files = sorted((state / "claims").glob("*.*"), key=lambda file: int(file.suffix[1:]))
    keys: dict[str, list[str]] = {}
    for key, file in {file.stem: file for file in files}.items():  # of several claims, the last
        if run := _read_run(file):
            keys.setdefault(run.id, []).append(key)
    return keys


def claim_key(name: str) -> str:
    """Return the key of a claimed name, for the names of claim files: the name may be too long for a file."""
    return hashlib.sha256(name.encode()).hexdigest()[:32]


def _read_run(file: Path) -> RunInfo | None:
    """Return the run in a file; None where the file is missing or damaged."""
    try:
        return RunInfo(**read_json_object(file))
    except TypeError:
        return None


@cache
def _machine() -> str:
    boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    return f"{boot} {Path('/proc/self/ns/pid').readlink()}"


def _is_running(process: int, started: str) -> bool:
    """Return whether a process of this machine is running: a later process with its number has another start time."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # of another user, whose processes /proc may hide
        return True
    return _start_time(process) == started


def _start_time(process: int) -> str:
    """Return the start time of a process, in ticks since boot (proc(5)); "" where it is missing or a zombie."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return ""
    return "" if fields[0] in "ZX" else fields[19]
