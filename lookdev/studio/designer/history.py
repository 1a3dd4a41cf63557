"""The state of all edits in the Designer, and the history of states, for undo and redo."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

MAX_STEPS = 200
"""Largest number of steps that can be undone."""
MAX_BYTES = 256 << 20
"""Approximate limit of the contents of all states of a history, in bytes; the oldest steps are dropped first."""


@dataclass(frozen=True)
class EditState:
    """The contents of edited files, by path, and the variants that only the page shows.

    `variants` has the chosen variant of each variant set, by the look's ``file<prim>``.
    """

    files: Mapping[Path, bytes] = field(default_factory=dict)
    variants: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


@dataclass(frozen=True)
class _Step:
    """A step of the history: its label, the state after it, and the gesture to which it belongs, if any."""

    label: str
    state: EditState
    gesture: str = ""


class History:
    """A list of states, each reached by a step with a label, and the index of the present state in it.

    Consecutive steps of one gesture, such as the drag of a slider, are merged into one step.
    """

    def __init__(self) -> None:
        self._steps = [_Step("", EditState())]
        self._index = 0

    @property
    def state(self) -> EditState:
        """The present state."""
        return self._steps[self._index].state

    @property
    def undo_label(self) -> str | None:
        """The label of the step that can be undone, or None."""
        return self._steps[self._index].label if self._index else None

    @property
    def redo_label(self) -> str | None:
        """The label of the step that can be redone, or None."""
        return self._steps[self._index + 1].label if self._index + 1 < len(self._steps) else None

    def push(self, label: str, state: EditState, gesture: str = "") -> None:
        """Add a step that leads to a new state; steps that were undone are dropped."""
        del self._steps[self._index + 1 :]
        if gesture and self._index and self._steps[-1].gesture == gesture:
            self._steps[-1] = _Step(label, state, gesture)
            return
        self._steps.append(_Step(label, state, gesture))
        while len(self._steps) > 2 and (len(self._steps) > MAX_STEPS + 1 or self._size() > MAX_BYTES):
            del self._steps[0]
        self._index = len(self._steps) - 1

    def copy(self) -> History:
        """Return a history with the same steps."""
        duplicate = History()
        duplicate._steps, duplicate._index = list(self._steps), self._index
        return duplicate

    def step(self, direction: int) -> str | None:
        """Undo (`direction` -1) or redo (1) a step; return its label, or None if there is no such step."""
        label = self.undo_label if direction < 0 else self.redo_label
        if label is not None:
            self._index += direction
        return label

    def _size(self) -> int:
        """Return the bytes of the contents of all states; a content that several states share counts once."""
        return sum(map(len, {id(content): content for content in self._contents()}.values()))

    def _contents(self) -> Iterator[bytes]:
        """Yield the contents of the edited files of all states."""
        for step in self._steps:
            yield from step.state.files.values()
