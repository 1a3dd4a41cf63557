"""What the files that outputs made are made of, on disk, while any number of runs make them.

An entry states that the content of a digest is what the key describes, which stays true: so entries of several runs are
put together in any order. Each run appends to a file of its own, a line an entry; ``pictures.json`` has all those of
runs that have ended.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import TextIO

from lookdev.cache import atomic_path, file_digest
from lookdev.text import TextError, parse_json, read_text

_LARGEST = 1 << 30  # bytes

Entry = tuple[str, str]
"""Key and digest."""


class Ledger:
    """The entries of an output folder; those of the run `own` are written as they are made."""

    def __init__(self, state: Path, own: str = "") -> None:
        self._file = state / "pictures.json"
        self._own = state / f"pictures.{own}.jsonl"
        self._stream: TextIO | None = None
        self._whole = _read_whole(self._file)
        self._entries = {name: {entry} for name, entry in self._whole.items()}
        self._read: dict[Path, int] = {}
        self._latest: dict[str, Entry] = {}
        self._read_runs()

    @property
    def names(self) -> list[str]:
        """The files that outputs have made, by their paths in the output folder."""
        return sorted(self._entries)

    def add(self, name: str, key: str, digest: str) -> None:
        """Note that a file was made."""
        if self._stream is None:
            self._stream = self._own.open("a", encoding="utf-8")
        # The end of the line comes first: what a full disk has cut off spoils no other entry.
        self._stream.write("\n" + json.dumps([name, key, digest]))
        self._stream.flush()
        self._take(name, (key, digest))

    def has(self, name: str, key: str, file: Path) -> bool:
        """Return whether a file is what a key describes."""
        for again in (False, True):
            if again:
                self._read_runs()
            digests = {digest for known, digest in self._entries.get(name, ()) if known == key}
            if digests:
                return file.is_file() and file_digest(file) in digests
        return False

    def close(self, living: Iterable[str]) -> None:
        """End the own file, and put what ended runs have written into one; `living` are the other runs."""
        if self._stream is not None:
            self._stream.close()
        self._read_runs()
        kept = {self._own.with_name(f"pictures.{run}.jsonl") for run in living}
        ended = [file for file in self._read if file not in kept]
        if not ended:
            return
        whole = self._whole | self._latest
        if whole != self._whole:
            with atomic_path(self._file) as temporary:
                temporary.write_text(json.dumps(whole, indent=0))
        for file in ended:
            file.unlink(missing_ok=True)

    def _read_runs(self) -> None:
        """Read what runs have written since it was read last."""
        for file in sorted(self._file.parent.glob("pictures.*.jsonl")):
            with suppress(OSError), file.open("rb") as stream:
                stream.seek(self._read.get(file, 0))
                data = stream.read()
                # The last line may still grow.
                whole = data.rpartition(b"\n")[0] if not _parsed(data.rpartition(b"\n")[2]) else data
                self._read[file] = self._read.get(file, 0) + len(whole)
                for line in whole.splitlines():
                    if entry := _parsed(line):
                        name, key, digest = entry
                        self._take(name, (key, digest))

    def _take(self, name: str, entry: Entry) -> None:
        self._latest[name] = entry
        self._entries.setdefault(name, set()).add(entry)


def _parsed(line: bytes) -> list[str] | None:
    """Return the parts of a line; None where it is cut off."""
    try:
        found = json.loads(line)
    except ValueError:
        return None
    return found if isinstance(found, list) and len(found) == 3 and all(isinstance(e, str) for e in found) else None


def _read_whole(file: Path) -> dict[str, Entry]:
    try:
        found = parse_json(read_text(file, _LARGEST), file)
    except TextError:  # lost or spoilt: every picture is made again
        return {}
    pairs = found.items() if isinstance(found, dict) else ()
    return {
        name: (entry[0], entry[1])
        for name, entry in pairs
        if isinstance(entry, list) and len(entry) == 2 and all(isinstance(each, str) for each in entry)
    }
