"""Print the table of docs/models.md: the variance of each classic model's sampling, and of cosine sampling."""

import sys

import numpy as np

from lookdev.brdf import CONTINUOUS_MODELS, complete_parameters, evaluate_cosine, pdf, sample
from lookdev.brdf.microfacet import sample_cosine
from lookdev.closures.setups import view_at

ANGLES = (0.0, 45.0, 80.0)


def variances(model: str) -> list[str]:
    """Return the variances of the model's sampling and of cosine sampling, and the largest weight, at each angle."""
    bsdf = CONTINUOUS_MODELS[model].bsdf(complete_parameters(model, {"sigma": 0.6} if model == "oren-nayar" else {}))
    u, rows = np.random.default_rng(1).random((1 << 17, 2)), []
    for angle in ANGLES:
        wo = np.broadcast_to(view_at(angle, 0.0), (len(u), 3))
        wi, around = sample(bsdf, wo, u), sample_cosine(u[:, 0], u[:, 1])
        density = pdf(bsdf, wo, wi)
        is_positive = density > 0.0
        model_weights = np.where(
            is_positive, evaluate_cosine(bsdf, wo, wi).mean(axis=-1) / np.where(is_positive, density, 1.0), 0.0
        )
        cosine_weights = evaluate_cosine(bsdf, wo, around).mean(axis=-1) * np.pi / around[:, 2]
        model_weights, cosine_weights = model_weights / model_weights.mean(), cosine_weights / cosine_weights.mean()
        rows.append(f"{model_weights.var():.2g}, {cosine_weights.var():.2g}, {model_weights.max():.2f}")
    return rows


if __name__ == "__main__":
    names = [name for name in CONTINUOUS_MODELS if name not in ("disney", "pixar", "lambert")]
    head = ["model", *(f"{angle:g} degrees: own, cosine, greatest" for angle in ANGLES)]
    rows = [head, ["---"] * len(head), *([name, *variances(name)] for name in names)]
    sys.stdout.writelines(f"| {' | '.join(row)} |\n" for row in rows)
