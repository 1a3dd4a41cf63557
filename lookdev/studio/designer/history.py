"""What the Designer has edited, as values, and the history of them: undo and redo of everything."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

LONGEST = 200
"""Steps that can be undone."""
LARGEST = 256 << 20
"""Bytes of all contents of files in a history, about; the oldest steps go first."""


@dataclass(frozen=True)
class State:
    """The contents of edited files, and variants that are shown without being in a file, by look (``file<prim>``)."""

    files: Mapping[Path, bytes] = field(default_factory=dict)
    variants: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


@dataclass(frozen=True)
class _Step:
    label: str
    state: State
    gesture: str = ""


class History:
    """States, each after a step with a label. Steps of one gesture are one step."""

    def __init__(self) -> None:
        self._steps = [_Step("", State())]
        self._at = 0

    @property
    def state(self) -> State:
        return self._steps[self._at].state

    @property
    def undoes(self) -> str | None:
        """The label of the step that would be undone."""
        return self._steps[self._at].label if self._at else None

    @property
    def redoes(self) -> str | None:
        """The label of the step that would be done again."""
        return self._steps[self._at + 1].label if self._at + 1 < len(self._steps) else None

    def push(self, label: str, state: State, gesture: str = "") -> None:
        """Make a step; what was undone is forgotten."""
        del self._steps[self._at + 1 :]
        if gesture and self._at and self._steps[-1].gesture == gesture:
            self._steps[-1] = _Step(label, state, gesture)
            return
        self._steps.append(_Step(label, state, gesture))
        while len(self._steps) > 2 and (len(self._steps) > LONGEST + 1 or self._size() > LARGEST):
            del self._steps[0]
        self._at = len(self._steps) - 1

    def copy(self) -> History:
        """Return a history of the same steps."""
        made = History()
        made._steps, made._at = list(self._steps), self._at
        return made

    def step(self, by: int) -> str | None:
        """Undo (-1) or redo (1) a step, and return its label; None where there is none."""
        label = self.undoes if by < 0 else self.redoes
        if label is not None:
            self._at += by
        return label

    def _size(self) -> int:
        return sum(map(len, {id(each): each for each in self._contents()}.values()))

    def _contents(self) -> Iterator[bytes]:
        for step in self._steps:
            yield from step.state.files.values()
