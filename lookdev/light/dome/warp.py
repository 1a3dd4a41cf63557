"""Bilinear look-ups in a lat-long map, and sampling of directions in proportion to them.

The sampling inverts the cumulative distribution of the bilinear function exactly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lookdev.arrays import Floats, Ints
from lookdev.light.mapping import direction_to_uv, uv_to_direction

# The first guess in `_invert_strip` neglects the curvature of the sine over a row; a step squares the relative error.
_NEWTON_STEPS = 3


class BilinearWarp:
    """A mapping from uniform points of the unit square to directions, with a pdf in proportion to a lat-long map.

    The pdf per steradian is the `lookup` of the map `values` (H, W), not negative, divided by `integral`, the integral
    of this look-up over the sphere. If all values are 0, the pdf is uniform. The cumulative distribution, which
    contains the cosine of the latitude, is inverted first over the rows, then along a row.
    """

    def __init__(self, values: Floats) -> None:
        if not values.any():
            values = np.ones_like(values)
        height, width = values.shape
        self._values = values
        # Strip k is between the centres of rows k - 1 and k, where values are linear in the latitude. The first and the
        # last strip reach to the poles, with constant values.
        self._rows = np.concatenate([values[:1], values, values[-1:]])
        middle = 0.5 * (self._rows + np.roll(self._rows, -1, axis=1))
        self._row_cumulative = np.concatenate([np.zeros((height + 2, 1)), np.cumsum(middle, axis=1)], axis=1) / width
        self._row_sums = self._row_cumulative[:, -1].copy()
        # A position in a strip is t in [0, 1] between the two centres; the first strip begins, the last ends at 0.5.
        strips = np.arange(height + 1)
        first, last = np.where(strips == 0, 0.5, 0.0), np.where(strips == height, 0.5, 1.0)
        self._start = self._primitive(strips, first)
        mass = self._primitive(strips, last) - self._start
        self._strip_cumulative = np.concatenate([[0.0], np.cumsum(np.maximum(mass, 0.0))])
        self._first, self._last = first, last
        # The solid angle is sin(theta) d theta d phi, with theta = pi y / H for row y of H, and phi = 2 pi u.
        self.integral = float(2.0 * np.pi**2 / height * self._strip_cumulative[-1])

    def pdf(self, direction: ArrayLike) -> Floats:
        """Return the density (...) per steradian of directions (..., 3)."""
        return np.asarray(lookup_towards(self._values[..., None], direction)[..., 0] / self.integral)

    def draw_directions(self, u: ArrayLike) -> Floats:
        """Map points (N, 2) of the unit square to unit directions (N, 3)."""
        return coordinates_to_directions(self.coordinates(u))

    def coordinates(self, u: ArrayLike) -> Floats:
        """Map points (N, 2) of the unit square to coordinates (x, y) of the map, an array (N, 2) in [0, 1].

        x is along a row, y from the top.
        """
        u1, u2 = np.moveaxis(np.asarray(u, np.float64), -1, 0)
        height, width = len(self._rows) - 2, self._rows.shape[1]
        target = u2 * self._strip_cumulative[-1]
        strip = np.clip(np.searchsorted(self._strip_cumulative, target, side="right") - 1, 0, height)
        t = self._invert_strip(strip, target - self._strip_cumulative[strip])
        y = (strip - 0.5 + t) / height

        def row_cumulative(column: Ints) -> Floats:
            """Return the cumulative sum up to the centre of a column, along the interpolated row at `t`."""
            before, after = self._row_cumulative[strip, column], self._row_cumulative[strip + 1, column]
            return np.asarray((1.0 - t) * before + t * after)

        row_target = u1 * row_cumulative(np.full(len(t), width))
        # A bisection finds the column, `low`, after whose centre the target is reached.
        low, high = np.zeros(len(t), np.int64), np.full(len(t), width, np.int64)
        for _ in range(int(width).bit_length()):
            half = (low + high) // 2
            beyond = row_cumulative(half) <= row_target
            low, high = np.where(beyond, half, low), np.where(beyond, high, half)
        low = np.minimum(low, width - 1)
        left = (1.0 - t) * self._rows[strip, low] + t * self._rows[strip + 1, low]
        after = (low + 1) % width
        right = (1.0 - t) * self._rows[strip, after] + t * self._rows[strip + 1, after]
        x = (low + 0.5 + _invert_line(left, right, (row_target - row_cumulative(low)) * width)) / width
        return np.stack([x % 1.0, np.clip(y, 0.0, 1.0)], axis=-1)

    def _primitive(self, strip: Ints, t: Floats) -> Floats:
        """Return the antiderivative over t of ``(a + (b - a) t) sin(theta)``, the density of a strip.

        a and b are the sums of the rows above and below the strip, t is the position in the strip.
        """
        a, slope = self._row_sums[strip], self._row_sums[strip + 1] - self._row_sums[strip]
        step = np.pi / (len(self._rows) - 2)
        theta = step * (strip - 0.5 + t)
        return np.asarray((slope / step * np.sin(theta) - (a + slope * t) * np.cos(theta)) / step)

    def _invert_strip(self, strip: Ints, mass: Floats) -> Floats:
        """Return the position t in each strip up to which the integral of the strip's density is `mass`."""
        a, slope = self._row_sums[strip], self._row_sums[strip + 1] - self._row_sums[strip]
        step = np.pi / (len(self._rows) - 2)
        first, last = self._first[strip], self._last[strip]
        share = mass / np.maximum(np.diff(self._strip_cumulative)[strip], np.finfo(np.float64).tiny)
        begin, end = ((a + slope * t) * np.sin(step * (strip - 0.5 + t)) for t in (first, last))
        total = 0.5 * (np.maximum(begin, 0.0) + np.maximum(end, 0.0))
        t = first + (last - first) * _invert_line(np.maximum(begin, 0.0), np.maximum(end, 0.0), share * total)
        for _ in range(_NEWTON_STEPS):
            density = (a + slope * t) * np.sin(step * (strip - 0.5 + t))
            error = self._primitive(strip, t) - self._start[strip] - mass
            t = np.clip(t - np.where(density > 0.0, error / np.where(density > 0.0, density, 1.0), 0.0), first, last)
        return np.asarray(t)


