"""The placement of a light: its position in metres and its axes, from a matrix of USD.

`Axes` are the light's own x, y and z axes in world space: unit vectors at right angles. They are right- or left-handed,
because a transform in USD may mirror.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lookdev.arrays import Floats
from lookdev.errors import EnvironmentMapError

Vector = tuple[float, float, float]
Axes = tuple[Vector, Vector, Vector]

WORLD_AXES: Axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

_SKEW = 1e-4  # the largest cosine between two axes that counts as rounding; float32 matrices of USD have 1e-6


def placement(matrix: ArrayLike) -> tuple[Vector, Axes, Vector]:
    """Return the position, the axes, and the scale along each axis of a matrix (4, 4) for column vectors.

    Raises
    ------
    EnvironmentMapError
        The matrix is skewed, flat or not finite.
    """
    values = np.asarray(matrix, np.float64)
    scale = np.linalg.norm(values[:3, :3], axis=0)
    if not np.isfinite(values).all() or not (scale > 0.0).all():
        raise EnvironmentMapError("the placement of a light is flat or not finite; a scale other than 0 would be right")
    axes = (values[:3, :3] / scale).T
    skew = np.abs(axes @ axes.T - np.eye(3)).max()
    if skew > _SKEW:
        raise EnvironmentMapError(
            f"the placement of a light is skewed: two of its axes have a cosine of {skew:.2g}; moves, turns and "
            "scales along its own axes would be right"
        )
    # The nearest orthogonal matrix is the product of the singular vectors (Higham 1986).
    left, _, right = np.linalg.svd(axes)
    return vector(values[:3, 3]), checked_axes(left @ right), vector(scale)


def checked_axes(axes: ArrayLike) -> Axes:
    """Return axes (3, 3) as tuples; raise EnvironmentMapError unless they are unit vectors at right angles."""
    values = np.asarray(axes, np.float64)
    if values.shape != (3, 3) or not (np.abs(values @ values.T - np.eye(3)) < 1e-6).all():
        raise EnvironmentMapError(f"axes {values.tolist()}: three unit vectors at right angles would be right")
    x, y, z = (vector(row) for row in values)
    return x, y, z


def vector(values: ArrayLike) -> Vector:
    """Return three numbers as a tuple of Python floats."""
    x, y, z = np.asarray(values, np.float64).tolist()
    return x, y, z


def to_local(axes: Axes, world: Floats) -> Floats:
    """Transform vectors (..., 3) from world space to the space whose axes are `axes`."""
    return np.asarray(world @ np.array(axes).T)


def to_world(axes: Axes, local: Floats) -> Floats:
    """Transform vectors (..., 3) from the space whose axes are `axes` to world space."""
    return np.asarray(local @ np.array(axes))
