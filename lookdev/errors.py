"""Every error that `lookdev` raises on purpose.

    LookdevError
    ├── TextError           a text file cannot be read or parsed (defined beside the reader, in lookdev.text)
    ├── JobError            a job file is wrong: carries every Fault found in it
    ├── LookError           a look (USD material) is wrong: carries every Fault found in it
    │   └── StageError      a USD file, of a look or an asset, cannot be opened or composed
    ├── AssetError          an asset cannot be read or has no surface to render
    ├── EnvironmentMapError a light cannot be read, or shown by a backend
    ├── RigError            a rig (USD lights) is wrong: carries every Fault found in it
    ├── ExpressionError     a mask expression is wrong (defined beside the parser, in lookdev.material)
    ├── TextureError        a texture cannot be read or has no such channel
    ├── ModelError          reflectance model parameters are unknown or outside their hard range
    ├── CodegenError        a model uses an operation that the symbolic arrays do not support
    ├── ContentError        the cache lacks a file that a render task names
    ├── ReadingError        a file crashed what read it, or takes too much time or memory (defined in lookdev.guard)
    ├── KilledError         the system killed the program (defined in lookdev.guard)
    ├── OutputError         a frame, sheet or picture cannot be written or read back
    ├── WorkerError         the render worker died, hung or sent no valid answer
    └── RenderError         Blender refused or failed to render a frame

A message states what is wrong, where, and what would be right. The command line prints it without a traceback; any
other exception is a defect of the program, which ends in a report file (`lookdev.cli.crash`). What a message quotes
is shortened, and cannot control a terminal.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

_MOST = 100  # faults in a message
_CONTROLS = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


def replace_controls(text: str) -> str:
    """Return a text with a question mark for each character, but ends of lines, that controls a terminal."""
    return _CONTROLS.sub("?", text)


def shorten(text: str, longest: int = 400) -> str:
    """Return the beginning of a text, for a message, as `replace_controls`."""
    return replace_controls(text if len(text) <= longest else f"{text[:longest]}… ({len(text)} characters)")


class LookdevError(Exception):
    """Base of every error raised on purpose."""

    def __str__(self) -> str:
        return "\n".join(shorten(line, 1500) for line in super().__str__().splitlines()[: _MOST + 1])


@dataclass(frozen=True, order=True)
class Fault:
    """One thing wrong with a file.

    `where` is the place inside `file`: a dotted key with indices for TOML (``ibl[1].exposure``), a prim path and
    input for USD (``/Paint/Base.inputs:roughness``). `hint` states what would be right; it may be empty.
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
        more = len(self.faults) - _MOST
        shown = [*map(str, self.faults[:_MOST]), *[f"and {more} more faults"] * (more > 0)]
        super().__init__("\n".join(shown))

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
    """A light cannot be read, or shown by a backend."""


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
    """A frame, sheet or picture cannot be written or read back."""


class WorkerError(LookdevError):
    """The render worker died, hung or sent no valid answer."""


class RenderError(LookdevError):
    """Blender refused or failed to render a frame."""


def nearest_hint(name: str, known: Sequence[str]) -> str:
    """Return a hint with the known name nearest to a misspelt one, or with all known names."""
    return close_hint(name, known, 0.6) or f"known: {', '.join(known)}"


def close_hint(name: str, known: Sequence[str], cutoff: float = 0.8) -> str:
    """Return a hint with the known name nearest to one that may be misspelt; "" where none is close."""
    close = difflib.get_close_matches(name, known, n=1, cutoff=cutoff)
    return f"did you mean '{close[0]}'?" if close else ""
