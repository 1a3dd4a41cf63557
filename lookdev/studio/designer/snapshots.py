"""Snapshots of the Designer: pictures of the viewport, each with the state of the looks, to which a user can go back.

They last as long as the server.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from lookdev.errors import LookdevError
from lookdev.studio.designer.history import EditState

MAX_SNAPSHOTS = 24
MAX_PICTURE_BYTES = 4 << 20
"""Largest size of a picture, in bytes."""
_PNG = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True)
class Snapshot:
    """A picture as PNG, the state of the looks, and the names of the visible look and rig.

    `number` counts the snapshots from 1. `time` is in seconds since the epoch.
    """

    number: int
    picture: bytes
    state: EditState
    visible: tuple[str, str]
    time: float

    @property
    def name(self) -> str:
        """The name of the snapshot for the user."""
        return f"snapshot {self.number}"


class Snapshots:
    """Snapshots by number: the last `MAX_SNAPSHOTS` ones."""

    def __init__(self) -> None:
        self._snapshots: dict[int, Snapshot] = {}
        self._next = 1

    def store(self, picture: bytes, state: EditState, scene_key: tuple[str, str]) -> None:
        """Store a snapshot; raise LookdevError if the picture is not a PNG, or is too large."""
        if not picture.startswith(_PNG) or len(picture) > MAX_PICTURE_BYTES:
            raise LookdevError(f"a snapshot is a PNG of at most {MAX_PICTURE_BYTES >> 20} MiB")
        self._snapshots[self._next] = Snapshot(self._next, picture, state, scene_key, time.time())
        self._next += 1
        if len(self._snapshots) > MAX_SNAPSHOTS:
            del self._snapshots[min(self._snapshots)]

    def drop(self, number: int) -> None:
        """Delete a snapshot."""
        del self._snapshots[self[number].number]

    def __getitem__(self, number: int) -> Snapshot:
        if number not in self._snapshots:
            raise LookdevError(f"there is no snapshot {number}")
        return self._snapshots[number]

    def describe(self) -> list[dict[str, Any]]:
        """Return number, name, time, look and rig of each snapshot, the oldest first."""
        return [
            {
                "number": snapshot.number,
                "name": snapshot.name,
                "time": snapshot.time,
                "look": snapshot.visible[0],
                "rig": snapshot.visible[1],
            }
            for snapshot in self._snapshots.values()
        ]
