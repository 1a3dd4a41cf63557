"""Makes an asset of a stage's visible surfaces: its meshes, instances and slots, and notes for the user.

A shape is read once for all gprims that share it. A surface here is a placed gprim with its shape, the GeomSubsets that
divide the shape into parts, and the primvars that the gprim inherits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdShade

from lookdev.asset.faces import raise_faults
from lookdev.asset.finish import make_meshes
from lookdev.asset.mesh import Asset, Instance, Mesh, Slot
from lookdev.asset.shape import MAX_COORDINATE, Attribute, PolygonShape
from lookdev.asset.store import make_asset
from lookdev.asset.usd.gprims import GPRIMS, GprimReader, GprimSurface
from lookdev.asset.usd.primvars import InheritedPrimvars, default_uv
from lookdev.asset.usd.walk import PURPOSES, PlacedGprim, Walk, faulty_transform_path, is_affine, prototype_path
from lookdev.errors import AssetError, nearest_hint
from lookdev.stage import Composed, binding_targets
from lookdev.stage.units import Z_UP, is_y_up, unit_faults

_MIN_RADIUS, _MAX_RADIUS = 1e-6, 1e9  # the radii, in metres, of assets that renderers handle
_MAX_PATHS = 3  # paths that a note names
_MAX_FAULTS = 20  # lines of an error message


@contextmanager
def name_file_in_errors(file: str) -> Iterator[None]:
    """Put the file's name before each line of an AssetError that the block raises."""
    try:
        yield
    except AssetError as error:
        lines = str(error).splitlines()
        more = [f"{len(lines) - _MAX_FAULTS} more faults"] * (len(lines) > _MAX_FAULTS)
        raise AssetError("\n".join(f"{file}: {line}" for line in (*lines[:_MAX_FAULTS], *more))) from error


@dataclass(frozen=True, eq=False)
class _PlacedSurface:
    """A placed gprim with the number of its shape, the names of its GeomSubsets and its inherited primvars."""

    gprim: PlacedGprim
    shape: int
    subsets: tuple[str, ...]
    inherited: InheritedPrimvars


