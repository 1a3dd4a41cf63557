"""The search: some starts by renders alone, the best followed by damped Gauss-Newton steps, the end by more samples.

- Levenberg, K. 1944; Marquardt, D. W. 1963: damped steps. Bounds are those of scipy's `lsq_linear`.
- White, H. 1980. A Heteroskedasticity-Consistent Covariance Matrix Estimator. Econometrica 48(4): errors of parameters.
- Particle Data Group. Review of Particle Physics, section 5.2.2: errors grow where a fit is worse than the noise.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, eigh, solve_triangular
from scipy.optimize import lsq_linear
from scipy.stats import qmc
from threadpoolctl import threadpool_limits

from lookdev.errors import LookdevError
from lookdev.fitting.picture.target import Target
from lookdev.fitting.picture.unknowns import Unknown

Floats = NDArray[np.float64]

Render = Callable[[Mapping[str, tuple[float, ...]], bool, int, tuple[int, int]], Floats]
"""From values of the look's unknowns by name, whether derivatives are wanted, samples and seeds to halves (2, 1 + P, H,
W, 4) of a picture and its derivatives by each number of each unknown, in order."""

_INSIDE = 5e-4
"""Units from a bound within which nothing is rendered: a lobe without weight is drawn by no direction."""

_LONGEST = 0.4  # units of a step
_DAMPING, _MOST_DAMPING = 1e-3, 10.0
_NOTHING = 1e-3  # units of a step: a thousandth of a slider
_NEAR = 0.05
"""Units within which two ends are one."""
_UNDETERMINED = 0.25
"""Units of error from which on a parameter is not determined: a quarter of its slider."""

_ALIKE = 0.95
"""Of a correlation, from which on two parameters are said to trade off."""


@dataclass(frozen=True)
class Settings:
    """How much is searched: `tried` starts, of which the best few are `followed`; samples of a half's pixel.

    A derivative needs fewer samples than a picture: it multiplies what is left of the difference.
    """

    tried: int = 12
    followed: int = 2
    steps: int = 8
    rounds: int = 10
    coarse: int = 8
    samples: int = 32
    finest: int = 256
    slopes: int = 16
    seed: int = 0


@dataclass(frozen=True)
class Point:
    """A point of the loss curve: what is done, the start that is followed, and the loss; `accepted` steps are kept."""

    stage: str
    start: int
    loss: float
    accepted: bool = True


@dataclass(frozen=True, eq=False)
class Found:
    """What was found.

    values, errors
        Of each unknown by name: its numbers, and their standard errors by the noise of picture and renders; nan where
        they have no effect.
    without_effect, undetermined
        Names of those that change no pixel, or less than the noise.
    alike
        Pairs of names, with their correlation, that change the picture alike: each is less sure than both together.
    before, after, noise
        The loss at the look's own values and at those found, and the part of it that is the picture's noise.
    misfit
        The root of the loss over that part, at least 1, by which errors are multiplied.
    starts
        The losses at which starts that were followed ended, best first, and whether each ended near the result.
    pictures
        The means of halves (H, W, C) at the look's own values, and at those found.
    converged, interrupted
        Whether the last step is smaller than its error, and whether the search was cut short.
    """

    values: Mapping[str, tuple[float, ...]]
    errors: Mapping[str, tuple[float, ...]]
    without_effect: tuple[str, ...]
    undetermined: tuple[str, ...]
    alike: tuple[tuple[str, str, float], ...]
    before: float
    after: float
    noise: float
    misfit: float
    starts: tuple[tuple[float, bool], ...]
    curve: tuple[Point, ...]
    pictures: tuple[Floats, Floats]
    converged: bool
    interrupted: bool
    seconds: float


@dataclass(eq=False)
class _Fit:
    """A local model: weighted residual, derivatives and their products, in units."""

    gradient: Floats
    hessian: Floats
    whole: Floats  # the Hessian without the noise of derivatives
    covariance: Floats
    level: float  # the variance of residuals, relative to the weights


@dataclass(eq=False)
class Search:
    """A search for the unknowns of a look whose renders are nearest to a target."""

    render: Render
    target: Target
    unknowns: Sequence[Unknown]
    settings: Settings = field(default_factory=Settings)
    report: Callable[[Point], None] = lambda point: None
    _curve: list[Point] = field(default_factory=list)
    _seeds: Iterator[int] = field(default_factory=count)
    _best: tuple[Floats, float, Floats] | None = None
    _first: Floats = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        self._low = np.concatenate([np.repeat(each.unit(np.array(each.low)), each.width) for each in self.unknowns])
        self._high = np.concatenate([np.repeat(each.unit(np.array(each.high)), each.width) for each in self.unknowns])
        inside = np.minimum(_INSIDE, 0.25 * (self._high - self._low))
        self._inner = self._low + inside, self._high - inside
        self._given = self._within(np.concatenate([each.unit(np.array(each.constant.value)) for each in self.unknowns]))
        self._used = self.target.weight > 0.0
        self._weight = self.target.weight[self._used]

    def run(self) -> Found:
        """Return the best that is found; after a KeyboardInterrupt the best so far, if there is one.

        Raises LookdevError where no unknown changes the picture.
        """
        started = time.perf_counter()
        ends: list[tuple[Floats, float]] = []
        converged = interrupted = False
        before = 0.0
        # Threads of the linear algebra, on matrices of a few columns, only wait for each other.
        with threadpool_limits(1, "blas"):
            try:
                starts, before = self._starts()
                for number, start in enumerate(starts):
                    ends.append(self._follow(start, number, [end for end, _ in ends]))
                ends.sort(key=lambda end: end[1])
                converged = self._polish(ends[0][0])
            except KeyboardInterrupt:
                if self._best is None:
                    raise
                interrupted = True
            assert self._best is not None
            return self._found(before, ends, converged, interrupted, started)

    def _starts(self) -> tuple[list[Floats], float]:
        """Return the starts to follow, best first, and the loss of the look's own values."""
        settings = self.settings
        tried = [self._given]
        if settings.tried > 1:
            usual = [np.repeat([each.unit(np.array(end)) for end in each.usual], each.width).reshape(2, -1)
                     for each in self.unknowns]  # fmt: skip
            low, high = np.concatenate(usual, axis=1)
            drawn = qmc.Sobol(len(low), rng=np.random.default_rng(settings.seed)).random(_power_above(settings.tried))
            tried += [self._within(low + (high - low) * each) for each in drawn[: settings.tried - 1]]
        seeds = self._pair()
        losses = []
        for number, unit in enumerate(tried):
            halves = self._pictures(unit, settings.coarse, seeds)
            losses.append(self.target.loss(*halves))
            self._note("start", number, losses[-1])
            self._keep(unit, losses[-1], halves)
            self._first = self._first if number else 0.5 * (halves[0] + halves[1])
        order = np.argsort(losses)[: settings.followed]
        return [tried[n] for n in order], losses[0]

    def _follow(self, unit: Floats, number: int, known: Sequence[Floats]) -> tuple[Floats, float]:
        """Return where damped steps end from a start, and the loss there, by the same samples at each step.

        Steps end where they are smaller than the error by so many samples, or near where another start has ended.
        """
        settings, seeds = self.settings, self._pair()
        halves = self._pictures(unit, settings.samples, seeds)
        loss, damping = self.target.loss(*halves), _DAMPING
        self._note("follow", number, loss)
        for _ in range(settings.steps):
            local = self._local(unit, halves, settings.slopes)
            accepted = False
            while not accepted and damping < _MOST_DAMPING:
                step = self._step(unit, local, damping)
                if self._is_small(step, local, 1.0):
                    return unit, loss
                moved = self._within(unit + step)
                trial = self._pictures(moved, settings.samples, seeds)
                found = self.target.loss(*trial)
                accepted = found < loss
                self._note("follow", number, found, accepted)
                damping = damping / 8.0 if accepted else max(damping, 1e-2) * 8.0
            if not accepted:
                break  # nothing more that this many samples show
            unit, halves, loss = moved, trial, found
            self._keep(unit, loss, halves)
            if any(np.abs(unit - end).max() < _NEAR for end in known):
                break
        return unit, loss

    def _polish(self, unit: Floats) -> bool:
        """Take steps by fresh samples, twice as many each time; return whether the last is smaller than its error."""
        samples, slopes = 2 * self.settings.samples, 2 * self.settings.slopes
        small = False
        for number in range(self.settings.rounds):
            halves = self._pictures(unit, samples, self._pair())
            local = self._local(unit, halves, slopes)
            self._note("refine", number, loss := self.target.loss(*halves))
            self._best = unit, loss, 0.5 * (halves[0] + halves[1])
            step = self._step(unit, local, 0.0)
            unit = self._within(unit + step)
            small = self._is_small(step, local, 1.0)
            if small and samples >= self.settings.finest:
                break
            samples = min(2 * samples, self.settings.finest)
            # Where steps are not small yet, their noise is that of derivatives: it makes them shorter.
            slopes = min(2 * slopes, 8 * self.settings.slopes)
        self._best = unit, loss, self._best[2] if self._best else self._first
        return small

    def _found(
        self,
        before: float,
        ends: Sequence[tuple[Floats, float]],
        converged: bool,
        interrupted: bool,
        started: float,
    ) -> Found:
        assert self._best is not None, "a start was rendered"
        unit, loss, picture = self._best
        nothing = np.full(len(unit), np.nan)
        errors, whole, misfit, noise = nothing, None, 1.0, self.target.noise
        if not interrupted:
            halves = self._pictures(unit, self.settings.finest, self._pair())
            loss, picture = self.target.loss(*halves), 0.5 * (halves[0] + halves[1])
            self._note("end", 0, loss)
            local = self._local(unit, halves, 16 * self.settings.slopes)
            misfit = float(np.sqrt(max(1.0, loss / noise))) if noise > 0.0 else 1.0
            whole = local.covariance
            errors = misfit * np.sqrt(np.diag(whole))
            errors = np.where(np.diag(local.hessian) > 0.0, errors, np.nan)
        names = [each.name + f"[{'rgb'[i]}]" * (each.width > 1) for each in self.unknowns for i in range(each.width)]
        vague = [name for name, error in zip(names, errors, strict=True) if error > _UNDETERMINED]
        idle = [name for name, error in zip(names, errors, strict=True) if np.isnan(error) and not interrupted]
        at_bound = self._snapped(unit)
        values, spread = {}, {}
        for each, part in self._parts():
            values[each.name] = tuple(map(float, each.value(at_bound[part])))
            spread[each.name] = tuple(map(float, errors[part] * each.rate(at_bound[part])))
        return Found(
            values, spread, tuple(idle), tuple(vague), tuple(_alike(names, whole, errors)), before, loss, noise, misfit,
            tuple((end, bool(np.abs(where - unit).max() < _NEAR)) for where, end in ends),
            tuple(self._curve), (self._first, picture), converged, interrupted, time.perf_counter() - started,
        )  # fmt: skip

    def _pictures(self, unit: Floats, samples: int, seeds: tuple[int, int]) -> tuple[Floats, Floats]:
        halves = self._rendered(unit, False, samples, seeds)
        return halves[0, 0], halves[1, 0]

    def _rendered(self, unit: Floats, slopes: bool, samples: int, seeds: tuple[int, int]) -> Floats:
        """Return halves (2, 1 + P, H, W, C), exposed, derived by units."""
        parts = [(each, unit[part]) for each, part in self._parts()]
        values = {each.name: tuple(map(float, each.value(part))) for each, part in parts if not each.is_exposure}
        found = self.render(values, slopes, samples, seeds)[..., : self.target.value.shape[-1]].astype(np.float64)
        light = np.array([1.0, 1.0, 1.0, 0.0])[: found.shape[-1]]  # alpha is not exposed
        gain = {each.is_exposure: 2.0 ** float(each.value(part)[0]) for each, part in parts}.get(True, 1.0)
        found *= gain * light + (1.0 - light)
        made, place = [found[:, 0]], 1
        for each, part in parts if slopes else ():
            if each.is_exposure:
                made.append(np.log(2.0) * each.rate(part)[0] * light * found[:, 0])
                continue
            for rate in each.rate(part):
                made.append(rate * found[:, place])
                place += 1
        return np.stack(made, axis=1)

    def _local(self, unit: Floats, halves: tuple[Floats, Floats], samples: int) -> _Fit:
        """Return the local model; derivatives are of samples of their own, so that their noise is independent."""
        found = self._rendered(unit, True, samples, self._pair())[:, 1:]
        one, other = (np.stack([each[self._used] for each in half], axis=-1) for half in found)
        a, b = (each[self._used] for each in halves)
        both = 0.5 * (one + other)
        weighted = both * self._weight[:, None]
        rest = 0.5 * (a + b) - self.target.value[self._used]
        hessian = both.T @ weighted
        crossed = (one * self._weight[:, None]).T @ other
        whole = 0.5 * (crossed + crossed.T)
        if not hessian.any():
            names = ", ".join(each.name for each in self.unknowns)
            raise LookdevError(f"the picture does not change with {names}: another parameter or pose would be right")
        ridge = 1e-9 * np.trace(hessian) * np.eye(len(hessian))
        if eigh(whole + ridge, hessian + ridge, eigvals_only=True).min() < 0.25:
            whole = hessian  # so few samples do not show what of it is their noise
        variance = self.target.variance[self._used] + (0.5 * (a - b)) ** 2
        level = float((self._weight * variance).mean())
        # A slider's width is known of each beforehand: so what has no effect has an error of that.
        known = _positive(crossed) + level * np.eye(len(crossed))
        scores = _positive((one * (self._weight**2 * variance)[:, None]).T @ other) + level**2 * np.eye(len(crossed))
        inverse = np.linalg.inv(known)
        covariance = inverse @ scores @ inverse
        return _Fit(weighted.T @ rest, hessian, whole, covariance, level)

    def _step(self, unit: Floats, local: _Fit, damping: float) -> Floats:
        """Return the step to the least weighted square of the local model within the bounds."""
        raised = local.whole + np.diag(damping * np.diag(local.hessian) + local.level)
        root = cholesky(raised)
        aim = -solve_triangular(root, local.gradient, trans="T")
        low = np.maximum(self._inner[0] - unit, -_LONGEST)
        high = np.minimum(self._inner[1] - unit, _LONGEST)
        return np.asarray(lsq_linear(root, aim, (np.minimum(low, -1e-12), np.maximum(high, 1e-12)), method="bvls").x)

    def _is_small(self, step: Floats, local: _Fit, errors: float) -> bool:
        return bool(np.all(np.abs(step) < np.maximum(errors * np.sqrt(np.diag(local.covariance)), _NOTHING)))

    def _parts(self) -> Iterator[tuple[Unknown, slice]]:
        """Yield each unknown with the places of its numbers."""
        first = 0
        for each in self.unknowns:
            yield each, slice(first, first + each.width)
            first += each.width

    def _within(self, unit: Floats) -> Floats:
        return np.asarray(np.clip(unit, *self._inner))

    def _snapped(self, unit: Floats) -> Floats:
        """Return units at their bounds where they are as near as renders go."""
        low, high = (np.abs(unit - end) < 1e-6 for end in self._inner)
        return np.where(low, self._low, np.where(high, self._high, unit))

    def _pair(self) -> tuple[int, int]:
        return next(self._seeds), next(self._seeds)

    def _keep(self, unit: Floats, loss: float, halves: tuple[Floats, Floats]) -> None:
        if self._best is None or loss < self._best[1]:
            self._best = unit, loss, 0.5 * (halves[0] + halves[1])

    def _note(self, stage: str, start: int, loss: float, accepted: bool = True) -> None:
        self._curve.append(Point(stage, start, loss, accepted))
        self.report(self._curve[-1])


def _alike(names: Sequence[str], covariance: Floats | None, errors: Floats) -> Iterator[tuple[str, str, float]]:
    if covariance is None:
        return
    scale = np.sqrt(np.diag(covariance))
    for i in range(len(names)):
        for j in range(i):
            found = float(covariance[i, j] / (scale[i] * scale[j]))
            if abs(found) > _ALIKE and np.isfinite(errors[[i, j]]).all():
                yield names[j], names[i], found


def _positive(matrix: Floats) -> Floats:
    """Return the symmetric part of a product of independent halves, without the negative squares that are its noise."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def _power_above(number: int) -> int:
    return 1 << (number - 1).bit_length()
