"""Reads the primvars of a gprim, its own and those that it inherits, and checks their types.

The number of values is checked later. A primvar whose values have two numbers is a UV set. So is a primvar of
texture coordinates with three numbers; the third number is dropped. Other primvars have one or three numbers. A primvar
of another type is dropped without a note. A primvar is dropped with a note if it has no value, several elements per
value, or a name that USD defines with a different type.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from lookdev.arrays import Reals
from lookdev.asset.shape import Attribute
from lookdev.asset.usd.attributes import check_floats, check_range, read_array

# The numbers in one value of a primvar, by its type in USD's C++.
_WIDTHS = {"float": 1, "double": 1, "GfHalf": 1} | {f"GfVec{width}{kind}": width for width in (2, 3) for kind in "fdh"}
_STANDARD_WIDTHS = {"st": 2, "displayColor": 3, "displayOpacity": 1}  # by the names that USD defines
_NORMALS = "normals"
_SKINNING = "skel:"


@dataclass(frozen=True)
class InheritedPrimvars:
    """Primvars that a prim inherits, or that its children can inherit from it.

    `attributes` has their values, by name. `primvars` are USD's primvars. They can include more: primvars of dropped
    types, and primvars that the prim authors itself. `key` is equal for equal names and values of attributes.
    """

    primvars: tuple[UsdGeom.Primvar, ...] = ()
    attributes: Mapping[str, Attribute] = field(default_factory=dict)
    key: tuple[tuple[str, bytes], ...] = ()


class PrimvarReader:
    """Reads primvars at a given time; calls `note` with a message and the prim for each dropped primvar."""

    def __init__(self, time: Usd.TimeCode, note: Callable[[str, Usd.Prim], None]) -> None:
        self._time = time
        self._note = note
        self._inherited: dict[Sdf.Path, InheritedPrimvars] = {}
        # By type: the numbers in one value, whether the type is that of a UV set, and whether it is an array.
        self._kinds: dict[Sdf.ValueTypeName, tuple[int, bool, bool]] = {}

    def local_primvars(self, prim: Usd.Prim) -> tuple[tuple[Attribute, ...], str]:
        """Return the primvars authored on a prim itself, and the prim's `default_uv`."""
        primvars = UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithAuthoredValues()
        attributes = tuple(attribute for primvar in primvars if (attribute := self._attribute(primvar)) is not None)
        uvs = [attribute.name for attribute in attributes if attribute.is_uv]
        if len(uvs) < 2 or "st" in uvs:
            return attributes, default_uv(uvs, uvs)
        return attributes, default_uv(
            uvs, [primvar.GetPrimvarName() for primvar in primvars if _is_texture_coordinate(primvar.GetTypeName())]
        )

    def inherited_primvars(self, prim: Usd.Prim) -> InheritedPrimvars:
        """Return the constant primvars that a prim inherits and does not author itself."""
        parent_primvars = self._inheritable_primvars(prim.GetParent())
        if not parent_primvars.primvars:
            return parent_primvars
        inheriting = UsdGeom.PrimvarsAPI(prim).FindPrimvarsWithInheritance(list(parent_primvars.primvars))
        names = {primvar.GetPrimvarName() for primvar in inheriting if primvar.GetAttr().GetPrim() != prim}
        if names >= parent_primvars.attributes.keys():
            return parent_primvars
        attributes = {name: attribute for name, attribute in parent_primvars.attributes.items() if name in names}
        return InheritedPrimvars(
            parent_primvars.primvars, attributes, tuple(item for item in parent_primvars.key if item[0] in names)
        )

    def _inheritable_primvars(self, prim: Usd.Prim) -> InheritedPrimvars:
        """Return the primvars that the children of a prim can inherit from it; results are stored by path."""
        path = prim.GetPath()
        if path not in self._inherited:
            primvars = tuple(UsdGeom.PrimvarsAPI(prim).FindInheritablePrimvars())
            values = (self._attribute(primvar) for primvar in primvars)
            attributes = {attribute.name: attribute for attribute in values if attribute is not None}
            key = tuple((name, attribute.values.tobytes()) for name, attribute in sorted(attributes.items()))
            self._inherited[path] = InheritedPrimvars(primvars, attributes, key)
        return self._inherited[path]

    def normals(self, prim: Usd.Prim) -> Attribute | None:
        """Return the normals of a point-based prim: ``primvars:normals``, or else ``normals``, or None."""
        primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar(_NORMALS)
        if primvar and primvar.HasValue():
            values = self._values(primvar, 3, primvar.GetTypeName().isArray)
            interpolation = primvar.GetInterpolation()
        else:
            values = read_array(prim, _NORMALS, self._time, np.float64, (3,))
            interpolation = UsdGeom.PointBased(prim).GetNormalsInterpolation()
        return Attribute(_NORMALS, values, interpolation) if len(values) else None

    def _attribute(self, primvar: UsdGeom.Primvar) -> Attribute | None:
        """Return a primvar as an attribute, or None if it is dropped, is the normals or belongs to skinning."""
        name, kind = primvar.GetPrimvarName(), primvar.GetTypeName()
        if kind not in self._kinds:
            width = _WIDTHS.get(kind.scalarType.cppTypeName, 0)
            self._kinds[kind] = width, width == 2 or _is_texture_coordinate(kind), kind.isArray
        width, is_uv, is_array = self._kinds[kind]
        if name == _NORMALS or name.startswith(_SKINNING):
            return None
        if name in _STANDARD_WIDTHS and not (is_uv if _STANDARD_WIDTHS[name] == 2 else width == _STANDARD_WIDTHS[name]):
            self._note_dropped(primvar, f"of type {kind}")
            return None
        if not width:
            return None
        if (size := primvar.GetElementSize()) != 1:
            self._note_dropped(primvar, f"of elementSize {size}")
            return None
        values = self._values(primvar, width, is_array)
        if len(values) == 0:
            self._note_dropped(primvar, "without a value")
            return None
        return Attribute(name, values[:, :2] if is_uv else values, primvar.GetInterpolation(), is_uv)

    def _note_dropped(self, primvar: UsdGeom.Primvar, reason: str) -> None:
        """Call `note` for a primvar that is dropped."""
        self._note(f"with {primvar.GetName()} {reason}, left out", primvar.GetAttr().GetPrim())

    def _values(self, primvar: UsdGeom.Primvar, width: int, is_array: bool) -> Reals:
        """Return a primvar's values, (k,) or (k, width), with its indices applied; (0,) if the primvar has no value."""
        value = primvar.Get(self._time)
        if value is None:
            return np.zeros(0)
        values = check_floats(value, primvar.GetAttr(), width, is_array)
        if primvar.IsIndexed():
            prim, name = primvar.GetAttr().GetPrim(), primvar.GetIndicesAttr().GetName()
            indices = read_array(prim, name, self._time, np.intp)
            check_range(indices, len(values), prim, name, "values")
            values = values[indices]
        return values


def _is_texture_coordinate(kind: Sdf.ValueTypeName) -> bool:
    """Return whether a type is one of USD's types of texture coordinates, such as texCoord2f."""
    return bool(kind.role == Sdf.ValueRoleNames.TextureCoordinate)


def default_uv(names: Collection[str], texture_coordinates: Collection[str]) -> str:
    """Return the default of the UV sets `names`: ``st``, else the only one with a texture coordinate type, else "".

    If no UV set has such a type, the default is the only UV set. `texture_coordinates` are the names of the primvars
    that have such a type.
    """
    if "st" in names:
        return "st"
    candidates = [name for name in names if name in texture_coordinates] or list(names)
    return candidates[0] if len(candidates) == 1 else ""
