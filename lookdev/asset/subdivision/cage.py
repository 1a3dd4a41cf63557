"""A control cage with its tags: creases, corners, holes, and what happens at its boundary."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lookdev.asset.mesh import Interpolation, Mesh, Subdivision
from lookdev.asset.subdivision.topology import Doubles, Flags, Index, Level, connect
from lookdev.errors import AssetError

INFINITE = 10.0
"""The least sharpness that never decays, as in OpenSubdiv and USD."""


@dataclass(frozen=True, eq=False)
class Cage:
    """The half-edges of a cage, which of its points (n,) are manifold, and which faces (f,) are not shown."""

    level: Level
    manifold: Flags
    hidden: Flags


@dataclass(frozen=True, eq=False)
class Tags:
    """Creases (e, 2) and (e,), corners (c,) and (c,), holes (h,), as in `Subdivision`."""

    crease_edges: Index
    crease_sharpness: Doubles
    corner_points: Index
    corner_sharpness: Doubles
    holes: Index


@dataclass(frozen=True, eq=False)
class Control:
    """A cage: points (n, 3), corners (m,) index into them, sizes (f,), tags, and values (m, k) at corners."""

    points: Doubles
    corners: Index
    sizes: Index
    tags: Tags
    values: list[tuple[Interpolation, Doubles]]


def tags(mesh: Mesh) -> Tags:
    """Return the tags of a cage.

    Raises
    ------
    AssetError
        A tag names a point or face that does not exist, or has no sharpness; `loop` has a face that is no triangle;
        there is no face.
    """
    rules = mesh.subdivision
    assert rules is not None, "a mesh without subdivision has no tags"
    if len(mesh.face_sizes) == 0:
        raise AssetError(f"{mesh.name}: the cage of a subdivision surface has no face; it needs one")
    edges = np.asarray(rules.crease_edges, np.intp).reshape(-1, 2)
    corners, holes = np.asarray(rules.corner_points, np.intp), np.asarray(rules.holes, np.intp)
    if rules.scheme == "loop" and len(wrong := np.flatnonzero(mesh.face_sizes != 3)):
        raise AssetError(
            f"{mesh.name}: face {wrong[0]} has {mesh.face_sizes[wrong[0]]} corners; subdivision scheme 'loop' "
            "refines triangles only (catmullClark takes any face)"
        )
    for what, indices, count, of in (
        ("a crease", edges, len(mesh.points), "points"),
        ("a corner", corners, len(mesh.points), "points"),
        ("a hole", holes, len(mesh.face_sizes), "faces"),
    ):
        outside = indices[(indices < 0) | (indices >= count)]
        if len(outside):
            raise AssetError(f"{mesh.name}: {what} has index {outside[0]}, but there are {count} {of}")
    return Tags(
        edges,
        _sharpness(mesh, "crease", rules.crease_sharpness, len(edges)),
        corners,
        _sharpness(mesh, "corner", rules.corner_sharpness, len(corners)),
        holes,
    )


def _sharpness(mesh: Mesh, what: str, values: object, count: int) -> Doubles:
    sharpness = np.asarray(values, np.float64)
    if sharpness.shape != (count,):
        raise AssetError(f"{mesh.name}: {count} {what}s have {sharpness.size} values of sharpness; each needs one")
    if np.isnan(sharpness).any():
        raise AssetError(f"{mesh.name}: the sharpness of {what} {int(np.isnan(sharpness).argmax())} is not a number")
    return np.where(sharpness >= INFINITE, np.inf, np.maximum(sharpness, 0.0))


def build_cage(control: Control, rules: Subdivision) -> Cage:
    """Return the half-edges of a cage with its tags, by the boundary rule of `rules`, whose own tags are not used.

    Tags are applied in the order of OpenSubdiv (Far::TopologyRefinerFactory): a crease between points that share no
    edge has no effect; boundaries, edges and points that are not manifold become infinitely sharp; a point that is
    not manifold stays smooth along two edges of three or more faces. With the boundary rule `none`, faces at a boundary
    edge's ends are not shown, unless the boundary edges there are infinitely sharp creases.
    """
    count, tagged, boundary = len(control.points), control.tags, rules.interpolate_boundary
    level, joints = connect(control.corners, control.sizes, count)
    manifold = joints.manifold(level.ends)
    tagged_edges = np.zeros(len(level.ends))
    edge = _find(level, tagged.crease_edges)
    tagged_edges[edge[edge >= 0]] = tagged.crease_sharpness[edge >= 0]
    np.maximum(level.edge_sharpness, tagged_edges, out=level.edge_sharpness)
    level.point_sharpness[tagged.corner_points] = tagged.corner_sharpness

    faces = np.bincount(control.corners, minlength=count)
    edges = np.bincount(level.ends.ravel(), minlength=count)
    twisted = np.bincount(level.ends[joints.twisted].ravel(), minlength=count)
    open_edges = np.bincount(level.ends[level.boundary].ravel(), minlength=count)
    fin = (twisted == 2) & (open_edges == 0) & (faces > edges)
    level.point_sharpness[~manifold & ~fin] = np.inf
    if boundary == "edgeAndCorner":
        level.point_sharpness[(faces == 1) & (edges == 2)] = np.inf

    hidden = np.zeros(len(control.sizes), bool)
    if boundary == "none" and rules.scheme != "bilinear":
        loose = np.zeros(count, bool)
        loose[level.ends[level.boundary & np.isfinite(tagged_edges)]] = True
        hidden[level.faces[loose[control.corners]]] = True
    hidden[tagged.holes] = True
    return Cage(level, manifold, hidden)


def _find(level: Level, pairs: Index) -> Index:
    """Return the edge (k,) between each pair (k, 2) of points, -1 where there is none."""
    count = len(level.point_sharpness)
    keys = np.sort(level.ends, axis=1) @ np.array([count, 1])
    wanted = np.sort(pairs, axis=1) @ np.array([count, 1])
    order = np.argsort(keys)
    place = np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)
    return np.where(keys[order[place]] == wanted, order[place], -1)
