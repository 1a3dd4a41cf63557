"""The meshes, instances and slots of a stage."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from pxr import Usd, UsdGeom

from lookdev.asset.faces import raise_all
from lookdev.asset.finish import finish
from lookdev.asset.mesh import Asset, Instance, Mesh, Slot
from lookdev.asset.shape import LARGEST, Attribute, Shape
from lookdev.asset.store import make_asset
from lookdev.asset.usd.bindings import bound_materials, dangling
from lookdev.asset.usd.gprims import GPRIMS, GprimReader, Surface
from lookdev.asset.usd.primvars import Inherited, default_uv
from lookdev.asset.usd.walk import PURPOSES, Seen, Walk, affine, misplaced_by
from lookdev.errors import AssetError, nearest_hint
from lookdev.stage import Composed, units
from lookdev.stage.units import Z_UP

_SMALLEST, _LARGEST = 1e-6, 1e9  # radii, in metres, of assets that renderers show whole
_MOST_PATHS = 3  # in a note
_MOST_FAULTS = 20  # in an error


@contextmanager
def located(file: str) -> Iterator[None]:
    """Put the file before each line of an AssetError."""
    try:
        yield
    except AssetError as error:
        lines = str(error).splitlines()
        more = [f"{len(lines) - _MOST_FAULTS} more faults"] * (len(lines) > _MOST_FAULTS)
        raise AssetError("\n".join(f"{file}: {line}" for line in (*lines[:_MOST_FAULTS], *more))) from error


@dataclass(frozen=True, eq=False)
class _Shown:
    """A gprim with the number of its shape, its subsets' names and what it inherits."""

    seen: Seen
    shape: int
    subsets: tuple[str, ...]
    inherited: Inherited


