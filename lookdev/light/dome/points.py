"""The points of a dome light: 2^20 directions in proportion to its radiance, in the order of a Hilbert curve.

One direction is drawn from each cell of a square grid of random numbers, so that neighbours on the curve are neighbours
in the random numbers and, but for the warp, in direction.

``*.points.exr``, 1024 x 1024: point n is pixel (n mod 1024, n div 1024). R = azimuth in radians; G = z; B = m, the mean
of the three channels of the radiance; A = the colour as two 12-bit integers, red and green, in units of 3 m / 4095.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lookdev.light.dome.warp import BilinearWarp, lookup, place_directions

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SIDE = 1024
"""Of the grid of random numbers, and of the file: N is its square."""

COLOR_STEPS = 4095
"""The largest of the 12-bit integers."""

SOBOL_SEED = 20120808

_PART = 2**15  # points that are drawn at once


def draw_points(table: Floats, warp: BilinearWarp, side: int) -> tuple[NDArray[np.float32], Floats]:
    """Draw ``side^2`` points, a power of two, of a map: the pixels (side^2, 4) of the file, and the unit directions.

    `table` (H, W, 3) is the radiance, row 0 at the zenith, and `warp` that of the mean of its channels.
    """
    u = _points_along_curve(side)
    pixels, directions = np.empty((len(u), 4), np.float32), np.empty((len(u), 3))
    # Arrays of a part stay in the processor's cache, which halves the time.
    for part in (slice(begin, begin + _PART) for begin in range(0, len(u), _PART)):
        places = warp.places(u[part])
        x, y = np.moveaxis(places, -1, 0)
        color = lookup(table, np.stack([x, 1.0 - y], axis=-1))
        mean = color.mean(axis=-1)
        share = color / (3.0 * np.where(mean > 0.0, mean, 1.0)[:, None])
        red, green = np.moveaxis(np.rint(share[:, :2] * COLOR_STEPS), -1, 0)
        columns = np.pi * (1.0 - 2.0 * x), np.cos(np.pi * y), mean, red * (COLOR_STEPS + 1) + green
        pixels[part], directions[part] = np.stack(columns, axis=-1), place_directions(places)
    return pixels, directions


@lru_cache(maxsize=1)  # the same for every map
def _points_along_curve(side: int) -> Floats:
    """Return points (side^2, 2) of the unit square, one in each cell of a grid, along a Hilbert curve."""
    # Not at the top: it takes longer to import than a drawn map to read.
    from scipy.stats import qmc

    # Of a power of two of Sobol points, one is in each cell of the grid.
    u = qmc.Sobol(2, scramble=True, rng=SOBOL_SEED).random(side * side)
    return np.asarray(u[np.argsort(along_hilbert(np.floor(u * side).astype(np.int64), side))])


def along_hilbert(cells: Ints, side: int) -> Ints:
    """Return the positions (N,) along a Hilbert curve of cells (N, 2) of a square, whose side is a power of two."""
    x, y = cells.T.copy()
    place = np.zeros(len(cells), np.int64)
    step = side // 2
    while step:
        right, up = (x & step) > 0, (y & step) > 0
        place += step * step * ((3 * right) ^ up)
        # Each quarter is the curve, rotated or mirrored.
        flip = ~up & right
        x, y = np.where(flip, side - 1 - x, x), np.where(flip, side - 1 - y, y)
        x, y = np.where(up, x, y), np.where(up, y, x)
        step //= 2
    return place
