"""The schedule of renders of a cell, and the measurements of each."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Literal, NamedTuple

from lookdev.bench.curves import Reached, ratio, reach
from lookdev.bench.matrix import MOST_REPEATS, SEEDS, Cell, Options
from lookdev.bench.reference import FIRST_SEED, Reference, Render, Shot, obtain
from lookdev.errors import LookdevError

EXACT = "exact"
"""The backend that others are compared with, and whose frames end at a target error."""

Way = Literal["raw", "denoised", "aimed", "aimed, denoised"]
"""How a picture is made; aimed: until its estimated relMSE is `Options.aim`."""

PICTURES: tuple[Way, ...] = ("raw", "denoised")
"""Those with as many samples as are asked for."""

_SEEDS_PER_REPEAT = FIRST_SEED // (SEEDS * MOST_REPEATS)
_AIMED_SEEDS: dict[Way, int] = {"aimed": _SEEDS_PER_REPEAT - 2, "aimed, denoised": _SEEDS_PER_REPEAT - 1}
_ENOUGH_PARTS = 4  # of a reference that may end early, for each that it has otherwise
_REACH_DENOISED = 64.0  # how far denoised curves are continued, in times of their last effort


class Series(NamedTuple):
    """What a curve is of."""

    backend: str
    way: Way = "raw"

    def __str__(self) -> str:
        return self.backend if self.way == "raw" else f"{self.backend}, {self.way}"


@dataclass(frozen=True)
class Candidate:
    """A backend that is ready to render a cell."""

    backend: str
    key: str  # of the picture, whatever its sampling
    render: Render
    skips: tuple[str, ...] = ()  # work that is left out because no pixel differs, and why
    denoises: bool = False


@dataclass(frozen=True)
class Turn:
    """One render of the schedule."""

    repeat: int
    samples: int
    backend: str
    seed: int


@dataclass(frozen=True)
class Measurement:
    """One timed picture: its `Shot` without the pixels, and its `Verdict`."""

    scene: str
    ibl: str
    look: str
    backend: str
    way: Way
    samples: int
    repeat: int
    seed: int
    seconds: float
    relmse: float | None
    estimate: float | None
    bias: float
    bias_error: float
    memory: int
    renderer: str

    @property
    def series(self) -> Series:
        return Series(self.backend, self.way)


@dataclass(frozen=True)
class CurvePoint:
    """All renders of a series with one number of samples: median seconds; mean relMSE; the bias of their mean."""

    samples: int
    seconds: float
    relmse: float | None
    bias: float
    bias_error: float


@dataclass(frozen=True)
class Ratio:
    """The time of ``exact`` over that of another backend to the same relMSE, made in the same way."""

    backend: str
    way: Way
    target: float
    value: Reached | None  # of the curves
    low: float | None  # the least over the repeats, each with its own curve
    high: float | None
    by_samples: Reached | None  # of the samples, times what one costs more in renders that followed each other


@dataclass(frozen=True)
class Times:
    """Seconds to a relMSE: of the curve, and the extremes of those of each repeat."""

    value: Reached | None
    low: float | None
    high: float | None


@dataclass(frozen=True)
class CellResult:
    """The measurements of a cell so far: curves, times to a relMSE, references, skips, failures."""

    cell: Cell
    measurements: tuple[Measurement, ...]
    curves: Mapping[Series, tuple[CurvePoint, ...]]
    reached: Mapping[Series, Mapping[float, Times]]
    ratios: tuple[Ratio, ...]
    references: Mapping[str, Reference]
    skips: Mapping[str, tuple[str, ...]]
    failures: Mapping[str, str]  # why a backend's measurements end

    def of(self, series: Series) -> list[Measurement]:
        """Return the measurements of a series."""
        return [row for row in self.measurements if row.series == series]


def schedule(options: Options, backends: Sequence[str]) -> Iterator[Turn]:
    """Yield every render in order; backends are interleaved, so that a slower machine affects all of them."""
    for repeat in range(options.repeats):
        for place, samples in enumerate(options.samples):
            # Every render has another seed, below those of references.
            for backend in backends:
                yield Turn(repeat, samples, backend, _seed(options, repeat) + place)


def _seed(options: Options, repeat: int) -> int:
    return (options.seed * MOST_REPEATS + repeat) * _SEEDS_PER_REPEAT


class CellRun:
    """A cell while it is measured; `result` may be called at any time."""

    def __init__(self, cell: Cell, candidates: Sequence[Candidate], options: Options) -> None:
        self._cell = cell
        self._candidates = {candidate.backend: candidate for candidate in candidates}
        self._options = options
        self._references: dict[str, Reference] = {}
        self._shots: dict[tuple[Series, int], list[Shot]] = {}
        self._measurements: list[Measurement] = []
        self._failures: dict[str, str] = {}
        self._most: dict[str, int] = {}  # samples after which a backend's error is small enough
        self._hopeless: set[Way] = set()  # not aimed at again

    def run(self, report: Callable[[str], None]) -> None:
        """Render references, warm up, then measure; a backend that fails is left out from then on."""
        options = self._options
        for backend in self._candidates:
            with self._left_out(backend, report):
                self._references[backend] = self._reference(backend, report)
        for backend in self._living():
            with self._left_out(backend, report):
                self._shoot(backend, options.samples[0], FIRST_SEED)
        turns = list(schedule(options, list(self._candidates)))
        for repeat in range(options.repeats):
            for turn in (each for each in turns if each.repeat == repeat):
                if turn.backend in self._living() and turn.samples <= self._most.get(turn.backend, turn.samples):
                    with self._left_out(turn.backend, report):
                        self._take(turn, report)
            if EXACT in self._living() and options.aim is not None:
                with self._left_out(EXACT, report):
                    self._aim(repeat, options.aim, report)

    def _reference(self, backend: str, report: Callable[[str], None]) -> Reference:
        options, candidate = self._options, self._candidates[backend]
        finer = _ENOUGH_PARTS if options.enough else 1
        return obtain(
            candidate.key,
            max(options.samples[-1] // finer, 2),
            options.reference * finer,
            candidate.render,
            enough=options.enough,
            fresh=options.fresh,
            report=lambda text: report(f"{self._cell}: {backend}: {text}"),
        )

    def _take(self, turn: Turn, report: Callable[[str], None]) -> None:
        """Render once, which gives a measurement, or two of a picture that is denoised."""
        shot = self._shoot(turn.backend, turn.samples, turn.seed)
        pictures: dict[Way, Shot] = {"raw": shot} if shot.raw is None else {"raw": shot.raw, "denoised": shot}
        rows = [self._judge(Series(turn.backend, way), turn, each, report) for way, each in pictures.items()]
        if turn.repeat == 0 and all(row.relmse is None or row.relmse <= self._options.until for row in rows):
            self._most[turn.backend] = turn.samples

    def _aim(self, repeat: int, aim: float, report: Callable[[str], None]) -> None:
        """Render until an error is estimated, raw and denoised; once only where the most samples do not suffice."""
        for way, place in _AIMED_SEEDS.items():
            denoise = "off" if way == "aimed" else "measured"
            if way in self._hopeless or (denoise == "measured" and not self._options.denoise):
                continue
            turn = Turn(repeat, self._options.samples[-1], EXACT, _seed(self._options, repeat) + place)
            shot = self._candidates[EXACT].render(turn.samples, turn.seed, error=aim, denoise=denoise)
            self._judge(Series(EXACT, way), turn, shot, report)
            if shot.estimate is None or shot.estimate > aim:
                self._hopeless.add(way)

    def _shoot(self, backend: str, samples: int, seed: int) -> Shot:
        candidate = self._candidates[backend]
        if self._options.denoise and candidate.denoises:
            return candidate.render(samples, seed, denoise="measured")
        return candidate.render(samples, seed)

    def _judge(self, series: Series, turn: Turn, shot: Shot, report: Callable[[str], None]) -> Measurement:
        verdict = self._references[turn.backend].judge(shot)
        row = Measurement(
            **asdict(self._cell),
            **series._asdict(),
            samples=shot.samples,
            repeat=turn.repeat,
            seed=turn.seed,
            seconds=shot.seconds,
            estimate=shot.estimate,
            memory=shot.memory,
            renderer=shot.renderer,
            **asdict(verdict),
        )
        self._measurements.append(row)
        self._shots.setdefault((series, turn.samples), []).append(shot)
        error = "lost in the noise of its reference" if verdict.relmse is None else f"relMSE {verdict.relmse:.2e}"
        report(f"{self._cell}: {series}: {shot.samples} samples, {shot.seconds:.2f} s, {error}")
        return row

    def _living(self) -> list[str]:
        return [backend for backend in self._candidates if backend not in self._failures]

    @contextmanager
    def _left_out(self, backend: str, report: Callable[[str], None]) -> Iterator[None]:
        """Note an error of a backend, which is used no more."""
        try:
            yield
        except (LookdevError, OSError) as error:
            self._failures[backend] = str(error)
            report(f"{self._cell}: {backend} fails and is left out: {error}")

    def result(self) -> CellResult:
        """Return the measurements so far."""
        rows = self._measurements
        measured = {row.series for row in rows}
        every = (Series(backend, way) for backend in self._candidates for way in PICTURES)
        curves = {each: self._curve(each) for each in every if each.way == "raw" or each in measured}
        targets = self._options.targets
        reached = {series: {target: self._times(series, curve, target) for target in targets}
                   for series, curve in curves.items()}  # fmt: skip
        ratios = tuple(
            self._ratio(series, target, curves, reached)
            for series in curves
            for target in targets
            if series.backend != EXACT and Series(EXACT, series.way) in curves
        )
        skips = {backend: candidate.skips for backend, candidate in self._candidates.items()}
        found = dict(self._references), skips, dict(self._failures)
        return CellResult(self._cell, tuple(rows), curves, reached, ratios, *found)

    def _curve(self, series: Series) -> tuple[CurvePoint, ...]:
        points = []
        for samples in self._options.samples:
            if shots := self._shots.get((series, samples)):
                verdict = self._references[series.backend].judge(*shots)
                seconds = statistics.median(shot.seconds for shot in shots)
                points.append(CurvePoint(samples, seconds, verdict.relmse, verdict.bias, verdict.bias_error))
        return tuple(points)

    def _of_repeats(self, series: Series) -> dict[int, list[Measurement]]:
        return {repeat: [row for row in self._measurements if row.series == series and row.repeat == repeat]
                for repeat in range(self._options.repeats)}  # fmt: skip

    def _times(self, series: Series, curve: Sequence[CurvePoint], target: float) -> Times:
        spread = [self._reach(series, rows, target) for rows in self._of_repeats(series).values()]
        found = [each.value for each in spread if each is not None]
        return Times(self._reach(series, curve, target), min(found, default=None), max(found, default=None))

    def _ratio(
        self,
        other: Series,
        target: float,
        curves: Mapping[Series, Sequence[CurvePoint]],
        reached: Mapping[Series, Mapping[float, Times]],
    ) -> Ratio:
        exact = Series(EXACT, other.way)
        ours, theirs = self._of_repeats(exact), self._of_repeats(other)
        spread = []
        for repeat in range(self._options.repeats):
            value = ratio(self._reach(exact, ours[repeat], target), self._reach(other, theirs[repeat], target))
            if value is not None and value.mark in ("", "~"):
                spread.append(value.value)
        value = ratio(reached[exact][target].value, reached[other][target].value)
        by_samples = ratio(*(self._reach(each, curves[each], target, "samples") for each in (exact, other)))
        cost = _cost(self._measurements, exact, other)
        by_samples = None if by_samples is None or cost is None else Reached(cost * by_samples.value, by_samples.mark)
        extremes = min(spread, default=None), max(spread, default=None)
        return Ratio(other.backend, other.way, target, value, *extremes, by_samples)

    def _reach(
        self,
        series: Series,
        points: Sequence[CurvePoint] | Sequence[Measurement],
        target: float,
        effort: Literal["seconds", "samples"] = "seconds",
    ) -> Reached | None:
        """Return the seconds, or samples, to a relMSE on the curve of points whose relMSE is known."""
        known = [(getattr(point, effort), point.relmse) for point in points if point.relmse is not None]
        curve = [each for each, _ in known], [relmse for _, relmse in known]
        if not self._options.independent:
            return reach(*curve, target)
        # What a denoiser leaves falls more slowly than noise.
        raw = series.way == "raw"
        return reach(*curve, target, limit=None if raw else _REACH_DENOISED, slopes=(float(raw), 1.0))


def _cost(rows: Sequence[Measurement], exact: Series, other: Series) -> float | None:
    """Return what a sample of one costs over one of another: the median over pairs of renders that followed each other.

    The pairs are those of the most samples that both have, where what a frame costs beyond its samples matters least.
    """
    ours, theirs = (
        {(row.repeat, row.samples): row.seconds for row in rows if row.series == each} for each in (exact, other)
    )
    pairs = ours.keys() & theirs.keys()
    most = max((samples for _, samples in pairs), default=0)
    costs = [ours[pair] / theirs[pair] for pair in pairs if pair[1] == most]
    return statistics.median(costs) if costs else None
