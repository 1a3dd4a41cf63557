"""Least squares for rational functions, for `lookdev.closures.fitting`.

Levenberg-Marquardt with an analytic Jacobian. Between rounds, weights change so that the largest error decreases
(Lawson's algorithm). A step is taken only if the denominator stays above a floor on the whole domain, without poles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.rational import Rational

_MIN_DENOMINATOR = 0.01
_ROUNDS, _STEPS, _TRIES = 8, 40, 8


@dataclass(frozen=True, eq=False)
class RationalProblem:
    """Values `target` at `x` and `y` and their tolerances, all (n,)."""

    x: Floats
    y: Floats
    target: Floats
    tolerance: Floats


@dataclass(frozen=True)
class Degree:
    """The highest powers of x, of y and of both together in a polynomial."""

    x: int
    y: int
    total: int

    def terms(self) -> list[tuple[int, int]]:
        """Return the powers of x and y of each term, the constant first."""
        return [(i, j) for i in range(self.x + 1) for j in range(self.y + 1) if i + j <= self.total]


def fit_rational(problem: RationalProblem, numerator: Degree, denominator: Degree) -> Rational:
    """Fit a rational function with polynomials of degrees `numerator` and `denominator` to a problem.

    Of all steps, the result is the one with the smallest maximum of the errors, relative to the tolerances.
    """
    numerator_powers, denominator_powers = numerator.terms(), denominator.terms()[1:]
    numerator_terms = _powers(numerator_powers, problem.x, problem.y) / problem.tolerance[:, None]
    denominator_terms = _powers(denominator_powers, problem.x, problem.y)
    domain = _powers(denominator_powers, *_box(problem))
    target = problem.target / problem.tolerance
    size = len(numerator_powers)
    coefficients = np.concatenate(
        [np.linalg.lstsq(numerator_terms, target, rcond=None)[0], np.zeros(len(denominator_powers))]
    )
    weight = np.ones_like(target)
    best_coefficients, smallest = coefficients, np.inf
    for _ in range(_ROUNDS):
        root, damping = np.sqrt(weight), 1e-3
        for _ in range(_STEPS):
            q = 1.0 + denominator_terms @ coefficients[size:]
            value = numerator_terms @ coefficients[:size] / q
            error = value - target
            if np.abs(error).max() < smallest:
                best_coefficients, smallest = coefficients, float(np.abs(error).max())
            jacobian = np.hstack([numerator_terms, -value[:, None] * denominator_terms]) * (root / q)[:, None]
            scale = np.sqrt((jacobian * jacobian).sum(axis=0)) + 1e-12
            loss = (weight * error * error).sum()
            for _ in range(_TRIES):
                damped = np.vstack([jacobian / scale, np.sqrt(damping) * np.eye(len(coefficients))])
                step = (
                    np.linalg.lstsq(damped, np.append(-error * root, np.zeros(len(coefficients))), rcond=None)[0]
                    / scale
                )
                candidate = coefficients + step
                q = 1.0 + denominator_terms @ candidate[size:]
                reduced = (weight * (numerator_terms @ candidate[:size] / q - target) ** 2).sum()
                if reduced < loss and (1.0 + domain @ candidate[size:]).min() > _MIN_DENOMINATOR:
                    break
                damping *= 4.0
            else:
                break
            coefficients, damping = candidate, max(damping / 6.0, 1e-9)
            if loss - reduced < 1e-4 * loss:
                break
        error = np.abs(numerator_terms @ coefficients[:size] / (1.0 + denominator_terms @ coefficients[size:]) - target)
        weight = weight * (error / error.max() + 0.03)
        weight /= weight.mean()
    top, bottom = best_coefficients[:size], np.append(1.0, best_coefficients[size:])
    largest = np.abs(bottom).max()
    return Rational(_rows(numerator_powers, top / largest), _rows(denominator.terms(), bottom / largest))


def _powers(terms: list[tuple[int, int]], x: Floats, y: Floats) -> Floats:
    return np.array([x**i * y**j for i, j in terms]).reshape(len(terms), x.size).T


def _box(problem: RationalProblem) -> tuple[Floats, Floats]:
    """Return points (n,) of the whole domain: x from 0 to 1, y from the least to the greatest."""
    x, y = np.meshgrid(np.linspace(0.0, 1.0, 101), np.linspace(problem.y.min(), problem.y.max(), 41))
    return x.ravel(), y.ravel()


def _rows(terms: list[tuple[int, int]], coefficients: Floats) -> list[list[float]]:
    rows: list[list[float]] = [[] for _ in range(1 + max(i for i, _ in terms))]
    for (i, _), coefficient in zip(terms, coefficients, strict=True):
        rows[i].append(float(f"{coefficient:.8g}"))
    return rows
