"""Renders a cell (a scene, a light and a look) with several backends, and measures time and error of each render.

The renders of one backend with increasing samples are points of a curve of error over time. From the curves follow the
times to a target error, and the ratios of these times between backends. Errors are relMSE against a reference.
"""

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
"""All other backends are compared with this backend. Only this backend also renders aimed pictures (`PictureKind`)."""

PictureKind = Literal["raw", "denoised", "aimed", "aimed, denoised"]
"""How a picture is made. Samples are added to an aimed picture until it estimates `BenchOptions.target_estimate`."""

PICTURES: tuple[PictureKind, ...] = ("raw", "denoised")
"""The kinds of pictures that have a given number of samples."""

MAX_EXTRAPOLATION = 4.0
"""A curve is extrapolated to at most this number of times the effort (seconds or samples) of its last point."""

_MAX_EXTRAPOLATION_DENOISED = 64.0  # the same for denoised curves, with `BenchOptions.independent`
_SEEDS_PER_REPEAT = FIRST_SEED // (SEEDS * MAX_REPEATS)  # seeds that are reserved for the renders of one repeat
# If a reference may end early, each of its parts is divided into this number of smaller parts.
_ENOUGH_PARTS = 4


class Series(NamedTuple):
    """The renders that one curve shows: the renders of one backend with one kind of pictures."""

    backend: str
    picture_kind: PictureKind = "raw"

    def __str__(self) -> str:
        return self.backend if self.picture_kind == "raw" else f"{self.backend}, {self.picture_kind}"


@dataclass(frozen=True)
class Candidate:
    """A backend that is ready to render a cell."""

    backend: str
    key: str  # identifies the converged picture in the cache of references
    render: RenderPicture
    skips: tuple[str, ...] = ()  # work that is left out because it changes no pixel, with the reasons
    denoises: bool = False  # whether the backend can denoise


@dataclass(frozen=True)
class Measurement:
    """One timed picture, with the fields of its cell, its series, its `TimedPicture` and its `MeasuredError`."""

    scene: str
    ibl: str
    look: str
    backend: str
    picture_kind: PictureKind
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
        return Series(self.backend, self.picture_kind)


@dataclass(frozen=True)
class CurvePoint(MeasuredError):
    """All renders of a series with one number of samples: median seconds, mean relMSE, and the bias of their mean."""

    samples: int
    seconds: float


@dataclass(frozen=True)
class CurveEffort:
    """The effort at which a curve reaches an error, or a ratio of two such efforts.

    `mark` is "" within the measured range, and "~" if the curve was extrapolated. `mark` is "<" or ">" if the value is
    only a bound, because the first point of a curve is below the error already.
    """

    value: float
    mark: Literal["", "~", "<", ">"] = ""


@dataclass(frozen=True)
class Times:
    """Seconds to a relMSE, or a ratio of two such times, with the spread over the repeats.

    `value` is read from the curve of all repeats. `low` and `high` are the least and the most of the values that the
    repeats give alone. A value is None if a curve does not reach the relMSE.
    """

    value: CurveEffort | None
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Ratio(Times):
    """The time of ``exact`` to a relMSE, over the time of another backend to it, with pictures of the same kind.

    `way` is the kind of the pictures. `by_samples` is another estimate of this ratio: the ratio of the samples that
    both backends need, times the ratio of the time of one sample. The time of a sample is compared between renders that
    followed each other.
    """

    backend: str  # the other backend
    way: PictureKind
    target: float  # relMSE
    by_samples: CurveEffort | None


