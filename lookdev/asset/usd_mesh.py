"""One `UsdGeom.Mesh` as arrays: faces, normals, UVs, primvars and material slots."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from lookdev.asset.mesh import Floats, Ints, Mesh, Slot
from lookdev.asset.normals import area_vectors, flat_normals, smooth_normals, unit_or
from lookdev.asset.tangents import corner_tangents
from lookdev.errors import AssetError

TIME = Usd.TimeCode.EarliestTime()
Index = NDArray[np.intp]

# The numbers in one value of a primvar, by its type in USD's C++.
_WIDTHS = {"float": 1, "double": 1, "GfHalf": 1} | {f"GfVec{width}{kind}": width for width in (2, 3) for kind in "fdh"}


@dataclass(frozen=True, eq=False)
class _Topology:
    """The faces that are kept, and the numbers of points, faces and corners in the file.

    corner_source (m,), corner_points (m,), corner_faces (m,): index of each kept corner among the file's corners, of
    its point and of its face; face_source (f,): index of each kept face among the file's faces; face_sizes (f,).
    """

    point_count: int
    face_count: int
    corner_count: int
    corner_source: Index
    corner_points: Ints
    corner_faces: Index
    face_source: Index
    face_sizes: Ints


@dataclass(frozen=True)
class MeshReader:
    """Reads meshes of one stage: `unit` metres per unit of length, `up` 1 or 2 for the y or z axis."""

    file: Path
    unit: float
    up: int

    def read(
        self, mesh: Any, subsets: list[Any], materials: list[str | None], first_slot: int
    ) -> tuple[Mesh, list[Slot]] | None:
        """Return a mesh and its slots, numbered from `first_slot`, or None where no face is left.

        `materials` are the paths of the materials bound to the mesh itself and to each subset. Subdivision surfaces are
        read as their control polygons. Without normals in the file, a mesh whose subdivisionScheme is ``none`` has
        those of its facets, any other area-weighted smooth ones. Normals that mostly point against the faces' winding
        are flipped: in USD the winding decides. A mesh without texture coordinates has a spherical ``st`` around the
        middle of its bounds, so that tangents exist.

        Raises
        ------
        AssetError
            Counts, indices and sizes do not agree.
        """
        where = f"{self.file}: {mesh.GetPath()}"
        points = np.asarray(mesh.GetPointsAttr().Get(TIME) or [], np.float64).reshape(-1, 3) * self.unit
        if not np.isfinite(points).all():
            raise AssetError(f"{where}: points[{int(np.argmin(np.isfinite(points).all(axis=1)))}] is not finite")
        topology = _topology(mesh, len(points), where)
        if len(topology.face_sizes) == 0:
            return None
        normals = _normals(mesh, points, topology, where)
        uvs, primvars = _primvars(mesh, topology, where)
        if not uvs:
            uvs = {"st": _spherical(points, topology, self.up)}
        single = points.astype(np.float32)
        corners, sizes = topology.corner_points, topology.face_sizes
        face_slots, slots = _slots(mesh, subsets, materials, topology, where)
        return Mesh(
            name=str(mesh.GetPath()),
            points=single,
            corner_points=corners,
            face_sizes=sizes,
            face_slots=face_slots + np.int32(first_slot),
            normals=normals,
            tangents=corner_tangents(single, corners, sizes, normals, next(iter(uvs.values()))),
            uvs=uvs,
            primvars=primvars,
        ), slots


def _topology(mesh: Any, point_count: int, where: str) -> _Topology:
    sizes = np.asarray(mesh.GetFaceVertexCountsAttr().Get(TIME) or [], np.intp)
    indices = np.asarray(mesh.GetFaceVertexIndicesAttr().Get(TIME) or [], np.intp)
    holes = np.asarray(mesh.GetHoleIndicesAttr().Get(TIME) or [], np.intp)
    if sizes.sum() != len(indices) or (sizes < 0).any():
        raise AssetError(
            f"{where}: faceVertexCounts add up to {sizes.sum()} corners, faceVertexIndices has {len(indices)}; "
            "they must agree"
        )
    _check_range(indices, point_count, f"{where}: faceVertexIndices", "points")
    _check_range(holes, len(sizes), f"{where}: holeIndices", "faces")

    faces = np.repeat(np.arange(len(sizes)), sizes)
    keep = sizes >= 3
    keep[holes] = False
    # A face with one point twice has two equal neighbours among its sorted numbers.
    keyed = np.sort(faces * max(point_count, 1) + indices)
    keep[keyed[1:][np.diff(keyed) == 0] // max(point_count, 1)] = False

    source = np.arange(len(indices))
    if mesh.GetOrientationAttr().Get(TIME) == UsdGeom.Tokens.leftHanded:
        starts = np.cumsum(sizes) - sizes
        source = np.repeat(2 * starts + sizes - 1, sizes) - source  # each face's corners backwards
    source = source[keep[faces]]
    return _Topology(
        point_count=point_count,
        face_count=len(sizes),
        corner_count=len(indices),
        corner_source=source,
        corner_points=indices[source].astype(np.int32),
        corner_faces=faces[source],
        face_source=np.flatnonzero(keep),
        face_sizes=sizes[keep].astype(np.int32),
    )


def _check_range(indices: Index, count: int, what: str, of: str) -> None:
    wrong = (indices < 0) | (indices >= count)
    if wrong.any():
        i = int(np.argmax(wrong))
        raise AssetError(f"{what}[{i}] is {indices[i]}, but there are {count} {of}; it must lie in 0..{count - 1}")


def _to_corners(values: NDArray[Any], interpolation: str, topology: _Topology, what: str) -> Floats:
    """Return one value for each corner that is kept; a wrong number of values, or one not finite, raises AssetError."""
    by_point = topology.point_count, topology.corner_points.astype(np.intp)
    rules: dict[str, tuple[int, Index]] = {
        UsdGeom.Tokens.constant: (1, np.zeros_like(topology.corner_source)),
        UsdGeom.Tokens.uniform: (topology.face_count, topology.corner_faces),
        UsdGeom.Tokens.vertex: by_point,
        UsdGeom.Tokens.varying: by_point,
        UsdGeom.Tokens.faceVarying: (topology.corner_count, topology.corner_source),
    }
    count, index = rules[interpolation]
    if len(values) != count:
        raise AssetError(f"{what} has {len(values)} values; interpolation '{interpolation}' needs {count}")
    corners = values[index].astype(np.float32)
    if not np.isfinite(corners).all():
        raise AssetError(f"{what} holds a value that is not finite; every value must be a number")
    return corners


def _primvar_values(primvar: Any, what: str) -> NDArray[Any]:
    """Return a primvar's values (k,) or (k, width) with its indices applied; none where it is empty."""
    value = primvar.Get(TIME)
    values = np.asarray(value if primvar.GetTypeName().isArray else [value])
    if primvar.IsIndexed():
        indices = np.asarray(primvar.GetIndices(TIME) or [], np.intp)
        _check_range(indices, len(values), f"{what}:indices", "values")
        values = values[indices]
    return values


