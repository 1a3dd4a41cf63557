"""Primvars at a time, checked for their kind; how many values there must be is checked later.

UV sets are the primvars of two numbers a value and texture coordinates of three, whose third is left out. Other
primvars are those of one number and of three. What has another type is left out; so is, with a note, what has no value
or several elements a value, or one of the names that USD defines with another type than USD's.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from lookdev.asset.shape import Attribute
from lookdev.asset.usd.attributes import check_range, checked_floats, read_array

# The numbers in one value of a primvar, by its type in USD's C++.
_WIDTHS = {"float": 1, "double": 1, "GfHalf": 1} | {f"GfVec{width}{kind}": width for width in (2, 3) for kind in "fdh"}
_DEFINED = {"st": 2, "displayColor": 3, "displayOpacity": 1}
_NORMALS = "normals"
_SKINNING = "skel:"


@dataclass(frozen=True)
class Inherited:
    """Primvars that a prim hands down to what is below it; `key` is the same where their names and values are."""

    primvars: tuple[Any, ...] = ()
    attributes: Mapping[str, Attribute] = field(default_factory=dict)
    key: tuple[tuple[str, bytes], ...] = ()


class PrimvarReader:
    """Reads primvars at a time; `note` is told what is left out of a prim."""

    def __init__(self, time: Usd.TimeCode, note: Callable[[str, Usd.Prim], None]) -> None:
        self._time = time
        self._note = note
        self._inherited: dict[Sdf.Path, Inherited] = {}
        self._kinds: dict[Any, tuple[int, bool, bool]] = {}

    def own(self, prim: Usd.Prim) -> tuple[tuple[Attribute, ...], str]:
        """Return the primvars of a prim itself, and its `default_uv`."""
        primvars = UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithAuthoredValues()
        attributes = tuple(read for each in primvars if (read := self._attribute(each)) is not None)
        uvs = [each.name for each in attributes if each.is_uv]
        if len(uvs) < 2 or "st" in uvs:
            return attributes, default_uv(uvs, uvs)
        return attributes, default_uv(
            uvs, [each.GetPrimvarName() for each in primvars if _is_texture(each.GetTypeName())]
        )

    def inherited(self, prim: Usd.Prim) -> Inherited:
        """Return the constant primvars that a prim inherits, and does not have itself."""
        above = self._handed_down(prim.GetParent())
        if not above.primvars:
            return above
        found = UsdGeom.PrimvarsAPI(prim).FindPrimvarsWithInheritance(list(above.primvars))
        mine = {each.GetPrimvarName() for each in found if each.GetAttr().GetPrim() != prim}
        if mine >= above.attributes.keys():
            return above
        attributes = {name: each for name, each in above.attributes.items() if name in mine}
        return Inherited(above.primvars, attributes, tuple(each for each in above.key if each[0] in mine))

    def _handed_down(self, prim: Usd.Prim) -> Inherited:
        path = prim.GetPath()
        if path not in self._inherited:
            primvars = tuple(UsdGeom.PrimvarsAPI(prim).FindInheritablePrimvars())
            read = (self._attribute(each) for each in primvars)
            attributes = {each.name: each for each in read if each is not None}
            key = tuple((name, each.values.tobytes()) for name, each in sorted(attributes.items()))
            self._inherited[path] = Inherited(primvars, attributes, key)
        return self._inherited[path]

    def normals(self, prim: Usd.Prim) -> Attribute | None:
        """Return ``primvars:normals``, else ``normals``, of a point-based prim."""
        primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar(_NORMALS)
        if primvar and primvar.HasValue():
            values = self._values(primvar, 3, primvar.GetTypeName().isArray)
            interpolation = primvar.GetInterpolation()
        else:
            values = read_array(prim, _NORMALS, self._time, np.float64, (3,))
            interpolation = UsdGeom.PointBased(prim).GetNormalsInterpolation()
        return Attribute(_NORMALS, values, interpolation) if len(values) else None

    def _attribute(self, primvar: Any) -> Attribute | None:
        name, kind = primvar.GetPrimvarName(), primvar.GetTypeName()
        if kind not in self._kinds:
            width = _WIDTHS.get(kind.scalarType.cppTypeName, 0)
            self._kinds[kind] = width, width == 2 or _is_texture(kind), kind.isArray
        width, is_uv, is_array = self._kinds[kind]
        if name == _NORMALS or name.startswith(_SKINNING):
            return None
        if name in _DEFINED and not (is_uv if _DEFINED[name] == 2 else width == _DEFINED[name]):
            self._leave_out(primvar, f"of type {kind}")
            return None
        if not width:
            return None
        if (size := primvar.GetElementSize()) != 1:
            self._leave_out(primvar, f"of elementSize {size}")
            return None
        values = self._values(primvar, width, is_array)
        if len(values) == 0:
            self._leave_out(primvar, "without a value")
            return None
        return Attribute(name, values[:, :2] if is_uv else values, primvar.GetInterpolation(), is_uv)

    def _leave_out(self, primvar: Any, why: str) -> None:
        self._note(f"with {primvar.GetName()} {why}, left out", primvar.GetAttr().GetPrim())

    def _values(self, primvar: Any, width: int, is_array: bool) -> NDArray[Any]:
        """Return a primvar's values (k,) or (k, width) with its indices applied; none where it is empty."""
        value = primvar.Get(self._time)
        if value is None:
            return np.zeros(0)
        values = checked_floats(value, primvar.GetAttr(), width, is_array)
        if primvar.IsIndexed():
            prim, name = primvar.GetAttr().GetPrim(), primvar.GetIndicesAttr().GetName()
            indices = read_array(prim, name, self._time, np.intp)
            check_range(indices, len(values), prim, name, "values")
            values = values[indices]
        return values


def _is_texture(kind: Any) -> bool:
    return bool(kind.role == Sdf.ValueRoleNames.TextureCoordinate)


def default_uv(names: Collection[str], textured: Collection[str]) -> str:
    """Return ``st``, else the only UV set of a texture coordinate's type, else the only one, else ""."""
    if "st" in names:
        return "st"
    candidates = [name for name in names if name in textured] or list(names)
    return candidates[0] if len(candidates) == 1 else ""
