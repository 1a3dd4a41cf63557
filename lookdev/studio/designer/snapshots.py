"""Snapshots: pictures of what was shown, each with the state of the looks. They last as long as the server."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from lookdev.errors import LookdevError
from lookdev.studio.designer.history import State

MOST = 24
LARGEST = 4 << 20
"""Bytes of a picture."""
_PNG = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True)
class Snapshot:
    """A picture as PNG, the state, the names of look and rig, and seconds of the epoch."""

    number: int
    picture: bytes
    state: State
    chosen: tuple[str, str]
    time: float

    @property
    def name(self) -> str:
        return f"snapshot {self.number}"


class Snapshots:
    """Snapshots by number; of more than `MOST` the oldest go."""

    def __init__(self) -> None:
        self._kept: dict[int, Snapshot] = {}
        self._next = 1

    def keep(self, picture: bytes, state: State, chosen: tuple[str, str]) -> None:
        """Keep a snapshot; raises LookdevError where the picture is no PNG, or too large."""
        if not picture.startswith(_PNG) or len(picture) > LARGEST:
            raise LookdevError(f"a snapshot is a PNG of at most {LARGEST >> 20} MiB")
        self._kept[self._next] = Snapshot(self._next, picture, state, chosen, time.time())
        self._next += 1
        if len(self._kept) > MOST:
            del self._kept[min(self._kept)]

    def drop(self, number: int) -> None:
        """Forget a snapshot."""
        del self._kept[self[number].number]

    def __getitem__(self, number: int) -> Snapshot:
        if number not in self._kept:
            raise LookdevError(f"there is no snapshot {number}")
        return self._kept[number]

    def listed(self) -> list[dict[str, Any]]:
        """Return number, name, time, look and rig of each, the oldest first."""
        return [
            {"number": each.number, "name": each.name, "time": each.time, "look": each.chosen[0], "rig": each.chosen[1]}
            for each in self._kept.values()
        ]
