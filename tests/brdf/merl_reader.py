"""Measured samples looked up one pair of directions at a time, by angles and rotations, as the published readers do.

Nothing of `lookdev.brdf.measured` is used. ``python merl_reader.py`` rewrites the oracle of the built-in measurement,
whose samples are all it takes from there.
"""

import json
from collections.abc import Sequence
from itertools import product
from math import acos, atan2, cos, floor, pi, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from lookdev.arrays import Floats

ORACLE = Path(__file__).parents[1] / "oracles" / "measured.jsonl"


def _turned(w: Floats, axis: Floats, angle: float) -> Floats:
    turned: Floats = w * cos(angle) + axis * (axis @ w) * (1.0 - cos(angle)) + np.cross(axis, w) * sin(angle)
    return turned


def half_angles(wo: Floats, wi: Floats) -> tuple[float, float, float]:
    """Return theta_h, theta_d and phi_d, folded into [0, pi), of the light's direction about the half vector."""
    half = (wo + wi) / np.linalg.norm(wo + wi)
    theta_h, phi_h = acos(min(half[2], 1.0)), atan2(half[1], half[0])
    difference = _turned(_turned(wi, np.array([0.0, 0.0, 1.0]), -phi_h), np.array([0.0, 1.0, 0.0]), -theta_h)
    return theta_h, acos(min(difference[2], 1.0)), atan2(difference[1], difference[0]) % pi


def look_up_samples(samples: Floats, positions: Sequence[float], wrapped: Sequence[bool], interpolation: str) -> Floats:
    """Look samples (*counts, 3) up at positions in units of cells, or interpolate between the cells' centres."""
    counts = samples.shape[:-1]
    if interpolation == "nearest":
        index = tuple(min(int(position), count - 1) for position, count in zip(positions, counts, strict=True))
        return np.maximum(samples[index], 0.0)
    total = np.zeros(3)
    for up in product((False, True), repeat=len(counts)):
        weight, corner = 1.0, []
        for position, count, wraps, upper in zip(positions, counts, wrapped, up, strict=True):
            shifted = position - 0.5 if wraps else min(max(position - 0.5, 0.0), count - 1.0)
            low = floor(shifted)
            weight *= shifted - low if upper else 1.0 - (shifted - low)
            number = low + upper
            corner.append(number % count if wraps else min(number, count - 1))
        total += weight * np.maximum(samples[tuple(corner)], 0.0)
    return total


def merl(samples: Floats, wo: Floats, wi: Floats, interpolation: str) -> Floats:
    """Return f (3,) from samples (theta_h, theta_d, phi_d, 3)."""
    theta_h, theta_d, phi_d = half_angles(wo, wi)
    h, d, phi = samples.shape[:3]
    positions = sqrt(theta_h / (pi / 2.0)) * h, theta_d / (pi / 2.0) * d, phi_d / pi * phi
    return look_up_samples(samples, positions, (False, False, True), interpolation)


def anisotropic(samples: Floats, wo: Floats, wi: Floats, interpolation: str, *, half: bool = False) -> Floats:
    """Return f (3,) from samples (theta_i, theta_o, phi_d, phi_i, 3)."""
    turn = (atan2(wo[1], wo[0]) - atan2(wi[1], wi[0])) % (2.0 * pi)
    if half and turn > pi:
        wo, wi, turn = wi, wo, 2.0 * pi - turn
    span = pi if half else 2.0 * pi
    angles = acos(wi[2]) / (pi / 2.0), acos(wo[2]) / (pi / 2.0), turn / span, (atan2(wi[1], wi[0]) / (2.0 * pi)) % 1.0
    positions = [angle * count for angle, count in zip(angles, samples.shape, strict=False)]
    return look_up_samples(samples, positions, (False, False, not half, True), interpolation)


def _oracle() -> str:
    from lookdev.brdf.measured.synthetic import plastic_grid

    rng = np.random.default_rng(19)
    lines = []
    for number in range(100):
        wo, wi = rng.normal(size=(2, 3))
        wo, wi = (np.abs(w) * [1.0, -1.0, 1.0] / np.linalg.norm(w) for w in (wo, wi))
        if number % 2:
            wi = wo * [-1.0, -1.0, 1.0] + rng.normal(size=3) * 0.1
            wi = np.abs(wi) * np.sign(wi * [1.0, 1.0, 0.0] + [0.0, 0.0, 1.0]) / np.linalg.norm(wi)
        interpolation = ("linear", "nearest")[number % 4 // 2]
        params = {"file": "builtin:plastic", "interpolation": interpolation}
        case: dict[str, Any] = {"model": "measured", "params": params, "wo": wo.tolist(), "wi": wi.tolist()}
        lines.append(json.dumps(case | {"f": merl(plastic_grid().samples, wo, wi, interpolation).tolist()}))
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    ORACLE.write_text(_oracle())
