"""Bins of shading normals: each bin has its own sampling distribution of a dome light's directions (`slots`).

The sphere of normals is divided into rows of latitude of equal height, and each row into bins (cells) of equal width.
The width is nearly the same in all rows. `lookdev/shaders/dome.osl.h` finds the bin of a normal. The sampling weight of
a direction is the bin's `widened_cosine`: the largest cosine between the direction and any normal of a cone about the
bin's axis. The cone contains the bin, so that the weight is positive wherever a normal of the bin has a positive
cosine.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

AnyFloat = TypeVar("AnyFloat", np.float32, np.float64)

ROWS = 10
"""The number of rows, each of 18 degrees of latitude."""

CELLS = tuple(round(19.6 * float(np.sin(np.pi * (row + 0.5) / ROWS))) for row in range(ROWS))
"""The number of bins in each row, from the zenith down. At the equator, bins are as wide as high, about 18 degrees."""

FIRST = tuple(int(sum(CELLS[:row])) for row in range(ROWS))
"""The number of each row's first bin."""

COUNT = sum(CELLS)
"""The number of bins."""

# The radians by which a cone extends beyond its bin, because the shader's arc tangents are only accurate to 1e-5.
_MARGIN = 1e-3


def _direction(theta: float, phi: float) -> tuple[float, float, float]:
    """Return the unit vector at the angle theta from +z and the azimuth phi, in radians."""
    return float(np.sin(theta) * np.cos(phi)), float(np.sin(theta) * np.sin(phi)), float(np.cos(theta))


def _cone_radius() -> float:
    """Return the largest angle between a bin's axis and a point of the bin, over all bins: a corner is the farthest."""
    farthest = 0.0
    for row, cells in enumerate(CELLS):
        axis = np.array(_direction(np.pi * (row + 0.5) / ROWS, np.pi / cells))
        for theta in (np.pi * row / ROWS, np.pi * (row + 1) / ROWS):
            farthest = max(farthest, float(np.arccos(np.clip(axis @ _direction(theta, 0.0), -1.0, 1.0))))
    return farthest


_CELL_INDICES = [(row, cell) for row, cells in enumerate(CELLS) for cell in range(cells)]
AXES = np.array([_direction(np.pi * (r + 0.5) / ROWS, 2.0 * np.pi * (c + 0.5) / CELLS[r]) for r, c in _CELL_INDICES])
"""The axis of each bin, its middle, as unit vectors (COUNT, 3) relative to the light's axes."""

RADIUS = _cone_radius() + _MARGIN
"""The half angle in radians of the cone of normals of every bin."""


def widened_cosine(cosine: NDArray[AnyFloat]) -> NDArray[AnyFloat]:
    """Return the widened cosines (...) of directions, at least 0, from the cosines (...) to the axis of the bin."""
    cosine_radius, sine_radius = math.cos(RADIUS), math.sin(RADIUS)
    # cos(max(0, angle - radius)).
    rotated = cosine_radius * cosine + sine_radius * np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0))
    return np.where(cosine > cosine_radius, cosine.dtype.type(1.0), np.maximum(rotated, 0.0))
