"""Export of jobs to other programs: a .blend, scenes of Mitsuba, a job of a farm; and copies of the example jobs."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class ExportResult:
    """The files that an export wrote, text about them and their use, and notes for the user."""

    files: tuple[Path, ...]
    text: str
    notes: tuple[str, ...]
