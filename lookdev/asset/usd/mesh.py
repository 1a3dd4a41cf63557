"""Reads a `UsdGeom.Mesh` as a shape: its faces, its subdivision rules, and its GeomSubsets with material bindings."""

from __future__ import annotations

from typing import get_args

import numpy as np
from pxr import Usd, UsdGeom, UsdShade

from lookdev.arrays import Floats, Floats32, Indices, Ints32
from lookdev.asset.mesh import BoundaryRule, FaceVaryingRule, Scheme, Subdivision, TriangleRule
from lookdev.asset.shape import PolygonShape
from lookdev.asset.usd.attributes import check_range, read_array, read_token
from lookdev.asset.usd.primvars import PrimvarReader
from lookdev.errors import AssetError

_NORMALS = ("normals", "primvars:normals")
_ORIENTATIONS = ("rightHanded", "leftHanded")
_ELEMENTS = ("face", "point", "edge", "tetrahedron", "segment")  # the element types of a GeomSubset
# The attributes of sharp edges and points.
_TAGS = ("creaseIndices", "creaseLengths", "creaseSharpnesses", "cornerIndices", "cornerSharpnesses")


def mesh_shape(
    prim: Usd.Prim, time: Usd.TimeCode, unit: float, primvars: PrimvarReader, points: Floats | None = None
) -> tuple[PolygonShape, tuple[str, ...]]:
    """Return the shape of a mesh at `time`, and the names of its GeomSubsets with material bindings.

    Part n of the shape has the faces of subset n, counted from 1; part 0 has all other faces. `unit` is the length of
    the stage's unit in metres. `points` (n, 3), in the stage's unit, replace the points in the file. Authored normals
    of a subdivision surface have no effect, as USD's schema says. A mesh of subdivisionScheme ``none`` without normals
    is flat.

    Raises
    ------
    AssetError
        An attribute has a wrong type, or contradicts another one.
    """
    authored = set(prim.GetAuthoredPropertyNames())
    if points is None:
        points = read_array(prim, "points", time, np.float64, (3,), bounded=False)
    sizes = read_array(prim, "faceVertexCounts", time, np.intp)
    holes = read_array(prim, "holeIndices", time, np.intp) if "holeIndices" in authored else None
    scheme = read_token(prim, "subdivisionScheme", time, (*get_args(Scheme), "none"))
    is_left_handed = "orientation" in authored and read_token(prim, "orientation", time, _ORIENTATIONS) == "leftHanded"
    attributes, default_uv = primvars.local_primvars(prim)
    subsets, parts = _read_parts(prim, time, len(sizes))
    is_flat = scheme == "none"
    return PolygonShape(
        name=str(prim.GetPath()),
        points=points * unit,
        face_sizes=sizes,
        face_points=read_array(prim, "faceVertexIndices", time, np.intp),
        attributes=attributes,
        normals=primvars.normals(prim) if is_flat and not authored.isdisjoint(_NORMALS) else None,
        flat=is_flat,
        left_handed=is_left_handed,
        holes=holes,
        subdivision=None if is_flat else _read_subdivision(prim, time, scheme, authored, len(points)),
        face_parts=parts,
        default_uv=default_uv,
    ), subsets


def _read_subdivision(
    prim: Usd.Prim, time: Usd.TimeCode, scheme: Scheme, authored: set[str], point_count: int
) -> Subdivision:
    """Return the subdivision rules of a mesh; a rule has its default unless its property is in `authored`."""
    # For each rule: the field of `Subdivision`, the attribute in USD, and the type of the allowed values.
    fields = (
        ("interpolate_boundary", "interpolateBoundary", BoundaryRule),
        ("face_varying", "faceVaryingLinearInterpolation", FaceVaryingRule),
        ("triangle_rule", "triangleSubdivisionRule", TriangleRule),
    )
    rules = {field: read_token(prim, name, time, get_args(rule)) for field, name, rule in fields if name in authored}
    if not authored.isdisjoint(_TAGS):
        rules["crease_edges"], rules["crease_sharpness"] = _read_creases(prim, time, point_count)
        rules["corner_points"], rules["corner_sharpness"] = _read_corners(prim, time, point_count)
    return Subdivision(scheme, **rules)


