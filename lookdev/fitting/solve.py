"""The search of `lookdev fit`: it compares many random starts, and runs least squares within bounds from the best few.

The models take arrays of parameters. One evaluation of a model therefore gives all finite differences of the Jacobian:
the parameters get an additional first axis, and each entry along this axis has one number changed.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import qmc
from threadpoolctl import threadpool_limits

from lookdev.arrays import Floats
from lookdev.brdf import Model, evaluate
from lookdev.brdf.parameters import add_followers
from lookdev.brdf.vectors import Parameters
from lookdev.errors import LookdevError, nearest_hint
from lookdev.fitting.data import LOSSES, ReflectanceSamples, evaluate_pairs
from lookdev.fitting.parameters import FreeParameter, free_parameters
from lookdev.plotting import PlotSubject, model_subject

_TRIALS = 128  # the number of random starts
_COARSE_STEP = 4  # the starts are compared, and improved by least squares, with every fourth pair of directions
# Parameters without effect are searched with every 16th pair of directions, at 4 random sets of parameters.
_SPARSE_STEP, _EFFECT_POINTS = 16, 4
_DIFFERENCE_STEP = 1e-6  # the change of a unit (`FreeParameter`) for a derivative
_NO_EFFECT = 1e-9
"""A parameter has no effect if the derivative of every compared value is smaller than this, relative to the data."""


@dataclass(frozen=True, eq=False)
class ModelFit:
    """The result of a fit.

    Attributes
    ----------
    subject
        The fitted model, as a subject of plots.
    values
        The values of all fitted and fixed parameters by name: numbers, colours (3,), tokens.
    without_effect
        The names of fitted parameters without an effect on f at the result; their values have no meaning.
    loss_name
        The name of the loss, a key of `LOSSES`.
    loss, per_channel
        The root mean square of the differences of compressed f cos theta_i: over all channels, and for each of red,
        green and blue.
    starts
        The final loss of each start from which least squares ran, best first. It is measured on every fourth pair of
        directions.
    samples
        The number of pairs of directions.
    seconds
        The CPU time of the fit, summed up over all threads of the process.
    """

    model: Model
    subject: PlotSubject
    values: Mapping[str, object]
    without_effect: tuple[str, ...]
    loss_name: str
    loss: float
    per_channel: tuple[float, float, float]
    starts: tuple[float, ...]
    samples: int
    seconds: float

    def parameters(self) -> dict[str, object]:
        """Return the values of all parameters as plain data."""
        return {
            name: value if isinstance(value, str) else np.asarray(value).tolist() for name, value in self.values.items()
        }

    def data(self) -> dict[str, object]:
        """Return the fit as plain data."""
        return {
            "model": self.model.name, "parameters": self.parameters(), "without_effect": list(self.without_effect),
            "loss": {"name": self.loss_name, "value": self.loss, "per_channel": list(self.per_channel)},
            "starts": list(self.starts), "samples": self.samples, "seconds": self.seconds,
        }  # fmt: skip


def format_fit(result: ModelFit) -> str:
    """Return the text of a fit for the terminal."""
    channels = ", ".join(f"{loss:.3g}" for loss in result.per_channel)
    lines = [f"{result.model.title}: {result.loss_name} loss {result.loss:.3g} (red, green, blue: {channels})"]
    for name, value in result.parameters().items():
        numbers = value if isinstance(value, list) else [value]
        text = ", ".join(number if isinstance(number, str) else f"{number:.5g}" for number in numbers)
        lines.append(f"  {name} = {text}" + "  (without effect)" * (name in result.without_effect))
    ends = ", ".join(f"{loss:.3g}" for loss in result.starts)
    return "\n".join([*lines, f"starts ended at {ends}; {result.samples} pairs, {result.seconds:.1f} s of CPU"])


def fit_model(
    data: PlotSubject,
    model: Model,
    fixed: Mapping[str, object] | None = None,
    *,
    names: Sequence[str] = (),
    loss: str = "log",
    starts: int = 4,
    seed: int = 0,
) -> ModelFit:
    """Fit a model's parameters to the BRDF f of a surface.

    Parameters
    ----------
    data
        The surface: measured data, a look or another model. f is compared up to 80 degrees from the normal
        (`lookdev.fitting.data`).
    fixed
        Parameters, by name, that keep these values.
    names
        Names of the parameters to fit. Without names, `lookdev.fitting.parameters.free_parameters` chooses them.
    loss
        The name of one of `lookdev.fitting.data.LOSSES`.
    starts
        The number of starts from which least squares run. They are the best of 128 random starts and the default
        values.
    seed
        Seed of the random starts.

    Raises
    ------
    LookdevError
        The loss or a parameter is unknown, no parameter is left to fit, or the surface has no f.
    """
    if loss not in LOSSES:
        raise LookdevError(f"unknown loss '{loss}' ({nearest_hint(loss, list(LOSSES))})")
    if model.delta or data.is_delta:
        name = model.name if model.delta else data.label
        raise LookdevError(f"{name} scatters along single directions and has no f to fit")
    if not 1 <= starts <= _TRIALS:
        raise LookdevError(f"--starts {starts}: 1 to {_TRIALS} would be right")
    start_time = time.process_time()
    constant = model.complete(fixed or {})
    free: Sequence[FreeParameter] = free_parameters(model, fixed or {}, names)
    if not free:
        raise LookdevError(f"{model.name}: nothing is left to fit")
    measured = evaluate_pairs(data.bsdf, data.label)
    free = free if names else _select_effective(model, constant, free, measured, loss)
    problem = _Problem(model, constant, free, measured, loss)
    unit, losses = problem.solve(starts, seed)
    values = {parameter.name: parameter.value(part) for parameter, part in problem.parts(unit)}
    residual = problem.residual(unit[None])[0].reshape(-1, 3)
    effect = np.abs(problem.jacobian(unit)).max(axis=0)
    scale = float(np.abs(problem.target).max())
    without_effect = tuple(
        parameter.name
        for parameter, part in problem.parts(effect)
        if parameter.width == 1 and part.max() < _NO_EFFECT * scale
    )
    all_values = {**(fixed or {}), **{name: value.tolist() for name, value in values.items()}}
    subject = model_subject(model, all_values, f"{model.name}, fitted")
    red, green, blue = (float(np.sqrt(np.mean(residual[:, channel] ** 2))) for channel in range(3))
    return ModelFit(
        model, subject, all_values, without_effect, loss, float(np.sqrt(np.mean(residual**2))), (red, green, blue),
        losses, len(problem.data.f), time.process_time() - start_time,
    )  # fmt: skip


def _select_effective(
    model: Model, constant: Parameters, free: Sequence[FreeParameter], data: ReflectanceSamples, loss: str
) -> Sequence[FreeParameter]:
    """Return the parameters that change f for at least one of several random sets of parameters.

    Tokens select the form of a model. A parameter that only another form has changes nothing, and is left out.
    """
    problem = _Problem(model, constant, free, data.thin(_SPARSE_STEP), loss)
    units = np.random.default_rng(0).random((_EFFECT_POINTS, problem.size))
    effect = np.max([np.abs(problem.jacobian(unit)).max(axis=0) for unit in units], axis=0)
    limit = _NO_EFFECT * float(np.abs(problem.target).max())
    return tuple(parameter for parameter, part in problem.parts(effect) if part.max() > limit)


class _Problem:
    """The least squares problem of a fit.

    Its variables are the units in [0, 1] of all free parameters, one after the other: `size` numbers. Its residuals are
    differences of compressed f cos theta_i at n pairs of directions, in three channels.
    """

    def __init__(
        self, model: Model, constant: Parameters, free: Sequence[FreeParameter], data: ReflectanceSamples, loss: str
    ) -> None:
        self.model, self.constant, self.free, self.data, self.loss = model, constant, free, data, loss
        self.compress = LOSSES[loss]
        self.target = self.compress(data.f * data.cosine)
        self.size = sum(parameter.width for parameter in free)

    def parts(self, unit: Floats) -> list[tuple[FreeParameter, Floats]]:
        """Return each parameter with its part (..., width) of an array (..., size) over all variables."""
        ends = np.cumsum([parameter.width for parameter in self.free])
        return [
            (parameter, unit[..., end - parameter.width : end]) for parameter, end in zip(self.free, ends, strict=True)
        ]

    def residual(self, units: Floats) -> Floats:
        """Return the residuals (k, 3 n) for k sets of units (k, size)."""
        values = {parameter.name: parameter.value(part[:, None, :]) for parameter, part in self.parts(units)}
        bsdf = self.model.bsdf({**self.constant, **add_followers(self.model.parameters, values)})
        f = evaluate(bsdf, self.data.wo[None], self.data.wi[None])
        residual = self.compress(np.maximum(f, 0.0) * self.data.cosine) - self.target
        return np.broadcast_to(residual, (len(units), *self.target.shape)).reshape(len(units), -1)

    def jacobian(self, unit: Floats) -> Floats:
        """Return the derivatives (3 n, size) of the residuals by finite differences.

        The step of each variable is towards the middle of its range, so that it stays within the bounds.
        """
        step = np.where(unit > 0.5, -_DIFFERENCE_STEP, _DIFFERENCE_STEP)
        residuals = self.residual(np.vstack([unit, unit + np.diag(step)]))
        return np.asarray(((residuals[1:] - residuals[0]) / step[:, None]).T)

    def solve(self, starts: int, seed: int) -> tuple[Floats, tuple[float, ...]]:
        """Return the best units (size,), and the final losses of the starts from which least squares ran."""
        coarse = _Problem(self.model, self.constant, self.free, self.data.thin(_COARSE_STEP), self.loss)
        default = np.concatenate([parameter.unit(self.constant[parameter.name]) for parameter in self.free])
        trials = np.vstack([default, qmc.Sobol(self.size, rng=np.random.default_rng(seed)).random(_TRIALS)])
        trial_losses = np.concatenate(
            [np.mean(coarse.residual(part) ** 2, axis=1) for part in np.array_split(trials, 8)]
        )
        best_starts = trials[np.argsort(trial_losses)[:starts]]
        ends = [coarse.follow(start, 40) for start in best_starts]
        ends.sort(key=lambda end: end[1])
        return self.follow(ends[0][0], 60)[0], tuple(loss for _, loss in ends)

    def follow(self, start: Floats, max_evaluations: int) -> tuple[Floats, float]:
        """Run least squares from the units `start`; return the units (size,) at which it ends, and their loss."""
        # Threads make the linear algebra of matrices with ten columns ten times slower, and more on a busy machine.
        with threadpool_limits(1, "blas"):
            end = least_squares(
                lambda unit: self.residual(unit[None])[0],
                np.clip(start, 1e-3, 1.0 - 1e-3),
                self.jacobian,
                bounds=(0.0, 1.0),
                max_nfev=max_evaluations,
                xtol=1e-10,
                ftol=1e-12,
                gtol=1e-14,
            )
        return end.x, float(np.sqrt(np.mean(end.fun**2)))
