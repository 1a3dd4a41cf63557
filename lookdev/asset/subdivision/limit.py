"""Where refinement ends: the position of each point on the limit surface, and the surface's normal at each corner.

A smooth point has one normal. At a point on a crease or at a corner, each sector of faces between sharp edges has its
own. A corner has a tangent plane where its sector is one face; a wider sector comes to it as a cone or a cusp, and has
the mean normal of its refined faces. So has any sector whose tangents vanish.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lookdev.asset.mesh import Floats
from lookdev.asset.normals import area_vectors, dot, flat_normals, sum_by, unit_or
from lookdev.asset.subdivision.masks import Kind, Masks, limit_masks
from lookdev.asset.subdivision.rules import Rules, interpolate
from lookdev.asset.subdivision.topology import Doubles, Flags, Index, Level, first_child, split

# The sine of the angle between two tangents, as a part of the ring's size, below which they span no plane: far below
# what an asset in float32 contains, far above the rounding of float64.
_NO_PLANE = 1e-9

# Sectors at a time: arrays over them stay in a processor's cache.
_BLOCK = 1 << 14

_FINITE = float(np.finfo(np.float64).max)


@dataclass(frozen=True, eq=False)
class Sectors:
    """The faces around each point, between the sharp edges that meet there.

    first (s,): the half-edge at the point of each sector's first face, clockwise; size (s,): the number of faces; kind
    (s,): which mask holds; of_corner (m,): the sector of each corner, -1 at points not asked for.
    """

    first: Index
    size: Index
    kind: Index
    of_corner: Index


def sectors(level: Level, wanted: Flags) -> Sectors:
    """Return the sectors at the points wanted (n,), as they are when all that is semi-sharp has become smooth."""
    edges = level.sharp_edges(_FINITE)
    corner = np.isinf(level.point_sharpness) | (edges > 2)
    of_point = np.select([corner, edges == 2, edges == 1], [Kind.CORNER, Kind.CREASE, Kind.DART], Kind.SMOOTH)
    sharp = np.isinf(level.edge_sharpness[level.edges])
    parted = (of_point >= Kind.CREASE)[level.points]
    # The next half-edge around the point, counter-clockwise, if the sector goes on.
    ahead = np.where(sharp[level.previous] & parted, -1, level.twins[level.previous])

    of_corner = np.full(len(level.points), -1)
    first, size, closed = [], [], []
    # A sector begins at a sharp edge; then there are only closed fans, which begin anywhere, one a point at a time.
    starts, count = np.flatnonzero((sharp | (level.twins < 0)) & wanted[level.points]), 0
    while True:
        sizes, around = _walk(starts, ahead, of_corner, count)
        first.append(starts)
        size.append(sizes)
        closed.append(around)
        count += len(starts)
        rest = np.flatnonzero((of_corner < 0) & wanted[level.points])
        if len(rest) == 0:
            break
        one = np.full(len(wanted), -1)
        one[level.points[rest]] = rest
        starts = one[one >= 0]
    firsts, sizes, around = np.concatenate(first), np.concatenate(size), np.concatenate(closed)
    kind = of_point[level.points[firsts]]
    kind[around != (kind < Kind.CREASE)] = Kind.NONE
    kind[(kind == Kind.CORNER) & (sizes > 1)] = Kind.NONE
    return Sectors(firsts, sizes, kind, of_corner)


def _walk(starts: Index, ahead: Index, of_corner: Index, first: int) -> tuple[Index, Flags]:
    """Number the corners of sectors by where they start, from `first` on; return the sizes, and which are closed."""
    size, closed = np.zeros(len(starts), np.intp), np.zeros(len(starts), bool)
    active, here = np.arange(len(starts)), starts
    while len(active):
        of_corner[here] = first + active
        size[active] += 1
        here = ahead[here]
        closed[active] = here == starts[active]
        go = (here >= 0) & ~closed[active]
        active, here = active[go], here[go]
    return size, closed


def limit(
    level: Level, values: Doubles, rules: Rules, wanted: Flags | None = None, has_normals: bool = True
) -> tuple[Doubles, Floats]:
    """Return the limit (n, k) of values at the points wanted (n,), and unit normals (m, 3) of their corners.

    With `has_normals` the first three values are a position. Normals are zero where they are not wanted and where the
    surface has no tangent plane. Values of `bilinear` are their own limit, and each corner has the normal of its
    bilinear patch. What is semi-sharp still is refined on its own until it is smooth: the limit is the same from every
    level.
    """
    if rules.scheme == "bilinear":
        return values, _patch_normals(level, values) if has_normals else np.zeros((0, 3), np.float32)
    wanted = np.ones(len(values), bool) if wanted is None else wanted
    unfinished = wanted & _semi_sharp(level)
    limits, normals = _masked(level, values, rules, wanted & ~unfinished, has_normals)
    if unfinished.any():
        ring, corners, points = level.part(_around(level, unfinished))
        child, child_values = split(ring, rules.triangles), interpolate(ring, values[points], rules)
        inner = np.zeros(len(child_values), bool)
        inner[: len(points)] = unfinished[points]
        child_limits, child_normals = limit(child, child_values, rules, inner, has_normals)
        limits[points[unfinished[points]]] = child_limits[inner]
        if has_normals:
            own = np.flatnonzero(unfinished[level.points[corners]])
            normals[corners[own]] = child_normals[first_child(own, rules.triangles)]
    return limits, normals


def complete_normals(level: Level, positions: Doubles, normals: Floats) -> None:
    """Replace normals (m, 3) that are zero by the area-weighted mean of their sector's faces, of length 1."""
    missing = ~normals.any(axis=1)
    if not missing.any():
        return
    without = np.zeros(len(positions), bool)
    without[level.points[missing]] = True
    ring, corners, points = level.part(_around(level, without))
    areas = area_vectors(positions[points][ring.points], ring.sizes)
    of_corner = sectors(ring, without[points]).of_corner
    own = np.flatnonzero(missing[corners])
    means = sum_by(of_corner[own], areas[ring.faces[own]], int(of_corner.max()) + 1)[of_corner[own]]
    normals[corners[own]] = unit_or(means, flat_normals(areas, ring.sizes)[own])


