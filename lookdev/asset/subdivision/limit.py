"""Computes the limit surface: the limit position of each point, and the surface's normal at each face corner.

A smooth point has one normal. At a point on a crease, or at a sharp corner point, each sector has a normal of its own.
A sector is the faces around the point between two sharp edges. At a corner point, a sector of one face has a tangent
plane; a wider sector is a cone or a cusp. A sector without a tangent plane gets the mean normal of its refined faces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Bools, Floats, Floats32, Indices
from lookdev.asset.normals import area_vectors, dot, flat_normals, normalize_or, sum_by
from lookdev.asset.subdivision.masks import Masks, SectorKind, limit_masks
from lookdev.asset.subdivision.rules import Rules, interpolate
from lookdev.asset.subdivision.topology import HalfEdges, first_child, split_faces

# Two tangents span a plane if their cross product, over the squared length of the ring's longest edge, exceeds this.
# Angles in a float32 asset are far larger; rounding errors of float64 are far smaller.
_PLANE_TOLERANCE = 1e-9

# Sectors in a block: arrays over them stay in the processor's cache.
_BLOCK_SECTORS = 1 << 14

_FINITE = float(np.finfo(np.float64).max)


@dataclass(frozen=True, eq=False)
class Sectors:
    """The s sectors at selected points: the faces around a point, between the sharp edges that meet there.

    - first (s,): the half-edge that begins at the point, in the sector's most clockwise face
    - size (s,): the number of faces
    - kind (s,): the `SectorKind` of the masks
    - sector_of_corner (m,): the number of each corner's sector, or -1 at points that are not selected
    """

    first: Indices
    size: Indices
    kind: Indices
    sector_of_corner: Indices


def find_sectors(level: HalfEdges, selected: Bools) -> Sectors:
    """Return the sectors at the points that are marked in `selected` (n,); semi-sharp features count as smooth."""
    edges = level.sharp_edges(_FINITE)
    is_corner_point = np.isinf(level.point_sharpness) | (edges > 2)
    conditions = [is_corner_point, edges == 2, edges == 1]
    point_kinds = np.select(conditions, [SectorKind.CORNER, SectorKind.CREASE, SectorKind.DART], SectorKind.SMOOTH)
    sharp = np.isinf(level.edge_sharpness[level.edges])
    is_divided = (point_kinds >= SectorKind.CREASE)[level.points]
    # For each half-edge, the next half-edge that begins at the same point, counter-clockwise; -1 at a sector's end.
    ahead = np.where(sharp[level.previous] & is_divided, -1, level.twins[level.previous])

    sector_of_corner = np.full(len(level.points), -1)
    start_parts, size_parts, closed_parts = [], [], []
    # The first round of the loop finds the sectors that begin at a sharp edge or a boundary. The other sectors are
    # closed fans, which can begin at any of their corners. Each further round finds one fan for each point.
    starts, count = np.flatnonzero((sharp | (level.twins < 0)) & selected[level.points]), 0
    while True:
        sizes, is_closed = _number_corners(starts, ahead, sector_of_corner, count)
        start_parts.append(starts)
        size_parts.append(sizes)
        closed_parts.append(is_closed)
        count += len(starts)
        remaining = np.flatnonzero((sector_of_corner < 0) & selected[level.points])
        if len(remaining) == 0:
            break
        start_at_point = np.full(len(selected), -1)
        start_at_point[level.points[remaining]] = remaining
        starts = start_at_point[start_at_point >= 0]
    firsts, sizes, is_closed = np.concatenate(start_parts), np.concatenate(size_parts), np.concatenate(closed_parts)
    kind = point_kinds[level.points[firsts]]
    # The sector of a smooth point or dart must be closed, and any other sector open; else it has no tangent plane.
    kind[is_closed != (kind < SectorKind.CREASE)] = SectorKind.NONE
    kind[(kind == SectorKind.CORNER) & (sizes > 1)] = SectorKind.NONE
    return Sectors(firsts, sizes, kind, sector_of_corner)


def _number_corners(starts: Indices, ahead: Indices, sector_of_corner: Indices, first: int) -> tuple[Indices, Bools]:
    """Write the number of each corner's sector to `sector_of_corner` (m,); return the sizes and which are closed.

    Each of the half-edges `starts` (s,) begins a sector. `ahead` (m,) is the half-edge that follows each half-edge in
    its sector, or -1 at the sector's end. The sectors are numbered from `first`. A sector is closed if it returns to
    its start.
    """
    size, is_closed = np.zeros(len(starts), np.intp), np.zeros(len(starts), bool)
    active, half_edges = np.arange(len(starts)), starts
    while len(active):
        sector_of_corner[half_edges] = first + active
        size[active] += 1
        half_edges = ahead[half_edges]
        is_closed[active] = half_edges == starts[active]
        continues = (half_edges >= 0) & ~is_closed[active]
        active, half_edges = active[continues], half_edges[continues]
    return size, is_closed


def limit_surface(
    level: HalfEdges, values: Floats, rules: Rules, selected: Bools | None = None, needs_normals: bool = True
) -> tuple[Floats, Floats32]:
    """Return the limit (n, k) of values (n, k) at the selected points, and unit normals (m, 3) at their corners.

    `selected` (n,) marks points; None selects all. With `needs_normals`, the first three columns of the values are a
    position; without it, the returned normals are empty (0, 3). At points that are not selected, values are unchanged,
    and normals are zero. Normals are also zero where the surface has no tangent plane. With the scheme bilinear, values
    are their own limit, and each corner has the normal of its bilinear patch. Semi-sharp points are refined further,
    with the faces around them, until they are smooth: the limit is the same from every level.
    """
    if rules.scheme == "bilinear":
        return values, _patch_normals(level, values) if needs_normals else np.zeros((0, 3), np.float32)
    selected = np.ones(len(values), bool) if selected is None else selected
    is_semi_sharp = selected & _semi_sharp_points(level)
    limits, normals = _apply_masks(level, values, rules, selected & ~is_semi_sharp, needs_normals)
    if is_semi_sharp.any():
        ring, corners, points = level.extract(_faces_around(level, is_semi_sharp))
        child, child_values = split_faces(ring, rules.triangles), interpolate(ring, values[points], rules)
        inner = np.zeros(len(child_values), bool)
        inner[: len(points)] = is_semi_sharp[points]
        child_limits, child_normals = limit_surface(child, child_values, rules, inner, needs_normals)
        limits[points[is_semi_sharp[points]]] = child_limits[inner]
        if needs_normals:
            ring_corners = np.flatnonzero(is_semi_sharp[level.points[corners]])
            normals[corners[ring_corners]] = child_normals[first_child(ring_corners, rules.triangles)]
    return limits, normals


def complete_normals(level: HalfEdges, positions: Floats, normals: Floats32) -> None:
    """Replace zero vectors in `normals` (m, 3) by area-weighted mean normals of the faces in the corners' sectors.

    `positions` (n, 3) are the positions of the points of `level`.
    """
    missing = ~normals.any(axis=1)
    if not missing.any():
        return
    lacks_normal = np.zeros(len(positions), bool)
    lacks_normal[level.points[missing]] = True
    ring, corners, points = level.extract(_faces_around(level, lacks_normal))
    areas = area_vectors(positions[points][ring.points], ring.sizes)
    sector_of_corner = find_sectors(ring, lacks_normal[points]).sector_of_corner
    ring_corners = np.flatnonzero(missing[corners])
    corner_sectors = sector_of_corner[ring_corners]
    means = sum_by(corner_sectors, areas[ring.faces[ring_corners]], int(sector_of_corner.max()) + 1)[corner_sectors]
    normals[corners[ring_corners]] = normalize_or(means, flat_normals(areas, ring.sizes)[ring_corners])


def _faces_around(level: HalfEdges, points: Bools) -> Bools:
    """Return which faces (f,) have at least one of the marked points (n,)."""
    faces = np.zeros(len(level.sizes), bool)
    faces[level.faces[points[level.points]]] = True
    return faces


def _patch_normals(level: HalfEdges, values: Floats) -> Floats32:
    """Return the unit cross product (m, 3) of the two edges at each corner; zero if they are parallel."""
    position = values[level.points, :3]
    ahead, back = position[level.next] - position, position[level.previous] - position
    return _unit_normals(np.cross(ahead, back), np.maximum(dot(ahead, ahead), dot(back, back))[:, 0])


def _unit_normals(cross: Floats, squared_length: Floats) -> Floats32:
    """Normalise cross products (s, 3) of two tangents; the result is zero if the tangents do not span a plane.

    `squared_length` (s,) is the square of a length to which the tangents are compared (`_PLANE_TOLERANCE`).
    """
    unit = normalize_or(cross, np.zeros(3))
    unit[dot(cross, cross)[:, 0] <= (_PLANE_TOLERANCE * squared_length) ** 2] = 0.0
    return unit.astype(np.float32)


def _semi_sharp_points(level: HalfEdges) -> Bools:
    """Return which points (n,) have a finite sharpness above 0, or an edge with such a sharpness."""
    is_semi_sharp = (level.point_sharpness > 0.0) & np.isfinite(level.point_sharpness)
    is_semi_sharp[level.ends[(level.edge_sharpness > 0.0) & np.isfinite(level.edge_sharpness)]] = True
    return np.asarray(is_semi_sharp)


def _apply_masks(
    level: HalfEdges, values: Floats, rules: Rules, selected: Bools, needs_normals: bool
) -> tuple[Floats, Floats32]:
    """Return the result of `limit_surface` for points without semi-sharp features, by the masks of their sectors."""
    limits, sectors = values.copy(), find_sectors(level, selected)
    # The last row is a zero normal for corners at points that are not selected, whose sector number is -1.
    normals = np.zeros((len(sectors.first) + 1, 3), np.float32)
    # Sectors of equal kind and size have the same masks, and are processed together.
    order = np.lexsort([sectors.size, sectors.kind])
    changes = np.diff(sectors.kind[order]) | np.diff(sectors.size[order])
    cuts = np.union1d(np.flatnonzero(changes) + 1, np.arange(_BLOCK_SECTORS, len(order), _BLOCK_SECTORS))
    for group in np.split(order, cuts.astype(np.intp)) if len(order) else []:
        kind, size = SectorKind(sectors.kind[group[0]]), int(sectors.size[group[0]])
        if kind != SectorKind.NONE:
            half_edges = sectors.first[group]
            masks = limit_masks(kind, size, rules)
            rows, squared_lengths = _ring_sums(level, values, half_edges, masks if needs_normals else masks.position())
            limits[level.points[half_edges]] = rows[0]
            if needs_normals:
                normals[group] = _unit_normals(np.cross(rows[1][:, :3], rows[2][:, :3]), squared_lengths)
    return limits, normals[sectors.sector_of_corner] if needs_normals else normals[:0]


def _ring_sums(level: HalfEdges, values: Floats, half_edges: Indices, masks: Masks) -> tuple[Floats, Floats]:
    """Return the sums (r, s, k) of values (n, k) over the rings of s sectors, weighted by the r rows of masks.

    Also return the squared length (s,) of the longest edge of each ring. The sectors begin at `half_edges` (s,).
    """
    size = masks.faces.shape[1]
    center = values[level.points[half_edges]]
    rows, squared_lengths = masks.center[:, None, None] * center, np.zeros(len(half_edges))

    def add(weights: Floats, ring: Floats) -> None:
        """Add the values (s, k) of one ring point of each sector, weighted by that point's column of the masks (r,)."""
        for row in np.flatnonzero(weights):
            rows[row] += weights[row] * ring

    for i in range(size + 1):
        if not masks.edges[:, i:].any():
            break
        # The i-th face of each sector. Its half-edge from the point ends at the ring's edge point i; after the last
        # face, the previous half-edge begins at the last edge point.
        corner = level.next[half_edges] if i < size else level.previous[half_edges]
        ring = values[level.points[corner]]
        add(masks.edges[:, i], ring)
        edge_vectors = (ring - center)[:, :3]
        np.maximum(squared_lengths, np.einsum("ij,ij->i", edge_vectors, edge_vectors), out=squared_lengths)
        if i < size and masks.faces[:, i].any():
            add(masks.faces[:, i], values[level.points[level.next[corner]]])
        if i < size - 1:
            half_edges = level.twins[level.previous[half_edges]]
    return rows, squared_lengths