class UsdScene:
    """Reads the meshes, instances and slots of a composed stage; raises AssetError without the file's name."""

    def __init__(self, composed: Composed, time: float | None, purposes: tuple[str, ...]) -> None:
        self._name = composed.composition.file.stem
        self._root = composed.composition.prim or "/"
        stage = composed.stage
        self._time = _time_code(stage, time)
        self._unit = UsdGeom.GetStageMetersPerUnit(stage)
        if faults := [f"{what}; it must be {right}" for what, right in units.faults(stage)]:
            raise AssetError("\n".join(faults))
        self._y_up = units.is_y_up(stage)
        for purpose in purposes:
            if purpose not in PURPOSES:
                raise AssetError(f"there is no purpose '{purpose}' ({nearest_hint(purpose, PURPOSES)})")
        self._walk = Walk(stage, self._time, purposes)
        self._gprims = GprimReader(self._time, self._unit, self._note)
        self._shapes: list[Shape] = []
        self._read: dict[tuple[object, ...], tuple[int, Surface] | None] = {}
        self._meshes: list[Mesh] = []
        self._slots: list[Slot] = []
        self._noted: dict[str, list[str]] = {}

    def asset(self) -> Asset:
        """Return the asset; its notes lack the file's name."""
        shown = self._shown()
        bases = finish(self._shapes, self._y_up)
        for each in shown:
            if bases[each.shape] is None:
                self._note("without a face, left out", each.seen.prim)
        shown = [each for each in shown if bases[each.shape] is not None]
        numbers = self._mesh_numbers(shown, bases)
        instances = self._instances([each.seen for each in shown], numbers)
        for prim in self._walk.unknown:
            self._note(f"of the type {prim.GetTypeName()}, which USD does not know, not rendered", prim)
        for name, prims in self._walk.astray.items():
            for prim in prims:
                self._note(f"xformOpOrder names {name}, which is not there", prim)
        notes = [
            *self._gprims.skinning.notes,
            *(
                f"{what} ({len(paths)}): {', '.join(paths[:_MOST_PATHS])}{', ...' * (len(paths) > _MOST_PATHS)}"
                for what, paths in self._noted.items()
            ),
        ]
        if not instances:
            below = f" below {self._root}" if self._root != "/" else ""
            raise AssetError(
                f"has no surface to render{below}; at least one visible surface with a face, of a purpose that is "
                "rendered, is needed" + "".join(f"; {note}" for note in notes)
            )
        asset = make_asset(self._name, self._meshes, instances, self._slots)
        if not _SMALLEST <= asset.radius <= _LARGEST:
            raise AssetError(
                f"{_widest(asset)}: the asset has a radius of {asset.radius:.3g} m, with metersPerUnit "
                f"{self._unit:g}; {_SMALLEST:g} to {_LARGEST:g} m can be rendered"
            )
        return replace(asset, unit=self._unit, notes=tuple(notes))

    def _note(self, what: str, prim: Usd.Prim) -> None:
        self._noted.setdefault(what, []).append(str(prim.GetPath()))

    def _shown(self) -> list[_Shown]:
        """Return what is shown of types that have a reader, each surface read once; all faults are raised together."""
        shown: list[_Shown] = []
        faults: list[str] = []
        found = list(self._walk.below(self._root))
        self._gprims.allot(found)
        for seen in found:
            prim = seen.prim
            if (kind := prim.GetTypeName()) not in GPRIMS:
                self._note(f"of type {kind}, not rendered", prim)
                continue
            try:
                key = self._gprims.key(prim)
                if key not in self._read:
                    self._read[key] = None
                    self._read[key] = self._added(prim)
                if (read := self._read[key]) is not None:
                    number, surface = read
                    copies = self._gprims.copies(prim, surface)
                    if copies is not None and len(copies) == 0:
                        self._note("without a point of a width, left out", prim)
                        continue
                    placed = self._walk.moved(seen, self._gprims.skinning.space(prim), copies)
                    shown.append(_Shown(placed, number, surface.subsets, self._gprims.primvars.inherited(prim)))
            except AssetError as error:
                faults.append(str(error))
        raise_all(faults)
        return shown

    def _added(self, prim: Usd.Prim) -> tuple[int, Surface]:
        """Return a gprim's surface and the number of its shape, which is added."""
        surface = self._gprims.read(prim)
        shape = surface.shape
        if shape.subdivision is not None and shape.subdivision.scheme == "loop" and (shape.face_sizes > 3).any():
            # Loop's scheme is undefined for other faces than triangles.
            self._note("of scheme loop, but with other faces than triangles, refined as catmullClark", prim)
            shape = replace(shape, subdivision=replace(shape.subdivision, scheme="catmullClark"))
        self._shapes.append(shape)
        return len(self._shapes) - 1, surface

    def _mesh_numbers(self, shown: Sequence[_Shown], bases: Sequence[Mesh | None]) -> list[int]:
        """Make a mesh for each surface with its materials and inherited primvars; return the number of each prim's."""
        used: dict[int, tuple[int, ...]] = {}
        parts: list[Usd.Prim] = []
        for each in shown:
            if each.shape not in used:
                mesh = bases[each.shape]
                assert mesh is not None, "what has no face is left out"
                used[each.shape] = tuple(np.unique(mesh.face_slots).tolist()) if each.subsets else (0,)
            prim = each.seen.prim
            parts += [prim.GetChild(each.subsets[part - 1]) if part else prim for part in used[each.shape]]
        materials = bound_materials(parts)
        for name, path, prim in dangling(parts):
            self._note(f"{name} names {path}, which is not a material", prim)
        numbers: dict[tuple[object, ...], int] = {}
        result: list[int] = []
        first = 0
        for each in shown:
            count = len(used[each.shape])
            bound = materials[first : first + count]
            key = (each.shape, each.inherited.key, *(_shared_path(material) for material in bound))
            if key not in numbers:
                numbers[key] = len(self._meshes)
                slots = [
                    Slot(str(prim.GetPath()), str(material.GetPath()) if material else None)
                    for prim, material in zip(parts[first : first + count], bound, strict=True)
                ]
                mesh = bases[each.shape]
                assert mesh is not None, "what has no face is left out"
                self._meshes.append(self._mesh(mesh, each, used[each.shape]))
                self._slots += slots
            result.append(numbers[key])
            first += count
        return result

    def _mesh(self, base: Mesh, shown: _Shown, used: Sequence[int]) -> Mesh:
        """Return a mesh with the numbers of its slots and the primvars that it inherits."""
        if len(used) == 1:
            face_slots = np.full(len(base.face_sizes), len(self._slots), np.int32)
        else:
            numbers = np.zeros(used[-1] + 1, np.int32)
            numbers[list(used)] = len(self._slots) + np.arange(len(used))
            face_slots = numbers[base.face_slots]
        mesh = replace(base, name=str(shown.seen.prim.GetPath()), face_slots=face_slots)
        return _with_constants(mesh, shown.inherited.attributes) if shown.inherited.attributes else mesh

    def _instances(self, seen: Sequence[Seen], numbers: Sequence[int]) -> list[Instance]:
        """Return the instances in metres and with z up, without those that have no volume."""
        if not seen:
            return []
        # USD multiplies row vectors from the left: transposed, and in metres as the points are.
        matrices = np.swapaxes(np.concatenate([each.transforms for each in seen]), 1, 2).copy()
        owners = np.repeat(np.arange(len(seen)), [len(each.transforms) for each in seen])
        if not (right := affine(np.swapaxes(matrices, 1, 2))).all():
            prims = {i: seen[i].prim for i in owners[~right].tolist()}
            places = dict.fromkeys(misplaced_by(prim, self._time) for prim in prims.values())
            what = f"its transform has a number not within +-{LARGEST:g}, or a last column that is not 0 0 0 1"
            raise AssetError("\n".join(f"{place}: {what}" for place in places))
        matrices[:, :3, 3] *= self._unit
        if self._y_up:
            matrices = Z_UP @ matrices @ Z_UP.T
        sizes = np.linalg.norm(matrices[:, :3, :3], axis=(1, 2))
        solid = np.abs(np.linalg.det(matrices[:, :3, :3])) > 1e-12 * sizes**3
        for i in owners[~solid]:
            self._note("without volume, left out", seen[i].prim)
        paths_of = [str(each.prim.GetPath()) for each in seen]
        return [
            Instance(numbers[i], matrix, paths_of[i])
            for i, matrix in zip(owners[solid].tolist(), matrices[solid], strict=True)
        ]


