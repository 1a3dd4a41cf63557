"""Changes of a text file that are wrong in any language, and what is no text file at all."""

import os
import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cases import ANY_MEANING, REFUSED, SOUND
from damage import Damage, flip_bits

_ODD = ("\x1b[31m", "\u202e", "\x07", "ä" * 300, "x" * 300_000)


@dataclass(frozen=True)
class Change:
    """A change of the bytes of a text; what it becomes, and what a message about it must name beside the file."""

    expected: frozenset[str]
    make: Damage
    names: tuple[str, ...] = ()


def _inserted(byte: bytes) -> Damage:
    def make(data: bytes, rng: random.Random) -> bytes:
        place = rng.randrange(len(data))
        return data[:place] + byte + data[place:]

    return make


def _shuffled(data: bytes, rng: random.Random) -> bytes:
    lines = data.splitlines(keepends=True)
    rng.shuffle(lines)
    return b"".join(lines)


def _repeated(data: bytes, rng: random.Random) -> bytes:
    lines = data.splitlines(keepends=True)
    place = rng.randrange(len(lines))
    return b"".join([*lines[:place], *[lines[place]] * rng.choice((2, 5)), *lines[place + 1 :]])


CHANGES: dict[str, Change] = {
    "UTF-16": Change(REFUSED, lambda data, rng: data.decode().encode("utf-16"), ("UTF-8",)),
    "UTF-32": Change(REFUSED, lambda data, rng: data.decode().encode("utf-32"), ("UTF-8|not",)),
    "a byte that is no text": Change(REFUSED, _inserted(b"\xff"), ("UTF-8",)),
    "a cut character": Change(REFUSED, _inserted(b"\xc3"), ("UTF-8",)),
    "a surrogate": Change(REFUSED, _inserted(b"\xed\xa0\x80"), ("UTF-8",)),
    "a zero": Change(REFUSED, _inserted(b"\0"), ("line",)),
    "a mark at its start": Change(SOUND, lambda data, rng: b"\xef\xbb\xbf" + data),
    "line ends of Windows": Change(SOUND, lambda data, rng: data.replace(b"\n", b"\r\n")),
    "empty": Change(REFUSED, lambda data, rng: b""),
    "noise": Change(REFUSED, lambda data, rng: b"\xff" + rng.randbytes(rng.choice((1, 1000, 100_000)))),
    "zeros": Change(REFUSED, lambda data, rng: bytes(4096)),
    "brackets": Change(REFUSED, lambda data, rng: rng.choice((b"[", b"{", b"(", b"<a>")) * 100_000),
    "flipped bits": Change(ANY_MEANING, flip_bits(bits=7)),
    "lines in another order": Change(ANY_MEANING, _shuffled),
    "a repeated line": Change(ANY_MEANING, _repeated),
}

Placed = Callable[[Path], object]


def _sparse(file: Path) -> None:
    with file.open("wb") as stream:
        stream.truncate(1 << 40)


NO_FILES: dict[str, tuple[Placed, str]] = {
    "a pipe": (os.mkfifo, "pipe|not a file|no readable file"),
    "a folder": (Path.mkdir, "folder|not a file|no readable file"),
    "a device": (lambda file: file.symlink_to("/dev/zero"), "device|not a file|no readable file"),
    "a link to itself": (lambda file: file.symlink_to(file), "cannot be read|no such file|no readable file"),
    "a link to nothing": (lambda file: file.symlink_to("nothing"), "cannot be read|no such file|no readable file"),
    "missing": (lambda file: None, "cannot be read|no such file|no readable file"),
    "a sparse file": (_sparse, "at most|does not know the format|Cannot determine"),
}
"""What is in the place of the file, and what a message says."""


def text_plan(rounds: int) -> list[tuple[str, ...]]:
    """Return the cases of any text file."""
    return [("text", name) for name in CHANGES for _ in range(rounds)] + [("place", name) for name in NO_FILES]


def spoil(
    planned: tuple[str, ...], rng: random.Random, file: Path, text: str
) -> tuple[frozenset[str], tuple[str, ...]]:
    """Write the file of a case of `text_plan`; return what must become of it, and what a message must name besides."""
    sort, name = planned
    if sort == "place":
        make, words = NO_FILES[name]
        file.unlink(missing_ok=True)
        make(file)
        return REFUSED, (words,)
    change = CHANGES[name]
    file.write_bytes(change.make(text.encode(), rng))
    return change.expected, change.names


def odd(rng: random.Random) -> str:
    """Return a text that spoils a message that quotes it."""
    return rng.choice(_ODD)
