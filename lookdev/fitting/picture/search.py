"""The search of a fit to a picture: it finds the values of unknowns for which renders are nearest to the picture.

The search renders several starts, improves the best starts by damped Gauss-Newton steps, and refines the best result
with more samples. Each picture is rendered as two independent halves, so that the loss has no bias (see `target`). The
search varies units, which are the unknowns scaled to similar ranges (`Unknown.unit`).

- Levenberg, K. 1944; Marquardt, D. W. 1963: damped steps. SciPy's `lsq_linear` solves them within bounds.
- White, H. 1980. A Heteroskedasticity-Consistent Covariance Matrix Estimator. Econometrica 48(4): errors of parameters.
- Particle Data Group. Review of Particle Physics, section 5.2.2: errors grow where a fit is worse than the noise.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count

import numpy as np
from scipy.linalg import cholesky, eigh, solve_triangular
from scipy.optimize import lsq_linear
from scipy.stats import qmc
from threadpoolctl import threadpool_limits

from lookdev.arrays import Floats
from lookdev.errors import LookdevError
from lookdev.fitting.picture.target import Target
from lookdev.fitting.picture.unknowns import Unknown

RenderLook = Callable[[Mapping[str, tuple[float, ...]], bool, int, tuple[int, int]], Floats]
"""A function that renders a look.

Its arguments are the values of the unknowns by name, whether to render derivatives, the samples per pixel of a half,
and the seeds of the two halves. It returns an array (2, 1 + P, H, W, 4), with the halves on the first axis. On the
second axis are the picture and, if derivatives are requested, its derivatives with respect to each of the P numbers of
the unknowns, in order. On the last axis are RGB and alpha.
"""

_BOUND_MARGIN = 5e-4
"""The least distance of a rendered unit from its bound. At a bound, a lobe may have weight 0, and is never sampled."""

_MAX_STEP = 0.4  # the largest change of a unit in one step
_DAMPING, _MAX_DAMPING = 1e-3, 10.0  # the damping of the first step, and the limit above which steps end
_MIN_STEP = 1e-3  # the change of a unit below which a step counts as small: a thousandth of a slider
_SAME_END_DISTANCE = 0.05
"""Two results of the search are the same if no unit of them differs by this number or more."""
_UNDETERMINED = 0.25
"""An unknown is not determined if its error is larger than this number of units, a quarter of its slider."""

_CORRELATED = 0.95
"""Two unknowns are reported as trading off if the correlation of their errors is above this number."""


@dataclass(frozen=True)
class SearchSettings:
    """The extent of the search. All numbers of samples are per pixel of a half.

    Attributes
    ----------
    start_count, start_samples
        The number of starts that are rendered, and their samples.
    followed_count, steps, samples
        The number of the best starts from which damped steps are taken, the most steps from a start, and the samples of
        a step.
    rounds, final_samples
        The most steps that refine the best result of the followed starts, and the samples of the last such step.
    derivative_samples
        The samples of a derivative. A derivative needs fewer samples, because it is multiplied by the remaining
        difference.
    """

    start_count: int = 12
    followed_count: int = 2
    steps: int = 8
    rounds: int = 10
    start_samples: int = 8
    samples: int = 32
    final_samples: int = 256
    derivative_samples: int = 16
    seed: int = 0


@dataclass(frozen=True)
class LossPoint:
    """A render of the search, and its loss.

    The `stage` is ``"start"``, ``"follow"``, ``"refine"`` or ``"end"``. `start` is the number of the start; in the
    stage ``"refine"`` it is the number of the round. `accepted` is false for a step that made the loss larger.
    """

    stage: str
    start: int
    loss: float
    accepted: bool = True


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The result of a search.

    Attributes
    ----------
    values, errors
        The numbers of each unknown by name, and their standard errors from the noise of the picture and of the renders.
        The error is nan for a number without effect.
    without_effect, undetermined
        The names of numbers that change no pixel, and the names of numbers whose error is larger than a quarter of the
        slider.
    correlated_pairs
        Names of pairs of numbers that the picture does not separate well, and the correlation of their errors.
    before, after, noise
        The loss at the look's original values, the loss at the result, and the part of the loss that is the picture's
        noise.
    misfit
        The square root of loss / noise, at least 1. The errors are already multiplied by this number.
    starts
        The final losses of the followed starts, best first, and whether each ended near the result.
    curve
        All renders, in order.
    pictures
        The render with the look's original values, and the render with the result, (H, W, C). Each is the mean of its
        two halves.
    converged, interrupted
        Whether the last step is smaller than its error, and whether the user interrupted the search.
    """

    values: Mapping[str, tuple[float, ...]]
    errors: Mapping[str, tuple[float, ...]]
    without_effect: tuple[str, ...]
    undetermined: tuple[str, ...]
    correlated_pairs: tuple[tuple[str, str, float], ...]
    before: float
    after: float
    noise: float
    misfit: float
    starts: tuple[tuple[float, bool], ...]
    curve: tuple[LossPoint, ...]
    pictures: tuple[Floats, Floats]
    converged: bool
    interrupted: bool
    seconds: float