def _widest(asset: Asset) -> str:
    """Return the path of the instance that reaches farthest from the origin."""

    def reach(instance: Instance) -> float:
        points = asset.meshes[instance.mesh].points.astype(np.float64)
        return float(np.abs(points @ instance.matrix[:3, :3].T + instance.matrix[:3, 3]).max())

    return max(asset.instances, key=reach).path


def _time_code(stage: Usd.Stage, time: float | None) -> Usd.TimeCode:
    if time is None:
        authored = stage.HasAuthoredMetadata("startTimeCode")
        return Usd.TimeCode(stage.GetStartTimeCode()) if authored else Usd.TimeCode.EarliestTime()
    if not math.isfinite(time):
        raise AssetError(f"the time is {time}; it must be a number")
    return Usd.TimeCode(time)


def _shared_path(prim: Usd.Prim | None) -> str:
    """Return a path that is the same for all instances of one prototype's prim."""
    if prim is None:
        return ""
    return str((prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim).GetPath())


def _with_constants(mesh: Mesh, attributes: Mapping[str, Attribute]) -> Mesh:
    """Return a mesh with attributes that are constant over it, which share one value in memory."""
    uvs, primvars = dict(mesh.uvs), dict(mesh.primvars)
    for name, each in attributes.items():
        value = each.values.astype(np.float32)
        if len(value) != 1 or not np.isfinite(value).all():
            raise AssetError(
                f"{mesh.name}: inherits primvars:{name} with {len(value)} values; 'constant' needs one, a number"
            )
        values = np.broadcast_to(value[0], (len(mesh.corner_points), *value.shape[1:]))
        (uvs if each.is_uv else primvars)[name] = values
    subdivision = mesh.subdivision
    if subdivision is not None:
        interpolation = {**subdivision.interpolation, **{name: each.interpolation for name, each in attributes.items()}}
        subdivision = replace(subdivision, interpolation=interpolation)
    default = mesh.default_uv if mesh.uvs else default_uv(list(uvs), list(uvs))
    return replace(mesh, uvs=uvs, primvars=primvars, subdivision=subdivision, default_uv=default)
