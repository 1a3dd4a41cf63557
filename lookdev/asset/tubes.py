"""Makes tubes and ribbons along curves, for the curves of USD files.

A curve is a sequence of smooth pieces, and is given by samples, called rings. Each ring becomes a cross-section of the
tube or ribbon. Where two pieces meet at an angle, the cross-sections at their ends lie in the plane that bisects the
angle. The tube therefore has no gap there, and its shading has an edge where the curve has a corner.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lookdev.arrays import Bools, Floats, Indices
from lookdev.asset.normals import dot, normalize_or
from lookdev.asset.tangents import perpendicular

# The points of a ring are displaced along the curve into the plane of the cross-section, by at most this number of
# radii. Where a curve reverses, the bisecting plane contains the curve, and the displacement would have no bound.
_MAX_CUT = 4.0


@dataclass(frozen=True, eq=False)
class CurveSamples:
    """The r samples, called rings, of c curves, in order along each curve.

    - positions (r, 3): points on the curve
    - directions (r, 3): unit tangents of the curve
    - radii (r,): half the width of the tube or ribbon
    - pieces, curves (r,): the number of the piece and of the curve that each ring belongs to, from 0 without gaps;
      pieces are numbered through all curves
    - closed (c,): whether each curve is closed, so that its last piece meets its first piece
    """

    positions: Floats
    directions: Floats
    radii: Floats
    pieces: Indices
    curves: Indices
    closed: Bools


@dataclass(frozen=True, eq=False)
class Strips:
    """A mesh along curves.

    - points, normals (n, 3): positions and unit normals
    - st (n, 2): texture coordinates at the points
    - face_sizes (f,): the number of corners of each face
    - face_points (m,): the point at each corner
    - point_rings (n,): the number of the ring from which each point comes
    - face_curves (f,): the number of the curve to which each face belongs
    """

    points: Floats
    normals: Floats
    st: Floats
    face_sizes: Indices
    face_points: Indices
    point_rings: Indices
    face_curves: Indices


def tubes(rings: CurveSamples, sides: int) -> Strips:
    """Return tubes of `sides` faces around each curve, with flat caps; a tube with radius 0 at an end ends in a point.

    In `st`, u grows around the curve, counter-clockwise when seen against the direction of the curve. v grows from 0 to
    1 with the length along the curve. A cap is a disc in the unit square. Normals are computed as for a round tube;
    they are exact where the tube is straight or does not taper.
    """
    # Each ring has `sides` + 1 points; the last has the position of the first, but u = 1. At each ring, x and y span
    # the cross-section, and `slope` is the derivative of the radius along the curve.
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

    # The caps of the open curves: `rims` has the rings at their ends, and `end_sign` is -1 at a start and 1 at an end.
    starts, ends = run_ends(rings.curves)
    rims = np.concatenate([starts, ends])
    end_sign = np.repeat([-1.0, 1.0], len(starts))
    has_cap = ~np.tile(rings.closed, 2) & (rings.radii[rims] > 0.0)
    rims, end_sign = rims[has_cap], end_sign[has_cap]
    # The points around each cap, counter-clockwise when seen from outside, and their positions in the unit disc.
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


def ribbons(rings: CurveSamples, facing: Floats) -> Strips:
    """Return flat ribbons whose normals are `facing` (r, 3), made perpendicular to the curve.

    In `st`, u grows across the ribbon, to the right if the curve runs upwards. v grows from 0 to 1 with the length
    along the curve.
    """
    across = normalize_or(np.cross(rings.directions, facing), perpendicular(rings.directions))
    normals = np.cross(across, rings.directions)
    u = np.broadcast_to([0.0, 1.0], (len(across), 2))
    outward = np.stack([-across, across], axis=1)
    return _strips(rings, outward, np.stack([normals, normals], axis=1), u, _relative_lengths(rings))


def _strips(rings: CurveSamples, outward: Floats, normals: Floats, u: Floats, fractions: Floats) -> Strips:
    """Return the faces between consecutive rings of each piece, from r rings of c points each.

    - outward (r, c, 3): unit vectors from the curve towards the points
    - normals (r, c, 3): unit normals at the points
    - u (r, c): the texture coordinate u of the points
    - fractions (r,): the texture coordinate v of each ring, which is the result of `_relative_lengths`
    """
    columns = outward.shape[1]
    planes = _cut_normals(rings)
    radii = rings.radii[:, None]
    limit = _MAX_CUT * radii
    with np.errstate(divide="ignore", invalid="ignore"):
        cut = -radii * np.einsum("rci,ri->rc", outward, planes) / dot(rings.directions, planes)
    cut = np.clip(np.where(np.isfinite(cut), cut, 0.0), -limit, limit)
    points = rings.positions[:, None] + radii[..., None] * outward + cut[..., None] * rings.directions[:, None]

    # A strip is the row of faces between two consecutive rings of a piece; `lower` has the number of its first ring.
    # Strips without area are dropped. At a tip, which is a ring of radius 0, a face has one corner instead of two.
    # `is_tip` is a pair of masks of strips: whether the lower ring is a tip, and whether the upper ring is a tip.
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


def run_ends(groups: Indices) -> tuple[Indices, Indices]:
    """Return two arrays: the indices of the first and of the last element of each run of equal numbers."""
    starts = np.flatnonzero(np.diff(groups, prepend=-1))
    return starts, np.append(starts[1:], len(groups)) - 1


def _relative_lengths(rings: CurveSamples) -> Floats:
    """Return the length from the start of the curve to each ring (r,), as a fraction of the curve's length."""
    steps = np.linalg.norm(np.diff(rings.positions, axis=0, prepend=rings.positions[:1]), axis=1)
    total = np.cumsum(steps)
    starts, ends = run_ends(rings.curves)
    return np.asarray((total - total[starts][rings.curves]) / (total[ends] - total[starts])[rings.curves])