@dataclass(eq=False)
class _LocalModel:
    """A quadratic model of the loss near some units; P is the number of units."""

    gradient: Floats  # (P,)
    hessian: Floats  # (P, P)
    unbiased_hessian: Floats  # (P, P), without the bias from the noise of derivatives
    covariance: Floats  # (P, P), of the errors of the units
    noise_variance: float  # the mean variance of the residuals, times their weights


@dataclass(eq=False)
class Search:
    """A search for the values of a look's unknowns for which renders are nearest to a target.

    Arrays of units, (P,), have the numbers of all unknowns one after the other.
    """

    render: RenderLook
    target: Target
    unknowns: Sequence[Unknown]
    settings: SearchSettings = field(default_factory=SearchSettings)
    report: Callable[[LossPoint], None] = lambda point: None
    _curve: list[LossPoint] = field(default_factory=list)
    _seeds: Iterator[int] = field(default_factory=count)
    _best: tuple[Floats, float, Floats] | None = None  # the units of the best render so far, its loss, and its picture
    _initial_picture: Floats = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        self._low = np.concatenate([unknown.units(unknown.low) for unknown in self.unknowns])
        self._high = np.concatenate([unknown.units(unknown.high) for unknown in self.unknowns])
        # The bounds of rendered units, which are inside the bounds of the unknowns.
        margin = np.minimum(_BOUND_MARGIN, 0.25 * (self._high - self._low))
        self._inner_bounds = self._low + margin, self._high - margin
        initial = [unknown.unit(np.array(unknown.constant.value)) for unknown in self.unknowns]
        self._initial = self._clip(np.concatenate(initial))
        # The mask (H, W, C) of the compared values of the picture, and their weights in one dimension.
        self._is_compared = self.target.weight > 0.0
        self._weight = self.target.weight[self._is_compared]

    def run(self) -> SearchResult:
        """Run the search and return its result; after a KeyboardInterrupt, return the best result so far.

        If nothing is rendered yet, the KeyboardInterrupt is raised. Raises LookdevError if no unknown changes the
        picture.
        """
        start_time = time.perf_counter()
        ends: list[tuple[Floats, float]] = []  # the units at which the steps from each start end, and their loss
        converged = interrupted = False
        before = 0.0
        # With few columns, threads of the linear algebra only wait for each other.
        with threadpool_limits(1, "blas"):
            try:
                starts, before = self._find_starts()
                for number, start in enumerate(starts):
                    ends.append(self._follow(start, number, [end for end, _ in ends]))
                ends.sort(key=lambda end: end[1])
                converged = self._polish(ends[0][0])
            except KeyboardInterrupt:
                if self._best is None:
                    raise
                interrupted = True
            assert self._best is not None
            return self._result(before, ends, converged, interrupted, start_time)

    def _find_starts(self) -> tuple[list[Floats], float]:
        """Return the units of the starts to follow, best first, and the loss of the look's original values."""
        settings = self.settings
        trials = [self._initial]
        if settings.start_count > 1:
            low, high = (
                np.concatenate([unknown.units(unknown.start_range[end]) for unknown in self.unknowns]) for end in (0, 1)
            )
            sobol = qmc.Sobol(len(low), rng=np.random.default_rng(settings.seed))
            samples = sobol.random(_next_power_of_two(settings.start_count))
            trials += [self._clip(low + (high - low) * sample) for sample in samples[: settings.start_count - 1]]
        seeds = self._next_seeds()
        losses = []
        for number, unit in enumerate(trials):
            halves = self._render_halves(unit, settings.start_samples, seeds)
            losses.append(self.target.loss(*halves))
            self._record_point("start", number, losses[-1])
            self._record_best(unit, losses[-1], halves)
            self._initial_picture = self._initial_picture if number else 0.5 * (halves[0] + halves[1])
        order = np.argsort(losses)[: settings.followed_count]
        return [trials[n] for n in order], losses[0]

    def _follow(self, unit: Floats, number: int, earlier_ends: Sequence[Floats]) -> tuple[Floats, float]:
        """Take damped steps from the units of a start, all with the same seeds; return the last units, and their loss.

        `number` is the number of the start. The steps end when a step is smaller than the error of the units, when no
        damping makes the loss smaller, or near `earlier_ends`, the last units of earlier starts. The damping is divided
        by 8 after an accepted step, and multiplied by 8 after a rejected one.
        """
        settings, seeds = self.settings, self._next_seeds()
        halves = self._render_halves(unit, settings.samples, seeds)
        loss, damping = self.target.loss(*halves), _DAMPING
        self._record_point("follow", number, loss)
        for _ in range(settings.steps):
            local = self._local_model(unit, halves, settings.derivative_samples)
            accepted = False
            while not accepted and damping < _MAX_DAMPING:
                step = self._solve_step(unit, local, damping)
                if self._is_small(step, local):
                    return unit, loss
                moved = self._clip(unit + step)
                trial = self._render_halves(moved, settings.samples, seeds)
                trial_loss = self.target.loss(*trial)
                accepted = trial_loss < loss
                self._record_point("follow", number, trial_loss, accepted)
                damping = damping / 8.0 if accepted else max(damping, 1e-2) * 8.0
            if not accepted:
                break  # a better step needs more samples
            unit, halves, loss = moved, trial, trial_loss
            self._record_best(unit, loss, halves)
            if any(np.abs(unit - end).max() < _SAME_END_DISTANCE for end in earlier_ends):
                break
        return unit, loss

    def _polish(self, unit: Floats) -> bool:
        """Refine units by undamped steps, each with new seeds; return whether the last step is smaller than its error.

        The first step has twice the samples of `_follow`. The samples are doubled after each step, up to
        `final_samples`.
        """
        samples, derivative_samples = 2 * self.settings.samples, 2 * self.settings.derivative_samples
        is_small = False
        for number in range(self.settings.rounds):
            halves = self._render_halves(unit, samples, self._next_seeds())
            local = self._local_model(unit, halves, derivative_samples)
            self._record_point("refine", number, loss := self.target.loss(*halves))
            self._best = unit, loss, 0.5 * (halves[0] + halves[1])
            step = self._solve_step(unit, local, 0.0)
            unit = self._clip(unit + step)
            is_small = self._is_small(step, local)
            if is_small and samples >= self.settings.final_samples:
                break
            samples = min(2 * samples, self.settings.final_samples)
            # While steps are large, the noise of derivatives makes them too short; more samples reduce it.
            derivative_samples = min(2 * derivative_samples, 8 * self.settings.derivative_samples)
        self._best = unit, loss, self._best[2] if self._best else self._initial_picture
        return is_small

    def _result(
        self, before: float, ends: Sequence[tuple[Floats, float]], converged: bool, interrupted: bool, start_time: float
    ) -> SearchResult:
        """Render the best units with all samples, and return the result with its errors.

        After an interruption nothing is rendered, and the errors are nan.
        """
        assert self._best is not None, "a start was rendered"
        unit, loss, picture = self._best
        no_errors = np.full(len(unit), np.nan)
        errors, covariance, misfit, noise = no_errors, None, 1.0, self.target.noise
        if not interrupted:
            halves = self._render_halves(unit, self.settings.final_samples, self._next_seeds())
            loss, picture = self.target.loss(*halves), 0.5 * (halves[0] + halves[1])
            self._record_point("end", 0, loss)
            local = self._local_model(unit, halves, 16 * self.settings.derivative_samples)
            misfit = float(np.sqrt(max(1.0, loss / noise))) if noise > 0.0 else 1.0
            covariance = local.covariance
            errors = misfit * np.sqrt(np.diag(covariance))
            errors = np.where(np.diag(local.hessian) > 0.0, errors, np.nan)
        names = [
            unknown.name + f"[{'rgb'[i]}]" * (unknown.width > 1)
            for unknown in self.unknowns
            for i in range(unknown.width)
        ]
        named_errors = list(zip(names, errors, strict=True))
        undetermined = [name for name, error in named_errors if error > _UNDETERMINED]
        without_effect = [name for name, error in named_errors if np.isnan(error) and not interrupted]
        final_unit = self._snap_to_bounds(unit)
        values, value_errors = {}, {}
        for unknown, part in self._slices():
            values[unknown.name] = tuple(map(float, unknown.value(final_unit[part])))
            value_errors[unknown.name] = tuple(map(float, errors[part] * unknown.rate(final_unit[part])))
        return SearchResult(
            values, value_errors, tuple(without_effect), tuple(undetermined),
            tuple(_correlated_pairs(names, covariance, errors)), before, loss, noise, misfit,
            tuple((end, bool(np.abs(end_unit - unit).max() < _SAME_END_DISTANCE)) for end_unit, end in ends),
            tuple(self._curve), (self._initial_picture, picture), converged, interrupted,
            time.perf_counter() - start_time,
        )  # fmt: skip

    def _render_halves(self, unit: Floats, samples: int, seeds: tuple[int, int]) -> tuple[Floats, Floats]:
        """Return two independent renders (H, W, C) with given units."""
        halves = self._render_in_units(unit, False, samples, seeds)
        return halves[0, 0], halves[1, 0]

    def _render_in_units(self, unit: Floats, with_derivatives: bool, samples: int, seeds: tuple[int, int]) -> Floats:
        """Render a picture and its derivatives with respect to units, as halves (2, 1 + P, H, W, C).

        If the exposure is an unknown, the picture and its derivatives are multiplied by its factor. C is the number of
        channels of the target.
        """
        parts = [(unknown, unit[part]) for unknown, part in self._slices()]
        values = {
            unknown.name: tuple(map(float, unknown.value(part))) for unknown, part in parts if not unknown.is_exposure
        }
        channels = self.target.value.shape[-1]
        halves = self.render(values, with_derivatives, samples, seeds)[..., :channels].astype(np.float64)
        light = np.array([1.0, 1.0, 1.0, 0.0])[:channels]  # alpha is not exposed
        # The factor of the exposure; 1 if the exposure is not an unknown.
        gain = {unknown.is_exposure: 2.0 ** float(unknown.value(part)[0]) for unknown, part in parts}.get(True, 1.0)
        halves *= gain * light + (1.0 - light)
        picture_and_derivatives, index = [halves[:, 0]], 1
        for unknown, part in parts if with_derivatives else ():
            if unknown.is_exposure:
                picture_and_derivatives.append(np.log(2.0) * unknown.rate(part)[0] * light * halves[:, 0])
                continue
            for rate in unknown.rate(part):
                picture_and_derivatives.append(rate * halves[:, index])
                index += 1
        return np.stack(picture_and_derivatives, axis=1)

    def _local_model(self, unit: Floats, halves: tuple[Floats, Floats], samples: int) -> _LocalModel:
        """Return a quadratic model of the loss near some units, from the halves that are rendered with these units.

        The derivatives are rendered with seeds of their own, so that their noise is independent of the halves' noise.
        `first` and `second` are the two halves of the derivatives at the compared numbers of the picture.
        """
        derivatives = self._render_in_units(unit, True, samples, self._next_seeds())[:, 1:]
        first, second = (
            np.stack([derivative[self._is_compared] for derivative in half], axis=-1) for half in derivatives
        )
        a, b = (half[self._is_compared] for half in halves)
        mean = 0.5 * (first + second)
        weighted = mean * self._weight[:, None]
        residual = 0.5 * (a + b) - self.target.value[self._is_compared]
        hessian = mean.T @ weighted
        cross_product = (first * self._weight[:, None]).T @ second
        unbiased = 0.5 * (cross_product + cross_product.T)
        if not hessian.any():
            names = ", ".join(unknown.name for unknown in self.unknowns)
            raise LookdevError(f"the picture does not change with {names}: another parameter or pose would be right")
        identity = np.eye(len(hessian))
        ridge = 1e-9 * np.trace(hessian) * identity
        if eigh(unbiased + ridge, hessian + ridge, eigvals_only=True).min() < 0.25:
            unbiased = hessian  # the samples are too few to remove the bias
        variance = self.target.variance[self._is_compared] + (0.5 * (a - b)) ** 2
        noise_variance = float((self._weight * variance).mean())
        # By the added identity, each unit has a prior standard error of 1, the width of its slider. A number without
        # effect keeps this error.
        information = _positive_part(cross_product) + noise_variance * identity
        weighted_variance = (self._weight**2 * variance)[:, None]
        scores = _positive_part((first * weighted_variance).T @ second) + noise_variance**2 * identity
        inverse = np.linalg.inv(information)
        covariance = inverse @ scores @ inverse
        return _LocalModel(weighted.T @ residual, hessian, unbiased, covariance, noise_variance)

    def _solve_step(self, unit: Floats, local: _LocalModel, damping: float) -> Floats:
        """Return the change of the units, within the bounds, that minimizes the damped local model."""
        damped = local.unbiased_hessian + np.diag(damping * np.diag(local.hessian) + local.noise_variance)
        root = cholesky(damped)
        target = -solve_triangular(root, local.gradient, trans="T")
        low = np.maximum(self._inner_bounds[0] - unit, -_MAX_STEP)
        high = np.minimum(self._inner_bounds[1] - unit, _MAX_STEP)
        return np.asarray(lsq_linear(root, target, (np.minimum(low, -1e-12), np.maximum(high, 1e-12)), method="bvls").x)

    def _is_small(self, step: Floats, local: _LocalModel) -> bool:
        """Return whether the change of each unit is smaller than its error or than `_MIN_STEP`."""
        return bool(np.all(np.abs(step) < np.maximum(np.sqrt(np.diag(local.covariance)), _MIN_STEP)))

    def _slices(self) -> Iterator[tuple[Unknown, slice]]:
        """Yield each unknown with the slice of its numbers in an array of units."""
        first = 0
        for unknown in self.unknowns:
            yield unknown, slice(first, first + unknown.width)
            first += unknown.width

    def _clip(self, unit: Floats) -> Floats:
        """Return units clipped to the bounds of rendered units, which have the margin `_BOUND_MARGIN`."""
        return np.asarray(np.clip(unit, *self._inner_bounds))

    def _snap_to_bounds(self, unit: Floats) -> Floats:
        """Return units; a unit that `_clip` keeps off a bound is replaced by the bound."""
        low, high = (np.abs(unit - end) < 1e-6 for end in self._inner_bounds)
        return np.where(low, self._low, np.where(high, self._high, unit))

    def _next_seeds(self) -> tuple[int, int]:
        return next(self._seeds), next(self._seeds)

    def _record_best(self, unit: Floats, loss: float, halves: tuple[Floats, Floats]) -> None:
        """Store units, their loss and their picture if no earlier loss is smaller."""
        if self._best is None or loss < self._best[1]:
            self._best = unit, loss, 0.5 * (halves[0] + halves[1])

    def _record_point(self, stage: str, start: int, loss: float, accepted: bool = True) -> None:
        """Append a render to the curve of losses, and report it."""
        self._curve.append(LossPoint(stage, start, loss, accepted))
        self.report(self._curve[-1])


def _correlated_pairs(
    names: Sequence[str], covariance: Floats | None, errors: Floats
) -> Iterator[tuple[str, str, float]]:
    """Yield the names of two numbers whose errors are correlated by more than `_CORRELATED`, and the correlation."""
    if covariance is None:
        return
    scale = np.sqrt(np.diag(covariance))
    for i in range(len(names)):
        for j in range(i):
            correlation = float(covariance[i, j] / (scale[i] * scale[j]))
            if abs(correlation) > _CORRELATED and np.isfinite(errors[[i, j]]).all():
                yield names[j], names[i], correlation


def _positive_part(matrix: Floats) -> Floats:
    """Return the symmetric part of a matrix, with 0 in place of negative eigenvalues, which noise causes."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def _next_power_of_two(number: int) -> int:
    return 1 << (number - 1).bit_length()
