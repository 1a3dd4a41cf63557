"""Fit rational functions of two variables to values, for `lookdev.closures.fitting`.

Each round is a weighted least squares fit by Levenberg and Marquardt, with an analytic Jacobian. Between rounds, the
weights grow where errors are large, so that the largest error decreases (Lawson's algorithm). A step is taken only if
the denominator stays above a floor on the whole domain, so that the function has no poles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.rational import Rational

_MIN_DENOMINATOR = 0.01  # the floor of the denominator, whose constant term is 1
# The largest numbers of rounds in a fit, of steps in a round, and of tries for a step. Each try has more damping than
# the one before.
_ROUNDS, _STEPS, _TRIES = 8, 40, 8


@dataclass(frozen=True, eq=False)
class RationalProblem:
    """The values to be fitted: `target` at the points (`x`, `y`), and the tolerated errors `tolerance`, all (n,)."""

    x: Floats
    y: Floats
    target: Floats
    tolerance: Floats


@dataclass(frozen=True)
class Degree:
    """The degree of a polynomial: the highest powers `x` and `y` of the variables, and their largest sum `total`."""

    x: int
    y: int
    total: int

    def terms(self) -> list[tuple[int, int]]:
        """Return the pairs (power of x, power of y) of all terms, the constant term first."""
        return [(i, j) for i in range(self.x + 1) for j in range(self.y + 1) if i + j <= self.total]


def fit_rational(problem: RationalProblem, numerator: Degree, denominator: Degree) -> Rational:
    """Fit a rational function with polynomials of degrees `numerator` and `denominator` to a problem.

    The result is the step of the iteration at which the largest error, relative to the tolerance, is smallest.
    """
    # The denominator's constant term is fixed to 1. `coefficients` has all coefficients of the numerator, followed by
    # the other coefficients of the denominator. Numerator and targets are divided by the tolerances, so errors are in
    # units of the tolerance. `q` is the denominator at the points of the problem. `domain` has the denominator's terms
    # at points of the whole domain.
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
        # Lawson's update multiplies weights by errors; the term 0.03 keeps every weight above 0.
        weight = weight * (error / error.max() + 0.03)
        weight /= weight.mean()
    # Scale both polynomials: the largest coefficient of the denominator becomes 1 or -1.
    top, bottom = best_coefficients[:size], np.append(1.0, best_coefficients[size:])
    largest = np.abs(bottom).max()
    return Rational(_rows(numerator_powers, top / largest), _rows(denominator.terms(), bottom / largest))


def _powers(terms: list[tuple[int, int]], x: Floats, y: Floats) -> Floats:
    """Return the values ``x^i y^j``, (n, terms), of the terms (i, j) at n points."""
    return np.array([x**i * y**j for i, j in terms]).reshape(len(terms), x.size).T


def _box(problem: RationalProblem) -> tuple[Floats, Floats]:
    """Return x and y, (n,), of a grid of points on the domain: x from 0 to 1, y over the range of the problem."""
    x, y = np.meshgrid(np.linspace(0.0, 1.0, 101), np.linspace(problem.y.min(), problem.y.max(), 41))
    return x.ravel(), y.ravel()


def _rows(terms: list[tuple[int, int]], coefficients: Floats) -> list[list[float]]:
    """Return coefficients as `Rational` has them, rounded to 8 digits: ``rows[i][j]`` belongs to ``x^i y^j``."""
    rows: list[list[float]] = [[] for _ in range(1 + max(i for i, _ in terms))]
    for (i, _), coefficient in zip(terms, coefficients, strict=True):
        rows[i].append(float(f"{coefficient:.8g}"))
    return rows
