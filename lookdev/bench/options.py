"""The options of the benchmarks: the scenes, lights, looks and backends to render, and numbers such as samples.

`lookdev bench` parses the options from its command line; each benchmark can have defaults of its own.
"""

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

MAX_SAMPLES = 1 << 14  # per pixel
MAX_REPEATS = 64
SEEDS = 128
"""The number of values of the option `seed`. Each value reserves `MAX_REPEATS` times 16 seeds of a renderer."""

QUARTERS = 4
"""The number of parts into which `growth` divides a sequence of frames, to compare their times."""

_NAMES: dict[str, tuple[str, dict[str, str]]] = {
    "scenes": ("scene", {name: scene.help for name, scene in SCENES.items()}),
    "ibls": ("IBL", IBLS | {name: rig.help for name, rig in RIGS.items()}),
    "looks": ("look", {name: look.help for name, look in LOOKS.items()}),
    "backends": ("backend", {name: backend.help for name, backend in BACKENDS.items()}),
}
"""The noun for a name, and all valid names with their descriptions, by the option that is a list of such names."""

_RANGES: dict[str, tuple[int, float, str]] = {
    "resolution": (16, 4096, "resolution {}: it is from {} to {} pixels"),
    "repeats": (1, MAX_REPEATS, "{} repeats: from {} to {}"),
    "seed": (0, SEEDS - 1, "seed {}: it is from {} to {}"),
    "frames": (QUARTERS, math.inf, "{} frames: their first quarter needs at least {}"),
    "reference": (4, 1024, "a reference of {} times the largest count: from {} to {}"),
}
"""The least value, the largest value, and the message for a value out of this range, by the option with the number."""


@dataclass(frozen=True)
class Cell:
    """One scene, one light and one look, which are rendered together. `ibl` is a name in `IBLS` or in `RIGS`."""

    scene: str
    ibl: str
    look: str

    def __str__(self) -> str:
        return f"{self.scene}, {self.ibl}, {self.look}"


@dataclass(frozen=True)
class BenchOptions:
    """The choice of cells, backends and samples of a benchmark; the defaults take about ten minutes on two cores.

    Raises LookdevError for unknown names, and for numbers out of their ranges.
    """

    scenes: tuple[str, ...] = ("sphere", "shaderball", "suzanne")
    ibls: tuple[str, ...] = tuple(IBLS)
    looks: tuple[str, ...] = ("plastic",)
    backends: tuple[str, ...] = ("exact", "principled")
    samples: tuple[int, ...] = (4, 16, 64)  # per pixel, increasing powers of two
    resolution: int = 256  # the side of the square frame, pixels
    repeats: int = 3  # renders with each number of samples
    seed: int = 0
    reference: int = 8  # the least samples of a reference, in multiples of the largest of `samples`
    fresh: bool = field(default=False, compare=False)  # whether references are rendered, not read from the cache
    frames: int = 100  # the number of frames of the sequence that `growth` measures, or of the denoise trial
    targets: tuple[float, ...] = (1e-3, 1e-4)  # the relMSEs to which the time is measured
    denoise: bool = False  # whether each render is also denoised
    target_estimate: float | None = None  # the backend `exact` also renders until it estimates this relMSE
    stop_relmse: float = 0.0  # a backend that reaches this relMSE is not rendered with more samples
    reference_relmse: float = 0.0  # a reference with this relMSE takes no more samples
    # Whether curves are extrapolated as if samples were independent: relMSE times samples stays constant.
    independent: bool = False

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
        """Yield every combination of a scene, a light and a look, in order."""
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

    `lists` maps an option to its text: names, or numbers of samples, with commas between. `numbers` maps other fields
    to their values. An empty text or None stands for the default. `defaults` has the defaults of the benchmark; with
    `everything`, all valid names are the default.
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
    """Return the names of the options that differ from the defaults, so that only a part of a benchmark is measured.

    Another seed or another number of samples for references does not count.
    """
    whole = replace(BenchOptions(**defaults), seed=options.seed, reference=options.reference)
    compared = (option.name for option in fields(BenchOptions) if option.compare)
    return tuple(name for name in compared if getattr(options, name) != getattr(whole, name))


def list_names() -> str:
    """Return the text of `lookdev bench --list`: all valid names of each option, with their descriptions."""
    width = max(len(name) for _, names in _NAMES.values() for name in names)
    lines = []
    for option, (_, names) in _NAMES.items():
        lines += [option, *(f"  {name:{width}}  {text}" for name, text in names.items())]
    return "\n".join(lines)


def _check_names(kind: str, names: Sequence[str], valid: Sequence[str]) -> None:
    """Raise LookdevError unless all names are valid and different; `kind` is the noun for such a name."""
    if not names:
        raise LookdevError(f"no {kind} is given; known: {', '.join(valid)}")
    for name in names:
        if name not in valid:
            raise LookdevError(f"there is no {kind} '{name}' ({nearest_hint(name, valid)})")
    if len(set(names)) < len(names):
        raise LookdevError(f"a {kind} is given twice: {', '.join(names)}")
