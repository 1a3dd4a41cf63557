"""Faults and notes of a rig, collected while it is read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from pxr import Sdf

from lookdev.errors import EnvironmentMapError, Fault, FaultsError, TextureError


@dataclass(eq=False)
class RigReport:
    """Faults and notes of the rig in `file`, in the order in which they occur."""

    file: str
    faults: list[Fault] = field(default_factory=list)
    notes: dict[str, None] = field(default_factory=dict)

    def fault(self, path: Sdf.Path | str, problem: str, hint: str = "") -> None:
        self.faults.append(Fault(self.file, str(path), problem, hint))

    def note(self, path: Sdf.Path | str, text: str) -> None:
        self.notes[f"{self.file}: {path}: {text}"] = None

    @contextmanager
    def collect(self, path: Sdf.Path | str) -> Iterator[None]:
        """Turn an error of a light, of its image or of its profile into a fault of a path."""
        try:
            yield
        except FaultsError as error:
            for fault in error.faults:
                self.fault(path, f"{fault.file}: {fault.where + ': ' if fault.where else ''}{fault.what}", fault.hint)
        except (EnvironmentMapError, TextureError) as error:
            self.fault(path, str(error))
