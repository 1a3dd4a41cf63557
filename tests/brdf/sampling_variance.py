"""Variance of each classic's own sampling against cosine sampling: prints the table of docs/models.md."""

import sys

import numpy as np

from lookdev.brdf import CONTINUOUS, complete_parameters, evaluate_cosine, pdf, sample
from lookdev.brdf.microfacet import sample_cosine
from lookdev.closures.setups import view_at

ANGLES = (0.0, 45.0, 80.0)


def cells(model: str) -> list[str]:
    """Return own variance, cosine's, and the greatest own weight, at each angle."""
    bsdf = CONTINUOUS[model].bsdf(complete_parameters(model, {"sigma": 0.6} if model == "oren-nayar" else {}))
    u, found = np.random.default_rng(1).random((1 << 17, 2)), []
    for angle in ANGLES:
        wo = np.broadcast_to(view_at(angle, 0.0), (len(u), 3))
        wi, around = sample(bsdf, wo, u), sample_cosine(u[:, 0], u[:, 1])
        density = pdf(bsdf, wo, wi)
        lit = density > 0.0
        own = np.where(lit, evaluate_cosine(bsdf, wo, wi).mean(axis=-1) / np.where(lit, density, 1.0), 0.0)
        other = evaluate_cosine(bsdf, wo, around).mean(axis=-1) * np.pi / around[:, 2]
        own, other = own / own.mean(), other / other.mean()
        found.append(f"{own.var():.2g}, {other.var():.2g}, {own.max():.2f}")
    return found


if __name__ == "__main__":
    names = [name for name in CONTINUOUS if name not in ("disney", "pixar", "lambert")]
    head = ["model", *(f"{angle:g} degrees: own, cosine, greatest" for angle in ANGLES)]
    rows = [head, ["---"] * len(head), *([name, *cells(name)] for name in names)]
    sys.stdout.writelines(f"| {' | '.join(row)} |\n" for row in rows)
