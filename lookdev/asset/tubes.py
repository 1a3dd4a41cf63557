"""Tubes and ribbons along curves that are sampled in rings.

A curve is a sequence of smooth pieces. Where two pieces meet at an angle, both cross-sections lie in the plane that
bisects it: the tube has no gap there, and its shading has an edge where the curve has a corner.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Bools, Floats, Indices
from lookdev.asset.normals import dot, normalize_or
from lookdev.asset.tangents import perpendicular

# Points are displaced along the curve into the plane of their cross-section, by at most so many radii: where a curve
# reverses, the bisecting plane contains the curve.
_MAX_CUT = 4.0


@dataclass(frozen=True, eq=False)
class Rings:
    """Samples (r,) of curves, called rings, in order: positions (r, 3), unit directions (r, 3), radii (r,).

    pieces (r,) and curves (r,) are the numbers of the piece and the curve of each ring, from 0 without gaps; closed
    (c,) is true where the last piece of a curve meets its first.
    """

    positions: Floats
    directions: Floats
    radii: Floats
    pieces: Indices
    curves: Indices
    closed: Bools


@dataclass(frozen=True, eq=False)
class Strips:
    """Faces along curves: points, normals (n, 3) and st (n, 2), face_sizes (f,) and face_points (m,).

    point_rings (n,) and face_curves (f,) are the numbers of the ring of each point and of the curve of each face.
    """

    points: Floats
    normals: Floats
    st: Floats
    face_sizes: Indices
    face_points: Indices
    point_rings: Indices
    face_curves: Indices


def tubes(rings: Rings, sides: int) -> Strips:
    """Return tubes with flat ends; a tube whose radius falls to 0 ends in a point.

    st: u grows around the curve, counter-clockwise seen against its direction; v grows from 0 to 1 with the length
    along it; an end is a disc in the unit square. Normals are those of the round tube, exact where the tube is straight
    or does not taper.
    """
    fractions = _relative_lengths(rings)
    x = _frames(rings, fractions)
    y = np.cross(rings.directions, x)
    angle = 2.0 * np.pi * np.arange(sides + 1) / sides
    angle[-1] = 0.0  # the same points as the first
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    outward = cos * x[:, None] + sin * y[:, None]
    slope = _slopes(rings)[:, None, None]
    u = np.broadcast_to(np.arange(sides + 1) / sides, outward.shape[:2])
    sheath = _strips(
        rings, outward, (outward - slope * rings.directions[:, None]) / np.sqrt(1.0 + slope**2), u, fractions
    )

    starts, ends = group_ends(rings.curves)
    rims = np.concatenate([starts, ends])
    end_sign = np.repeat([-1.0, 1.0], len(starts))
    has_cap = ~np.tile(rings.closed, 2) & (rings.radii[rims] > 0.0)
    rims, end_sign = rims[has_cap], end_sign[has_cap]
    around = np.where(end_sign[:, None] < 0.0, -np.arange(sides) % sides, np.arange(sides))
    disc = np.stack([np.cos(angle)[around], end_sign[:, None] * np.sin(angle)[around]], axis=-1)
    return Strips(
        points=np.concatenate([sheath.points, sheath.points[rims[:, None] * (sides + 1) + around].reshape(-1, 3)]),
        normals=np.concatenate([sheath.normals, np.repeat(end_sign[:, None] * rings.directions[rims], sides, axis=0)]),
        st=np.concatenate([sheath.st, 0.5 + 0.5 * disc.reshape(-1, 2)]),
        face_sizes=np.concatenate([sheath.face_sizes, np.full(len(rims), sides)]),
        face_points=np.concatenate([sheath.face_points, len(sheath.points) + np.arange(len(rims) * sides)]),
        point_rings=np.concatenate([sheath.point_rings, np.repeat(rims, sides)]),
        face_curves=np.concatenate([sheath.face_curves, rings.curves[rims]]),
    )


def ribbons(rings: Rings, facing: Floats) -> Strips:
    """Return flat ribbons that face along the part of `facing` (r, 3) that is perpendicular to the curve.

    st: u grows across the ribbon, to the right where the curve runs upwards; v grows from 0 to 1 with the length along
    it.
    """
    across = normalize_or(np.cross(rings.directions, facing), perpendicular(rings.directions))
    normals = np.cross(across, rings.directions)
    u = np.broadcast_to([0.0, 1.0], (len(across), 2))
    outward = np.stack([-across, across], axis=1)
    return _strips(rings, outward, np.stack([normals, normals], axis=1), u, _relative_lengths(rings))


def _strips(rings: Rings, outward: Floats, normals: Floats, u: Floats, fractions: Floats) -> Strips:
    """Return the faces between the rings of each piece, from c columns of points along it.

    outward (r, c, 3): unit vectors from the curve to the columns; normals (r, c, 3); u (r, c); fractions (r,): v, the
    length along the curve as a fraction of its total.
    """
    columns = outward.shape[1]
    planes = _cut_normals(rings)
    radii = rings.radii[:, None]
    limit = _MAX_CUT * radii
    with np.errstate(divide="ignore", invalid="ignore"):
        cut = -radii * np.einsum("rci,ri->rc", outward, planes) / dot(rings.directions, planes)
    cut = np.clip(np.where(np.isfinite(cut), cut, 0.0), -limit, limit)
    points = rings.positions[:, None] + radii[..., None] * outward + cut[..., None] * rings.directions[:, None]

    # The lower ring of each strip of faces between two rings of a piece. Strips without area are dropped. At a tip, a
    # ring of radius 0, a face has one corner instead of two.
    lower = np.flatnonzero(rings.pieces[:-1] == rings.pieces[1:])
    has_length = (rings.positions[lower] != rings.positions[lower + 1]).any(axis=1)
    is_tip = rings.radii[lower] == 0.0, rings.radii[lower + 1] == 0.0
    has_area = (has_length | (rings.radii[lower] != rings.radii[lower + 1])) & ~(is_tip[0] & is_tip[1])
    lower, is_tip = lower[has_area], (is_tip[0][has_area], is_tip[1][has_area])
    corners = lower[:, None, None] * columns + np.arange(columns - 1)[:, None] + [0, 1, columns + 1, columns]
    is_corner = np.ones(corners.shape, bool)
    is_corner[is_tip[0], :, 1] = False
    is_corner[is_tip[1], :, 3] = False
    return Strips(
        points=points.reshape(-1, 3),
        normals=normals.reshape(-1, 3),
        st=np.stack([u, np.broadcast_to(fractions[:, None], u.shape)], axis=-1).reshape(-1, 2),
        face_sizes=is_corner.sum(axis=-1).ravel(),
        face_points=corners[is_corner],
        point_rings=np.repeat(np.arange(len(points)), columns),
        face_curves=np.repeat(rings.curves[lower], columns - 1),
    )


def group_ends(groups: Indices) -> tuple[Indices, Indices]:
    """Return the index of the first and of the last element of each group of consecutive equal numbers."""
    starts = np.flatnonzero(np.diff(groups, prepend=-1))
    return starts, np.append(starts[1:], len(groups)) - 1


def _relative_lengths(rings: Rings) -> Floats:
    """Return the length from the start of the curve to each ring (r,), as a fraction of the curve's length."""
    steps = np.linalg.norm(np.diff(rings.positions, axis=0, prepend=rings.positions[:1]), axis=1)
    total = np.cumsum(steps)
    starts, ends = group_ends(rings.curves)
    return np.asarray((total - total[starts][rings.curves]) / (total[ends] - total[starts])[rings.curves])