def _read_creases(prim: Usd.Prim, time: Usd.TimeCode, point_count: int) -> tuple[Ints32, Floats32]:
    """Return the edges (e, 2) of all creases, which are chains of points, and the sharpness (e,) of each edge."""
    indices = read_array(prim, "creaseIndices", time, np.intp)
    lengths = read_array(prim, "creaseLengths", time, np.intp)
    sharpness = _read_sharpness(prim, "creaseSharpnesses", time)
    check_range(indices, point_count, prim, "creaseIndices", "points")
    if (lengths < 2).any():
        i = int(np.argmax(lengths < 2))
        raise AssetError(f"{prim.GetPath()}: creaseLengths[{i}] is {lengths[i]}; a crease has at least 2 points")
    if lengths.sum() != len(indices):
        raise AssetError(
            f"{prim.GetPath()}: creaseLengths add up to {lengths.sum()} points, creaseIndices has {len(indices)}; "
            "they must agree"
        )
    starts_edge = np.ones(len(indices), bool)
    starts_edge[np.cumsum(lengths) - 1] = False  # the last point of a crease starts no edge
    starts = np.flatnonzero(starts_edge)
    edges = np.stack([indices[starts], indices[starts + 1]], axis=-1)
    if len(sharpness) == len(lengths):
        sharpness = np.repeat(sharpness, lengths - 1)
    if len(sharpness) != len(edges):
        raise AssetError(
            f"{prim.GetPath()}: creaseSharpnesses has {len(sharpness)} values; one for each of the {len(lengths)} "
            f"creases or of the {len(edges)} edges would be right"
        )
    return edges.astype(np.int32), sharpness


def _read_corners(prim: Usd.Prim, time: Usd.TimeCode, point_count: int) -> tuple[Ints32, Floats32]:
    """Return the points (c,) that are sharp corners, and the sharpness (c,) of each."""
    indices = read_array(prim, "cornerIndices", time, np.intp)
    sharpness = _read_sharpness(prim, "cornerSharpnesses", time)
    check_range(indices, point_count, prim, "cornerIndices", "points")
    if len(indices) != len(sharpness):
        raise AssetError(
            f"{prim.GetPath()}: cornerSharpnesses has {len(sharpness)} values, cornerIndices {len(indices)}; "
            "they must agree"
        )
    return indices.astype(np.int32), sharpness


def _read_sharpness(prim: Usd.Prim, name: str, time: Usd.TimeCode) -> Floats32:
    """Return the values of sharpness (k,) of an attribute, clamped to 0..10; 10 is infinite."""
    values = read_array(prim, name, time, np.float32, bounded=False)  # inf is the largest sharpness
    if np.isnan(values).any():
        raise AssetError(f"{prim.GetPath()}: {name}[{int(np.argmax(np.isnan(values)))}] is not a number")
    return np.clip(values, 0.0, UsdGeom.Mesh.SHARPNESS_INFINITE)


def _read_parts(prim: Usd.Prim, time: Usd.TimeCode, face_count: int) -> tuple[tuple[str, ...], Indices | None]:
    """Return the names of a mesh's subsets with material bindings, and the part (f,) of each face.

    A face's part is the number of its subset, from 1, or 0 if the face is in no subset. Without such subsets,
    the second result is None.
    """
    subsets = UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets() if prim.GetAllChildrenNames() else []
    if not subsets:
        return (), None
    face_parts = np.zeros(face_count, np.intp)
    names = tuple(subset.GetPrim().GetName() for subset in subsets)
    for number, subset in enumerate(subsets, start=1):
        path = subset.GetPath()
        if (element_type := read_token(subset.GetPrim(), "elementType", time, _ELEMENTS)) != UsdGeom.Tokens.face:
            raise AssetError(f"{path}: elementType is {element_type!r}, but only 'face' can take a material")
        faces = read_array(subset.GetPrim(), "indices", time, np.intp)
        check_range(faces, face_count, subset.GetPrim(), "indices", "faces")
        if (is_taken := face_parts[faces] != 0).any():
            face = int(faces[is_taken.argmax()])
            other = names[face_parts[face] - 1]
            raise AssetError(f"{path}: face {face} is also in {prim.GetPath()}/{other}; a face can be in one only")
        face_parts[faces] = number
    return names, face_parts