def _invert_line(left: Floats, right: Floats, mass: Floats) -> Floats:
    """Return t in [0, 1] up to which a density that is linear from `left` to `right` has the integral `mass`."""
    root = np.sqrt(np.maximum(left * left + 2.0 * (right - left) * mass, 0.0))
    return np.asarray(np.clip(2.0 * mass / np.maximum(left + root, np.finfo(np.float64).tiny), 0.0, 1.0))


def coordinates_to_directions(coordinates: Floats) -> Floats:
    """Return the unit directions (N, 3) of the map coordinates (N, 2) that `BilinearWarp.coordinates` returns."""
    return uv_to_direction(np.stack([coordinates[:, 0], 1.0 - coordinates[:, 1]], axis=-1))


def lookup(table: ArrayLike, uv: ArrayLike) -> Floats:
    """Look up a lat-long table (H, W, C), row 0 at v = 1, at uv (..., 2): bilinear, periodic in u, clamped in v."""
    height, width = np.shape(table)[:2]
    u, v = np.moveaxis(np.asarray(uv, dtype=np.float64), -1, 0)
    return interpolate(table, u * width - 0.5, (1.0 - v) * height - 0.5, periodic=True)


def interpolate(table: ArrayLike, x: Floats, y: Floats, *, periodic: bool = False) -> Floats:
    """Return bilinear values (..., C) of a table (H, W, C) at columns x and rows y (...), periodic in x or clamped."""
    table = np.asarray(table)
    height, width = table.shape[:2]
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    s, t = (x - column)[..., None], (y - row)[..., None]
    left, right = ((column + k) % width if periodic else np.clip(column + k, 0, width - 1) for k in (0, 1))
    top, bottom = (np.clip(row + k, 0, height - 1) for k in (0, 1))
    upper = (1.0 - s) * table[top, left] + s * table[top, right]
    lower = (1.0 - s) * table[bottom, left] + s * table[bottom, right]
    return np.asarray((1.0 - t) * upper + t * lower, np.float64)


def lookup_towards(table: ArrayLike, direction: ArrayLike) -> Floats:
    """Return the `lookup` (..., C) of a lat-long table (H, W, C) in directions (..., 3)."""
    return lookup(table, direction_to_uv(direction))