class UsdScene:
    """Reads the meshes, instances and slots of a composed stage at a given time.

    `time` is as in `read_usd`; only gprims of the given purposes are read. The messages of its AssetErrors lack the
    file's name, which `name_file_in_errors` adds.
    """

    def __init__(self, composed: Composed, time: float | None, purposes: tuple[str, ...]) -> None:
        self._name = composed.composition.file.stem
        self._root = composed.composition.prim or "/"
        stage = composed.stage
        self._time = _time_code(stage, time)
        self._unit = UsdGeom.GetStageMetersPerUnit(stage)
        if faults := [f"{problem}; it must be {rule}" for problem, rule in unit_faults(stage)]:
            raise AssetError("\n".join(faults))
        self._y_up = is_y_up(stage)
        for purpose in purposes:
            if purpose not in PURPOSES:
                raise AssetError(f"there is no purpose '{purpose}' ({nearest_hint(purpose, PURPOSES)})")
        self._paths_of_notes: dict[str, list[str]] = {}
        self._walk = Walk(stage, self._time, purposes, self._note)
        self._gprims = GprimReader(self._time, self._unit, self._note)
        self._shapes: list[PolygonShape] = []
        # By `GprimReader.key`: the number of the shape in `_shapes`, and the surface; None for a surface with a fault.
        self._surfaces: dict[tuple[object, ...], tuple[int, GprimSurface] | None] = {}
        self._meshes: list[Mesh] = []
        self._slots: list[Slot] = []

    def read_asset(self) -> Asset:
        """Return the asset, with notes that lack the file's name."""
        surfaces = self._read_surfaces()
        meshes = make_meshes(self._shapes, self._y_up)
        mesh_of_shape = {shape: mesh for shape, mesh in enumerate(meshes) if mesh is not None}
        for surface in surfaces:
            if surface.shape not in mesh_of_shape:
                self._note("without a face, left out", surface.gprim.prim)
        surfaces = [surface for surface in surfaces if surface.shape in mesh_of_shape]
        numbers = self._make_meshes(surfaces, mesh_of_shape)
        instances = self._make_instances([surface.gprim for surface in surfaces], numbers)
        notes = [
            *self._gprims.skinning.notes,
            *(
                f"{note} ({len(paths)}): {', '.join(paths[:_MAX_PATHS])}{', ...' * (len(paths) > _MAX_PATHS)}"
                for note, paths in self._paths_of_notes.items()
            ),
        ]
        if not instances:
            below = f" below {self._root}" if self._root != "/" else ""
            raise AssetError(
                f"has no surface to render{below}; at least one visible surface with a face, of a purpose that is "
                "rendered, is needed" + "".join(f"; {note}" for note in notes)
            )
        asset = make_asset(self._name, self._meshes, instances, self._slots)
        if not _MIN_RADIUS <= asset.radius <= _MAX_RADIUS:
            raise AssetError(
                f"{_farthest_path(asset)}: the asset has a radius of {asset.radius:.3g} m, with metersPerUnit "
                f"{self._unit:g}; {_MIN_RADIUS:g} to {_MAX_RADIUS:g} m can be rendered"
            )
        return replace(asset, unit=self._unit, notes=tuple(notes))

    def _note(self, message: str, prim: Usd.Prim) -> None:
        """Add a prim to the note with the given message; a note lists all prims with the same message."""
        self._paths_of_notes.setdefault(message, []).append(str(prim.GetPath()))

    def _read_surfaces(self) -> list[_PlacedSurface]:
        """Return the visible surfaces of supported types, and read each shape once; raise all faults together."""
        surfaces: list[_PlacedSurface] = []
        faults: list[str] = []
        gprims = list(self._walk.gprims_below(self._root))
        self._gprims.set_errors(gprims)
        for gprim in gprims:
            prim = gprim.prim
            if (type_name := prim.GetTypeName()) not in GPRIMS:
                self._note(f"of type {type_name}, not rendered", prim)
                continue
            try:
                key = self._gprims.key(prim)
                if key not in self._surfaces:
                    self._surfaces[key] = None  # stays None if `_add_shape` raises an error
                    self._surfaces[key] = self._add_shape(prim)
                if (shape_and_surface := self._surfaces[key]) is not None:
                    number, surface = shape_and_surface
                    copies = self._gprims.copies(prim, surface)
                    # A Points prim has a copy of the surface for each point of positive width.
                    if copies is not None and len(copies) == 0:
                        self._note("without a point of a width, left out", prim)
                        continue
                    placed_gprim = self._walk.place_in_space(gprim, self._gprims.skinning.placing_prim(prim), copies)
                    inherited = self._gprims.primvars.inherited_primvars(prim)
                    surfaces.append(_PlacedSurface(placed_gprim, number, surface.subsets, inherited))
            except AssetError as error:
                faults.append(str(error))
        raise_faults(faults)
        return surfaces

    def _add_shape(self, prim: Usd.Prim) -> tuple[int, GprimSurface]:
        """Read the surface of a gprim and append its shape to `_shapes`; return the shape's number and the surface."""
        surface = self._gprims.read(prim)
        shape = surface.shape
        if shape.subdivision is not None and shape.subdivision.scheme == "loop" and (shape.face_sizes > 3).any():
            # The Loop scheme is defined for triangles only.
            self._note("of scheme loop, but with other faces than triangles, refined as catmullClark", prim)
            shape = replace(shape, subdivision=replace(shape.subdivision, scheme="catmullClark"))
        self._shapes.append(shape)
        return len(self._shapes) - 1, surface

    def _make_meshes(self, surfaces: Sequence[_PlacedSurface], mesh_of_shape: Mapping[int, Mesh]) -> list[int]:
        """Append a mesh for each combination of shape, materials and inherited primvars; return mesh numbers.

        The number of each surface is the index of its mesh in `_meshes`. The slots of a new mesh are appended to
        `_slots`. `mesh_of_shape` has the mesh of each shape, by number.
        """
        # `used_parts` has the parts of each shape that have faces. `parts` lists, for all surfaces, the prims of these
        # parts: a GeomSubset, or the gprim itself for part 0. `materials` has the bound material of each.
        used_parts: dict[int, tuple[int, ...]] = {}
        parts: list[Usd.Prim] = []
        for surface in surfaces:
            if surface.shape not in used_parts:
                # The `face_slots` of these meshes are the parts of the shape; `_assign_slots` replaces them.
                slots = mesh_of_shape[surface.shape].face_slots
                used_parts[surface.shape] = tuple(np.unique(slots).tolist()) if surface.subsets else (0,)
            prim = surface.gprim.prim
            parts += [prim.GetChild(surface.subsets[part - 1]) if part else prim for part in used_parts[surface.shape]]
        materials = _bound_materials(parts)
        for name, path, prim in _dangling_bindings(parts):
            self._note(f"{name} names {path}, which is not a material", prim)
        # The number of the mesh for each combination.
        numbers: dict[tuple[object, ...], int] = {}
        result: list[int] = []
        first = 0
        for surface in surfaces:
            count = len(used_parts[surface.shape])
            surface_materials = materials[first : first + count]
            key = (surface.shape, surface.inherited.key, *(prototype_path(material) for material in surface_materials))
            if key not in numbers:
                numbers[key] = len(self._meshes)
                mesh = mesh_of_shape[surface.shape]
                self._meshes.append(self._assign_slots(mesh, surface, used_parts[surface.shape]))
                self._slots += [
                    Slot(str(prim.GetPath()), str(material.GetPath()) if material else None)
                    for prim, material in zip(parts[first : first + count], surface_materials, strict=True)
                ]
            result.append(numbers[key])
            first += count
        return result

    def _assign_slots(self, base: Mesh, surface: _PlacedSurface, used_parts: Sequence[int]) -> Mesh:
        """Return the mesh `base` with new slots, one for each used part, and with the surface's inherited primvars.

        The numbers of the new slots begin at the number of slots so far. The caller appends the slots to `_slots`.
        """
        if len(used_parts) == 1:
            face_slots = np.full(len(base.face_sizes), len(self._slots), np.int32)
        else:
            # The slot of each part.
            numbers = np.zeros(used_parts[-1] + 1, np.int32)
            numbers[list(used_parts)] = len(self._slots) + np.arange(len(used_parts))
            face_slots = numbers[base.face_slots]
        mesh = replace(base, name=str(surface.gprim.prim.GetPath()), face_slots=face_slots)
        return _add_constant_attributes(mesh, surface.inherited.attributes) if surface.inherited.attributes else mesh

    def _make_instances(self, gprims: Sequence[PlacedGprim], numbers: Sequence[int]) -> list[Instance]:
        """Return the instances of gprims, in metres and with z up, without those that have no volume.

        `numbers` has the mesh number of each gprim.
        """
        if not gprims:
            return []
        # USD's matrices are for row vectors, and so are transposed here. Their translations become metres below.
        # `owners` has the index of the gprim that each matrix places.
        matrices = np.swapaxes(np.concatenate([gprim.transforms for gprim in gprims]), 1, 2).copy()
        owners = np.repeat(np.arange(len(gprims)), [len(gprim.transforms) for gprim in gprims])
        if not (is_valid := is_affine(np.swapaxes(matrices, 1, 2))).all():
            prims = {i: gprims[i].prim for i in owners[~is_valid].tolist()}
            paths = dict.fromkeys(faulty_transform_path(prim, self._time) for prim in prims.values())
            problem = f"its transform has a number beyond +-{MAX_COORDINATE:g}, or a last column that is not 0 0 0 1"
            raise AssetError("\n".join(f"{path}: {problem}" for path in paths))
        matrices[:, :3, 3] *= self._unit
        if self._y_up:
            matrices = Z_UP @ matrices @ Z_UP.T
        sizes = np.linalg.norm(matrices[:, :3, :3], axis=(1, 2))
        has_volume = np.abs(np.linalg.det(matrices[:, :3, :3])) > 1e-12 * sizes**3
        for i in owners[~has_volume]:
            self._note("without volume, left out", gprims[i].prim)
        paths_of = [str(gprim.prim.GetPath()) for gprim in gprims]
        return [
            Instance(numbers[i], matrix, paths_of[i])
            for i, matrix in zip(owners[has_volume].tolist(), matrices[has_volume], strict=True)
        ]


