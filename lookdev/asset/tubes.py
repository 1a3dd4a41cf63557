"""Tubes and ribbons along curves that are sampled in rings.

A curve is a row of pieces, each smooth. Where two pieces meet at an angle, both cross-sections lie in the plane that
halves it: a tube is closed there, and its shading has the edge that the curve has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookdev.asset.normals import dot, unit_or
from lookdev.asset.shape import Doubles, Index
from lookdev.asset.tangents import perpendicular

_LONGEST_CUT = 4.0  # in radii; where a curve turns back, the plane that halves the angle contains it


@dataclass(frozen=True, eq=False)
class Rings:
    """Samples (r,) of curves, in order: positions (r, 3), unit directions (r, 3), radii (r,).

    pieces (r,) and curves (r,) number the piece and the curve of each ring, from 0 without gaps; closed (c,) is True
    where the last piece of a curve meets its first.
    """

    positions: Doubles
    directions: Doubles
    radii: Doubles
    pieces: Index
    curves: Index
    closed: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Strips:
    """Faces along curves: points, normals (n, 3) and st (n, 2), face_sizes (f,) and face_points (m,).

    point_rings (n,) and face_curves (f,) are the ring of each point and the curve of each face.
    """

    points: Doubles
    normals: Doubles
    st: Doubles
    face_sizes: Index
    face_points: Index
    point_rings: Index
    face_curves: Index


def tubes(rings: Rings, sides: int) -> Strips:
    """Return tubes with flat ends; where the radius is 0 a tube ends in a point.

    st: u grows around the curve, counter-clockwise seen against its direction, v from 0 to 1 with the length along it;
    an end is a disc in the unit square. Normals are those of the round tube, exact where it is straight or does not
    taper.
    """
    along = _lengths(rings)
    x = _frames(rings, along)
    y = np.cross(rings.directions, x)
    angle = 2.0 * np.pi * np.arange(sides + 1) / sides
    angle[-1] = 0.0  # the same points as the first
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    outward = cos * x[:, None] + sin * y[:, None]
    slope = _slopes(rings)[:, None, None]
    u = np.broadcast_to(np.arange(sides + 1) / sides, outward.shape[:2])
    sheath = _strips(rings, outward, (outward - slope * rings.directions[:, None]) / np.sqrt(1.0 + slope**2), u, along)

    starts, ends = _ends(rings.curves)
    rims = np.concatenate([starts, ends])
    side = np.repeat([-1.0, 1.0], len(starts))
    capped = ~np.tile(rings.closed, 2) & (rings.radii[rims] > 0.0)
    rims, side = rims[capped], side[capped]
    around = np.where(side[:, None] < 0.0, -np.arange(sides) % sides, np.arange(sides))
    disc = np.stack([np.cos(angle)[around], side[:, None] * np.sin(angle)[around]], axis=-1)
    return Strips(
        points=np.concatenate([sheath.points, sheath.points[rims[:, None] * (sides + 1) + around].reshape(-1, 3)]),
        normals=np.concatenate([sheath.normals, np.repeat(side[:, None] * rings.directions[rims], sides, axis=0)]),
        st=np.concatenate([sheath.st, 0.5 + 0.5 * disc.reshape(-1, 2)]),
        face_sizes=np.concatenate([sheath.face_sizes, np.full(len(rims), sides)]),
        face_points=np.concatenate([sheath.face_points, len(sheath.points) + np.arange(len(rims) * sides)]),
        point_rings=np.concatenate([sheath.point_rings, np.repeat(rims, sides)]),
        face_curves=np.concatenate([sheath.face_curves, rings.curves[rims]]),
    )


def ribbons(rings: Rings, facing: Doubles) -> Strips:
    """Return flat ribbons that look along `facing` (r, 3), made perpendicular to the curve.

    st: u grows across the ribbon, to the right where the curve runs upwards, v from 0 to 1 with the length along it.
    """
    across = unit_or(np.cross(rings.directions, facing), perpendicular(rings.directions))
    normals = np.cross(across, rings.directions)
    u = np.broadcast_to([0.0, 1.0], (len(across), 2))
    outward = np.stack([-across, across], axis=1)
    return _strips(rings, outward, np.stack([normals, normals], axis=1), u, _lengths(rings))


def _strips(rings: Rings, outward: Doubles, normals: Doubles, u: Doubles, along: Doubles) -> Strips:
    """Return the faces between the rings of each piece; `outward` (r, c, 3) points from the curve to its c columns."""
    columns = outward.shape[1]
    planes = _planes(rings)
    radii = rings.radii[:, None]
    limit = _LONGEST_CUT * radii
    with np.errstate(divide="ignore", invalid="ignore"):
        cut = -radii * np.einsum("rci,ri->rc", outward, planes) / dot(rings.directions, planes)
    cut = np.clip(np.where(np.isfinite(cut), cut, 0.0), -limit, limit)
    points = rings.positions[:, None] + radii[..., None] * outward + cut[..., None] * rings.directions[:, None]

    below = np.flatnonzero(rings.pieces[:-1] == rings.pieces[1:])
    moved = (rings.positions[below] != rings.positions[below + 1]).any(axis=1)
    tips = rings.radii[below] == 0.0, rings.radii[below + 1] == 0.0
    solid = (moved | (rings.radii[below] != rings.radii[below + 1])) & ~(tips[0] & tips[1])
    below, tips = below[solid], (tips[0][solid], tips[1][solid])
    corners = below[:, None, None] * columns + np.arange(columns - 1)[:, None] + [0, 1, columns + 1, columns]
    kept = np.ones(corners.shape, bool)
    kept[tips[0], :, 1] = False
    kept[tips[1], :, 3] = False
    return Strips(
        points=points.reshape(-1, 3),
        normals=normals.reshape(-1, 3),
        st=np.stack([u, np.broadcast_to(along[:, None], u.shape)], axis=-1).reshape(-1, 2),
        face_sizes=kept.sum(axis=-1).ravel(),
        face_points=corners[kept],
        point_rings=np.repeat(np.arange(len(points)), columns),
        face_curves=np.repeat(rings.curves[below], columns - 1),
    )


def _ends(groups: Index) -> tuple[Index, Index]:
    """Return the index of the first and of the last element of each group of equal numbers, which lie together."""
    starts = np.flatnonzero(np.diff(groups, prepend=-1))
    return starts, np.append(starts[1:], len(groups)) - 1


def _lengths(rings: Rings) -> Doubles:
    """Return the length from the start of the curve to each ring (r,), relative to the whole."""
    steps = np.linalg.norm(np.diff(rings.positions, axis=0, prepend=rings.positions[:1]), axis=1)
    total = np.cumsum(steps)
    starts, ends = _ends(rings.curves)
    return np.asarray((total - total[starts][rings.curves]) / (total[ends] - total[starts])[rings.curves])


def _slopes(rings: Rings) -> Doubles:
    """Return the change of the radius per length at each ring (r,)."""
    starts, ends = _ends(rings.pieces)
    here = np.arange(len(rings.radii))
    before, after = np.maximum(here - 1, starts[rings.pieces]), np.minimum(here + 1, ends[rings.pieces])
    length = sum(np.linalg.norm(rings.positions[here] - rings.positions[other], axis=1) for other in (before, after))
    change = rings.radii[after] - rings.radii[before]
    return np.where(length > 0.0, change / np.where(length > 0.0, length, 1.0), 0.0)


def _planes(rings: Rings) -> Doubles:
    """Return a normal (r, 3), not unit, of the plane of each cross-section."""
    planes = rings.directions.copy()
    last = np.flatnonzero((rings.pieces[:-1] != rings.pieces[1:]) & (rings.curves[:-1] == rings.curves[1:]))
    starts, ends = _ends(rings.curves)
    last, first = np.append(last, ends[rings.closed]), np.append(last + 1, starts[rings.closed])
    planes[last] = planes[first] = rings.directions[last] + rings.directions[first]
    return planes


def _frames(rings: Rings, along: Doubles) -> Doubles:
    """Return a unit vector (r, 3) perpendicular to the curve, turned from ring to ring as little as possible.

    What it has turned about a closed curve at its end is taken back evenly, so that the ends meet.
    """
    starts, ends = _ends(rings.curves)
    number = np.arange(len(rings.curves)) - starts[rings.curves]
    turns = _turns(np.roll(rings.directions, 1, axis=0), rings.directions)
    turns[starts] = [1.0, 0.0, 0.0, 0.0]
    # The product of all turns up to each ring, by products of 2, 4, 8, ... of them.
    reach = 1
    while reach <= number.max():
        later = np.flatnonzero(number >= reach)
        turns[later] = _product(turns[later], turns[later - reach])
        reach *= 2
    first = perpendicular(rings.directions[starts])
    frames = _turned(first[rings.curves], turns)
    frames = unit_or(frames - dot(frames, rings.directions) * rings.directions, perpendicular(rings.directions))
    axis = rings.directions[starts]
    back = _turned(frames[ends], _turns(rings.directions[ends], axis))
    twist = np.arctan2(dot(np.cross(first, back), axis), dot(first, back)) * rings.closed[:, None]
    angle = -twist[rings.curves] * along[:, None]
    return np.asarray(np.cos(angle) * frames + np.sin(angle) * np.cross(rings.directions, frames))


def _turns(before: Doubles, after: Doubles) -> Doubles:
    """Return unit quaternions (r, 4), real part first, of the smallest rotations between unit vectors (r, 3)."""
    real = 1.0 + dot(before, after)
    opposite = real < 1e-12  # any half turn will do
    axis = np.where(opposite, perpendicular(before), np.cross(before, after))
    turns = np.concatenate([np.where(opposite, 0.0, real), axis], axis=1)
    return np.asarray(turns / np.linalg.norm(turns, axis=1, keepdims=True))


def _product(second: Doubles, first: Doubles) -> Doubles:
    """Return the rotations `second` after `first`, unit quaternions (r, 4)."""
    a, u, b, v = second[:, :1], second[:, 1:], first[:, :1], first[:, 1:]
    product = np.concatenate([a * b - dot(u, v), a * v + b * u + np.cross(u, v)], axis=1)
    return np.asarray(product / np.linalg.norm(product, axis=1, keepdims=True))


def _turned(vectors: Doubles, turns: Doubles) -> Doubles:
    """Return vectors (r, 3) rotated by unit quaternions (r, 4)."""
    axis = turns[:, 1:]
    across = np.cross(axis, vectors)
    return np.asarray(vectors + 2.0 * (turns[:, :1] * across + np.cross(axis, across)))