def effort_to_error(
    effort: Sequence[float],
    error: Sequence[float],
    target: float,
    *,
    limit: float | None = MAX_EXTRAPOLATION,
    slopes: tuple[float, float] = (0.0, math.inf),
) -> CurveEffort | None:
    """Return the effort (seconds or samples) at which a curve first reaches the error `target`.

    `effort` and `error` are the coordinates of the curve's points, by increasing samples; all are positive. Between the
    points, the logarithm of the error is linear in the logarithm of the effort. Beyond the last point, it falls by the
    slope between the last two points, clamped to the range `slopes`; independent samples have the slope 1. The function
    returns None if the curve does not fall there, or if the effort would be more than `limit` times the last effort.
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
    """Return the effort `one` over the effort `other`, or None if one of them is missing or both are bounds."""
    if one is None or other is None or one.mark == other.mark == "<":
        return None
    value = one.value / other.value
    if "<" in (one.mark, other.mark):
        return CurveEffort(value, "<" if one.mark == "<" else ">")
    return CurveEffort(value, "~" if "~" in (one.mark, other.mark) else "")


def schedule(options: BenchOptions) -> Iterator[tuple[int, int, int]]:
    """Yield the repeat, the samples and the seed of every render, in order. All seeds differ."""
    for repeat in range(options.repeats):
        for number, samples in enumerate(options.samples):
            yield repeat, samples, _seed(options, repeat) + number


def _seed(options: BenchOptions, repeat: int) -> int:
    """Return the first of the `_SEEDS_PER_REPEAT` seeds of a repeat; all of them are below the seeds of references."""
    return (options.seed * MAX_REPEATS + repeat) * _SEEDS_PER_REPEAT


@dataclass
class CellRun:
    """A cell and its measurements so far, with the times and ratios that follow from them.

    `references` and `failures` are by the name of the backend.
    """

    cell: Cell
    candidates: Sequence[Candidate]
    options: BenchOptions
    report: ReportProgress
    measurements: list[Measurement] = field(default_factory=list)
    curves: Mapping[Series, tuple[CurvePoint, ...]] = field(default_factory=dict)  # set when `run` ends
    references: dict[str, Reference] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)  # the error that ended a backend's measurements
    _pictures: dict[tuple[Series, int], list[TimedPicture]] = field(default_factory=dict)  # by series and samples
    # The samples with which a backend's error is at most `BenchOptions.stop_relmse`, by the name of the backend. The
    # backend is not rendered with more samples.
    _max_samples: dict[str, int] = field(default_factory=dict)
    # The kinds of aimed pictures that missed the aimed error with the most samples; they are not rendered again.
    _out_of_reach: set[PictureKind] = field(default_factory=set)

    def run(self) -> None:
        """Render references, warm up, then measure. A backend that fails is left out from then on.

        Renders of the backends are interleaved, so that a slowdown of the machine affects all of them.
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
            self.curves = {
                series: self._curve(series) for series in pairs if series.picture_kind == "raw" or series in measured
            }
            self._pictures.clear()

    def _attempt(self, candidate: Candidate, step: Callable[..., object], *arguments: float) -> None:
        """Call `step` with a backend, unless the backend has failed before; record an error as its failure."""
        if candidate.backend in self.failures:
            return
        try:
            step(candidate, *arguments)
        except (LookdevError, OSError) as error:
            self.failures[candidate.backend] = str(error)
            self.report(f"{self.cell}: {candidate.backend} fails and is left out: {error}")

    def _obtain_reference(self, candidate: Candidate) -> None:
        """Read the reference of a backend from the cache, or render it."""
        options = self.options
        finer = _ENOUGH_PARTS if options.reference_relmse else 1
        # The samples of a part, and the number of parts.
        amount = max(options.samples[-1] // finer, 2), options.reference * finer

        def report(text: str) -> None:
            self.report(f"{self.cell}: {candidate.backend}: {text}")

        self.references[candidate.backend] = obtain_reference(
            candidate.key, *amount, candidate.render, report, enough=options.reference_relmse, fresh=options.fresh
        )

    def _render(self, candidate: Candidate, samples: int, seed: int) -> TimedPicture:
        """Render once, and denoise if the options request this and the backend can denoise."""
        sampling = {"denoise": "measured"} if self.options.denoise and candidate.denoises else {}
        return candidate.render(samples, seed, **sampling)

    def _measure(self, candidate: Candidate, repeat: int, samples: int, seed: int) -> None:
        """Render once, and record a measurement of the raw picture and, if there is one, of the denoised picture.

        The first repeat also decides whether these samples suffice (see `_max_samples`).
        """
        rendered = self._render(candidate, samples, seed)
        pictures: dict[PictureKind, TimedPicture] = {"raw": rendered.raw or rendered}
        pictures |= {"denoised": rendered} if rendered.raw else {}
        rows = []
        for way, picture in pictures.items():
            series = Series(candidate.backend, way)
            rows.append(self._record_picture(series, repeat, seed, picture))
            self._pictures.setdefault((series, samples), []).append(picture)
        if repeat == 0 and all(row.relmse is None or row.relmse <= self.options.stop_relmse for row in rows):
            self._max_samples[candidate.backend] = samples

    def _render_to_aim(self, candidate: Candidate, repeat: int) -> None:
        """Render with ``exact`` until it estimates `BenchOptions.target_estimate`, without denoising and with it.

        A kind of picture that does not reach the error with the most samples is rendered only once.
        """
        aim = self.options.target_estimate
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
        """Measure the error of a picture, and append the measurement."""
        measured = self.references[series.backend].measure_error(picture)
        figures = {name: getattr(picture, name) for name in ("samples", "seconds", "estimate", "memory", "renderer")}
        row = Measurement(
            **asdict(self.cell), **series._asdict(), repeat=repeat, seed=seed, **figures, **asdict(measured)
        )
        self.measurements.append(row)
        error = "lost in the noise of its reference" if measured.relmse is None else f"relMSE {measured.relmse:.2e}"
        self.report(f"{self.cell}: {series}: {picture.samples} samples, {picture.seconds:.2f} s, {error}")
        return row

    def _curve(self, series: Series) -> tuple[CurvePoint, ...]:
        """Return the points of a series' curve, by increasing samples. A point averages the pictures of all repeats."""
        points = []
        for samples in self.options.samples:
            if pictures := self._pictures.get((series, samples)):
                measured = self.references[series.backend].measure_error(*pictures)
                seconds = statistics.median(picture.seconds for picture in pictures)
                points.append(CurvePoint(**asdict(measured), samples=samples, seconds=seconds))
        return tuple(points)

    @property
    def skips(self) -> dict[str, tuple[str, ...]]:
        """The `Candidate.skips` of each backend, by its name."""
        return {candidate.backend: candidate.skips for candidate in self.candidates}

    def measurements_of(self, series: Series) -> list[Measurement]:
        """Return the measurements of a series."""
        return [row for row in self.measurements if row.series == series]

    def times(self, series: Series, target: float) -> Times:
        """Return the seconds that a series takes to the relMSE `target`."""
        times = [reached.value for reached in self._efforts_of_repeats(series, target) if reached is not None]
        value = self._effort_to_error(series, self.curves.get(series, ()), target)
        return Times(value, min(times, default=None), max(times, default=None))

    def ratio(self, other: Series, target: float) -> Ratio | None:
        """Return the time of ``exact`` to a relMSE, over the time of a series to it; None if one was not measured."""
        pair = Series(EXACT, other.picture_kind), other
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
        """Return the seconds to the relMSE `target` on the curve of each repeat alone."""
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
        """Return the effort, seconds or samples, to the relMSE `target` on the curve through points of known relMSE."""
        certain = [(getattr(point, effort), point.relmse) for point in points if point.relmse is not None]
        curve = [value for value, _ in certain], [relmse for _, relmse in certain]
        if not self.options.independent:
            return effort_to_error(*curve, target)
        # Raw noise is extrapolated without limit, with the slope of independent samples. The error of a denoised
        # picture falls more slowly, so its slope may be smaller, and its extrapolation is limited.
        raw = series.picture_kind == "raw"
        limit = None if raw else _MAX_EXTRAPOLATION_DENOISED
        return effort_to_error(*curve, target, limit=limit, slopes=(float(raw), 1.0))

    def _cost_ratio(self, exact: Series, other: Series) -> float | None:
        """Return the time of a sample of the series `exact` over the time of a sample of the series `other`.

        This is the median over pairs of consecutive renders. Of the renders of both series, those with the most samples
        are compared, because the fixed cost of a frame matters least there.
        """
        ours, theirs = ({(row.samples, row.repeat): row.seconds for row in self.measurements if row.series == series}
                        for series in (exact, other))  # fmt: skip
        pairs = ours.keys() & theirs.keys()
        most = max((samples for samples, _ in pairs), default=0)
        costs = [ours[samples, repeat] / theirs[samples, repeat] for samples, repeat in pairs if samples == most]
        return statistics.median(costs) if costs else None
