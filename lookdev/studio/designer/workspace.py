"""The files that the Designer edits: their edits with the history, the files on disk, and recovery of unsaved work."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from lookdev.cache import write_file
from lookdev.errors import LookdevError
from lookdev.studio.designer.history import EditState, History
from lookdev.studio.designer.operations import FileEdit
from lookdev.studio.designer.recovery import Recovery, UnsavedWork
from lookdev.studio.designer.sources import ConflictError, SourceFiles, digest

_FILE_NAME = re.compile(r"[\w][\w .-]{0,100}")  # a valid name of a new file


class Workspace:
    """The state of all edits, with its history and its files; not thread-safe.

    `offered_work` is the unsaved work of an earlier Designer, which the user can restore or discard.
    """

    def __init__(self, recovery: Recovery | None) -> None:
        self.history = History()
        self.sources = SourceFiles()
        self._recovery = recovery

    @property
    def state(self) -> EditState:
        """The present state of all edits."""
        return self.history.state

    def content(self, file: Path) -> bytes:
        """Return the present content of a file: its edited content, or its original one."""
        return self.sources.content(self.state.files, file)

    def apply_edit(self, file: Path, operation: FileEdit) -> EditState:
        """Return the state after an operation on a file; the present state does not change."""
        with self.sources.copy_beside(file, self.content(file)) as copy:
            operation(copy)
            return replace(self.state, files={**self.state.files, file: copy.read_bytes()})

    def is_unsaved(self, file: Path) -> bool:
        """Return whether a file has edits that are not on disk."""
        return self.sources.is_unsaved(self.state.files, file)

    def save(self, file: Path | None, *, overwrite: bool) -> list[Path]:
        """Write a file, or all files with unsaved edits; return the files that were written.

        Raises ConflictError if one of them has changed on disk, unless `overwrite` is true.
        """
        targets = [target for target in self.sources.files if self.is_unsaved(target)] if file is None else [file]
        changed = self.sources.changed_files()
        if not overwrite and (conflicts := [target for target in targets if target in changed]):
            raise ConflictError(conflicts)
        for target in targets:
            self.sources.write(target, self.content(target), overwrite=overwrite)
        return targets

    def save_as(self, file: Path, name: str) -> Path:
        """Write the edited content of a file to a new file beside it, and return the new file.

        Raises LookdevError if the new file exists, or its name is not valid.
        """
        is_job = file.suffix == ".toml"
        if not _FILE_NAME.fullmatch(name) or Path(name).suffix not in {file.suffix, file.suffix if is_job else ".usd"}:
            hint = f"{file.stem}_2{file.suffix} would be right"
            raise LookdevError(f"'{name}' is not a file name for this {'job' if is_job else 'look'}; {hint}")
        target = file.with_name(name)
        if target.exists() or target.is_symlink():
            raise LookdevError(f"{target} exists already; another name would be right")
        write_file(target, self.content(file))
        return target

    def changed_contents(self) -> dict[Path, bytes]:
        """Return the contents of files that other programs have changed; raise LookdevError if there are none."""
        changed = self.sources.changed_files()
        contents = {file: file.read_bytes() for file in changed if file.is_file()}
        if not contents:
            raise LookdevError(f"{changed[0]} is no longer there" if changed else "no file has changed on disk")
        return contents

    def accept(self, contents: Mapping[Path, bytes]) -> None:
        """Record that files have these contents on disk, as other programs have written them."""
        for file, content in contents.items():
            self.sources.set_known_digest(file, digest(content))

    def accept_disk(self) -> None:
        """Record changes by other programs as known, so that saving overwrites them."""
        for file in self.sources.changed_files():
            self.sources.set_known_digest(file, self.sources.digest_on_disk(file))

    def store_unsaved(self, scene_key: tuple[str, str]) -> None:
        """Store unsaved work, for recovery after a crash; `scene_key` has the names of the visible look and rig."""
        if self._recovery is not None:
            edited_files = [file for file in self.sources.files if self.is_unsaved(file)]
            files = {file: (self.content(file), self.sources.known_digest(file)) for file in edited_files}
            self._recovery.store(UnsavedWork(files, self.state.variants, time.time(), scene_key))

    @property
    def offered_work(self) -> UnsavedWork | None:
        """The unsaved work of a Designer that has ended, if there is any."""
        return self._recovery.work if self._recovery else None

    def describe_offer(self) -> dict[str, Any] | None:
        """Return the offered work for the page: its time, its files, and which files have changed since."""
        if (work := self.offered_work) is None:
            return None
        files = [
            {"file": str(file), "changed": self.sources.digest_on_disk(file) != known_digest}
            for file, (_, known_digest) in work.files.items()
        ]
        return {"time": work.time, "files": files}

    def recovered_state(self) -> EditState:
        """Track the files of the offered work, and return the present state with its edits.

        Raises LookdevError if no work is offered.
        """
        work = self.offered_work
        if work is None:
            raise LookdevError("there is no unsaved work of an earlier Designer")
        for file, (_, known_digest) in work.files.items():
            self.sources.track(file)
            self.sources.set_known_digest(file, known_digest)
        files = {**self.state.files, **{file: content for file, (content, _) in work.files.items()}}
        return EditState(files, {**self.state.variants, **work.variants})

    def forget_offer(self) -> None:
        """Remove the record of the offered work; raise LookdevError if no work is offered."""
        if self._recovery is None or self._recovery.work is None:
            raise LookdevError("there is no unsaved work of an earlier Designer")
        self._recovery.forget()

    def close(self) -> bool:
        """End recovery; return whether there is unsaved work, which the next Designer offers."""
        return self._recovery is not None and self._recovery.close()
