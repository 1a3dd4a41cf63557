"""``manifest.json``: the files of a job's output, and the inputs of its render, each with its SHA-256.

The manifest is one JSON document:

    format, job, command, versions, view, settings, inputs, planned, frames, pictures

``job`` is the job's file, ``command`` renders it again, ``versions`` are the versions of this program, Python and
NumPy, ``view`` is the view of the pictures, and ``settings`` are tables of the job. ``inputs``, ``frames`` and
``pictures`` are lists of ``{file, sha256}``; paths of inputs are absolute, other paths are relative to the manifest's
folder. A frame also has its ``header``, and the ``command`` that renders it again. ``planned`` is the number of frames'
files of the whole job: after an interrupted run, ``frames`` lists fewer.
"""

from __future__ import annotations

import filecmp
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from lookdev.cache import atomic_path, file_digest
from lookdev.errors import OutputError
from lookdev.safe_text import TextError, parse_json, read_text

NAME = "manifest.json"
FORMAT = 1
"""The number of the format of manifests; each manifest has it, and `read_manifest` accepts no other number."""

STATE_FOLDER = ".lookdev"
"""Folder inside the output folder with files about runs: claims of frames, logs, ledgers and temporary files."""

FileState = Literal["missing", "changed", "unlisted"]
_MAX_BYTES = 1 << 30  # largest size of a manifest, in bytes: 250000 frames of 2 KiB fit


@dataclass(frozen=True)
class Deviation:
    """A file that differs from its entry in a manifest.

    Its state is ``missing`` or ``changed``, or ``unlisted`` for an EXR in the output folder without an entry.
    """

    file: Path
    state: FileState
    kind: str  # "frame", "picture" or "input"

    @property
    def is_failure(self) -> bool:
        """Whether the deviation makes the manifest wrong."""
        return self.state != "unlisted"

    def __str__(self) -> str:
        return f"{self.state}: {self.kind} {self.file}"


def write_manifest(folder: Path, manifest: Mapping[str, Any]) -> Path:
    """Write the manifest of an output folder, complete or not at all, and return its path.

    If the content does not change, the file keeps its modification time. Lists may be iterators, whose entries are
    written one after the other.
    """
    path = folder / NAME
    with atomic_path(path) as temporary:
        with temporary.open("w", encoding="utf-8") as stream:
            stream.writelines(_lines({"format": FORMAT, **manifest}))
        if path.is_file() and filecmp.cmp(temporary, path, shallow=False):
            os.utime(temporary, ns=(path.stat().st_atime_ns, path.stat().st_mtime_ns))
    return path


def _lines(manifest: Mapping[str, Any]) -> Iterator[str]:
    """Yield the text of a manifest in pieces; each entry of a list is a line.

    The `indent` of the module json is far slower.
    """
    yield "{"
    for number, (key, value) in enumerate(manifest.items()):
        yield f"{',' if number else ''}\n {json.dumps(key)}: "
        if isinstance(value, (list, Iterator)):
            yield "["
            for index, entry in enumerate(value):
                yield f"{',' if index else ''}\n  {json.dumps(entry)}"
            yield "\n ]"
        else:
            yield json.dumps(value)
    yield "\n}\n"


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of an output folder; raises OutputError where it is missing or damaged."""
    path = folder / NAME
    try:
        manifest = parse_json(read_text(path, _MAX_BYTES), path)
    except TextError as error:
        raise OutputError(f"{error}; 'lookdev render' of the job writes the manifest of its output") from error
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT or not _is_complete(manifest):
        raise OutputError(f"{path}: is not a manifest of format {FORMAT}; 'lookdev render' of the job makes it again")
    return manifest


def deviations(folder: Path, manifest: Mapping[str, Any]) -> Iterator[Deviation]:
    """Yield the missing, changed and unlisted files of an output folder, and the missing and changed inputs."""
    listed = set()
    for kind in ("frame", "picture", "input"):
        for entry in manifest[f"{kind}s"]:
            file = folder / entry["file"]
            listed.add(file)
            try:
                state: FileState | None = None if file_digest(file) == entry["sha256"] else "changed"
            except OSError:
                state = "missing"
            if state is not None:
                yield Deviation(file, state, kind)
    for file in sorted(folder.glob("*/*/[!.]*.exr")):
        if file not in listed:
            yield Deviation(file, "unlisted", "frame")


def _is_complete(manifest: Mapping[str, Any]) -> bool:
    """Return whether a manifest has its lists of files, with a path and a digest in each entry."""
    lists: Sequence[Any] = [manifest.get(key) for key in ("frames", "pictures", "inputs")]
    return all(isinstance(entries, list) and all(map(_is_file_entry, entries)) for entries in lists)


def _is_file_entry(entry: Any) -> bool:
    """Return whether an entry of a list has a path and a digest."""
    return isinstance(entry, dict) and isinstance(entry.get("file"), str) and isinstance(entry.get("sha256"), str)
