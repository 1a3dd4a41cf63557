"""What can be measured, and a choice of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import product, starmap
from types import MappingProxyType
from typing import Any

from lookdev.asset import BUILTINS, Asset
from lookdev.bench.assets import make_boulder
from lookdev.bench.looks import LOOKS
from lookdev.bench.rigs import RIGS
from lookdev.errors import LookdevError, nearest_hint
from lookdev.rendering.backends import BACKENDS
from lookdev.scene import Sampling

MILLION = 1_000_000


@dataclass(frozen=True)
class BenchScene:
    """An asset, and the bounces of its indirect light; a convex asset has none."""

    help: str
    make: Callable[[], Asset]
    bounces: int


SCENES: dict[str, BenchScene] = {
    "sphere": BenchScene("convex: direct light only", BUILTINS["sphere"], Sampling.bounces),
    "shaderball": BenchScene("the built-in shaderball", BUILTINS["shaderball"], Sampling.bounces),
    "suzanne": BenchScene("with three bounces of indirect light", BUILTINS["suzanne"], 3),
    "million": BenchScene("a boulder of a million triangles", lambda: make_boulder(MILLION), Sampling.bounces),
}
IBLS: dict[str, str] = {
    "studio": "soft boxes: large, and about equally bright",
    "city": "a small and very bright sun",
    "forest": "light through leaves: many small bright spots",
}
LARGEST_SAMPLES = 1 << 14
MOST_REPEATS = 64
SEEDS = 128
"""Each stands for `MOST_REPEATS` times 16 of a renderer's seeds."""

RESOLUTIONS = (16, 4096)
QUARTERS = 4
"""Parts of a sequence whose growth is measured."""


@dataclass(frozen=True)
class Cell:
    """One scene, one light, of `IBLS` or `RIGS`, and one look."""

    scene: str
    ibl: str
    look: str

    def __str__(self) -> str:
        return f"{self.scene}, {self.ibl}, {self.look}"


@dataclass(frozen=True)
class Options:
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
    independent: bool = False  # beyond its samples a curve falls as that of independent samples, however far

    def __post_init__(self) -> None:
        _known("scene", self.scenes, list(SCENES))
        _known("IBL", self.ibls, [*IBLS, *RIGS])
        _known("look", self.looks, list(LOOKS))
        _known("backend", self.backends, list(BACKENDS))
        for count in self.samples:
            if not 2 <= count <= LARGEST_SAMPLES or count & (count - 1):
                raise LookdevError(f"{count} samples: counts are powers of two from 2 to {LARGEST_SAMPLES}")
        if not self.samples or list(self.samples) != sorted(set(self.samples)):
            raise LookdevError(f"samples {self.samples}: counts are rising and at least one, like 4,16,64")
        low, high = RESOLUTIONS
        if not low <= self.resolution <= high:
            raise LookdevError(f"resolution {self.resolution}: it is from {low} to {high} pixels")
        if not 1 <= self.repeats <= MOST_REPEATS:
            raise LookdevError(f"{self.repeats} repeats: from 1 to {MOST_REPEATS}")
        if not 0 <= self.seed < SEEDS:
            raise LookdevError(f"seed {self.seed}: it is from 0 to {SEEDS - 1}")
        if self.frames < QUARTERS:
            raise LookdevError(f"{self.frames} frames: their first quarter needs at least {QUARTERS}")
        if not 4 <= self.reference <= 1024:
            raise LookdevError(f"a reference of {self.reference} times the largest count: from 4 to 1024")

    def cells(self) -> Iterator[Cell]:
        """Yield the cells in order."""
        return starmap(Cell, product(self.scenes, self.ibls, self.looks))

    def backends_of(self, cell: Cell) -> tuple[str, ...]:
        """Return the backends that can show the look of a cell."""
        look = LOOKS[cell.look].make()
        return tuple(name for name in self.backends if BACKENDS[name].cannot_show(look) is None)


def parse_options(
    lists: Mapping[str, str],
    *,
    defaults: Mapping[str, Any] = MappingProxyType({}),
    everything: bool = False,
    **numbers: int | None,
) -> Options:
    """Return the options of a command line; errors as `Options`.

    Parameters
    ----------
    lists
        Of ``scenes``, ``ibls``, ``looks``, ``backends`` and ``samples``, separated by commas; empty for the default.
    defaults
        Fields of `Options`, of the kind of benchmark.
    everything
        Makes all names the default.
    numbers
        Other fields of `Options`; None for the default.
    """
    chosen: dict[str, Any] = dict(defaults)
    if everything:
        chosen |= {"scenes": tuple(SCENES), "ibls": (*IBLS, *RIGS), "looks": tuple(LOOKS), "backends": tuple(BACKENDS)}
    given = {kind: tuple(part.strip() for part in text.split(",")) for kind, text in lists.items() if text.strip()}
    for count in given.get("samples", ()):
        if not count.isdecimal():
            raise LookdevError(f"--samples: '{count}' is no whole number; it is like 4,16,64")
    chosen |= given | {name: number for name, number in numbers.items() if number is not None}
    if "samples" in given:
        chosen["samples"] = tuple(map(int, given["samples"]))
    return Options(**chosen)


def restricted(options: Options, defaults: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what options restrict a benchmark to, by the names of the fields that are not its defaults.

    Another seed, and more samples of references, restrict nothing.
    """
    whole = replace(parse_options({}, defaults=defaults), seed=options.seed, reference=options.reference)
    compared = (each.name for each in fields(Options) if each.compare)
    return tuple(name for name in compared if getattr(options, name) != getattr(whole, name))


def listing() -> str:
    """Return all names with their descriptions."""
    kinds: dict[str, dict[str, str]] = {
        "scenes": {name: scene.help for name, scene in SCENES.items()},
        "ibls": IBLS | {name: rig.help for name, rig in RIGS.items()},
        "looks": {name: look.help for name, look in LOOKS.items()},
        "backends": {name: backend.help for name, backend in BACKENDS.items()},
    }
    width = max(len(name) for names in kinds.values() for name in names)
    lines = []
    for kind, names in kinds.items():
        lines += [kind, *(f"  {name:{width}}  {help}" for name, help in names.items())]
    return "\n".join(lines)


def _known(kind: str, names: Sequence[str], known: Sequence[str]) -> None:
    if not names:
        raise LookdevError(f"no {kind} is given; known: {', '.join(known)}")
    for name in names:
        if name not in known:
            raise LookdevError(f"there is no {kind} '{name}' ({nearest_hint(name, known)})")
    if len(set(names)) < len(names):
        raise LookdevError(f"a {kind} is given twice: {', '.join(names)}")
