"""The search: many random starts, of which the best few are followed by least squares within bounds.

Models are arrays over their parameters, too: the Jacobian's differences are one evaluation of a model whose parameters
have an axis for the number that is moved.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import qmc
from threadpoolctl import threadpool_limits

from lookdev.brdf import Model, evaluate
from lookdev.errors import LookdevError, nearest_hint
from lookdev.fitting.data import Data, data_of
from lookdev.fitting.loss import LOSSES
from lookdev.fitting.parameters import Free, free_parameters
from lookdev.plotting import Subject, subject_of
from lookdev.plotting.angles import Floats

_TRIED = 128
_COARSE = 4
_SPARSE, _PLACES = 16, 4
_STEP = 1e-6
_NOTHING = 1e-9
"""The change of the loss, relative to the data, below which a parameter has no effect."""


@dataclass(frozen=True, eq=False)
class Fit:
    """What was found.

    values
        Of all parameters of the model that are fitted or given, by name: numbers, colours (3,), tokens.
    unknown
        Fitted parameters without an effect on f at the result: their values have no meaning.
    loss, per_channel
        Root mean square of the differences of compressed f cos theta_i; of each of red, green and blue.
    starts
        The loss at which each start that was followed ended, best first, on a part of the data.
    seconds
        Of CPU, all threads of the process together.
    """

    model: Model
    subject: Subject
    values: Mapping[str, Any]
    unknown: tuple[str, ...]
    loss_name: str
    loss: float
    per_channel: tuple[float, float, float]
    starts: tuple[float, ...]
    samples: int
    seconds: float

    def data(self) -> dict[str, Any]:
        """Return the fit as plain data."""
        plain = {
            name: each if isinstance(each, str) else np.asarray(each).tolist() for name, each in self.values.items()
        }
        return {
            "model": self.model.name, "parameters": plain, "without_effect": list(self.unknown),
            "loss": {"name": self.loss_name, "value": self.loss, "per_channel": list(self.per_channel)},
            "starts": list(self.starts), "samples": self.samples, "seconds": self.seconds,
        }  # fmt: skip


def fit_text(found: Fit) -> str:
    """Return a fit as lines of text."""
    channels = ", ".join(f"{each:.3g}" for each in found.per_channel)
    lines = [f"{found.model.title}: {found.loss_name} loss {found.loss:.3g} (red, green, blue: {channels})"]
    for name, value in found.data()["parameters"].items():
        numbers = value if isinstance(value, list) else [value]
        shown = ", ".join(each if isinstance(each, str) else f"{each:.5g}" for each in numbers)
        lines.append(f"  {name} = {shown}" + "  (without effect)" * (name in found.unknown))
    ends = ", ".join(f"{each:.3g}" for each in found.starts)
    return "\n".join([*lines, f"starts ended at {ends}; {found.samples} pairs, {found.seconds:.1f} s of CPU"])


def fit(
    data: Subject,
    model: Model,
    fixed: Mapping[str, Any] | None = None,
    *,
    wanted: Sequence[str] = (),
    loss: str = "log",
    starts: int = 4,
    seed: int = 0,
) -> Fit:
    """Fit a model's parameters to f of a surface.

    Parameters
    ----------
    data
        The surface, of any origin; f counts up to 80 degrees from the normal (`lookdev.fitting.data`).
    fixed
        Parameters, by name, that keep these values.
    wanted
        Names of the parameters to fit; by default `lookdev.fitting.free_parameters`.
    loss
        One of `lookdev.fitting.LOSSES`.
    starts
        How many of the starts are followed, from the best of 128 random ones and the defaults on.

    Raises
    ------
    LookdevError
        The loss or a parameter is unknown, nothing is left to fit, or there is no f.
    """
    if loss not in LOSSES:
        raise LookdevError(f"unknown loss '{loss}' ({nearest_hint(loss, list(LOSSES))})")
    if model.delta or data.is_delta:
        name = model.name if model.delta else data.label
        raise LookdevError(f"{name} scatters along single directions and has no f to fit")
    if not 1 <= starts <= _TRIED:
        raise LookdevError(f"--starts {starts}: 1 to {_TRIED} would be right")
    began = time.process_time()
    constant = model.complete(fixed or {})
    free: Sequence[Free] = free_parameters(model, fixed or {}, wanted)
    if not free:
        raise LookdevError(f"{model.name}: nothing is left to fit")
    measured = data_of(data.bsdf, data.label)
    free = free if wanted else _effective(model, constant, free, measured, loss)
    problem = _Problem(model, constant, free, measured, loss)
    found = problem.solve(starts, seed)
    values = {each.name: each.value(part) for each, part in problem.parts(found.unit)}
    rest = problem.residual(found.unit[None])[0].reshape(-1, 3)
    effect = np.abs(problem.jacobian(found.unit)).max(axis=0)
    scale = float(np.abs(problem.target).max())
    unknown = tuple(
        each.name for each, part in problem.parts(effect) if each.width == 1 and part.max() < _NOTHING * scale
    )
    given = {**(fixed or {}), **{name: value.tolist() for name, value in values.items()}}
    described = subject_of(model, {name: _plain(value) for name, value in given.items()}, f"{model.name}, fitted")
    red, green, blue = (float(np.sqrt(np.mean(rest[:, channel] ** 2))) for channel in range(3))
    return Fit(
        model, described, given, unknown, loss, float(np.sqrt(np.mean(rest**2))), (red, green, blue),
        found.losses, len(problem.data.f), time.process_time() - began,
    )  # fmt: skip


def _effective(
    model: Model, constant: Mapping[str, Any], free: Sequence[Free], data: Data, loss: str
) -> Sequence[Free]:
    """Return the parameters that change f, anywhere among random places: not those of a form that is not chosen."""
    problem = _Problem(model, constant, free, data.part(_SPARSE), loss)
    places = np.random.default_rng(0).random((_PLACES, problem.size))
    effect = np.max([np.abs(problem.jacobian(place)).max(axis=0) for place in places], axis=0)
    limit = _NOTHING * float(np.abs(problem.target).max())
    return tuple(each for each, part in problem.parts(effect) if part.max() > limit)


def _plain(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


@dataclass(frozen=True, eq=False)
class _Found:
    unit: Floats
    losses: tuple[float, ...]


class _Problem:
    def __init__(self, model: Model, constant: Mapping[str, Any], free: Sequence[Free], data: Data, loss: str) -> None:
        self.model, self.constant, self.free, self.data, self.loss = model, constant, free, data, loss
        self.compress = LOSSES[loss]
        self.target = self.compress(data.f * data.cosine)
        self.size = sum(each.width for each in free)

    def parts(self, unit: Floats) -> list[tuple[Free, Floats]]:
        """Return the numbers (..., size) of each parameter."""
        ends = np.cumsum([each.width for each in self.free])
        return [(each, unit[..., end - each.width : end]) for each, end in zip(self.free, ends, strict=True)]

    def residual(self, units: Floats) -> Floats:
        """Return compressed differences (k, 3 n) of k sets of numbers (k, size)."""
        given = {each.name: each.value(part[:, None, :]) for each, part in self.parts(units)}
        followers = {name: given[each.follows] for name, each in self.model.parameters.items() if each.follows in given}
        bsdf = self.model.bsdf({**self.constant, **followers, **given})
        f = evaluate(bsdf, self.data.wo[None], self.data.wi[None])
        rest = self.compress(np.maximum(f, 0.0) * self.data.cosine) - self.target
        return np.broadcast_to(rest, (len(units), *self.target.shape)).reshape(len(units), -1)

    def jacobian(self, unit: Floats) -> Floats:
        """Return the derivatives (3 n, size), by differences towards the middle of each range."""
        step = np.where(unit > 0.5, -_STEP, _STEP)
        rest = self.residual(np.vstack([unit, unit + np.diag(step)]))
        return np.asarray(((rest[1:] - rest[0]) / step[:, None]).T)

    def solve(self, starts: int, seed: int) -> _Found:
        """Return the best numbers (size,), and the losses of the starts that were followed."""
        coarse = _Problem(self.model, self.constant, self.free, self.data.part(_COARSE), self.loss)
        default = np.concatenate([each.unit(self.constant[each.name]) for each in self.free])
        tried = np.vstack([default, qmc.Sobol(self.size, rng=np.random.default_rng(seed)).random(_TRIED)])
        quality = np.concatenate([np.mean(coarse.residual(part) ** 2, axis=1) for part in np.array_split(tried, 8)])
        best = tried[np.argsort(quality)[:starts]]
        ends = [coarse.follow(start, 40) for start in best]
        ends.sort(key=lambda end: end[1])
        return _Found(self.follow(ends[0][0], 60)[0], tuple(loss for _, loss in ends))

    def follow(self, start: Floats, most: int) -> tuple[Floats, float]:
        """Return where least squares ends from some numbers, and the loss there."""
        # Threads of the linear algebra take ten times as long on matrices of ten columns, more beside other work.
        with threadpool_limits(1, "blas"):
            end = least_squares(
                lambda unit: self.residual(unit[None])[0],
                np.clip(start, 1e-3, 1.0 - 1e-3),
                self.jacobian,
                bounds=(0.0, 1.0),
                max_nfev=most,
                xtol=1e-10,
                ftol=1e-12,
                gtol=1e-14,
            )
        return end.x, float(np.sqrt(np.mean(end.fun**2)))
