"""Converts gprims to shapes by their types: meshes, curves, points and primitives, deformed by UsdSkel.

A primitive is one of UsdGeom's implicit surfaces, such as a Sphere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from pxr import Usd

from lookdev.arrays import Floats
from lookdev.asset.shape import PolygonShape
from lookdev.asset.usd import primitives
from lookdev.asset.usd.attributes import points_from_velocities
from lookdev.asset.usd.curves import curve_shape, point_shape
from lookdev.asset.usd.mesh import mesh_shape
from lookdev.asset.usd.primvars import PrimvarReader
from lookdev.asset.usd.skinning import Skinning
from lookdev.asset.usd.walk import PlacedGprim, prototype_path
from lookdev.errors import AssetError

_CURVES = ("BasisCurves", "NurbsCurves")
GPRIMS = ("Mesh", *_CURVES, "Points", *primitives.PRIMITIVES)
"""The types of gprims that are rendered."""
_CURVE_ATTRIBUTES = ("widths", "normals")  # primvars with a meaning of their own for curves and points


@dataclass(frozen=True, eq=False)
class GprimSurface:
    """A gprim's shape, and the names of the GeomSubsets that are the shape's parts 1, 2, ...

    The transform of the prim that `Skinning.placing_prim` returns places the shape. `copies`, unless None, are matrices
    (k, 4, 4) for row vectors in the stage's unit, which place k copies of the shape in the space of that prim.
    """

    shape: PolygonShape
    subsets: tuple[str, ...] = ()
    copies: Floats | None = None


class GprimReader:
    """Reads gprims of a stage at a given time, in metres.

    `unit` is the length of the stage's unit in metres. `note` is called with a message and the prim for content that is
    dropped.
    """

    def __init__(self, time: Usd.TimeCode, unit: float, note: Callable[[str, Usd.Prim], None]) -> None:
        self.primvars = PrimvarReader(time, note)
        self.skinning = Skinning(time)
        self._time = time
        self._unit = unit
        self._note = note
        self._errors: dict[primitives.PrimitiveKey, float] = {}
        # By the key of a primitive: the parameters of the surface that it shares with others, and its scale relative to
        # this surface. The dictionary is empty unless primitives that differ only by size share surfaces.
        self._shared: dict[primitives.PrimitiveKey, tuple[primitives.PrimitiveKey, float]] = {}

    def set_errors(self, gprims: Iterable[PlacedGprim]) -> None:
        """Choose the error of each primitive's mesh (`error` of `primitive_shape`) from all visible gprims.

        If there are too many primitives for the least error, primitives of equal proportions become scaled copies of
        one surface.
        """
        radii: dict[primitives.PrimitiveKey, float] = {}
        for gprim in gprims:
            if gprim.prim.GetTypeName() in primitives.PRIMITIVES:
                try:
                    key = primitives.primitive_key(gprim.prim, self._time)
                except AssetError:
                    continue  # `read` raises it again
                # The scale of the largest placement: the root mean square of the scales along the axes.
                scale = float(np.linalg.norm(gprim.transforms[:, :3, :3], axis=(1, 2)).max()) / np.sqrt(3.0)
                radii[key] = max(radii.get(key, 0.0), max(key[2:]) * scale)
        sized = {key: radius for key, radius in radii.items() if 0.0 < radius < np.inf}
        errors = primitives.surface_errors(np.array(list(sized.values())))
        self._errors = dict(zip(sized, errors.tolist(), strict=True))
        if (errors > primitives.MIN_ERROR).any():
            self._shared = {key: primitives.proportions(key, error) for key, error in self._errors.items()}

    def key(self, prim: Usd.Prim) -> tuple[object, ...]:
        """Return a key that is equal for gprims that share a surface.

        Gprims share a surface if they are instances of one gprim or primitives with equal parameters and primvars.
        """
        skinning_key = self.skinning.key(prim)
        if prim.GetTypeName() in primitives.PRIMITIVES and not skinning_key:
            attributes, _ = self.primvars.local_primvars(prim)
            key = primitives.primitive_key(prim, self._time)
            shared_key, _ = self._shared.get(key, (key, 1.0))
            return (*shared_key, *((attribute.name, attribute.values.tobytes()) for attribute in attributes))
        return prototype_path(prim), *skinning_key

    def read(self, prim: Usd.Prim) -> GprimSurface:
        """Return the surface of a gprim of a type in `GPRIMS`; raises AssetError if the gprim contradicts itself."""
        type_name = prim.GetTypeName()
        if type_name in primitives.PRIMITIVES:
            return self._read_primitive(prim)
        deformed = self.skinning.deform(prim)
        points = points_from_velocities(prim, self._time) if deformed is None else deformed.points
        if type_name == "Points":
            shape, copies = point_shape(prim, self._time, self._unit, points=points)
            return GprimSurface(self._add_constant_primvars(shape, prim), (), copies)
        if type_name in _CURVES:
            attributes, default_uv = self.primvars.local_primvars(prim)
            shape = curve_shape(prim, self._time, self._unit, attributes, points)
            return GprimSurface(replace(shape, default_uv=default_uv or "st"))
        shape, subsets = mesh_shape(prim, self._time, self._unit, self.primvars, points)
        if deformed is not None and shape.normals is not None:
            shape = replace(shape, normals=deformed.normals(shape.normals, shape.face_points))
        return GprimSurface(shape, subsets)

    def copies(self, prim: Usd.Prim, surface: GprimSurface) -> Floats | None:
        """Return the placements (k, 4, 4) of a gprim's surface, as in `GprimSurface.copies`, which may be None.

        Unlike `surface.copies`, the placements include the scale of a primitive relative to the surface that it shares.
        """
        scale = self._shared_scale(prim)
        return surface.copies if scale == 1.0 else np.diag([scale, scale, scale, 1.0])[None]

    def _shared_scale(self, prim: Usd.Prim) -> float:
        """Return the scale of a primitive relative to the surface that it shares with others; 1 if it shares none."""
        if prim.GetTypeName() not in primitives.PRIMITIVES or not self._shared or self.skinning.key(prim):
            return 1.0
        return self._shared.get(primitives.primitive_key(prim, self._time), ((), 1.0))[1]

    def _read_primitive(self, prim: Usd.Prim) -> GprimSurface:
        """Return the surface of a primitive; a surface that it shares with others lacks the primitive's scale."""
        error = self._errors.get(primitives.primitive_key(prim, self._time), primitives.MIN_ERROR)
        shape = primitives.primitive_shape(prim, self._time, self._unit / self._shared_scale(prim), error)
        deformed = self.skinning.deform(prim, shape.points / self._unit)
        if deformed is not None and shape.normals is not None:
            normals = deformed.normals(shape.normals, shape.face_points)
            shape = replace(shape, points=deformed.points * self._unit, normals=normals)
        return GprimSurface(self._add_constant_primvars(shape, prim))

    def _add_constant_primvars(self, shape: PolygonShape, prim: Usd.Prim) -> PolygonShape:
        """Return the shape of a Points prim or a primitive, with the prim's constant primvars; others are dropped."""
        attributes = {attribute.name: attribute for attribute in shape.attributes}
        for attribute in self.primvars.local_primvars(prim)[0]:
            if len(attribute.values) == 1:
                attributes[attribute.name] = replace(attribute, interpolation="constant")
            elif attribute.name not in _CURVE_ATTRIBUTES:
                self._note(
                    f"with primvars:{attribute.name} of {len(attribute.values)} values, left out: one is carried", prim
                )
        return replace(shape, attributes=tuple(attributes.values()))