def _primvars(mesh: Any, topology: _Topology, where: str) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Return UV sets, ``st`` first, and the primvars of one or three real numbers; others are left out."""
    uvs: dict[str, Floats] = {}
    primvars: dict[str, Floats] = {}
    for primvar in UsdGeom.PrimvarsAPI(mesh).FindPrimvarsWithInheritance():
        name, kind = primvar.GetPrimvarName(), primvar.GetTypeName()
        width = _WIDTHS.get(kind.scalarType.cppTypeName)
        if width is None or primvar.GetElementSize() != 1 or name == UsdGeom.Tokens.normals:
            continue
        what = f"{where}: primvars:{name}"
        if not primvar.HasValue() or len(values := _primvar_values(primvar, what)) == 0:
            continue
        corners = _to_corners(values, primvar.GetInterpolation(), topology, what)
        if width == 2 or kind.role == Sdf.ValueRoleNames.TextureCoordinate:
            uvs[name] = corners[:, :2]
        else:
            primvars[name] = corners
    return dict(sorted(uvs.items(), key=lambda item: item[0] != "st")), primvars


def _normals(mesh: Any, points: NDArray[np.float64], topology: _Topology, where: str) -> Floats:
    """Return unit normals (m, 3): ``primvars:normals``, else ``normals``, else made from the points."""
    areas = area_vectors(points[topology.corner_points], topology.face_sizes)
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar(UsdGeom.Tokens.normals)
    if primvar and primvar.HasValue():
        what, interpolation = f"{where}: primvars:normals", primvar.GetInterpolation()
        values = _primvar_values(primvar, what)
    else:
        what, interpolation = f"{where}: normals", mesh.GetNormalsInterpolation()
        values = np.asarray(mesh.GetNormalsAttr().Get(TIME) or [])
    flat = flat_normals(areas, topology.face_sizes)
    if len(values):
        authored = _to_corners(values, interpolation, topology, what).astype(np.float64)
        agreement = (authored * np.repeat(areas, topology.face_sizes, axis=0)).sum()
        normals = unit_or(-authored if agreement < 0.0 else authored, flat)
    elif mesh.GetSubdivisionSchemeAttr().Get(TIME) == UsdGeom.Tokens.none:
        normals = flat
    else:
        normals = smooth_normals(areas, topology.corner_points, topology.face_sizes, len(points))
    return normals.astype(np.float32)


def _spherical(points: NDArray[np.float64], topology: _Topology, up: int) -> Floats:
    """Return st (m, 2): longitude about the up axis and latitude; no face straddles the seam."""
    used = points[topology.corner_points]
    x, y, z = np.roll(used - 0.5 * (used.min(axis=0) + used.max(axis=0)), 2 - up, axis=1).T
    u = np.arctan2(y, x) / (2.0 * np.pi) + 0.5
    starts = np.cumsum(topology.face_sizes) - topology.face_sizes
    u += np.round(np.repeat(u[starts], topology.face_sizes) - u)
    v = np.arctan2(z, np.hypot(x, y)) / np.pi + 0.5
    return np.asarray(np.stack([u, v], axis=-1), np.float32)


def _slots(
    mesh: Any, subsets: list[Any], materials: list[str | None], topology: _Topology, where: str
) -> tuple[Ints, list[Slot]]:
    """Return the slot of each face (f,) and the slots: the subsets, and the mesh for the faces in none."""
    slots = [Slot(str(prim.GetPath()), bound) for prim, bound in zip((mesh, *subsets), materials, strict=True)]
    owner = np.zeros(topology.face_count, np.intp)
    for number, subset in enumerate(subsets, start=1):
        what = f"{where}: GeomSubset {subset.GetPrim().GetName()}"
        if (kind := subset.GetElementTypeAttr().Get(TIME)) != UsdGeom.Tokens.face:
            raise AssetError(f"{what} binds a material to elements of type '{kind}'; only 'face' can take one")
        faces = np.asarray(subset.GetIndicesAttr().Get(TIME) or [], np.intp)
        _check_range(faces, topology.face_count, f"{what}: indices", "faces")
        if (taken := owner[faces] != 0).any():
            face = int(faces[taken.argmax()])
            raise AssetError(f"{what}: face {face} is also in {slots[owner[face]].path}; a face can be in one only")
        owner[faces] = number
    used, compact = np.unique(owner[topology.face_source], return_inverse=True)
    return compact.astype(np.int32), [slots[number] for number in used]
