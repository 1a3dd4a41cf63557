"""Options of a benchmark: what is measured, from a command line and its defaults."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import product, starmap
from types import MappingProxyType
from typing import Any

from lookdev.bench.subjects import IBLS, LOOKS, RIGS, SCENES
from lookdev.errors import LookdevError, nearest_hint
from lookdev.rendering.backends import BACKENDS

MAX_SAMPLES = 1 << 14
MAX_REPEATS = 64
SEEDS = 128
"""The number of seeds of a benchmark; each contains `MAX_REPEATS` times 16 of a renderer's seeds."""

QUARTERS = 4
"""Parts of a sequence whose growth is measured."""

_NAMES: dict[str, tuple[str, dict[str, str]]] = {
    "scenes": ("scene", {name: scene.help for name, scene in SCENES.items()}),
    "ibls": ("IBL", IBLS | {name: rig.help for name, rig in RIGS.items()}),
    "looks": ("look", {name: look.help for name, look in LOOKS.items()}),
    "backends": ("backend", {name: backend.help for name, backend in BACKENDS.items()}),
}
"""Of each option of names: what a name is of, and all names with their descriptions."""

_RANGES: dict[str, tuple[int, float, str]] = {
    "resolution": (16, 4096, "resolution {}: it is from {} to {} pixels"),
    "repeats": (1, MAX_REPEATS, "{} repeats: from {} to {}"),
    "seed": (0, SEEDS - 1, "seed {}: it is from {} to {}"),
    "frames": (QUARTERS, math.inf, "{} frames: their first quarter needs at least {}"),
    "reference": (4, 1024, "a reference of {} times the largest count: from {} to {}"),
}


@dataclass(frozen=True)
class Cell:
    """One scene, one light, of `IBLS` or `RIGS`, and one look."""

    scene: str
    ibl: str
    look: str

    def __str__(self) -> str:
        return f"{self.scene}, {self.ibl}, {self.look}"


@dataclass(frozen=True)
class BenchOptions:
    """A choice of what is measured; the defaults take about ten minutes on two cores.

    Raises LookdevError for unknown names, and numbers out of their ranges.
    """

    scenes: tuple[str, ...] = ("sphere", "shaderball", "suzanne")
    ibls: tuple[str, ...] = tuple(IBLS)
    looks: tuple[str, ...] = ("plastic",)
    backends: tuple[str, ...] = ("exact", "principled")
    samples: tuple[int, ...] = (4, 16, 64)  # per pixel, increasing powers of two
    resolution: int = 256  # the side of the frame
    repeats: int = 3  # renders of each number of samples
    seed: int = 0
    reference: int = 8  # samples of a reference, at least, over the largest count
    fresh: bool = field(default=False, compare=False)  # references are rendered again
    frames: int = 100  # of the sequence whose growth is measured
    targets: tuple[float, ...] = (1e-3, 1e-4)  # relMSE to which the time is measured
    denoise: bool = False  # each render is denoised too
    aim: float | None = None  # exact is also rendered until it estimates this relMSE
    until: float = 0.0  # relMSE below which a backend is rendered with no more samples
    enough: float = 0.0  # relMSE of a reference below which it takes no more samples
    independent: bool = False  # curves are extrapolated far, as those of independent samples

    def __post_init__(self) -> None:
        for option, (kind, names) in _NAMES.items():
            _check_names(kind, getattr(self, option), list(names))
        for count in self.samples:
            if not 2 <= count <= MAX_SAMPLES or count & (count - 1):
                raise LookdevError(f"{count} samples: counts are powers of two from 2 to {MAX_SAMPLES}")
        if not self.samples or list(self.samples) != sorted(set(self.samples)):
            raise LookdevError(f"samples {self.samples}: counts are rising and at least one, like 4,16,64")
        for option, (low, high, message) in _RANGES.items():
            if not low <= getattr(self, option) <= high:
                raise LookdevError(message.format(getattr(self, option), low, high))

    def cells(self) -> Iterator[Cell]:
        """Yield the cells in order."""
        return starmap(Cell, product(self.scenes, self.ibls, self.looks))

    def backends_of(self, cell: Cell) -> tuple[str, ...]:
        """Return the backends that can show the look of a cell."""
        look = LOOKS[cell.look].make()
        return tuple(name for name in self.backends if BACKENDS[name].look_gap(look) is None)


def parse_options(
    lists: Mapping[str, str],
    *,
    defaults: Mapping[str, Any] = MappingProxyType({}),
    everything: bool = False,
    **numbers: int | None,
) -> BenchOptions:
    """Return the options of a command line; raises as `BenchOptions`.

    `lists` are those of names and ``samples``, separated by commas, empty for the default; `numbers` are other fields,
    None for the default. `defaults` are those of the kind of benchmark; `everything` makes all names the default.
    """
    names = {option: tuple(valid) for option, (_, valid) in _NAMES.items()} if everything else {}
    texts = {option: tuple(map(str.strip, text.split(","))) for option, text in lists.items() if text.strip()}
    counts = texts.pop("samples", ())
    for count in counts:
        if not count.isdecimal():
            raise LookdevError(f"--samples: '{count}' is no whole number; it is like 4,16,64")
    samples = {"samples": tuple(map(int, counts))} if counts else {}
    present = {name: number for name, number in numbers.items() if number is not None}
    return BenchOptions(**{**defaults, **names, **texts, **samples, **present})


def restrictions(options: BenchOptions, defaults: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the fields that restrict a benchmark to a part of it.

    Another seed, and more samples of references, restrict nothing.
    """
    whole = replace(BenchOptions(**defaults), seed=options.seed, reference=options.reference)
    compared = (option.name for option in fields(BenchOptions) if option.compare)
    return tuple(name for name in compared if getattr(options, name) != getattr(whole, name))


def list_names() -> str:
    """Return all names with their descriptions."""
    width = max(len(name) for _, names in _NAMES.values() for name in names)
    lines = []
    for option, (_, names) in _NAMES.items():
        lines += [option, *(f"  {name:{width}}  {text}" for name, text in names.items())]
    return "\n".join(lines)


def _check_names(kind: str, names: Sequence[str], valid: Sequence[str]) -> None:
    if not names:
        raise LookdevError(f"no {kind} is given; known: {', '.join(valid)}")
    for name in names:
        if name not in valid:
            raise LookdevError(f"there is no {kind} '{name}' ({nearest_hint(name, valid)})")
    if len(set(names)) < len(names):
        raise LookdevError(f"a {kind} is given twice: {', '.join(names)}")