def _slopes(rings: CurveSamples) -> Floats:
    """Return the derivative (r,) of the radius by the length along the curve, from the neighbours of each ring."""
    starts, ends = run_ends(rings.pieces)
    ring = np.arange(len(rings.radii))
    before, after = np.maximum(ring - 1, starts[rings.pieces]), np.minimum(ring + 1, ends[rings.pieces])
    length = sum(np.linalg.norm(rings.positions[ring] - rings.positions[other], axis=1) for other in (before, after))
    change = rings.radii[after] - rings.radii[before]
    return np.where(length > 0.0, change / np.where(length > 0.0, length, 1.0), 0.0)


def _cut_normals(rings: CurveSamples) -> Floats:
    """Return a normal (r, 3), not normalised, of the plane of each ring's cross-section."""
    planes = rings.directions.copy()
    # The last ring of a piece and the first ring of the next piece of the same curve share a plane, which bisects the
    # angle between the pieces.
    last = np.flatnonzero((rings.pieces[:-1] != rings.pieces[1:]) & (rings.curves[:-1] == rings.curves[1:]))
    starts, ends = run_ends(rings.curves)
    last, first = np.append(last, ends[rings.closed]), np.append(last + 1, starts[rings.closed])
    planes[last] = planes[first] = rings.directions[last] + rings.directions[first]
    return planes


def _frames(rings: CurveSamples, fractions: Floats) -> Floats:
    """Return unit vectors (r, 3) at the rings, perpendicular to the curve; they rotate about it as little as possible.

    On a closed curve, the vectors at the start and at the end differ by a rotation about the curve. This rotation is
    subtracted evenly along the curve, so that the ends meet. `fractions` (r,) are the relative lengths along the curve.
    """
    starts, ends = run_ends(rings.curves)
    number = np.arange(len(rings.curves)) - starts[rings.curves]
    rotations = _smallest_rotations(np.roll(rings.directions, 1, axis=0), rings.directions)
    rotations[starts] = [1.0, 0.0, 0.0, 0.0]
    # A prefix product: after each round, a ring has the product of the last 2, 4, 8, ... rotations up to it.
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
    """Return the smallest rotations from unit vectors (r, 3) to others, as unit quaternions (r, 4), real part first."""
    real = 1.0 + dot(before, after)
    is_opposite = real < 1e-12  # any half turn is a smallest rotation
    axis = np.where(is_opposite, perpendicular(before), np.cross(before, after))
    rotations = np.concatenate([np.where(is_opposite, 0.0, real), axis], axis=1)
    return np.asarray(rotations / np.linalg.norm(rotations, axis=1, keepdims=True))


def _compose_rotations(second: Floats, first: Floats) -> Floats:
    """Return unit quaternions (r, 4) of the rotations that apply `first` and then `second`, also (r, 4)."""
    a, u, b, v = second[:, :1], second[:, 1:], first[:, :1], first[:, 1:]
    product = np.concatenate([a * b - dot(u, v), a * v + b * u + np.cross(u, v)], axis=1)
    return np.asarray(product / np.linalg.norm(product, axis=1, keepdims=True))


def _rotate(vectors: Floats, rotations: Floats) -> Floats:
    """Return vectors (r, 3) rotated by unit quaternions (r, 4)."""
    axis = rotations[:, 1:]
    across = np.cross(axis, vectors)
    return np.asarray(vectors + 2.0 * (rotations[:, :1] * across + np.cross(axis, across)))
