"""The points of a dome light: 2^20 directions, distributed in proportion to its radiance, for the shader to draw from.

A direction is a warped pair of random numbers, a point of the unit square. The square is divided into a grid with one
random point in each cell, and the cells are ordered along a Hilbert curve. Neighbours on the curve are therefore
neighbours in the square and, apart from the warp, in direction.

The file of the points is an EXR of 1024 x 1024: point n is pixel (n mod 1024, n div 1024). R is the azimuth in radians,
G the z of the direction, and B is m, the mean of the three channels of the radiance. A has the colour as two 12-bit
integers, 4096 red + green, in units of 3 m / 4095; blue is the rest of the sum 3 m.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from lookdev.arrays import Floats, Floats32, Ints
from lookdev.light.dome.warp import BilinearWarp, coordinates_to_directions, lookup

SIDE = 1024
"""The number of rows and columns of the grid, and of the file; the number of points, N, is its square."""

COLOR_STEPS = 4095
"""The largest 12-bit integer."""

SOBOL_SEED = 20120808
"""The seed of the scrambled Sobol points, so that every run draws the same ones."""

_PART = 2**15  # the number of points that are drawn at once


def draw_points(table: Floats, warp: BilinearWarp, side: int) -> tuple[Floats32, Floats]:
    """Return ``side^2`` random points of a map: the pixels (side^2, 4) of the file, and unit directions (side^2, 3).

    Parameters
    ----------
    table : (H, W, 3)
        The radiance, row 0 at the zenith.
    warp
        The warp from random numbers to directions in proportion to the mean of the channels.
    side
        The number of rows of the grid, a power of two.
    """
    u = _points_along_curve(side)
    pixels, directions = np.empty((len(u), 4), np.float32), np.empty((len(u), 3))
    # Arrays of a part stay in the processor's cache, which halves the time.
    for part in (slice(begin, begin + _PART) for begin in range(0, len(u), _PART)):
        coordinates = warp.coordinates(u[part])
        x, y = np.moveaxis(coordinates, -1, 0)
        color = lookup(table, np.stack([x, 1.0 - y], axis=-1))
        mean = color.mean(axis=-1)
        share = color / (3.0 * np.where(mean > 0.0, mean, 1.0)[:, None])
        red, green = np.moveaxis(np.rint(share[:, :2] * COLOR_STEPS), -1, 0)
        columns = np.pi * (1.0 - 2.0 * x), np.cos(np.pi * y), mean, red * (COLOR_STEPS + 1) + green
        pixels[part], directions[part] = np.stack(columns, axis=-1), coordinates_to_directions(coordinates)
    return pixels, directions


@lru_cache(maxsize=1)  # the same for every map
def _points_along_curve(side: int) -> Floats:
    """Return points (side^2, 2) of the unit square, one in each cell of a grid, along a Hilbert curve."""
    # SciPy is imported here, because most runs only read the file of points, which takes less time than the import.
    from scipy.stats import qmc

    # Each cell of the grid has one Sobol point, because the number of points is a power of two.
    u = qmc.Sobol(2, scramble=True, rng=SOBOL_SEED).random(side * side)
    return np.asarray(u[np.argsort(hilbert_positions(np.floor(u * side).astype(np.int64), side))])


def hilbert_positions(cells: Ints, side: int) -> Ints:
    """Return the positions (N,) of cells (N, 2) along a Hilbert curve in a grid of `side` rows, a power of two."""
    x, y = cells.T.copy()
    position = np.zeros(len(cells), np.int64)
    step = side // 2
    while step:
        right, up = (x & step) > 0, (y & step) > 0
        position += step * step * ((3 * right) ^ up)
        # In each quarter of the square, the curve is a smaller copy of itself, rotated or mirrored.
        flip = ~up & right
        x, y = np.where(flip, side - 1 - x, x), np.where(flip, side - 1 - y, y)
        x, y = np.where(up, x, y), np.where(up, y, x)
        step //= 2
    return position
