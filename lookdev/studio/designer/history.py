"""The state of the Designer's edits, and its history: undo and redo of all edits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

LONGEST = 200
"""Largest number of steps that can be undone."""
LARGEST = 256 << 20
"""Approximate limit of all contents of files in a history, in bytes; the oldest steps are dropped first."""


@dataclass(frozen=True)
class EditState:
    """The contents of edited files, and the variants that only the page shows, by look (``file<prim>``)."""

    files: Mapping[Path, bytes] = field(default_factory=dict)
    variants: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


@dataclass(frozen=True)
class _Step:
    label: str
    state: EditState
    gesture: str = ""


class History:
    """A list of states, each reached by a step with a label. Steps of one gesture are merged into one step."""

    def __init__(self) -> None:
        self._steps = [_Step("", EditState())]
        self._at = 0

    @property
    def state(self) -> EditState:
        return self._steps[self._at].state

    @property
    def undoes(self) -> str | None:
        """The label of the step that undo would undo; None if there is none."""
        return self._steps[self._at].label if self._at else None

    @property
    def redoes(self) -> str | None:
        """The label of the step that redo would redo; None if there is none."""
        return self._steps[self._at + 1].label if self._at + 1 < len(self._steps) else None

    def push(self, label: str, state: EditState, gesture: str = "") -> None:
        """Add a step to a new state; steps that were undone are dropped."""
        del self._steps[self._at + 1 :]
        if gesture and self._at and self._steps[-1].gesture == gesture:
            self._steps[-1] = _Step(label, state, gesture)
            return
        self._steps.append(_Step(label, state, gesture))
        while len(self._steps) > 2 and (len(self._steps) > LONGEST + 1 or self._size() > LARGEST):
            del self._steps[0]
        self._at = len(self._steps) - 1

    def copy(self) -> History:
        """Return a history with the same steps."""
        duplicate = History()
        duplicate._steps, duplicate._at = list(self._steps), self._at
        return duplicate

    def step(self, direction: int) -> str | None:
        """Undo (`direction` -1) or redo (1) a step; return its label, or None if there is no such step."""
        label = self.undoes if direction < 0 else self.redoes
        if label is not None:
            self._at += direction
        return label

    def _size(self) -> int:
        return sum(map(len, {id(content): content for content in self._contents()}.values()))

    def _contents(self) -> Iterator[bytes]:
        for step in self._steps:
            yield from step.state.files.values()
