"""The ledger of an output folder: the record, on disk, of the files that runs have made from finished frames.

The ledger tells whether a picture or movie on disk is up to date. An entry has a key, which is a digest of all inputs
of a file, and the digest of the content that is made from these inputs. An entry never becomes false, so entries of
several runs can be merged in any order. Each run appends its entries to a file of its own, one entry per line.
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

_MAX_LEDGER_BYTES = 1 << 30  # the maximum size of ``pictures.json``: a larger file is not read

LedgerEntry = tuple[str, str]
"""A key, and the digest of the file's content."""


class Ledger:
    """The entries of an output folder.

    `state` is the state folder in the output folder, and `run` is the id of the run that adds entries.
    """

    def __init__(self, state: Path, run: str = "") -> None:
        self._file = state / "pictures.json"
        self._run_file = state / f"pictures.{run}.jsonl"
        self._stream: TextIO | None = None
        self._merged = _read_merged(self._file)
        self._entries = {name: {entry} for name, entry in self._merged.items()}
        self._offsets: dict[Path, int] = {}  # the number of bytes read so far, by the file of a run
        self._latest: dict[str, LedgerEntry] = {}  # the entry that was read or added last, by the name of a file
        self._read_runs()

    @property
    def names(self) -> list[str]:
        """The paths, relative to the output folder, of all files that have an entry."""
        return sorted(self._entries)

    def add(self, name: str, key: str, digest: str) -> None:
        """Record a file in an entry, and write the entry to disk at once.

        `name` is the path of the file relative to the output folder. `digest` is the digest of its content.
        """
        if self._stream is None:
            self._stream = self._run_file.open("a", encoding="utf-8")
        # The newline comes before the entry. If a full disk cuts off an entry, the next one still starts a new line.
        self._stream.write("\n" + json.dumps([name, key, digest]))
        self._stream.flush()
        self._add_entry(name, (key, digest))

    def has(self, name: str, key: str, file: Path) -> bool:
        """Return whether `file`, recorded under `name`, has the content that is made from the inputs with this key."""
        for is_retry in (False, True):
            if is_retry:  # another run may have recorded the file in the meantime
                self._read_runs()
            digests = {digest for entry_key, digest in self._entries.get(name, ()) if entry_key == key}
            if digests:
                return file.is_file() and file_digest(file) in digests
        return False

    def close(self, living_runs: Iterable[str]) -> None:
        """Close the file of this run, and merge the files of ended runs into ``pictures.json``.

        `living_runs` has the ids of the other runs that have not ended.
        """
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
                # A last line that cannot be parsed may be incomplete: it is read again next time.
                complete = data.rpartition(b"\n")[0] if not _parse_line(data.rpartition(b"\n")[2]) else data
                self._offsets[file] = self._offsets.get(file, 0) + len(complete)
                for line in complete.splitlines():
                    if parts := _parse_line(line):
                        name, key, digest = parts
                        self._add_entry(name, (key, digest))

    def _add_entry(self, name: str, entry: LedgerEntry) -> None:
        """Add an entry of a file to the entries in memory."""
        self._latest[name] = entry
        self._entries.setdefault(name, set()).add(entry)


def _parse_line(line: bytes) -> list[str] | None:
    """Return the name, the key and the digest in a line, or None if the line is incomplete."""
    try:
        parts = json.loads(line)
    except ValueError:
        return None
    is_entry = isinstance(parts, list) and len(parts) == 3 and all(isinstance(part, str) for part in parts)
    return parts if is_entry else None


def _read_merged(file: Path) -> dict[str, LedgerEntry]:
    """Return the entries of ended runs, by name; none if the file is missing, so that every picture is made again."""
    return {
        name: (entry[0], entry[1])
        for name, entry in read_json_object(file, _MAX_LEDGER_BYTES).items()
        if isinstance(entry, list) and len(entry) == 2 and all(isinstance(part, str) for part in entry)
    }
