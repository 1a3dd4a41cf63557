"""The array type of all models, and vector algebra over the last axis of arrays.

Functions use only ufuncs, `where`, `stack`, `expand_dims` and sums over the last axis. Code generation can therefore
call them with symbolic arrays (`lookdev.codegen.trace`).
"""

from __future__ import annotations

from collections.abc import Mapping
from types import EllipsisType
from typing import Any, Literal, Protocol, SupportsIndex, TypeAlias

import numpy as np

from lookdev.arrays import Bools, Floats

UfuncMethod: TypeAlias = Literal["__call__", "reduce", "reduceat", "accumulate", "outer", "inner"]
"""The ways to apply a ufunc, as `__array_ufunc__` (NEP 13) names them."""

_IndexPart: TypeAlias = SupportsIndex | slice | EllipsisType | None
Index: TypeAlias = _IndexPart | tuple[_IndexPart, ...]
"""An index of an array; index arrays are excluded."""


class BooleanArray(Protocol):
    """The result of a comparison of arrays: an array of booleans, or a symbolic array in its place."""

    def __array__(self, dtype: None = ..., /) -> Bools: ...
    def __array_ufunc__(self, ufunc: np.ufunc, method: UfuncMethod, *inputs: object, **kwargs: object) -> object: ...
    def __and__(self, other: BooleanArray, /) -> BooleanArray: ...
    def __or__(self, other: BooleanArray, /) -> BooleanArray: ...
    def __invert__(self) -> BooleanArray: ...


class Array(Protocol):
    """A float64 array, or a symbolic array in its place.

    Shapes in docstrings: ``(...)`` is a number at each point, ``(..., 3)`` a vector or a colour.
    """

    @property
    def shape(self) -> tuple[int, ...]: ...
    @property
    def ndim(self) -> int: ...
    def __array__(self, dtype: None = ..., /) -> Floats: ...
    def __array_ufunc__(self, ufunc: np.ufunc, method: UfuncMethod, *inputs: object, **kwargs: object) -> object: ...
    def __getitem__(self, index: Index, /) -> Array: ...
    def __add__(self, other: Real, /) -> Array: ...
    def __radd__(self, other: Real, /) -> Array: ...
    def __sub__(self, other: Real, /) -> Array: ...
    def __rsub__(self, other: Real, /) -> Array: ...
    def __mul__(self, other: Real, /) -> Array: ...
    def __rmul__(self, other: Real, /) -> Array: ...
    def __truediv__(self, other: Real, /) -> Array: ...
    def __rtruediv__(self, other: Real, /) -> Array: ...
    def __neg__(self) -> Array: ...
    def sum(self, axis: int) -> Array: ...
    def __lt__(self, other: Real, /) -> BooleanArray: ...
    def __le__(self, other: Real, /) -> BooleanArray: ...
    def __gt__(self, other: Real, /) -> BooleanArray: ...
    def __ge__(self, other: Real, /) -> BooleanArray: ...


Real: TypeAlias = "Array | float"
"""An array, or one number for all points."""

Parameters: TypeAlias = Mapping[str, Any]
"""Values of a model's parameters by name: arrays, and strings for tokens."""

TINY = 1e-18
"""A floor for divisors. Its square, and the inverse of its square, are still normal float32 numbers."""


def vector(x: Array, y: Array, z: Array) -> Array:
    """Stack components (...) to vectors (..., 3)."""
    return np.stack([x, y, z], axis=-1)


def scale(vectors: Array, factor: Real) -> Array:
    """Multiply vectors (..., 3) by scalars (...)."""
    return vectors * np.expand_dims(factor, -1)


def mix(a: Real, b: Real, t: Real) -> Real:
    """Interpolate linearly between `a` and `b`; the result is exactly `a` at t = 0, and exactly `b` at t = 1."""
    # a + (b - a) t is not exact at t = 1: if a is far larger than b, the rounding error exceeds b.
    return a + 0.0 * t if are_equal(a, b) else a * (1.0 - t) + b * t


def mix_color(a: Array, b: Array, t: Real) -> Array:
    """Interpolate linearly between colours (..., 3) by scalars (...)."""
    return mix(a, b, np.expand_dims(t, -1))  # type: ignore[return-value]


def dot(a: Array, b: Array) -> Array:
    """Return the dot product over the last axis."""
    # numpy.sum would take three times as long over an axis of three.
    product = a * b
    return product[..., 0] + product[..., 1] + product[..., 2]


def cross(a: Array, b: Array) -> Array:
    """Return the cross product over the last axis."""
    (ax, ay, az), (bx, by, bz) = ([v[..., i] for i in range(3)] for v in (a, b))
    return vector(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)


def normalize(v: Array) -> Array:
    """Scale vectors (..., 3) to unit length; the length must not be zero."""
    return scale(v, 1.0 / np.sqrt(dot(v, v)))


# Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017, listing 3, vector b1.
def perpendicular(n: Array) -> Array:
    """Return unit vectors (..., 3) perpendicular to unit vectors (..., 3), by a formula without singularities."""
    x, y, z = n[..., 0], n[..., 1], n[..., 2]
    sign = np.where(z < 0.0, -1.0, 1.0)
    a = -1.0 / (sign + z)
    return vector(1.0 + sign * x * x * a, sign * x * y * a, -sign * x)


def reflect(w: Array, wm: Array) -> Array:
    """Mirror directions `w` (..., 3) about unit microfacet normals `wm` (..., 3) (Burley 2012, appendix B.1)."""
    return scale(wm, 2.0 * dot(w, wm)) - w


def mean(color: Array) -> Array:
    """Return the mean of the three channels, (...)."""
    return (color[..., 0] + color[..., 1] + color[..., 2]) * (1.0 / 3.0)


def are_equal(a: Real, b: Real) -> bool:
    """Return whether two values are equal everywhere; symbolic values are equal if their difference folds to 0."""
    difference = a - b
    return isinstance(difference, np.ndarray | np.floating | float) and not np.any(difference)
