"""Unsaved work that survives a crash: a record of each Designer's edits, kept until they are saved or discarded.

It is written after each edit, whole or not at all, and locked by the process that writes it. A record that nobody locks
is of a Designer that has ended: the next one of the same job or asset offers it.
"""

from __future__ import annotations

import base64
import fcntl
import hashlib
import json
import os
import secrets
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lookdev.cache import atomic_path
from lookdev.errors import LookdevError

STATE_VARIABLE = "LOOKDEV_STATE"
"""Environment variable with the folder of what is kept between runs, but is not made again as a cache is."""


def state_folder() -> Path:
    """Return ``$LOOKDEV_STATE``, else ``$XDG_STATE_HOME/lookdev``, else ``~/.local/state/lookdev``."""
    base = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(os.environ.get(STATE_VARIABLE) or str(Path(base) / "lookdev"))


@dataclass(frozen=True)
class Work:
    """Unsaved work: the contents of files, each with the digest of what was on disk; variants; seconds of the epoch.

    `shown` are the names of the look and the rig that were shown.
    """

    files: Mapping[Path, tuple[bytes, str]]
    variants: Mapping[str, Mapping[str, str]]
    time: float
    shown: tuple[str, str] = ("", "")

    def packed(self) -> str:
        """Return it as JSON."""
        files = {
            str(file): [base64.b64encode(content).decode(), known] for file, (content, known) in self.files.items()
        }
        return json.dumps({"files": files, "variants": self.variants, "time": self.time, "shown": self.shown})

    @staticmethod
    def unpacked(text: str) -> Work:
        """Return what `packed` has made; raises ValueError for anything else."""
        match json.loads(text):
            case {
                "files": dict(files),
                "variants": dict(variants),
                "time": float(at),
                "shown": [str(look), str(rig)],
            }:
                each = {Path(name): (base64.b64decode(content), str(known)) for name, (content, known) in files.items()}
                return Work(each, variants, at, (look, rig))
        raise ValueError("is no record of unsaved work")


class Recovery:
    """The record of a Designer, and that of an earlier one of the same `opened` that has ended with unsaved work."""

    def __init__(self, opened: str, folder: Path | None = None) -> None:
        self._folder = (folder or state_folder()) / "designer"
        self._stem = hashlib.sha256(opened.encode()).hexdigest()[:24]
        self._record = self._folder / f"{self._stem}-{secrets.token_hex(4)}.json"
        self._lock: int | None = None
        self._found: Path | None = None
        self.work = self._find()

    def keep(self, work: Work) -> None:
        """Write the record, or remove it where there is nothing unsaved; raises LookdevError where that fails."""
        try:
            if not work.files:
                self._record.unlink(missing_ok=True)
                return
            self._folder.mkdir(parents=True, exist_ok=True)
            if self._lock is None:
                self._lock = os.open(self._lock_of(self._record), os.O_RDWR | os.O_CREAT, 0o600)
                fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            with atomic_path(self._record) as temporary:
                temporary.touch(0o600)
                temporary.write_text(work.packed(), "utf-8")
        except OSError as error:
            hint = f"make room there, or set {STATE_VARIABLE} to another folder"
            raise LookdevError(f"{self._folder}: unsaved work cannot be kept: {error.strerror}; {hint}") from error

    def forget(self) -> None:
        """Remove the record that was found."""
        if self._found is not None:
            self._found.unlink(missing_ok=True)
            self._lock_of(self._found).unlink(missing_ok=True)
        self._found, self.work = None, None

    def close(self) -> bool:
        """End; return whether the record stays, since there is unsaved work."""
        stays = self._record.exists()
        if self._lock is not None:
            if not stays:
                self._lock_of(self._record).unlink(missing_ok=True)
            os.close(self._lock)
            self._lock = None
        return stays

    def _find(self) -> Work | None:
        records = sorted(self._folder.glob(f"{self._stem}-*.json"), key=_age, reverse=True)
        for record in records:
            try:
                if not self._is_locked(record):
                    work = Work.unpacked(record.read_text("utf-8"))
                    self._found = record
                    return work
            except (OSError, ValueError, RecursionError):
                continue
        return None

    def _is_locked(self, record: Path) -> bool:
        try:
            lock = os.open(self._lock_of(record), os.O_RDWR)
        except FileNotFoundError:
            return False
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return True
        finally:
            os.close(lock)
        return False

    @staticmethod
    def _lock_of(record: Path) -> Path:
        return record.with_suffix(".lock")


def _age(file: Path) -> float:
    try:
        return file.stat().st_mtime
    except OSError:
        return 0.0


def now() -> float:
    """Return the time of a record."""
    return time.time()
