"""The schedule of renders of a cell, and the measurements of each."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from lookdev.bench.curves import Reached, ratio, reach
from lookdev.bench.matrix import MOST_REPEATS, SEEDS, Cell, Options
from lookdev.bench.reference import FIRST_SEED, Reference, Render, Shot, Verdict, obtain

TARGETS = (1e-3, 1e-4)
"""The relMSE to which the time is measured."""

_SEEDS_PER_REPEAT = FIRST_SEED // (SEEDS * MOST_REPEATS)


@dataclass(frozen=True)
class Candidate:
    """A backend that is ready to render a cell."""

    backend: str
    key: str  # of the picture, whatever its sampling
    render: Render
    skips: tuple[str, ...] = ()  # work that is left out because no pixel differs, and why


@dataclass(frozen=True)
class Turn:
    """One render of the schedule."""

    repeat: int
    samples: int
    backend: str
    seed: int


@dataclass(frozen=True)
class Measurement:
    """One timed render: its `Shot` without the picture, and its `Verdict`."""

    scene: str
    ibl: str
    look: str
    backend: str
    samples: int
    repeat: int
    seed: int
    seconds: float
    relmse: float | None
    bias: float
    bias_error: float
    memory: int
    renderer: str


@dataclass(frozen=True)
class CurvePoint:
    """All renders of a backend with one number of samples: median seconds; mean relMSE; the bias of their mean."""

    samples: int
    seconds: float
    relmse: float | None
    bias: float
    bias_error: float


@dataclass(frozen=True)
class Ratio:
    """The time of ``exact`` over that of another backend to the same relMSE."""

    backend: str
    target: float
    value: Reached | None  # of the curves
    low: float | None  # the least over the repeats, each with its own curve
    high: float | None


@dataclass(frozen=True)
class CellResult:
    """The measurements of a cell so far: curves, times to a relMSE, references and skips, by backend."""

    cell: Cell
    measurements: tuple[Measurement, ...]
    curves: Mapping[str, tuple[CurvePoint, ...]]
    reached: Mapping[str, Mapping[float, Reached | None]]
    ratios: tuple[Ratio, ...]
    references: Mapping[str, Reference]
    skips: Mapping[str, tuple[str, ...]]


def schedule(options: Options, backends: Sequence[str]) -> Iterator[Turn]:
    """Yield every render in order; backends are interleaved, so that a slower machine affects all of them."""
    for repeat in range(options.repeats):
        for place, samples in enumerate(options.samples):
            # Every render has another seed, below those of references.
            seed = (options.seed * MOST_REPEATS + repeat) * _SEEDS_PER_REPEAT + place
            for backend in backends:
                yield Turn(repeat, samples, backend, seed)


class CellRun:
    """A cell while it is measured; `result` may be called at any time."""

    def __init__(self, cell: Cell, candidates: Sequence[Candidate], options: Options) -> None:
        self._cell = cell
        self._candidates = {candidate.backend: candidate for candidate in candidates}
        self._options = options
        self._references: dict[str, Reference] = {}
        self._shots: dict[tuple[str, int], list[Shot]] = {}
        self._measurements: list[Measurement] = []

    def run(self, report: Callable[[str], None]) -> None:
        """Render references, warm up, then measure."""
        options = self._options
        for backend, candidate in self._candidates.items():
            self._references[backend] = obtain(
                candidate.key,
                options.samples[-1],
                options.reference,
                candidate.render,
                fresh=options.fresh,
                report=lambda text, backend=backend: report(f"{self._cell}: {backend}: {text}"),  # type: ignore[misc]
            )
        for candidate in self._candidates.values():
            candidate.render(options.samples[0], FIRST_SEED)
        for turn in schedule(options, list(self._candidates)):
            shot = self._candidates[turn.backend].render(turn.samples, turn.seed)
            self._shots.setdefault((turn.backend, turn.samples), []).append(shot)
            verdict = self._references[turn.backend].judge(shot)
            self._measurements.append(_measurement(self._cell, turn, shot, verdict))
            error = "below its reference" if verdict.relmse is None else f"relMSE {verdict.relmse:.2e}"
            report(f"{self._cell}: {turn.backend}: {turn.samples} samples, {shot.seconds:.2f} s, {error}")

    def result(self) -> CellResult:
        """Return the measurements so far."""
        curves = {backend: self._curve(backend) for backend in self._candidates}
        reached = {backend: {target: _reach(curve, target) for target in TARGETS} for backend, curve in curves.items()}
        others = [backend for backend in curves if backend != "exact"] if "exact" in curves else []
        ratios = tuple(self._ratio(other, target, reached) for other in others for target in TARGETS)
        skips = {backend: candidate.skips for backend, candidate in self._candidates.items()}
        return CellResult(self._cell, tuple(self._measurements), curves, reached, ratios, dict(self._references), skips)

    def _curve(self, backend: str) -> tuple[CurvePoint, ...]:
        points = []
        for samples in self._options.samples:
            if shots := self._shots.get((backend, samples)):
                verdict = self._references[backend].judge(*shots)
                seconds = statistics.median(shot.seconds for shot in shots)
                points.append(CurvePoint(samples, seconds, verdict.relmse, verdict.bias, verdict.bias_error))
        return tuple(points)

    def _ratio(self, other: str, target: float, reached: Mapping[str, Mapping[float, Reached | None]]) -> Ratio:
        spread = []
        for repeat in range(self._options.repeats):
            rows = [each for each in self._measurements if each.repeat == repeat]
            value = ratio(
                *(_reach([row for row in rows if row.backend == backend], target) for backend in ("exact", other))
            )
            if value is not None and value.mark in ("", "~"):
                spread.append(value.value)
        value = ratio(reached["exact"][target], reached[other][target])
        return Ratio(other, target, value, min(spread, default=None), max(spread, default=None))


def _measurement(cell: Cell, turn: Turn, shot: Shot, verdict: Verdict) -> Measurement:
    figures: dict[str, Any] = {"seconds": shot.seconds, "memory": shot.memory, "renderer": shot.renderer}
    return Measurement(**asdict(cell), **asdict(turn), **asdict(verdict), **figures)


def _reach(points: Sequence[CurvePoint] | Sequence[Measurement], target: float) -> Reached | None:
    """Return the seconds to a relMSE on the curve of points whose relMSE is known."""
    known = [(point.seconds, point.relmse) for point in points if point.relmse is not None]
    return reach([seconds for seconds, _ in known], [relmse for _, relmse in known], target)
