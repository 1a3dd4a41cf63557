"""The search: it renders starts, improves the best by damped Gauss-Newton steps, and refines with more samples.

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

Its arguments are the values of the unknowns by name, whether to differentiate, the samples per pixel of a half, and the
seeds of the two halves. It returns halves (2, 1 + P, H, W, 4): a picture, and, if it differentiates, its derivatives
with respect to each of the P numbers of the unknowns, in order.
"""

_BOUND_MARGIN = 5e-4
"""The least distance of renders from a bound, in units: a lobe of weight 0 would never be sampled."""

_MAX_STEP = 0.4  # units
_DAMPING, _MAX_DAMPING = 1e-3, 10.0
_MIN_STEP = 1e-3  # units of a step, a thousandth of a slider
_SAME_END_DISTANCE = 0.05
"""The distance, in units, below which two ends are the same."""
_UNDETERMINED = 0.25
"""Units of error above which a parameter is not determined: a quarter of its slider."""

_CORRELATED = 0.95
"""The correlation above which two parameters trade off."""


@dataclass(frozen=True)
class SearchSettings:
    """The extent of the search.

    It renders `start_count` starts, follows the best `followed_count` by at most `steps` steps each, and refines the
    best end in at most `rounds` rounds. Samples are those of a pixel in a half: `start_samples` of a start, `samples`
    of a step, `final_samples` of the last rounds. A derivative needs fewer, `derivative_samples`, as it is multiplied
    by the remaining difference.
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
    """A render of the search: its stage, the number of its start, its loss, and whether its step is accepted.

    The stages are ``"start"``, ``"follow"``, ``"refine"`` and ``"end"``. In the stage ``"refine"``, the number is that
    of the round.
    """

    stage: str
    start: int
    loss: float
    accepted: bool = True


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The result of a search.

    values, errors
        The numbers of each unknown by name, and their standard errors from the noise of picture and renders. The error
        is nan for a number without effect.
    without_effect, undetermined
        Names of numbers that change no pixel, and of numbers whose error is larger than a quarter of the slider.
    correlated_pairs
        Names of pairs of numbers that the picture does not separate well, and the correlation of their errors.
    before, after, noise
        The loss at the look's original values, the loss at the result, and the part of the loss that is the picture's
        noise.
    misfit
        The square root of loss / noise, at least 1. The errors are already multiplied by it.
    starts
        The final losses of the followed starts, best first, and whether each ended near the result.
    pictures
        The means of halves (H, W, C) at the look's original values, and at the result.
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
    """A local quadratic model of the loss, in units."""

    gradient: Floats
    hessian: Floats
    unbiased_hessian: Floats  # without the noise of derivatives
    covariance: Floats
    noise_variance: float  # of residuals, relative to the weights


@dataclass(eq=False)
class Search:
    """A search for the values of a look's unknowns at which its renders are nearest to a target.

    It varies units: the numbers of all unknowns, one after the other, scaled to similar ranges (`Unknown.unit`).
    """

    render: RenderLook
    target: Target
    unknowns: Sequence[Unknown]
    settings: SearchSettings = field(default_factory=SearchSettings)
    report: Callable[[LossPoint], None] = lambda point: None
    _curve: list[LossPoint] = field(default_factory=list)
    _seeds: Iterator[int] = field(default_factory=count)
    _best: tuple[Floats, float, Floats] | None = None
    _initial_picture: Floats = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        self._low = np.concatenate([unknown.units(unknown.low) for unknown in self.unknowns])
        self._high = np.concatenate([unknown.units(unknown.high) for unknown in self.unknowns])
        inside = np.minimum(_BOUND_MARGIN, 0.25 * (self._high - self._low))
        self._inner_bounds = self._low + inside, self._high - inside
        initial = [unknown.unit(np.array(unknown.constant.value)) for unknown in self.unknowns]
        self._initial = self._clip(np.concatenate(initial))
        self._is_compared = self.target.weight > 0.0
        self._weight = self.target.weight[self._is_compared]

    def run(self) -> SearchResult:
        """Return the best result; after a KeyboardInterrupt the best so far, if there is one.

        Raises LookdevError if no unknown changes the picture.
        """
        start_time = time.perf_counter()
        ends: list[tuple[Floats, float]] = []
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
        """Return the starts to follow, best first, and the loss of the look's original values."""
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

        Steps end when they are smaller than the error of the result, or near the end of an earlier start.
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
        """Take undamped steps, each with new seeds; return whether the last step is smaller than its error.

        The first step has twice the samples of `_follow`; they are doubled after each step, up to `final_samples`.
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
        halves = self._render_in_units(unit, False, samples, seeds)
        return halves[0, 0], halves[1, 0]

    def _render_in_units(self, unit: Floats, with_derivatives: bool, samples: int, seeds: tuple[int, int]) -> Floats:
        """Return halves (2, 1 + P, H, W, C): a picture, multiplied by the exposure, and its derivatives by units."""
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
        """Return the local model at units, from the halves rendered there.

        Derivatives are rendered with their own seeds, so that their noise is independent.
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
            unbiased = hessian  # too few samples to remove the noise
        variance = self.target.variance[self._is_compared] + (0.5 * (a - b)) ** 2
        noise_variance = float((self._weight * variance).mean())
        # The prior standard error of a number is the width of its slider. A number without effect keeps this error.
        information = _positive_part(cross_product) + noise_variance * identity
        weighted_variance = (self._weight**2 * variance)[:, None]
        scores = _positive_part((first * weighted_variance).T @ second) + noise_variance**2 * identity
        inverse = np.linalg.inv(information)
        covariance = inverse @ scores @ inverse
        return _LocalModel(weighted.T @ residual, hessian, unbiased, covariance, noise_variance)

    def _solve_step(self, unit: Floats, local: _LocalModel, damping: float) -> Floats:
        """Return the step to the least loss of the local model within the bounds."""
        damped = local.unbiased_hessian + np.diag(damping * np.diag(local.hessian) + local.noise_variance)
        root = cholesky(damped)
        target = -solve_triangular(root, local.gradient, trans="T")
        low = np.maximum(self._inner_bounds[0] - unit, -_MAX_STEP)
        high = np.minimum(self._inner_bounds[1] - unit, _MAX_STEP)
        return np.asarray(lsq_linear(root, target, (np.minimum(low, -1e-12), np.maximum(high, 1e-12)), method="bvls").x)

    def _is_small(self, step: Floats, local: _LocalModel) -> bool:
        return bool(np.all(np.abs(step) < np.maximum(np.sqrt(np.diag(local.covariance)), _MIN_STEP)))

    def _slices(self) -> Iterator[tuple[Unknown, slice]]:
        """Yield each unknown with the slice of its numbers."""
        first = 0
        for unknown in self.unknowns:
            yield unknown, slice(first, first + unknown.width)
            first += unknown.width

    def _clip(self, unit: Floats) -> Floats:
        return np.asarray(np.clip(unit, *self._inner_bounds))

    def _snap_to_bounds(self, unit: Floats) -> Floats:
        """Return units; those at the least distance of renders from a bound become the bound."""
        low, high = (np.abs(unit - end) < 1e-6 for end in self._inner_bounds)
        return np.where(low, self._low, np.where(high, self._high, unit))

    def _next_seeds(self) -> tuple[int, int]:
        return next(self._seeds), next(self._seeds)

    def _record_best(self, unit: Floats, loss: float, halves: tuple[Floats, Floats]) -> None:
        if self._best is None or loss < self._best[1]:
            self._best = unit, loss, 0.5 * (halves[0] + halves[1])

    def _record_point(self, stage: str, start: int, loss: float, accepted: bool = True) -> None:
        self._curve.append(LossPoint(stage, start, loss, accepted))
        self.report(self._curve[-1])


def _correlated_pairs(
    names: Sequence[str], covariance: Floats | None, errors: Floats
) -> Iterator[tuple[str, str, float]]:
    if covariance is None:
        return
    scale = np.sqrt(np.diag(covariance))
    for i in range(len(names)):
        for j in range(i):
            correlation = float(covariance[i, j] / (scale[i] * scale[j]))
            if abs(correlation) > _CORRELATED and np.isfinite(errors[[i, j]]).all():
                yield names[j], names[i], correlation


def _positive_part(matrix: Floats) -> Floats:
    """Return the symmetric part of a product of independent halves; negative eigenvalues, due to noise, become 0."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def _next_power_of_two(number: int) -> int:
    return 1 << (number - 1).bit_length()