def _slopes(rings: Rings) -> Floats:
    """Return the derivative of the radius by the length at each ring (r,)."""
    starts, ends = group_ends(rings.pieces)
    ring = np.arange(len(rings.radii))
    before, after = np.maximum(ring - 1, starts[rings.pieces]), np.minimum(ring + 1, ends[rings.pieces])
    length = sum(np.linalg.norm(rings.positions[ring] - rings.positions[other], axis=1) for other in (before, after))
    change = rings.radii[after] - rings.radii[before]
    return np.where(length > 0.0, change / np.where(length > 0.0, length, 1.0), 0.0)


def _cut_normals(rings: Rings) -> Floats:
    """Return a normal (r, 3), not unit, of the plane of each ring's cross-section."""
    planes = rings.directions.copy()
    last = np.flatnonzero((rings.pieces[:-1] != rings.pieces[1:]) & (rings.curves[:-1] == rings.curves[1:]))
    starts, ends = group_ends(rings.curves)
    last, first = np.append(last, ends[rings.closed]), np.append(last + 1, starts[rings.closed])
    planes[last] = planes[first] = rings.directions[last] + rings.directions[first]
    return planes


def _frames(rings: Rings, fractions: Floats) -> Floats:
    """Return unit vectors (r, 3) perpendicular to the curve that rotate from ring to ring as little as possible.

    On a closed curve the rotation that remains at the end is subtracted evenly along it, so that the ends meet.
    """
    starts, ends = group_ends(rings.curves)
    number = np.arange(len(rings.curves)) - starts[rings.curves]
    rotations = _smallest_rotations(np.roll(rings.directions, 1, axis=0), rings.directions)
    rotations[starts] = [1.0, 0.0, 0.0, 0.0]
    # The product of all rotations up to each ring, by products of 2, 4, 8, ... of them.
    reach = 1
    while reach <= number.max():
        later = np.flatnonzero(number >= reach)
        rotations[later] = _compose_rotations(rotations[later], rotations[later - reach])
        reach *= 2
    first = perpendicular(rings.directions[starts])
    frames = _rotate(first[rings.curves], rotations)
    frames = normalize_or(frames - dot(frames, rings.directions) * rings.directions, perpendicular(rings.directions))
    axis = rings.directions[starts]
    transported = _rotate(frames[ends], _smallest_rotations(rings.directions[ends], axis))
    twist = np.arctan2(dot(np.cross(first, transported), axis), dot(first, transported)) * rings.closed[:, None]
    angle = -twist[rings.curves] * fractions[:, None]
    return np.asarray(np.cos(angle) * frames + np.sin(angle) * np.cross(rings.directions, frames))


