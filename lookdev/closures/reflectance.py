"""Compute the two fits of `lookdev.brdf.reflectance`: ``python -m lookdev.closures.reflectance`` writes their table.

Both fits describe Disney's specular lobe of 2014. ``"whole"`` is the lobe's directional albedo with a Fresnel term of
1. It is a function of alpha and of `relative_cosine`, the cosine of the view relative to the lobe's width. ``"cosine"``
is the cosine at which Schlick's weight (1 - cosine)^5 equals its mean over the lobe. It is a function of the view's
cosine and of alpha. Residuals are the largest and the root mean square error of the albedo for views up to 85 degrees.
"""

from __future__ import annotations

import json

import numpy as np

from lookdev.brdf.fresnel import schlick_weight
from lookdev.brdf.reflectance import FITS_FILE, relative_cosine
from lookdev.closures.fits import ClosureFit
from lookdev.closures.fitting import fit_entry
from lookdev.closures.rational import Degree, RationalProblem, fit_rational
from lookdev.closures.setups import FULL, LobeGrid, measure_albedos, specular_setups

_TOLERANCE = 0.01  # the tolerated error of a directional albedo


def make_table(grid: LobeGrid = FULL) -> dict[str, ClosureFit]:
    """Return the table of coefficients and residuals, with the keys ``"whole"`` and ``"cosine"``."""
    # `albedos.unweighted` is the albedo with a Fresnel term of 1, and `albedos.weighted` is the albedo with Schlick's
    # weight as the Fresnel term.
    albedos = measure_albedos(specular_setups("2014", grid))
    inside = albedos.angle < 89.2  # beyond 89.2 degrees, both functions change fast, and matter little
    x = np.asarray(relative_cosine(albedos.cosine, albedos.alpha))
    problem = RationalProblem(
        x[inside], albedos.alpha[inside], albedos.unweighted[inside], np.full(np.count_nonzero(inside), _TOLERANCE)
    )
    whole = fit_rational(problem, Degree(3, 3, 3), Degree(2, 2, 2))
    # Schlick's weight is (1 - cosine)^5: the fifth root of its mean is 1 minus the cosine. The tolerance of the albedo
    # is converted to a tolerance of the cosine in the same way.
    root = (albedos.weighted / albedos.unweighted) ** 0.2
    tolerance = np.minimum(((albedos.weighted + _TOLERANCE) / albedos.unweighted) ** 0.2 - root, 0.3)
    problem = RationalProblem(albedos.cosine[inside], albedos.alpha[inside], 1.0 - root[inside], tolerance[inside])
    cosine = fit_rational(problem, Degree(2, 2, 3), Degree(2, 2, 2))
    moderate = albedos.angle <= 85.0
    typical = np.clip(cosine(albedos.cosine, albedos.alpha), 0.0, 1.0)
    return {
        "whole": fit_entry(whole, (np.clip(whole(x, albedos.alpha), 0.0, 1.0) - albedos.unweighted)[moderate]),
        "cosine": fit_entry(cosine, (albedos.unweighted * schlick_weight(typical) - albedos.weighted)[moderate]),
    }


if __name__ == "__main__":
    FITS_FILE.write_text(json.dumps(make_table(), indent=1) + "\n")
