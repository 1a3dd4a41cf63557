"""Gprims as shapes, by their types: meshes, curves, points and implicit surfaces, deformed as UsdSkel does."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pxr import Usd

from lookdev.asset.shape import Doubles, Shape
from lookdev.asset.usd.curves import curve_shape, point_shape
from lookdev.asset.usd.mesh import mesh_shape
from lookdev.asset.usd.primitives import (
    LEAST_ERROR,
    PRIMITIVES,
    allotted_errors,
    primitive_key,
    primitive_shape,
    proportions,
)
from lookdev.asset.usd.primvars import PrimvarReader
from lookdev.asset.usd.skinning import Skinning
from lookdev.asset.usd.velocities import carried_points
from lookdev.asset.usd.walk import Seen
from lookdev.errors import AssetError

_CURVES = ("BasisCurves", "NurbsCurves")
GPRIMS = ("Mesh", *_CURVES, "Points", *PRIMITIVES)
"""The types that are rendered."""
_SHAPING = ("widths", "normals")


@dataclass(frozen=True, eq=False)
class Surface:
    """A gprim's shape, and the names of the GeomSubsets that are its parts from 1 on.

    It is where `GprimReader.space` says, with `copies` (k, 4, 4), for row vectors in the stage's unit, once for each.
    """

    shape: Shape
    subsets: tuple[str, ...] = ()
    copies: Doubles | None = None


class GprimReader:
    """Reads gprims of a stage at a time, in metres of `unit` a unit; `note` is told what is left out of a prim."""

    def __init__(self, time: Usd.TimeCode, unit: float, note: Callable[[str, Usd.Prim], None]) -> None:
        self.primvars = PrimvarReader(time, note)
        self.skinning = Skinning(time)
        self._time = time
        self._unit = unit
        self._note = note
        self._errors: dict[tuple[Any, ...], float] = {}
        self._alike: dict[tuple[Any, ...], tuple[tuple[Any, ...], float]] = {}

    def allot(self, seen: Iterable[Seen]) -> None:
        """Settle how fine implicit surfaces are, by all that are seen.

        Where they are too many to be as fine as one, those that are alike but for their size are copies of one.
        """
        radii: dict[tuple[Any, ...], float] = {}
        for each in seen:
            if each.prim.GetTypeName() in PRIMITIVES:
                try:
                    key = primitive_key(each.prim, self._time)
                except AssetError:
                    continue  # raised when it is read
                scale = float(np.linalg.norm(each.transforms[:, :3, :3], axis=(1, 2)).max()) / np.sqrt(3.0)
                radii[key] = max(radii.get(key, 0.0), max(key[2:]) * scale)
        solid = {key: radius for key, radius in radii.items() if 0.0 < radius < np.inf}
        errors = allotted_errors(np.array(list(solid.values())))
        self._errors = dict(zip(solid, errors.tolist(), strict=True))
        if (errors > LEAST_ERROR).any():
            self._alike = {key: proportions(key, error) for key, error in self._errors.items()}

    def key(self, prim: Usd.Prim) -> tuple[Any, ...]:
        """Return what is the same for gprims with one surface: instances of a prototype's gprim, like primitives."""
        posed = self.skinning.key(prim)
        if prim.GetTypeName() in PRIMITIVES and not posed:
            own, _ = self.primvars.own(prim)
            key = primitive_key(prim, self._time)
            alike, _ = self._alike.get(key, (key, 1.0))
            return (*alike, *((each.name, each.values.tobytes()) for each in own))
        return str((prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim).GetPath()), *posed

    def read(self, prim: Usd.Prim) -> Surface:
        """Return the surface of a gprim of a type in `GPRIMS`; raises AssetError where it contradicts itself."""
        kind = prim.GetTypeName()
        if kind in PRIMITIVES:
            return self._primitive(prim)
        deformed = self.skinning.deformed(prim)
        points = carried_points(prim, self._time) if deformed is None else deformed.points
        if kind == "Points":
            shape, copies = point_shape(prim, self._time, self._unit, points=points)
            return Surface(self._with_constants(shape, prim), (), copies)
        if kind in _CURVES:
            attributes, default_uv = self.primvars.own(prim)
            shape = curve_shape(prim, self._time, self._unit, attributes, points)
            return Surface(replace(shape, default_uv=default_uv or "st"))
        shape, subsets = mesh_shape(prim, self._time, self._unit, self.primvars, points)
        if deformed is not None and shape.normals is not None:
            shape = replace(shape, normals=deformed.normals(shape.normals, shape.face_points))
        return Surface(shape, subsets)

    def copies(self, prim: Usd.Prim, surface: Surface) -> Doubles | None:
        """Return the placements (k, 4, 4) of a gprim's surface in its space, as `Surface.copies`."""
        size = self._size(prim)
        return surface.copies if size == 1.0 else np.diag([size, size, size, 1.0])[None]

    def _size(self, prim: Usd.Prim) -> float:
        """Return the factor of a primitive to the surface that it shares with others."""
        if prim.GetTypeName() not in PRIMITIVES or not self._alike or self.skinning.key(prim):
            return 1.0
        return self._alike.get(primitive_key(prim, self._time), ((), 1.0))[1]

    def _primitive(self, prim: Usd.Prim) -> Surface:
        error = self._errors.get(primitive_key(prim, self._time), LEAST_ERROR)
        shape = primitive_shape(prim, self._time, self._unit / self._size(prim), error)
        deformed = self.skinning.deformed(prim, shape.points / self._unit)
        if deformed is not None and shape.normals is not None:
            normals = deformed.normals(shape.normals, shape.face_points)
            shape = replace(shape, points=deformed.points * self._unit, normals=normals)
        return Surface(self._with_constants(shape, prim))

    def _with_constants(self, shape: Shape, prim: Usd.Prim) -> Shape:
        """Return a sphere or primitive with the primvars of its prim that are constant, which is all it can carry."""
        attributes = {each.name: each for each in shape.attributes}
        for each in self.primvars.own(prim)[0]:
            if len(each.values) == 1:
                attributes[each.name] = replace(each, interpolation="constant")
            elif each.name not in _SHAPING:
                self._note(f"with primvars:{each.name} of {len(each.values)} values, left out: one is carried", prim)
        return replace(shape, attributes=tuple(attributes.values()))
