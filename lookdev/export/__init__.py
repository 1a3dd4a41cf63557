"""Exports jobs to other programs: as a .blend, as scenes of Mitsuba, or as a job of a render farm.

`examples` copies the example jobs.
"""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class ExportResult:
    """The result of an export: the written files, a text about the files and their use, and notes for the user."""

    files: tuple[Path, ...]
    text: str
    notes: tuple[str, ...]