def _farthest_path(asset: Asset) -> str:
    """Return the path of the instance that has the coordinate of largest magnitude in world space."""

    def farthest_coordinate(instance: Instance) -> float:
        """Return the largest magnitude of an instance's coordinates in world space."""
        points = asset.meshes[instance.mesh].points.astype(np.float64)
        return float(np.abs(points @ instance.matrix[:3, :3].T + instance.matrix[:3, 3]).max())

    return max(asset.instances, key=farthest_coordinate).path


def _time_code(stage: Usd.Stage, time: float | None) -> Usd.TimeCode:
    """Return the time at which a stage is read: `time`, else its startTimeCode, else USD's earliest time."""
    if time is None:
        has_start = stage.HasAuthoredMetadata("startTimeCode")
        return Usd.TimeCode(stage.GetStartTimeCode()) if has_start else Usd.TimeCode.EarliestTime()
    if not math.isfinite(time):
        raise AssetError(f"the time is {time}; it must be a number")
    return Usd.TimeCode(time)


def _bound_materials(prims: Sequence[Usd.Prim]) -> list[Usd.Prim | None]:
    """Return the material bound to each prim for the purpose `full`, or else for all purposes, or None."""
    if not prims:
        return []
    materials, _ = UsdShade.MaterialBindingAPI.ComputeBoundMaterials(list(prims), UsdShade.Tokens.full)
    return [material.GetPrim() if material else None for material in materials]


