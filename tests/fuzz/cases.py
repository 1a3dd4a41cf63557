"""What a case of a malformed input is, what became of it, and whether that is right.

A `Kind` of input makes its cases from a seed and a number. A case is written to a folder and read, and becomes

    sound     the result equals that of the sound input
    noted     it is read, and a note names the place
    refused   an error of lookdev names the file and the place
    silent    the result differs without a word
    unclear   an error or a note does not name the place, is longer than 2,000 characters, or has control characters
    traceback any other exception
    stderr    a library has written to stderr

and, found by the pool that runs it in another process: hang, memory, crash.
"""

import random
import re
import tempfile
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from lookdev.errors import LookdevError

REFUSED, NOTED, SOUND = frozenset({"refused"}), frozenset({"noted"}), frozenset({"sound"})
NAMED, ANY = REFUSED | NOTED, REFUSED | NOTED | SOUND
ANY_MEANING = ANY | {"silent"}
"""Where a changed text may be right, with another meaning."""
LONGEST = 2000  # characters of a message
_CONTROLS = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e]")


@dataclass(frozen=True)
class Reading:
    """What was read: `result` is compared with that of the sound input, `notes` are those the user gets."""

    result: Mapping[str, object]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Shown:
    """How a case is rendered: the job that shows its files, and those that are right, by name.

    Each of `right` is called with an empty folder and the notes, writes its files and returns the text of their job.
    Where nothing was noted, only that of the name "sound" is right.
    """

    job: str
    right: Mapping[str, Callable[[Path, str], str]]


@dataclass(frozen=True)
class Case:
    """An input with one thing wrong.

    `expected` are the outcomes that are right. An error must contain each of `error_names`, a note those of
    `note_names`; a word may be a choice of several, "points|faceVertexIndices".
    """

    title: str
    expected: frozenset[str]
    read: Callable[[], Reading]
    sound: Callable[[], Reading]
    error_names: tuple[str, ...] = ()
    note_names: tuple[str, ...] = ()
    shown: Shown | None = None


@dataclass(frozen=True)
class Kind:
    """A kind of input: `make(rng, number, folder)` writes the files of a case into an empty folder.

    The first `count` numbers are different cases; later ones are the same faults with other numbers or other files.
    `sorts` are those of the first numbers, and repeat.
    """

    name: str
    make: Callable[[random.Random, int, Path], Case]
    count: int
    sorts: tuple[str, ...]

    def sample(self, seed: int, count: int) -> list[int]:
        """Return numbers of cases: each sort in turn, in a random order, until there are `count`, or one of each."""
        rng, turns = random.Random(seed), dict.fromkeys(self.sorts, 0)
        numbers = rng.sample(range(self.count), self.count)
        ranked = []
        for number in numbers:
            sort = self.sorts[number % len(self.sorts)]
            ranked.append((turns[sort], number))
            turns[sort] += 1
        ranked.sort(key=lambda pair: pair[0])
        return [number for _, number in ranked[: max(count, len(turns))]]


def planned_kind(
    name: str,
    plan: Sequence[tuple[Any, ...]],
    make: Callable[[random.Random, tuple[Any, ...], Path], Case],
    rounds: int = 1,
) -> Kind:
    """Return a kind of the cases of a plan, whose entries begin with the sort of their fault, in a random order."""
    order = random.Random(name).sample(plan, len(plan))
    sorts = tuple(str(planned[0]) for planned in order)
    return Kind(
        name, lambda rng, number, folder: make(rng, order[number % len(order)], folder), rounds * len(plan), sorts
    )


def reading_of(write: Callable[[Path], object], read: Callable[[Path], Reading]) -> Callable[[], Reading]:
    """Return a function that reads, once, what is written into an empty folder."""

    @cache
    def reading() -> Reading:
        with tempfile.TemporaryDirectory() as folder:
            write(Path(folder))
            return read(Path(folder))

    return reading


@dataclass(frozen=True)
class Outcome:
    """What became of a case; `text` is the message, or what shows the fault; `peak` is of its process, in bytes."""

    title: str
    expected: tuple[str, ...]
    outcome: str
    text: str = ""
    seconds: float = 0.0
    peak: int = 0

    @property
    def right(self) -> bool:
        """Whether it is what was expected."""
        return self.outcome in self.expected


def make_case(kind: Kind, seed: int, number: int, folder: Path) -> Case:
    """Return a case of a kind: always the same for the same seed and number."""
    return kind.make(random.Random(f"{kind.name} {seed} {number}"), number, folder)


def judge(case: Case) -> Outcome:
    """Read a case and say what became of it."""
    outcome, text = _outcome_of(case)
    return Outcome(case.title, tuple(sorted(case.expected)), outcome, text)


def _outcome_of(case: Case) -> tuple[str, str]:
    try:
        reading = case.read()
    except LookdevError as error:
        problem = _unclear(str(error), case.error_names)
        return ("unclear", f"{problem}: {error}") if problem else ("refused", str(error))
    except MemoryError:
        return "memory", traceback.format_exc()
    except Exception:  # noqa: BLE001  # any other exception is what is looked for
        return "traceback", traceback.format_exc()
    sound = case.sound()
    notes = [note for note in reading.notes if note not in sound.notes]
    for note in notes:
        if problem := _unclear(note, ()):
            return "unclear", f"{problem}: {note}"
    if any(not _unclear(note, case.note_names) for note in notes):
        return "noted", "\n".join(notes)
    different = [key for key in (*sound.result, *reading.result) if reading.result.get(key) != sound.result.get(key)]
    if not different:
        # A note that does not name the place is no fault where there is nothing to say.
        return "sound", ""
    return "silent", f"{', '.join(different[:5])} differ; notes: {notes}"


def _unclear(text: str, names: tuple[str, ...]) -> str:
    """Return why a message is unclear, or ''."""
    if len(text) > LONGEST:
        return f"{len(text)} characters"
    if (found := _CONTROLS.search(text)) is not None:
        return f"control character {found[0]!r}"
    for name in names:
        if not any(each in text for each in name.split("|")):
            return f"does not name {name}"
    return ""
