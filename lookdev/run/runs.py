"""The runs that write to one output folder, on any number of machines that share it.

Each run has a file in ``.lookdev/runs``, whose time it sets again and again: its sign of life. A run whose process has
gone, or that shows no sign for a while, is dead: another removes its file, and it stops should it go on. No clock is
compared with another: a sign is a change, whatever it changes to, and the time without one is that of the observer.

What a run is about to make it claims: a hard link to its file, which one of many makes. Claims of the dead are void.
Nothing rests on claims but work: files are written whole, and each has the same content whoever writes it.
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

from lookdev.cache import atomic_path, process_name
from lookdev.errors import OutputError, WorkerError
from lookdev.output.manifest import STATE_FOLDER
from lookdev.text import TextError, parse_json, read_text, stated_limit

LEASE_VARIABLE = "LOOKDEV_LEASE"
"""Environment variable: seconds without a sign of life after which a run counts as dead."""

DEFAULT_LEASE = 60

_SIGNS = 6  # in the time of a lease
_SCRATCH = "scratch-"
# The names that lookdev.cache.atomic_path gives.
_TEMPORARY = re.compile(r"\..+\.([0-9a-f]+)-[0-9a-f]{8}(?:\.[a-z0-9]+)?")


@dataclass(frozen=True)
class RunInfo:
    """A run, as its file describes it: who it is, what it renders, and the digest of its plan, once it has one."""

    id: str  # begins with the name of its process, as the names of its temporary files do
    host: str
    machine: str  # the boot and the namespace of process ids
    process: int
    started: str  # when the process was, as the kernel counts
    since: str  # UTC
    part: str = ""  # as 2/8
    plan: str = ""

    @classmethod
    def of_this_process(cls, part: str) -> Self:
        """Return a new run of this process."""
        pid, now = os.getpid(), datetime.now(UTC).isoformat(timespec="seconds")
        name = f"{process_name()}{secrets.token_hex(4)}"
        return cls(name, socket.gethostname(), _machine(), pid, _started(pid), now, part)

    def __str__(self) -> str:
        return f"process {self.process} on {self.host} (since {self.since})"

    @property
    def has_ended(self) -> bool:
        """Whether it was a process of this machine, and is no more."""
        return self.machine == _machine() and not _runs(self.process, self.started)


class Runs:
    """The runs of an output folder, as one observer sees them."""

    def __init__(self, state: Path) -> None:
        self._folder = state / "runs"
        self._lease = lease()
        self._seen: dict[str, tuple[int, float]] = {}

    def all(self) -> list[RunInfo]:
        """Return the runs that have files, the dead included."""
        try:
            names = sorted(path.name for path in self._folder.iterdir() if not path.name.startswith("."))
        except FileNotFoundError:
            return []
        return [found for name in names if (found := _read_run(self._folder / name))]

    def alive(self) -> list[RunInfo]:
        """Return the runs that are not known to be dead; those that are lose their files."""
        return [run for run in self.all() if self.lives(run)]

    def lives(self, run: RunInfo) -> bool:
        """Return whether a run is not known to be dead; one that is loses its file."""
        file = self._folder / run.id
        try:
            # An open file is looked up on the server, where a stat may be as old as a minute.
            with file.open("rb") as stream:
                sign = os.fstat(stream.fileno()).st_mtime_ns
        except OSError as error:
            return error.errno not in (errno.ENOENT, errno.ESTALE)
        now = time.monotonic()
        before, since = self._seen.get(run.id, (None, now))
        if sign != before:
            self._seen[run.id] = sign, now
            since = now
        if not run.has_ended and now - since <= self._lease:
            return True
        with suppress(OSError):
            file.unlink()
        return False

    def shows_life(self, run: RunInfo) -> bool:
        """Wait until a run shows that it lives, or is dead."""
        if not self.lives(run):
            return False
        first = self._seen[run.id][0] if run.id in self._seen else None
        while self.lives(run):
            if run.machine == _machine() or self._seen.get(run.id, (first,))[0] != first:
                return True
            time.sleep(self._lease / _SIGNS / 4)
        return False


class Run:
    """This run. It shows life from a thread of its own until it is left."""

    def __init__(self, output: Path, part: str = "") -> None:
        self.state = output / STATE_FOLDER
        self.info = RunInfo.of_this_process(part)
        self.runs = Runs(self.state)
        self._lease = lease()
        self._output = output
        self._file = self.state / "runs" / self.info.id
        self._claims = self.state / "claims"
        self._held: dict[str, Path] = {}
        self._ended, self._lost = threading.Event(), False
        self._pulse = threading.Thread(target=self._beat_on, daemon=True)

    def __enter__(self) -> Self:
        try:
            self._register()
            self._remove_scratch()
        except OSError as error:
            raise OutputError(f"{self._output}: the output folder cannot be written: {error.strerror}") from error
        self._pulse.start()
        return self

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        self._ended.set()
        self._pulse.join()
        try:
            # Others remove the temporary files of a run that they take for dead: what fails then is a consequence.
            if isinstance(error, OutputError | WorkerError | FileNotFoundError):
                self.check()
        finally:
            self._leave()

    def _leave(self) -> None:
        """Remove what this run has in the state folder, and the folder's parts for runs if it is the last."""
        with suppress(OSError):  # what remains is void: the process ends
            for key in list(self._held):
                self.release(key)
            self._file.unlink(missing_ok=True)
            self._remove_scratch()
            if not self.others():
                self._remove_state()

    def others(self) -> list[RunInfo]:
        """Return the other runs that are not known to be dead."""
        return [run for run in self.runs.alive() if run.id != self.info.id]

    def renders(self, plan: str) -> list[RunInfo]:
        """State the digest of this run's plan; return the others, which have the same.

        Raises OutputError where a living run has another: each would replace the frames of the other.
        """
        self.info = replace(self.info, plan=plan)
        self._write()
        for run in self.others():
            if run.plan not in ("", plan) and self.runs.shows_life(run):
                raise OutputError(
                    f"{self._output}: {run} renders another version of this job, or another job, to it, or has another "
                    "version of this program; wait for its end, or choose another output"
                )
        return self.others()

    def check(self) -> None:
        """Raise OutputError where this run stood still for so long that others took it for dead."""
        self._beat()
        if self._lost:
            raise OutputError(
                f"{self._output}: this run stood still for more than {self._lease:g} s, and counts as dead: others may "
                "have gone on with its frames; run the same command again to continue"
            )

    def claim(self, name: str) -> bool:
        """Claim what has a name; return False where another living run has claimed it; raises as `check`, OSError."""
        self.check()
        key = claim_key(name)
        number = 0
        while True:
            file = self._claims / f"{key}.{number}"
            if self._link(file):
                self._held[key] = file
                return True
            owner = _read_run(file)
            if owner is not None and owner.id == self.info.id:
                return True
            if owner is not None and self.runs.lives(owner):
                return False
            number += file.exists()  # of the dead, whoever makes the next has it; released: this one

    def release(self, name: str) -> None:
        """Give up a claim, and remove those of dead runs before it."""
        key = claim_key(name) if name not in self._held else name
        if (held := self._held.pop(key, None)) is None:
            return
        for number in range(int(held.suffix[1:]) + 1):
            (self._claims / f"{key}.{number}").unlink(missing_ok=True)

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """Yield a folder for temporary files of this run."""
        folder = self.state / f"{_SCRATCH}{self.info.id}-{secrets.token_hex(4)}"
        folder.mkdir()
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def log(self, name: str) -> Path:
        """Return the file of a log of this run in the state folder; the usual one, unless another run has it."""
        usual = f"{name}.{self.info.part.replace('/', '-')}" if self.info.part else name
        mine = self.claim(f"log {usual}")
        return self.state / (f"{usual}.log" if mine else f"{usual}.{self.info.id}.log")

    def remove_logs(self) -> None:
        """Remove the logs of other runs, which have ended and left nothing to explain."""
        for file in self.state.glob("worker*.log"):
            usual = file.name.removesuffix(".log")
            if claim_key(f"log {usual}") not in self._held and self.info.id not in usual:
                file.unlink(missing_ok=True)

    def remove_leftovers(self, folders: Iterable[Path]) -> None:
        """Remove the temporary files of dead runs from folders."""
        found: list[tuple[Path, str]] = []
        for folder in folders:
            with suppress(FileNotFoundError, NotADirectoryError):
                found += [(path, named[1]) for path in folder.iterdir() if (named := _TEMPORARY.fullmatch(path.name))]
        # Asked for after the files: who writes one has joined before.
        processes = {run.id[: len(process_name())] for run in self.runs.alive()} if found else set()
        for path, process in found:
            if process not in {*processes, process_name()}:
                path.unlink(missing_ok=True)

    def _link(self, file: Path) -> bool:
        try:
            os.link(self._file, file)
        except FileExistsError:
            return False
        except FileNotFoundError:
            self._claims.mkdir(parents=True, exist_ok=True)
            self.check()
            return self._link(file)
        except OSError as error:
            if error.errno not in (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK):
                raise
            return self._create(file)
        return True

    def _create(self, file: Path) -> bool:
        """Claim on a file system without hard links."""
        try:
            with file.open("x") as stream:
                stream.write(self._text())
        except FileExistsError:
            # Between creation and content nobody knows whose it is.
            for _ in range(20):
                if not _is_empty(file):
                    break
                time.sleep(0.1)
            return False
        return True

    def _text(self) -> str:
        return json.dumps(asdict(self.info))

    def _register(self) -> None:
        for tries in range(5):
            self._claims.mkdir(parents=True, exist_ok=True)
            try:
                self._write()
            except FileNotFoundError:  # the last run ends at this moment, and removes the folders
                if tries == 4:
                    raise
            else:
                return

    def _write(self) -> None:
        with atomic_path(self._file) as temporary:
            temporary.write_text(self._text())

    def _beat_on(self) -> None:
        while not self._ended.wait(self._lease / _SIGNS):
            self._beat()

    def _beat(self) -> None:
        try:
            os.utime(self._file)
        except OSError as error:  # on a file system that cannot be written for a while, writing frames reports it
            self._lost = self._lost or error.errno in (errno.ENOENT, errno.ESTALE)

    def _remove_scratch(self) -> None:
        folders = list(self.state.glob(f"{_SCRATCH}*"))
        # Asked for after the folders: who makes one has joined before.
        living = {run.id for run in self.runs.alive()} | {self.info.id}
        for folder in folders:
            if folder.name.removeprefix(_SCRATCH).partition("-")[0] not in living:
                # The worker of a killed run may still write to it; the next run removes what remains.
                shutil.rmtree(folder, ignore_errors=True)

    def _remove_state(self) -> None:
        """Remove what serves runs at work. A run that starts at this moment makes it again."""
        self.remove_leftovers([self._file.parent])
        for file in self._claims.iterdir():
            file.unlink(missing_ok=True)
        for folder in (self._claims, self._file.parent):
            with suppress(OSError):
                folder.rmdir()


