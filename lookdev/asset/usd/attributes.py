"""Reads and checks the values of USD attributes at a given time, for all modules that read assets.

A value has the requested type, shape and range, or an AssetError names its prim and attribute. The checks are needed
because USD returns the value that a layer has, even if it contradicts the attribute's type. The caller checks the
number of values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar, get_args

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from lookdev.arrays import Elements, Floats, Indices, Reals
from lookdev.asset.faces import index_rule
from lookdev.asset.mesh import Interpolation
from lookdev.asset.shape import MAX_COORDINATE
from lookdev.errors import AssetError, nearest_hint
from lookdev.stage import quote

_T = TypeVar("_T", bound=np.generic)
_Token = TypeVar("_Token", bound=str)

# The shape of one value in each type of array: () for a number, (3,) for a vector.
_FLOATS: Mapping[type, tuple[int, ...]] = {
    Vt.FloatArray: (),
    Vt.DoubleArray: (),
    Vt.HalfArray: (),
    **{getattr(Vt, f"Vec{width}{kind}Array"): (width,) for width in (2, 3, 4) for kind in "fdh"},
    Vt.QuatfArray: (4,),
    Vt.QuathArray: (4,),
    Vt.Matrix4dArray: (4, 4),
}
_INTEGERS: Mapping[type, tuple[int, ...]] = dict.fromkeys(
    (Vt.IntArray, Vt.UIntArray, Vt.Int64Array, Vt.UInt64Array, Vt.UCharArray), ()
)
# The type that a message asks for, by the shape of one value.
_NEEDED = {(): "float[]", (2,): "float2[]", (3,): "float3[]", (4,): "quatf[]", (4, 4): "matrix4d[]"}
_INTERPOLATIONS: tuple[Interpolation, ...] = get_args(Interpolation)


def read_array(
    prim: Usd.Prim, name: str, time: Usd.TimeCode, kind: type[_T], shape: tuple[int, ...] = (), *, bounded: bool = True
) -> NDArray[_T]:
    """Return the values (k, *shape) of an array attribute; the array is empty if the attribute has no value.

    `kind` is the NumPy type of the numbers, `np.intp` for integers. A caller that reads many arrays can pass
    `bounded=False` and check the bounds of all at once.

    Raises
    ------
    AssetError
        The value is not an array of such values, or, with `bounded`, a number is not within +-`MAX_COORDINATE`.
    """
    return check_array(prim.GetAttribute(name).Get(time), prim, name, kind, shape, bounded=bounded)


def check_array(
    value: object, prim: Usd.Prim, name: str, kind: type[_T], shape: tuple[int, ...] = (), *, bounded: bool = True
) -> NDArray[_T]:
    """Return the array of a value that USD computed for the attribute `name`, with the checks of `read_array`."""
    if value is None:
        return np.zeros((0, *shape), kind)
    is_integer = kind is np.intp
    if (_INTEGERS if is_integer else _FLOATS).get(type(value)) != shape:
        raise wrong_type(prim, name, value, "int[]" if is_integer else _NEEDED[shape])
    values = np.asarray(value).astype(kind)
    if bounded and not is_integer:
        check_bounded(values, prim, name)
    return values


def check_floats(value: object, attribute: Usd.Attribute, width: int, is_array: bool) -> Reals:
    """Return an attribute's value as floats (k, width), or (k,) if `width` is 1.

    `value` is the value that USD returned for the attribute. If the attribute is not an array, k is 1.
    """
    shape = (width,) if width > 1 else ()
    if is_array:
        if _FLOATS.get(type(value)) == shape:
            return np.asarray(value)
    elif (values := np.asarray([value])).dtype.kind == "f" and values.shape[1:] == shape:
        return values
    needed = _NEEDED[shape] if is_array else _NEEDED[shape].removesuffix("[]")
    raise wrong_type(attribute.GetPrim(), attribute.GetName(), value, needed)


def check_bounded(values: Elements, prim: Usd.Prim, name: str) -> None:
    """Raise AssetError if a number of an array (k, ...) is not within +-`MAX_COORDINATE`."""
    wrong = ~(np.abs(values) <= MAX_COORDINATE)
    if wrong.any():
        i = int(wrong.reshape(len(values), -1).any(axis=1).argmax())
        number = values[i][wrong[i]].flat[0] if values.ndim > 1 else values[i]
        raise AssetError(f"{prim.GetPath()}: {name}[{i}] is {number:g}; a number within +-{MAX_COORDINATE:g} is needed")


def check_range(indices: Indices, count: int, prim: Usd.Prim, name: str, noun: str) -> None:
    """Raise AssetError if an index of the attribute `name` is not in 0..count-1; `noun` names the indexed elements."""
    wrong = (indices < 0) | (indices >= count)
    if wrong.any():
        i = int(np.argmax(wrong))
        raise AssetError(f"{prim.GetPath()}: {name}[{i}] is {indices[i]}, but {index_rule(count, noun)}")


def read_number(prim: Usd.Prim, name: str, time: Usd.TimeCode, low: float = -MAX_COORDINATE) -> float:
    """Return a number attribute's value; raises AssetError if it is not from `low` to `MAX_COORDINATE`."""
    value = prim.GetAttribute(name).Get(time)
    if type(value) not in (float, int):
        raise wrong_type(prim, name, value, "double")
    if not low <= value <= MAX_COORDINATE:
        raise AssetError(
            f"{prim.GetPath()}: {name} is {value:g}; a number from {low:g} to {MAX_COORDINATE:g} is needed"
        )
    return float(value)