def _around(level: Level, points: Flags) -> Flags:
    """Return the faces (f,) that have one of the points (n,)."""
    faces = np.zeros(len(level.sizes), bool)
    faces[level.faces[points[level.points]]] = True
    return faces


def _patch_normals(level: Level, values: Doubles) -> Floats:
    """Return at each corner (m, 3) the direction of the cross product of its two edges; zero where they span none."""
    position = values[level.points, :3]
    ahead, back = position[level.next] - position, position[level.previous] - position
    return _direction(np.cross(ahead, back), np.maximum(dot(ahead, ahead), dot(back, back))[:, 0])


def _direction(cross: Doubles, reach: Doubles) -> Floats:
    """Return cross products (s, 3) of unit length; zero where they are but rounding of edges of length^2 `reach`."""
    unit = unit_or(cross, np.zeros(3))
    unit[dot(cross, cross)[:, 0] <= (_NO_PLANE * reach) ** 2] = 0.0
    return unit.astype(np.float32)


def _semi_sharp(level: Level) -> Flags:
    """Return whether each point (n,), or an edge that meets there, is sharp but not infinitely."""
    semi = (level.point_sharpness > 0.0) & np.isfinite(level.point_sharpness)
    semi[level.ends[(level.edge_sharpness > 0.0) & np.isfinite(level.edge_sharpness)]] = True
    return np.asarray(semi)


def _masked(level: Level, values: Doubles, rules: Rules, wanted: Flags, has_normals: bool) -> tuple[Doubles, Floats]:
    """Return `limit` of points where nothing is semi-sharp: each sector's masks applied to its ring."""
    limits, parts = values.copy(), sectors(level, wanted)
    # The last one is that of corners that are not wanted, whose sector is -1.
    normals = np.zeros((len(parts.first) + 1, 3), np.float32)
    order = np.lexsort([parts.size, parts.kind])
    changes = np.diff(parts.kind[order]) | np.diff(parts.size[order])
    cuts = np.union1d(np.flatnonzero(changes) + 1, np.arange(_BLOCK, len(order), _BLOCK))
    for group in np.split(order, cuts.astype(np.intp)) if len(order) else []:
        kind, size = Kind(parts.kind[group[0]]), int(parts.size[group[0]])
        if kind != Kind.NONE:
            half = parts.first[group]
            masks = limit_masks(kind, size, rules)
            rows, reach = _ring_sums(level, values, half, masks if has_normals else masks.position())
            limits[level.points[half]] = rows[0]
            if has_normals:
                normals[group] = _direction(np.cross(rows[1][:, :3], rows[2][:, :3]), reach)
    return limits, normals[parts.of_corner] if has_normals else normals[:0]


def _ring_sums(level: Level, values: Doubles, half: Index, masks: Masks) -> tuple[Doubles, Doubles]:
    """Return the rows (r, s, k) of sectors (s,) that begin at `half`, and the square (s,) of their longest edge."""
    size = masks.faces.shape[1]
    center = values[level.points[half]]
    rows, reach = masks.own[:, None, None] * center, np.zeros(len(half))

    def add(weights: Doubles, ring: Doubles) -> None:
        for row in np.flatnonzero(weights):
            rows[row] += weights[row] * ring

    for i in range(size + 1):
        if not masks.edges[:, i:].any():
            break
        corner = level.next[half] if i < size else level.previous[half]
        ring = values[level.points[corner]]
        add(masks.edges[:, i], ring)
        legs = (ring - center)[:, :3]
        np.maximum(reach, np.einsum("ij,ij->i", legs, legs), out=reach)
        if i < size and masks.faces[:, i].any():
            add(masks.faces[:, i], values[level.points[level.next[corner]]])
        if i < size - 1:
            half = level.twins[level.previous[half]]
    return rows, reach