def lease() -> float:
    """Return the seconds of `LEASE_VARIABLE`; raises OutputError where it states none."""
    return float(stated_limit(LEASE_VARIABLE, DEFAULT_LEASE, "seconds"))


def claims(state: Path) -> dict[str, list[str]]:
    """Return the keys of what runs have claimed, by their ids."""
    latest: dict[str, tuple[int, Path]] = {}
    for file in (state / "claims").glob("*.*"):
        latest[file.stem] = max(latest.get(file.stem, (-1, file)), (int(file.suffix[1:]), file))
    found: dict[str, list[str]] = {}
    for key, (_, file) in latest.items():
        if run := _read_run(file):
            found.setdefault(run.id, []).append(key)
    return found


def claim_key(name: str) -> str:
    """Return what the files of claims are named by: names are longer than files' may be."""
    return hashlib.sha256(name.encode()).hexdigest()[:32]


def _read_run(file: Path) -> RunInfo | None:
    """Return the run of a file; None where there is none, or it is damaged."""
    try:
        return RunInfo(**parse_json(read_text(file), file))
    except (TextError, TypeError):
        return None


def _is_empty(file: Path) -> bool:
    try:
        return file.stat().st_size == 0
    except FileNotFoundError:
        return False


@cache
def _machine() -> str:
    boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    return f"{boot} {Path('/proc/self/ns/pid').readlink()}"


def _runs(process: int, started: str) -> bool:
    """Return whether a process of this machine runs, and has not merely the number of an earlier one."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # of another user, whose processes /proc may hide
        return True
    return _started(process) == started


def _started(process: int) -> str:
    """Return when a process was started, in ticks since boot, by proc(5); "" where there is none, or a zombie."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return ""
    return "" if fields[0] in "ZX" else fields[19]
