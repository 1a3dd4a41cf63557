"""The contents of edited files: their history, what is on disk, and what is kept of unsaved work."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from lookdev.cache import atomic_path
from lookdev.errors import LookdevError
from lookdev.studio.designer.history import History, State
from lookdev.studio.designer.operations import Operation
from lookdev.studio.designer.recovery import Recovery, Work, now
from lookdev.studio.designer.sources import ConflictError, Sources, digest

_FILE_NAME = re.compile(r"[\w][\w .-]{0,100}")


class Workspace:
    """A state with a history, and its files; all in one thread at a time."""

    def __init__(self, recovery: Recovery | None) -> None:
        self.history = History()
        self.sources = Sources()
        self._recovery = recovery

    @property
    def state(self) -> State:
        """What is edited, now."""
        return self.history.state

    def content(self, file: Path) -> bytes:
        """Return the edited content of a file."""
        return self.sources.content(self.state.files, file)

    def edited(self, file: Path, operation: Operation) -> State:
        """Return the state after an edit of a file."""
        with self.sources.beside(file, self.content(file)) as copy:
            operation(copy)
            return replace(self.state, files={**self.state.files, file: copy.read_bytes()})

    def unsaved(self, file: Path) -> bool:
        """Return whether a file lacks edits."""
        return self.sources.unsaved(self.state.files, file)

    def save(self, file: Path | None, *, over: bool) -> list[Path]:
        """Write a file, or all that lack edits; raises ConflictError where one was changed, unless `over`."""
        wanted = [each for each in self.sources.files if self.unsaved(each)] if file is None else [file]
        changed = self.sources.changed()
        if not over and (conflicts := [each for each in wanted if each in changed]):
            raise ConflictError(conflicts)
        for each in wanted:
            self.sources.write(each, self.content(each), over=over)
        return wanted

    def save_as(self, file: Path, name: str) -> Path:
        """Write the edited content of a file to a new one beside it, and return that.

        Raises LookdevError where that exists, or its name does not fit.
        """
        of_job = file.suffix == ".toml"
        if not _FILE_NAME.fullmatch(name) or Path(name).suffix not in {file.suffix, file.suffix if of_job else ".usd"}:
            hint = f"for instance {file.stem}_2{file.suffix}"
            raise LookdevError(f"'{name}' is no name of a file for this {'job' if of_job else 'look'}: {hint}")
        target = file.with_name(name)
        if target.exists() or target.is_symlink():
            raise LookdevError(f"{target} exists already; another name would be right")
        with atomic_path(target) as temporary:
            temporary.write_bytes(self.content(file))
        return target

    def on_disk(self) -> dict[Path, bytes]:
        """Return the contents of files that others have changed; raises LookdevError where there are none."""
        changed = self.sources.changed()
        contents = {file: file.read_bytes() for file in changed if file.is_file()}
        if not contents:
            raise LookdevError(f"{changed[0]} is no longer there" if changed else "no file has changed on disk")
        return contents

    def accept(self, contents: Mapping[Path, bytes]) -> None:
        """Take contents for what is known to be on disk."""
        for file, content in contents.items():
            self.sources.expect(file, digest(content))

    def ignore(self) -> None:
        """Take what others have written for known, so that saving writes over it."""
        for file in self.sources.changed():
            self.sources.expect(file, self.sources.on_disk(file))

    def keep(self, shown: tuple[str, str]) -> None:
        """Keep unsaved work for after a crash."""
        if self._recovery is not None:
            edited = [file for file in self.sources.files if self.unsaved(file)]
            files = {file: (self.content(file), self.sources.known(file)) for file in edited}
            self._recovery.keep(Work(files, self.state.variants, now(), shown))

    @property
    def offered(self) -> Work | None:
        """The unsaved work of a Designer that has ended."""
        return self._recovery.work if self._recovery else None

    def offer(self) -> dict[str, Any] | None:
        """Return what is offered, for the page: its time, its files, and which of them have changed since."""
        if (work := self.offered) is None:
            return None
        files = [
            {"file": str(file), "changed": self.sources.on_disk(file) != known}
            for file, (_, known) in work.files.items()
        ]
        return {"time": work.time, "files": files}

    def recovered(self) -> State:
        """Return the state with the work that is offered; raises LookdevError where none is."""
        work = self.offered
        if work is None:
            raise LookdevError("there is no unsaved work of an earlier Designer")
        for file, (_, known) in work.files.items():
            self.sources.take(file)
            self.sources.expect(file, known)
        files = {**self.state.files, **{file: content for file, (content, _) in work.files.items()}}
        return State(files, {**self.state.variants, **work.variants})

    def forget(self) -> None:
        """Remove the record of the work that is offered."""
        if self._recovery is None or self._recovery.work is None:
            raise LookdevError("there is no unsaved work of an earlier Designer")
        self._recovery.forget()

    def close(self) -> bool:
        """End; return whether there is unsaved work, which stays for the next time."""
        return self._recovery is not None and self._recovery.close()
