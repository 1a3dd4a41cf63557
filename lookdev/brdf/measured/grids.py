"""Samples of measured reflectance on a grid of angles, and the look-up of f between them.

- Rusinkiewicz, S. 1998. A New Change of Variables for Efficient BRDF Representation. EGWR.
- Matusik, W. et al. 2003. A Data-Driven Reflectance Model. ACM TOG 22(3): the grid of MERL's files.
- Ngan, A. et al. 2005. Experimental Analysis of BRDF Models. EGSR: the grid of the anisotropic measurements.

The cells of a grid divide the range of each angle. A sample is at the centre of its cell. The interpolation
``"nearest"`` returns the sample of the cell that contains the angles. ``"linear"`` interpolates along every angle.
Angles to the normal and to the half vector are clamped to the first and last sample; azimuths wrap.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import product
from operator import mul
from typing import TypeAlias

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.lobes import DirectionPair
from lookdev.brdf.table import NumberTable, look_up
from lookdev.brdf.vectors import TINY, Array, Real, dot

Corner: TypeAlias = tuple[Array, Real]
"""A sample that an interpolation along one angle reads: its index (...) along this angle, and its weight (...)."""

HALF_PI = 0.5 * np.pi
"""The range in radians of angles to the normal."""


@dataclass(frozen=True, eq=False)
class IsotropicGrid:
    """Samples (theta_h, theta_d, phi_d, 3) of an isotropic surface, in 1/sr, none negative.

    theta_h is the angle of the half vector to the normal, in equal steps of its square root. theta_d and phi_d are the
    angle and the azimuth of the light's direction about the half vector. phi_d covers [0, pi): by reciprocity f is the
    same at phi_d + pi.
    """

    samples: Floats

    @cached_property
    def table(self) -> NumberTable:
        """The samples as a table of colours: a row for each theta_h and theta_d, a column for each phi_d."""
        return NumberTable(self.samples.reshape(-1, self.samples.shape[2], 3))

    def f(self, d: DirectionPair, interpolation: str) -> Array:
        """Return f (..., 3), in 1/sr, for a pair of directions; `interpolation` is ``"nearest"`` or ``"linear"``."""
        halves, differences, azimuths = self.samples.shape[:3]  # the numbers of theta_h, theta_d and phi_d
        find_corners = _CORNERS[interpolation]
        theta_h = _elevation(d.wm)
        # sin theta_d is half the length of the chord between the directions; their dot product would cancel.
        chord = d.wi - d.wo
        theta_d = arc_tangent(0.5 * np.sqrt(dot(chord, chord)), d.cos_theta_d)
        # phi_d is the angle of the point (wo_z - wi_z, (wo x wi)_z / cos theta_d). Both coordinates have the factor
        # 2 sin theta_h sin theta_d.
        y = (d.wo[..., 0] * d.wi[..., 1] - d.wo[..., 1] * d.wi[..., 0]) / d.cos_theta_d
        phi_d = arc_tangent(y, d.wo[..., 2] - d.wi[..., 2])
        folded = np.where(phi_d < 0.0, phi_d + np.pi, phi_d)
        folded = np.where(folded >= np.pi, folded - np.pi, folded)
        return _interpolate(
            self.table,
            lambda h, t: h * float(differences) + t,
            lambda phi: phi,
            (
                find_corners(np.sqrt(theta_h / HALF_PI) * float(halves), halves, wraps=False),
                find_corners(theta_d * (differences / HALF_PI), differences, wraps=False),
            ),
            (find_corners(folded * (azimuths / np.pi), azimuths, wraps=True),),
        )


@dataclass(frozen=True, eq=False)
class AnisotropicGrid:
    """Samples (theta_i, theta_o, phi_d, phi_i, 3) of an anisotropic surface, in 1/sr.

    theta_i and theta_o are the angles of light and view to the normal. phi_i is the azimuth of the light from the
    tangent, phi_d the azimuth of the view from the light. With `half`, phi_d covers only [0, pi], and the rest follows
    by reciprocity. A negative sample counts as 0.
    """

    samples: Floats
    half: bool = False

    @cached_property
    def table(self) -> NumberTable:
        """The samples as a table of colours: a row for each theta_i and theta_o, a column for each phi_d and phi_i."""
        lights, views, differences, azimuths = self.samples.shape[:4]
        return NumberTable(self.samples.reshape(lights * views, differences * azimuths, 3))

    def f(self, d: DirectionPair, interpolation: str) -> Array:
        """Return f (..., 3), in 1/sr, for a pair of directions; `interpolation` is ``"nearest"`` or ``"linear"``."""
        # The numbers of theta_i, theta_o, phi_d and phi_i.
        lights, views, differences, azimuths = self.samples.shape[:4]
        find_corners = _CORNERS[interpolation]
        phi_i, phi_o = (arc_tangent(w[..., 1], w[..., 0]) for w in (d.wi, d.wo))
        theta_i, theta_o = _elevation(d.wi), _elevation(d.wo)
        phi_d = phi_o - phi_i
        if self.half:
            phi_d = np.where(phi_d > np.pi, phi_d - 2.0 * np.pi, np.where(phi_d <= -np.pi, phi_d + 2.0 * np.pi, phi_d))
            swapped = phi_d < 0.0
            theta_i, theta_o = np.where(swapped, theta_o, theta_i), np.where(swapped, theta_i, theta_o)
            phi_i, phi_d = np.where(swapped, phi_o, phi_i), np.absolute(phi_d)
        phi_d_corners = find_corners(
            _azimuth_fraction(phi_d, 1.0 if self.half else 2.0) * differences, differences, wraps=not self.half
        )
        return _interpolate(
            self.table,
            lambda i, o: i * float(views) + o,
            lambda difference, phi: difference * float(azimuths) + phi,
            (
                find_corners(theta_i * (lights / HALF_PI), lights, wraps=False),
                find_corners(theta_o * (views / HALF_PI), views, wraps=False),
            ),
            (phi_d_corners, find_corners(_azimuth_fraction(phi_i, 2.0) * azimuths, azimuths, wraps=True)),
        )


MeasurementGrid: TypeAlias = IsotropicGrid | AnisotropicGrid


def _elevation(w: Array) -> Array:
    """Return the angles (...) of directions (..., 3) to the normal."""
    return arc_tangent(np.sqrt(w[..., 0] * w[..., 0] + w[..., 1] * w[..., 1]), w[..., 2])


def arc_tangent(y: Array, x: Array) -> Array:
    """Return the angle of the point (x, y) to the x axis, as arctan2 does.

    A Newton step follows arctan2, because OSL's arctan2 can be off by 1e-4.
    """
    angle: Array = np.arctan2(y, x)
    length = np.sqrt(x * x + y * y)
    return angle + (y * np.cos(angle) - x * np.sin(angle)) / np.maximum(length, TINY)


def _azimuth_fraction(angle: Array, period: float) -> Array:
    """Return an angle as a fraction of ``period * pi``, in [0, 1].

    The angle is above -2 pi, or from 0 to pi if the period is 1.
    """
    part = angle * (1.0 / (period * np.pi))
    return np.where(part < 0.0, part + 1.0, part)


def _nearest(position: Array, count: int, *, wraps: bool) -> tuple[Corner, ...]:
    """Return the cell that contains a position along one angle, as one corner of weight 1.

    The position is in units of cells, from 0 to `count`.
    """
    return ((np.clip(np.floor(position), 0.0, count - 1.0), 1.0),)


def _linear(position: Array, count: int, *, wraps: bool) -> tuple[Corner, ...]:
    """Return the two samples beside a position along one angle as corners, with weights that sum to 1.

    The position is in units of cells, from 0 to `count`. With `wraps`, the first sample follows the last one.
    """
    last = count - 1.0
    shifted = position - 0.5
    if wraps:
        low = np.floor(shifted)
        part = shifted - low
        return (np.where(low < 0.0, last, low), 1.0 - part), (np.where(low >= last, 0.0, low + 1.0), part)
    shifted = np.clip(shifted, 0.0, last)
    low = np.minimum(np.floor(shifted), max(last - 1.0, 0.0))
    part = shifted - low
    return (low, 1.0 - part), (np.minimum(low + 1.0, last), part)


_CORNERS = {"nearest": _nearest, "linear": _linear}


def _interpolate(
    table: NumberTable,
    row: Callable[..., Array],
    column: Callable[..., Array],
    rows: tuple[tuple[Corner, ...], ...],
    columns: tuple[tuple[Corner, ...], ...],
) -> Array:
    """Return the sum of a table's samples at all corners, each multiplied by the product of its weights.

    `rows` has the corners along each angle that selects a row of the table. The function `row` returns the row from one
    index along each of these angles. `columns` and `column` are the same for the columns.
    """
    total: Real = 0.0
    for row_corners in product(*rows):
        row_index = row(*(index for index, _ in row_corners))
        row_total: Real = 0.0
        for column_corners in product(*columns):
            sample = look_up(table, row_index, column(*(index for index, _ in column_corners)))
            row_total = row_total + _apply_weights(sample, column_corners)
        total = total + _apply_weights(row_total, row_corners)
    return total  # type: ignore[return-value]


def _apply_weights(color: Real, corners: tuple[Corner, ...]) -> Real:
    """Return a colour (..., 3) times the product of the corners' weights."""
    return color * np.expand_dims(reduce(mul, (weight for _, weight in corners)), -1)
