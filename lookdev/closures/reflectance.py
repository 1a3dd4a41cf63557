"""Make the fits of `lookdev.brdf.reflectance`: ``python -m lookdev.closures.reflectance`` writes its table.

`whole` is the directional albedo of Disney's specular lobe (2014) where its Fresnel term is 1, by the view's cosine
relative to alpha, and alpha; `cosine` the cosine at which Schlick's weight is its mean over the lobe, by the view's
cosine and alpha. A residual is the largest and the root mean square error of the albedo for views up to 85 degrees.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from lookdev.brdf.fresnel import schlick_weight
from lookdev.brdf.rational import Rational
from lookdev.brdf.reflectance import DATA, relative_cosine
from lookdev.closures.rational import Degree, Floats, Problem, fit_rational
from lookdev.closures.setups import FULL, Grid, measure, specular_setups

_TOLERANCE = 0.01


def make_table(grid: Grid = FULL) -> dict[str, Any]:
    """Return the table."""
    a = measure(specular_setups("2014", grid))
    kept = a.angle < 89.2  # beyond, both change too fast for their weight
    x = np.asarray(relative_cosine(a.cosine, a.alpha))
    problem = Problem(x[kept], a.alpha[kept], a.whole[kept], np.full(np.count_nonzero(kept), _TOLERANCE))
    whole = fit_rational(problem, Degree(3, 3, 3), Degree(2, 2, 2))
    # Schlick's weight is (1 - cosine)^5.
    root = (a.weighted / a.whole) ** 0.2
    allowed = np.minimum(((a.weighted + _TOLERANCE) / a.whole) ** 0.2 - root, 0.3)
    problem = Problem(a.cosine[kept], a.alpha[kept], 1.0 - root[kept], allowed[kept])
    cosine = fit_rational(problem, Degree(2, 2, 3), Degree(2, 2, 2))
    seen = a.angle <= 85.0
    typical = np.clip(cosine(a.cosine, a.alpha), 0.0, 1.0)
    return {
        "whole": _entry(whole, (np.clip(whole(x, a.alpha), 0.0, 1.0) - a.whole)[seen]),
        "cosine": _entry(cosine, (a.whole * schlick_weight(typical) - a.weighted)[seen]),
    }


def _entry(found: Rational, error: Floats) -> dict[str, Any]:
    residual = {"largest": np.abs(error).max(), "rms": np.sqrt(np.mean(error * error))}
    return {
        "numerator": found.numerator,
        "denominator": found.denominator,
        "residual": {name: float(f"{value:.3g}") for name, value in residual.items()},
    }


if __name__ == "__main__":
    DATA.write_text(json.dumps(make_table(), indent=1) + "\n")