def _smallest_rotations(before: Floats, after: Floats) -> Floats:
    """Return unit quaternions (r, 4), real part first, of the smallest rotations between unit vectors (r, 3)."""
    real = 1.0 + dot(before, after)
    is_opposite = real < 1e-12  # any half turn is a smallest rotation
    axis = np.where(is_opposite, perpendicular(before), np.cross(before, after))
    rotations = np.concatenate([np.where(is_opposite, 0.0, real), axis], axis=1)
    return np.asarray(rotations / np.linalg.norm(rotations, axis=1, keepdims=True))


def _compose_rotations(second: Floats, first: Floats) -> Floats:
    """Return the rotations by `first` and then `second`, unit quaternions (r, 4)."""
    a, u, b, v = second[:, :1], second[:, 1:], first[:, :1], first[:, 1:]
    product = np.concatenate([a * b - dot(u, v), a * v + b * u + np.cross(u, v)], axis=1)
    return np.asarray(product / np.linalg.norm(product, axis=1, keepdims=True))


def _rotate(vectors: Floats, rotations: Floats) -> Floats:
    """Return vectors (r, 3) rotated by unit quaternions (r, 4)."""
    axis = rotations[:, 1:]
    across = np.cross(axis, vectors)
    return np.asarray(vectors + 2.0 * (rotations[:, :1] * across + np.cross(axis, across)))
