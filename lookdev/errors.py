"""Every error that `lookdev` raises on purpose.

    LookdevError
    ├── TextError           a text file cannot be read or parsed (defined beside the reader, in lookdev.safe_text)
    ├── JobError            a job file is wrong: carries all its Faults
    ├── LookError           a look (USD material) is wrong: carries all its Faults
    │   └── StageError      a USD file, of a look or an asset, cannot be opened or composed
    ├── AssetError          an asset cannot be read or has no surface to render
    ├── EnvironmentMapError a light cannot be read, or a backend cannot render it
    ├── RigError            a rig (USD lights) is wrong: carries all its Faults
    ├── ExpressionError     a mask expression is wrong (defined beside the parser, in lookdev.material)
    ├── TextureError        a texture cannot be read or has no such channel
    ├── ModelError          reflectance model parameters are unknown or outside their hard range
    ├── CodegenError        a model uses an operation that the symbolic arrays do not support
    ├── ContentError        the cache lacks a file that a render task names
    ├── ReadingError        a file crashes its reader, or takes too much time or memory (defined in lookdev.sandbox)
    ├── KilledError         the system killed the program (defined in lookdev.sandbox)
    ├── OutputError         a frame, sheet or picture cannot be written or read
    ├── WorkerError         the render worker died, hung or sent no valid answer
    └── RenderError         Blender refused or failed to render a frame

A message states what is wrong, where, and what would be right. The command line prints it without a traceback. Any
other exception is a defect of the program, for which the command line writes a report file (`lookdev.cli.crash`).
Quotations in messages are shortened, and cannot control a terminal.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Self

_MAX_FAULTS = 100  # largest number of faults, or lines, in a message
# Characters that control a terminal or the direction of text, and surrogates; not the end of a line.
_CONTROLS = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


def replace_controls(text: str) -> str:
    """Return a text with a question mark in place of each character that controls a terminal, except ends of lines."""
    return _CONTROLS.sub("?", text)


def shorten(text: str, longest: int = 400) -> str:
    """Return the first `longest` characters of a text for a message, with `replace_controls` applied."""
    return replace_controls(text if len(text) <= longest else f"{text[:longest]}… ({len(text)} characters)")


class LookdevError(Exception):
    """Base of every error raised on purpose; its text is shortened and cannot control a terminal."""

    def __str__(self) -> str:
        return "\n".join(shorten(line, 1500) for line in super().__str__().splitlines()[: _MAX_FAULTS + 1])


@dataclass(frozen=True, order=True)
class Fault:
    """One fault of a file.

    `where` is the location in `file`: a dotted key with indices for TOML (``ibl[1].exposure``), a prim path and input
    for USD (``/Paint/Base.inputs:roughness``). `what` states what is wrong there. `hint` states what would be right, or
    is empty.
    """

    file: str
    where: str
    what: str
    hint: str = ""

    def __str__(self) -> str:
        file, *rest = shorten(self.file, 4096), *map(shorten, filter(None, (self.where, self.what)))
        return ": ".join((file, *rest)) + (f" ({shorten(self.hint)})" if self.hint else "")


class FaultsError(LookdevError):
    """An error that reports all faults of its input together."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self.faults: tuple[Fault, ...] = tuple(faults)
        more = len(self.faults) - _MAX_FAULTS
        lines = [*map(str, self.faults[:_MAX_FAULTS]), *[f"and {more} more faults"] * (more > 0)]
        super().__init__("\n".join(lines))

    @classmethod
    def at(cls, file: object, where: object, what: str, hint: str = "") -> Self:
        """Return the error of one fault; `file` and `where` are texts or paths."""
        return cls([Fault(str(file), str(where), what, hint)])

    def __str__(self) -> str:
        return Exception.__str__(self)


class JobError(FaultsError):
    """A job file is wrong."""


class LookError(FaultsError):
    """A look is wrong."""


class StageError(LookError):
    """A USD file, of a look or an asset, cannot be opened or composed."""


class AssetError(LookdevError):
    """An asset cannot be read or has no surface to render."""


class EnvironmentMapError(LookdevError):
    """A light cannot be read, or a backend cannot render it."""


class RigError(FaultsError):
    """A rig is wrong."""


class TextureError(LookdevError):
    """A texture cannot be read or has no such channel."""


class ModelError(LookdevError):
    """Reflectance model parameters are unknown or outside their hard range."""


class CodegenError(LookdevError):
    """A model uses an operation that the symbolic arrays do not support."""


class ContentError(LookdevError):
    """The cache lacks a file that a render task names."""


class OutputError(LookdevError):
    """A frame, sheet or picture cannot be written or read."""


class WorkerError(LookdevError):
    """The render worker died, hung or sent no valid answer."""


class RenderError(LookdevError):
    """Blender refused or failed to render a frame."""


def nearest_hint(name: str, names: Sequence[str]) -> str:
    """Return a hint for a misspelt name: the nearest of the valid `names`, or all of them if none is near."""
    return close_hint(name, names, 0.6) or f"known: {', '.join(names)}"


def close_hint(name: str, names: Sequence[str], cutoff: float = 0.8) -> str:
    """Return a hint with the valid name that is nearest to `name`, or "" if none is close.

    `cutoff` is the least similarity of a close name, from 0 to 1 (`difflib.get_close_matches`).
    """
    close = difflib.get_close_matches(name, names, n=1, cutoff=cutoff)
    return f"did you mean '{close[0]}'?" if close else ""
