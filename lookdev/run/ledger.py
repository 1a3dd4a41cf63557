"""The record of the files that outputs make, on disk, while any number of runs make them.

An entry states that content with this digest is the file that the key describes. This remains true, so entries of
several runs can be merged in any order. Each run appends its entries to a file of its own, one entry a line.
``pictures.json`` has the entries of all runs that have ended.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import TextIO

from lookdev.cache import file_digest, write_file
from lookdev.safe_text import read_json_object

_MAX_LEDGER_BYTES = 1 << 30  # bytes

LedgerEntry = tuple[str, str]
"""A key and a digest."""


class Ledger:
    """The entries of an output folder. The run with the id `run` writes its entries at once."""

    def __init__(self, state: Path, run: str = "") -> None:
        self._file = state / "pictures.json"
        self._run_file = state / f"pictures.{run}.jsonl"
        self._stream: TextIO | None = None
        self._merged = _read_merged(self._file)
        self._entries = {name: {entry} for name, entry in self._merged.items()}
        self._offsets: dict[Path, int] = {}  # of what is not read yet, in files of runs
        self._latest: dict[str, LedgerEntry] = {}
        self._read_runs()

    @property
    def names(self) -> list[str]:
        """The files that outputs have made, by their paths in the output folder."""
        return sorted(self._entries)

    def add(self, name: str, key: str, digest: str) -> None:
        """Record a file: its path in the output folder, its key and its digest."""
        if self._stream is None:
            self._stream = self._run_file.open("a", encoding="utf-8")
        # The line end comes first: an entry that a full disk cuts off then spoils no other entry.
        self._stream.write("\n" + json.dumps([name, key, digest]))
        self._stream.flush()
        self._add_entry(name, (key, digest))

    def has(self, name: str, key: str, file: Path) -> bool:
        """Return whether a file has the content that its key describes."""
        for is_retry in (False, True):
            if is_retry:
                self._read_runs()
            digests = {digest for entry_key, digest in self._entries.get(name, ()) if entry_key == key}
            if digests:
                return file.is_file() and file_digest(file) in digests
        return False

    def close(self, living_runs: Iterable[str]) -> None:
        """Close the file of this run, and merge those of ended runs; `living_runs` are the ids of the other runs."""
        if self._stream is not None:
            self._stream.close()
        self._read_runs()
        growing = {self._run_file.with_name(f"pictures.{run}.jsonl") for run in living_runs}
        ended = [file for file in self._offsets if file not in growing]
        if not ended:
            return
        merged = self._merged | self._latest
        if merged != self._merged:
            write_file(self._file, json.dumps(merged, indent=0))
        for file in ended:
            file.unlink(missing_ok=True)

    def _read_runs(self) -> None:
        """Read the entries that runs have written since the last call."""
        for file in sorted(self._file.parent.glob("pictures.*.jsonl")):
            with suppress(OSError), file.open("rb") as stream:
                stream.seek(self._offsets.get(file, 0))
                data = stream.read()
                # The last line may still grow.
                complete = data.rpartition(b"\n")[0] if not _parse_line(data.rpartition(b"\n")[2]) else data
                self._offsets[file] = self._offsets.get(file, 0) + len(complete)
                for line in complete.splitlines():
                    if parts := _parse_line(line):
                        name, key, digest = parts
                        self._add_entry(name, (key, digest))

    def _add_entry(self, name: str, entry: LedgerEntry) -> None:
        self._latest[name] = entry
        self._entries.setdefault(name, set()).add(entry)


def _parse_line(line: bytes) -> list[str] | None:
    """Return name, key and digest of a line; None where the line is cut off."""
    try:
        parts = json.loads(line)
    except ValueError:
        return None
    is_entry = isinstance(parts, list) and len(parts) == 3 and all(isinstance(part, str) for part in parts)
    return parts if is_entry else None


def _read_merged(file: Path) -> dict[str, LedgerEntry]:
    """Return the entries of ended runs; without the file, every picture is made again."""
    return {
        name: (entry[0], entry[1])
        for name, entry in read_json_object(file, _MAX_LEDGER_BYTES).items()
        if isinstance(entry, list) and len(entry) == 2 and all(isinstance(part, str) for part in entry)
    }
