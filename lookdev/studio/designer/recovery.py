"""Recovery of unsaved work after a crash: each Designer writes a record of its edits until they are saved or discarded.

The record is a file, written after each edit, whole or not at all. The process of the Designer holds a lock on a second
file beside it. A record without a lock belongs to a Designer that has ended: the next Designer of the same job or asset
offers its edits to the user.
"""

from __future__ import annotations

import base64
import fcntl
import hashlib
import json
import os
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lookdev.cache import atomic_path
from lookdev.errors import LookdevError

STATE_VARIABLE = "LOOKDEV_STATE"
"""Environment variable: the folder of state that outlasts a run and, unlike a cache, cannot be computed anew."""


def state_folder() -> Path:
    """Return ``$LOOKDEV_STATE``, else ``$XDG_STATE_HOME/lookdev``, else ``~/.local/state/lookdev``."""
    base = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(os.environ.get(STATE_VARIABLE) or str(Path(base) / "lookdev"))


@dataclass(frozen=True)
class UnsavedWork:
    """The unsaved work of a Designer.

    `files` has the edited content of each file, and the digest of the content that the Designer last knew on disk.
    `variants` is `EditState.variants`. `time` is in seconds since the epoch. `visible` has the names of the visible
    look and rig.
    """

    files: Mapping[Path, tuple[bytes, str]]
    variants: Mapping[str, Mapping[str, str]]
    time: float
    visible: tuple[str, str] = ("", "")

    def to_json(self) -> str:
        """Return the work as JSON."""
        files = {
            str(file): [base64.b64encode(content).decode(), disk_digest]
            for file, (content, disk_digest) in self.files.items()
        }
        return json.dumps({"files": files, "variants": self.variants, "time": self.time, "shown": self.visible})

    @staticmethod
    def from_json(text: str) -> UnsavedWork:
        """Return the work in a text that `to_json` wrote; raise ValueError for any other text."""
        match json.loads(text):
            case {
                "files": dict(files),
                "variants": dict(variants),
                "time": float(seconds),
                "shown": [str(look), str(rig)],
            }:
                contents = {
                    Path(name): (base64.b64decode(content), str(disk_digest))
                    for name, (content, disk_digest) in files.items()
                }
                return UnsavedWork(contents, variants, seconds, (look, rig))
        raise ValueError("is not a record of unsaved work")


class Recovery:
    """The record of a Designer, and the record of unsaved work that an earlier Designer of its job or asset left.

    `opening_key` identifies the job or asset. `work` is the unsaved work of the earlier Designer, or None.
    """

    def __init__(self, opening_key: str, folder: Path | None = None) -> None:
        self._folder = (folder or state_folder()) / "designer"
        self._stem = hashlib.sha256(opening_key.encode()).hexdigest()[:24]
        self._record = self._folder / f"{self._stem}-{secrets.token_hex(4)}.json"
        self._lock: int | None = None
        self._earlier_record: Path | None = None
        self.work = self._find_earlier()

    def store(self, work: UnsavedWork) -> None:
        """Write the record, or remove it if there is no unsaved work; raise LookdevError if that fails."""
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
                temporary.write_text(work.to_json(), "utf-8")
        except OSError as error:
            hint = f"make room there, or set {STATE_VARIABLE} to another folder"
            raise LookdevError(f"{self._folder}: unsaved work cannot be kept: {error.strerror}; {hint}") from error

    def forget(self) -> None:
        """Remove the record of the earlier Designer."""
        if self._earlier_record is not None:
            self._earlier_record.unlink(missing_ok=True)
            self._lock_of(self._earlier_record).unlink(missing_ok=True)
        self._earlier_record, self.work = None, None

    def close(self) -> bool:
        """Release the lock; return whether there is unsaved work, whose record stays."""
        has_record = self._record.exists()
        if self._lock is not None:
            if not has_record:
                self._lock_of(self._record).unlink(missing_ok=True)
            os.close(self._lock)
            self._lock = None
        return has_record

    def _find_earlier(self) -> UnsavedWork | None:
        """Return the newest valid work without a lock, and remember its record; None if there is none."""
        records = sorted(self._folder.glob(f"{self._stem}-*.json"), key=_modification_time, reverse=True)
        for record in records:
            try:
                if not self._is_locked(record):
                    work = UnsavedWork.from_json(record.read_text("utf-8"))
                    self._earlier_record = record
                    return work
            except (OSError, ValueError, RecursionError):
                continue
        return None

    def _is_locked(self, record: Path) -> bool:
        """Return whether a running Designer holds the lock of a record."""
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
        """Return the file whose lock belongs to a record."""
        return record.with_suffix(".lock")


def _modification_time(file: Path) -> float:
    """Return when a file was last written; 0 if it no longer exists."""
    try:
        return file.stat().st_mtime
    except OSError:
        return 0.0
