"""Evaluation of many pairs of directions: in parts that stay in a processor's cache, on all of its cores."""

from __future__ import annotations

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf import Bsdf, evaluate
from lookdev.codegen.program.arrays import PART, run_in_parts


def evaluate_in_parts(bsdf: Bsdf, wo: Floats, wi: Floats) -> Floats:
    """Return f of pairs of directions (..., 3), with exactly the values of `lookdev.brdf.evaluate`."""
    count = wo.size // 3
    if count <= PART:
        return np.asarray(evaluate(bsdf, wo, wi))
    f, towards_viewer, towards_light = np.empty((count, 3)), wo.reshape(-1, 3), wi.reshape(-1, 3)

    def fill(part: slice) -> None:
        f[part] = evaluate(bsdf, towards_viewer[part], towards_light[part])

    run_in_parts(fill, count)
    return f.reshape(wo.shape)
