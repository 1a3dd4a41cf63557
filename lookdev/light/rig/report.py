"""What is wrong with a rig, and what the user should know of it, collected while it is read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from pxr import Sdf

from lookdev.errors import EnvironmentMapError, Fault, FaultsError, TextureError


@dataclass(eq=False)
class Report:
    """Faults and notes of the rig in `file`, in the order in which they are found."""

    file: str
    faults: list[Fault] = field(default_factory=list)
    notes: dict[str, None] = field(default_factory=dict)

    def fault(self, place: Sdf.Path | str, what: str, hint: str = "") -> None:
        self.faults.append(Fault(self.file, str(place), what, hint))

    def note(self, place: Sdf.Path | str, what: str) -> None:
        self.notes[f"{self.file}: {place}: {what}"] = None

    @contextmanager
    def collected(self, place: Sdf.Path | str) -> Iterator[None]:
        """Turn an error of a light, of its image or of its profile into a fault at its place."""
        try:
            yield
        except FaultsError as error:
            for each in error.faults:
                self.fault(place, f"{each.file}: {each.where + ': ' if each.where else ''}{each.what}", each.hint)
        except (EnvironmentMapError, TextureError) as error:
            self.fault(place, str(error))