def _dangling_bindings(prims: Sequence[Usd.Prim]) -> Iterator[tuple[str, Sdf.Path, Usd.Prim]]:
    """Yield the bindings of prims and their ancestors to targets that are not materials, as (name, target, prim).

    `name` is the name of the binding's relationship, and `prim` the prim that has it.
    """
    visited: set[Sdf.Path] = set()
    for prim in prims:
        while prim and prim.GetPath() not in visited:
            visited.add(prim.GetPath())
            for name, path in binding_targets(prim).items():
                if not UsdShade.Material(prim.GetStage().GetPrimAtPath(path)):
                    yield name, path, prim
            prim = prim.GetParent()


def _add_constant_attributes(mesh: Mesh, attributes: Mapping[str, Attribute]) -> Mesh:
    """Return a mesh with further attributes, by name, that are constant over the mesh.

    Each attribute becomes an array over all corners, with a single value in memory.
    """
    uvs, primvars = dict(mesh.uvs), dict(mesh.primvars)
    for name, attribute in attributes.items():
        value = attribute.values.astype(np.float32)
        if len(value) != 1 or not np.isfinite(value).all():
            raise AssetError(
                f"{mesh.name}: inherits primvars:{name} with {len(value)} values; 'constant' needs one, a number"
            )
        values = np.broadcast_to(value[0], (len(mesh.corner_points), *value.shape[1:]))
        (uvs if attribute.is_uv else primvars)[name] = values
    subdivision = mesh.subdivision
    if subdivision is not None:
        added = {name: attribute.interpolation for name, attribute in attributes.items()}
        subdivision = replace(subdivision, interpolation={**subdivision.interpolation, **added})
    default = mesh.default_uv if mesh.uvs else default_uv(list(uvs), list(uvs))
    return replace(mesh, uvs=uvs, primvars=primvars, subdivision=subdivision, default_uv=default)
