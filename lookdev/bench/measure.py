"""Renders a cell, measures each render, and derives times and ratios from the curves of error over time."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from typing import Literal, NamedTuple

from lookdev.bench.options import MAX_REPEATS, SEEDS, BenchOptions, Cell
from lookdev.bench.reference import (
    FIRST_SEED,
    MeasuredError,
    Reference,
    RenderPicture,
    ReportProgress,
    TimedPicture,
    obtain_reference,
)
from lookdev.errors import LookdevError

EXACT = "exact"
"""The backend that others are compared with, and whose frames end at a target error."""

PictureKind = Literal["raw", "denoised", "aimed", "aimed, denoised"]
"""How a picture is made; aimed: until its estimated relMSE is `BenchOptions.aim`."""

PICTURES: tuple[PictureKind, ...] = ("raw", "denoised")
"""The pictures with the requested number of samples."""

MAX_EXTRAPOLATION = 4.0
"""The limit of extrapolation, as a factor of the last effort."""

_MAX_EXTRAPOLATION_DENOISED = 64.0  # that of denoised curves whose points are of independent samples
_SEEDS_PER_REPEAT = FIRST_SEED // (SEEDS * MAX_REPEATS)
_ENOUGH_PARTS = 4  # parts of a reference that may end early, for each part that it has otherwise


class Series(NamedTuple):
    """The series of renders that a curve shows: a backend, and how its pictures are made."""

    backend: str
    way: PictureKind = "raw"

    def __str__(self) -> str:
        return self.backend if self.way == "raw" else f"{self.backend}, {self.way}"


@dataclass(frozen=True)
class Candidate:
    """A backend that is ready to render a cell."""

    backend: str
    key: str  # of the picture, whatever its sampling
    render: RenderPicture
    skips: tuple[str, ...] = ()  # work that is left out because it changes no pixel, and why
    denoises: bool = False


@dataclass(frozen=True)
class Measurement:
    """One timed picture: its `TimedPicture` without the pixels, and its `MeasuredError`."""

    scene: str
    ibl: str
    look: str
    backend: str
    way: PictureKind
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
class CurvePoint(MeasuredError):
    """All renders of a series with one number of samples: median seconds; mean relMSE; the bias of their mean."""

    samples: int
    seconds: float


@dataclass(frozen=True)
class CurveEffort:
    """The effort at which a curve reaches an error, or a ratio of two such efforts.

    `mark` is "" within the measured range, "~" where the curve was extrapolated, "<" or ">" where the value is a bound,
    because the first point of a curve is below the error.
    """

    value: float
    mark: Literal["", "~", "<", ">"] = ""


@dataclass(frozen=True)
class Times:
    """Seconds to a relMSE, or a ratio of those: of the curve, and the extremes of those of each repeat."""

    value: CurveEffort | None
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Ratio(Times):
    """The time of ``exact`` over that of another backend to the same relMSE, made in the same way."""

    backend: str
    way: PictureKind
    target: float
    by_samples: CurveEffort | None  # of the samples, times what one costs more in renders that followed each other


def effort_to_error(
    effort: Sequence[float],
    error: Sequence[float],
    target: float,
    *,
    limit: float | None = MAX_EXTRAPOLATION,
    slopes: tuple[float, float] = (0.0, math.inf),
) -> CurveEffort | None:
    """Return the effort (seconds, or samples) at which a curve first reaches an error `target`.

    `effort` and `error` are its points by increasing samples, positive. Beyond them the curve falls, in logarithms, by
    the slope of its last two points, within `slopes`: 1 is that of independent samples. None where it does not fall, or
    does not reach the target within `limit` times its last effort.
    """
    if not error:
        return None
    if error[0] <= target:
        return CurveEffort(effort[0], "" if error[0] == target else "<")
    for start, end in pairwise(zip(effort, error, strict=True)):
        if end[1] <= target:
            share = math.log(start[1] / target) / math.log(start[1] / end[1])
            return CurveEffort(start[0] * (end[0] / start[0]) ** share)
    slope = 0.0
    if len(error) > 1 and effort[-1] > effort[-2]:
        slope = math.log(error[-2] / error[-1]) / math.log(effort[-1] / effort[-2])
    slope = min(max(slope, slopes[0]), slopes[1])
    if slope <= 0.0:
        return None
    value = effort[-1] * (error[-1] / target) ** (1.0 / slope)
    return CurveEffort(value, "~") if limit is None or value <= limit * effort[-1] else None


def effort_ratio(one: CurveEffort | None, other: CurveEffort | None) -> CurveEffort | None:
    """Return one effort over another; None where one is missing or both are bounds."""
    if one is None or other is None or one.mark == other.mark == "<":
        return None
    value = one.value / other.value
    if "<" in (one.mark, other.mark):
        return CurveEffort(value, "<" if one.mark == "<" else ">")
    return CurveEffort(value, "~" if "~" in (one.mark, other.mark) else "")


def schedule(options: BenchOptions) -> Iterator[tuple[int, int, int]]:
    """Yield the repeat, the samples and the seed of every render in order; no two have the same seed."""
    for repeat in range(options.repeats):
        for number, samples in enumerate(options.samples):
            yield repeat, samples, _seed(options, repeat) + number


def _seed(options: BenchOptions, repeat: int) -> int:
    """Return the first seed of a repeat, below those of references."""
    return (options.seed * MAX_REPEATS + repeat) * _SEEDS_PER_REPEAT


@dataclass
class CellRun:
    """A cell, and its measurements so far, with the times and ratios that follow from them."""

    cell: Cell
    candidates: Sequence[Candidate]
    options: BenchOptions
    report: ReportProgress
    measurements: list[Measurement] = field(default_factory=list)
    curves: Mapping[Series, tuple[CurvePoint, ...]] = field(default_factory=dict)  # once `run` has ended
    references: dict[str, Reference] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)  # why a backend's measurements end
    _pictures: dict[tuple[Series, int], list[TimedPicture]] = field(default_factory=dict)
    _max_samples: dict[str, int] = field(default_factory=dict)  # samples after which a backend's error is small enough
    _out_of_reach: set[PictureKind] = field(default_factory=set)  # not aimed at again

    def run(self) -> None:
        """Render references, warm up, then measure; a backend that fails is left out from then on.

        Backends are interleaved, so that a slower machine affects all of them.
        """
        try:
            for candidate in self.candidates:
                self._attempt(candidate, self._obtain_reference)
            for candidate in self.candidates:
                self._attempt(candidate, self._render, self.options.samples[0], FIRST_SEED)
            for repeat, samples, seed in schedule(self.options):
                for candidate in self.candidates:
                    if samples <= self._max_samples.get(candidate.backend, samples):
                        self._attempt(candidate, self._measure, repeat, samples, seed)
                if samples == self.options.samples[-1]:
                    for candidate in self.candidates:
                        self._attempt(candidate, self._render_to_aim, repeat)
        finally:
            measured = {row.series for row in self.measurements}
            pairs = [Series(candidate.backend, way) for candidate in self.candidates for way in PICTURES]
            self.curves = {series: self._curve(series) for series in pairs if series.way == "raw" or series in measured}
            self._pictures.clear()

    def _attempt(self, candidate: Candidate, step: Callable[..., object], *arguments: float) -> None:
        """Run a step of a backend, unless it failed before; note an error."""
        if candidate.backend in self.failures:
            return
        try:
            step(candidate, *arguments)
        except (LookdevError, OSError) as error:
            self.failures[candidate.backend] = str(error)
            self.report(f"{self.cell}: {candidate.backend} fails and is left out: {error}")

    def _obtain_reference(self, candidate: Candidate) -> None:
        options = self.options
        finer = _ENOUGH_PARTS if options.enough else 1
        amount = max(options.samples[-1] // finer, 2), options.reference * finer

        def report(text: str) -> None:
            self.report(f"{self.cell}: {candidate.backend}: {text}")

        self.references[candidate.backend] = obtain_reference(
            candidate.key, *amount, candidate.render, report, enough=options.enough, fresh=options.fresh
        )

    def _render(self, candidate: Candidate, samples: int, seed: int) -> TimedPicture:
        sampling = {"denoise": "measured"} if self.options.denoise and candidate.denoises else {}
        return candidate.render(samples, seed, **sampling)

    def _measure(self, candidate: Candidate, repeat: int, samples: int, seed: int) -> None:
        """Render once, which gives a measurement, or two of a picture that is denoised."""
        rendered = self._render(candidate, samples, seed)
        pictures: dict[PictureKind, TimedPicture] = {"raw": rendered.raw or rendered}
        pictures |= {"denoised": rendered} if rendered.raw else {}
        rows = []
        for way, picture in pictures.items():
            series = Series(candidate.backend, way)
            rows.append(self._record_picture(series, repeat, seed, picture))
            self._pictures.setdefault((series, samples), []).append(picture)
        if repeat == 0 and all(row.relmse is None or row.relmse <= self.options.until for row in rows):
            self._max_samples[candidate.backend] = samples

    def _render_to_aim(self, candidate: Candidate, repeat: int) -> None:
        """Render until an error is estimated, raw and denoised; only once if the most samples do not suffice."""
        aim = self.options.aim
        if aim is None or candidate.backend != EXACT:
            return
        ways: dict[PictureKind, str] = {"aimed": "off", "aimed, denoised": "measured"}
        for number, (way, denoise) in enumerate(ways.items(), start=_SEEDS_PER_REPEAT - len(ways)):
            if way in self._out_of_reach or (denoise == "measured" and not self.options.denoise):
                continue
            seed = _seed(self.options, repeat) + number
            picture = candidate.render(self.options.samples[-1], seed, error=aim, denoise=denoise)
            self._record_picture(Series(EXACT, way), repeat, seed, picture)
            if picture.estimate is None or picture.estimate > aim:
                self._out_of_reach.add(way)

    def _record_picture(self, series: Series, repeat: int, seed: int, picture: TimedPicture) -> Measurement:
        verdict = self.references[series.backend].measure_error(picture)
        figures = {name: getattr(picture, name) for name in ("samples", "seconds", "estimate", "memory", "renderer")}
        row = Measurement(
            **asdict(self.cell), **series._asdict(), repeat=repeat, seed=seed, **figures, **asdict(verdict)
        )
        self.measurements.append(row)
        error = "lost in the noise of its reference" if verdict.relmse is None else f"relMSE {verdict.relmse:.2e}"
        self.report(f"{self.cell}: {series}: {picture.samples} samples, {picture.seconds:.2f} s, {error}")
        return row

    def _curve(self, series: Series) -> tuple[CurvePoint, ...]:
        points = []
        for samples in self.options.samples:
            if pictures := self._pictures.get((series, samples)):
                verdict = self.references[series.backend].measure_error(*pictures)
                seconds = statistics.median(picture.seconds for picture in pictures)
                points.append(CurvePoint(**asdict(verdict), samples=samples, seconds=seconds))
        return tuple(points)

    @property
    def skips(self) -> dict[str, tuple[str, ...]]:
        """The skips of each backend."""
        return {candidate.backend: candidate.skips for candidate in self.candidates}

    def measurements_of(self, series: Series) -> list[Measurement]:
        """Return the measurements of a series."""
        return [row for row in self.measurements if row.series == series]

    def times(self, series: Series, target: float) -> Times:
        """Return the seconds of a series to a relMSE."""
        times = [reached.value for reached in self._efforts_of_repeats(series, target) if reached is not None]
        value = self._effort_to_error(series, self.curves.get(series, ()), target)
        return Times(value, min(times, default=None), max(times, default=None))

    def ratio(self, other: Series, target: float) -> Ratio | None:
        """Return the time of ``exact`` over that of a series; None where one of them was not measured."""
        pair = Series(EXACT, other.way), other
        if other.backend == EXACT or not all(series in self.curves for series in pair):
            return None
        value, by_samples = (
            effort_ratio(*(self._effort_to_error(series, self.curves[series], target, effort) for series in pair))
            for effort in ("seconds", "samples")
        )
        repeats = map(effort_ratio, *(self._efforts_of_repeats(series, target) for series in pair))
        spread = [ratio.value for ratio in repeats if ratio is not None and ratio.mark in ("", "~")]
        cost = self._cost_ratio(*pair)
        if by_samples is not None:
            by_samples = None if cost is None else CurveEffort(cost * by_samples.value, by_samples.mark)
        return Ratio(value, min(spread, default=None), max(spread, default=None), *other, target, by_samples)

    def _efforts_of_repeats(self, series: Series, target: float) -> list[CurveEffort | None]:
        """Return the seconds to a relMSE of each repeat alone."""
        rows = [[row for row in self.measurements if (row.series, row.repeat) == (series, repeat)]
                for repeat in range(self.options.repeats)]  # fmt: skip
        return [self._effort_to_error(series, points, target) for points in rows]

    def _effort_to_error(
        self,
        series: Series,
        points: Sequence[CurvePoint] | Sequence[Measurement],
        target: float,
        effort: str = "seconds",
    ) -> CurveEffort | None:
        """Return the seconds, or samples, to a relMSE on the curve of points whose relMSE is known."""
        certain = [(getattr(point, effort), point.relmse) for point in points if point.relmse is not None]
        curve = [value for value, _ in certain], [relmse for _, relmse in certain]
        if not self.options.independent:
            return effort_to_error(*curve, target)
        # What a denoiser leaves falls more slowly than noise.
        raw = series.way == "raw"
        limit = None if raw else _MAX_EXTRAPOLATION_DENOISED
        return effort_to_error(*curve, target, limit=limit, slopes=(float(raw), 1.0))

    def _cost_ratio(self, exact: Series, other: Series) -> float | None:
        """Return the time of a sample of one over that of another: the median over renders that followed each other.

        The renders are those of the most samples that both have, where the fixed cost of a frame matters least.
        """
        ours, theirs = ({(row.samples, row.repeat): row.seconds for row in self.measurements if row.series == series}
                        for series in (exact, other))  # fmt: skip
        pairs = ours.keys() & theirs.keys()
        most = max((samples for samples, _ in pairs), default=0)
        costs = [ours[samples, repeat] / theirs[samples, repeat] for samples, repeat in pairs if samples == most]
        return statistics.median(costs) if costs else None