def read_token(prim: Usd.Prim, name: str, time: Usd.TimeCode, allowed: Sequence[_Token]) -> _Token:
    """Return a token attribute's value; raises AssetError if it is not one of the allowed values."""
    value = read_any_token(prim, name, time)
    if value not in allowed:
        raise AssetError(f"{prim.GetPath()}: {name} is {quote(value)} ({nearest_hint(value, allowed)})")
    return allowed[allowed.index(value)]


def read_any_token(prim: Usd.Prim, name: str, time: Usd.TimeCode) -> str:
    """Return a token attribute's value; raises AssetError if it is not a token."""
    value = prim.GetAttribute(name).Get(time)
    if not isinstance(value, str):
        raise wrong_type(prim, name, value, "token")
    return value


def read_texts(prim: Usd.Prim, name: str) -> tuple[str, ...]:
    """Return the texts of an array attribute at the default time; raises AssetError for a value of another type."""
    value = prim.GetAttribute(name).Get()
    if value is None:
        return ()
    if not isinstance(value, (Vt.TokenArray, Vt.StringArray)):
        raise wrong_type(prim, name, value, "token[]")
    return tuple(value)


def read_matrix(prim: Usd.Prim, name: str, time: Usd.TimeCode) -> Floats:
    """Return a matrix (4, 4) for row vectors; raises AssetError if the value is not a bounded matrix."""
    value = prim.GetAttribute(name).Get(time)
    if not isinstance(value, Gf.Matrix4d):
        raise wrong_type(prim, name, value, "matrix4d")
    matrix = np.array(value, np.float64)
    check_bounded(matrix, prim, name)
    return matrix


def check_interpolation(prim: Usd.Prim, name: str, interpolation: str) -> Interpolation:
    """Return an interpolation of USD; raises AssetError for any other text."""
    if interpolation not in _INTERPOLATIONS:
        names = ", ".join(_INTERPOLATIONS)
        raise AssetError(f"{prim.GetPath()}: {name} has interpolation {quote(interpolation)}; known: {names}")
    return _INTERPOLATIONS[_INTERPOLATIONS.index(interpolation)]


def points_from_velocities(prim: Usd.Prim, time: Usd.TimeCode) -> Floats | None:
    """Return the points (n, 3) of a point-based prim, moved by its velocities to `time`; None without velocities.

    Between two time samples, velocities extrapolate the points from the earlier sample. This is UsdGeom's rule for
    motion in which the number of points changes between samples, as in a simulation. Velocities that do not fit the
    points of the earlier sample have no effect; USD warns about them. Raises AssetError if the value of an attribute is
    not an array of vectors of three numbers.
    """
    if not prim.GetAttribute("velocities").HasAuthoredValue():
        return None
    for name in ("points", "velocities", "accelerations"):
        read_array(prim, name, time, np.float64, (3,))
    point_based = UsdGeom.PointBased(prim)
    time = sample_time(time, point_based.GetPointsAttr())
    return check_array(point_based.ComputePointsAtTime(time, time), prim, "points", np.float64, (3,))


def sample_time(time: Usd.TimeCode, attribute: Usd.Attribute) -> Usd.TimeCode:
    """Return the given time, or the attribute's first time sample if the given time is USD's "earliest" time.

    USD cannot extrapolate from the earliest time.
    """
    samples = attribute.GetTimeSamples() if time.IsEarliestTime() else ()
    return Usd.TimeCode(samples[0]) if samples else time


def wrong_type(prim: Usd.Prim, name: str, value: object, required: str) -> AssetError:
    """Return the error for an attribute whose value has another type than required."""
    actual = "empty" if value is None else f"of type {type_name(value)}"
    return AssetError(f"{prim.GetPath()}: {name} is {actual}; {required} is needed")


def type_name(value: object) -> str:
    """Return USD's name for the type of a value."""
    return str(Sdf.GetValueTypeNameForValue(value)) or type(value).__name__
