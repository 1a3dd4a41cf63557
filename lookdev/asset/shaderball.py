"""Makes the built-in shader ball: a ball with a groove, a raised rim and a recess around a core, on a base.

The shader ball consists of two surfaces of revolution. The ball's axis is tilted towards the camera of pose 0, the pose
before the turntable turns. A profile consists of pieces, which are arcs and lines. A piece is an array of points
(k, 2): radius and height in metres. Every corner between two pieces has a fillet, which shows a highlight as a real
edge does. Normals are smooth everywhere.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from lookdev.arrays import Floats
from lookdev.asset.mesh import Asset, Instance, Slot
from lookdev.asset.revolve import RevolvedProfile, revolve
from lookdev.asset.store import make_asset

ProfilePoint = tuple[float, float]

_BALL_HEIGHT = 1.2  # metres from the ground to the ball's centre
_OPENING_AZIMUTH = -60.0  # degrees: the direction in which the ball's recess opens
_OPENING_ELEVATION = 30.0  # degrees
_STEP = 0.021  # metres between the points of a resampled piece, at most
_FILLET_STEPS = 8


def make_shaderball(segments: int = 256) -> Asset:
    """Return the shader ball, standing on z = 0, about 2.2 m high; u grows around each part's axis."""
    ball = revolve("/shaderball/body", _ball_profile(), segments, slot=0)
    base = revolve("/shaderball/base", _base_profile(), segments, slot=1)
    azimuth, tilt = np.radians(_OPENING_AZIMUTH), np.radians(90.0 - _OPENING_ELEVATION)
    placement = _rotation(2, azimuth) @ _rotation(1, tilt)
    placement[2, 3] = _BALL_HEIGHT
    instances = [Instance(0, placement), Instance(1, np.eye(4))]
    return make_asset("shaderball", [ball, base], instances, [Slot("/shaderball/body"), Slot("/shaderball/base")])


def _ball_profile() -> RevolvedProfile:
    """Return the ball's profile, from the pole at the back to the pole on the core.

    Its pieces are the unit sphere with the groove, then the rim, the recess and the core.
    """

    def at(latitude: float, radius: float = 1.0) -> ProfilePoint:
        """Return the profile point at a latitude in degrees, on a circle about the ball's centre."""
        return radius * np.cos(np.radians(latitude)), radius * np.sin(np.radians(latitude))

    core_radius, core_height, floor = 0.34, 0.46, 0.38
    # The core rises from the floor of the recess at the radius `seam`, and at this latitude about the core's centre.
    seam = float(np.sqrt(core_radius**2 - (floor - core_height) ** 2))
    seam_latitude = float(np.degrees(np.arctan2(floor - core_height, seam)))
    return _profile(
        [
            (_arc((0.0, 0.0), 1.0, -90.0, 10.0), 0.012),
            (np.array([at(10.0), at(10.4, 0.95)]), 0.012),
            (_arc((0.0, 0.0), 0.95, 10.4, 13.6), 0.012),
            (np.array([at(13.6, 0.95), at(14.0)]), 0.012),
            (_arc((0.0, 0.0), 1.0, 14.0, 51.0), 0.02),
            (np.array([at(51.0), at(51.5, 1.04)]), 0.012),
            (_arc((0.0, 0.0), 1.04, 51.5, 54.5), 0.012),
            (np.array([at(54.5, 1.04), (0.52, floor)]), 0.07),
            (np.array([(0.52, floor), (seam, floor)]), 0.02),
            (_arc((0.0, core_height), core_radius, seam_latitude, 90.0), 0.0),
        ]
    )


def _base_profile() -> RevolvedProfile:
    """Return the base's profile: a foot with a step, a concave neck and a collar, closed inside the ball."""
    cove = _arc((0.63, 0.235), 0.12, -100.0, -255.0)
    foot, neck = cove[0].tolist(), cove[-1].tolist()
    return _profile(
        [
            (np.array([(0.0, 0.0), (0.84, 0.0)]), 0.012),
            (np.array([(0.84, 0.0), (0.84, 0.06)]), 0.02),
            (np.array([(0.84, 0.06), (0.76, 0.075)]), 0.012),
            (np.array([(0.76, 0.075), (0.76, 0.115)]), 0.02),
            (np.array([(0.76, 0.115), foot]), 0.015),
            (cove, 0.008),
            (np.array([neck, (neck[0], 0.385)]), 0.008),
            (np.array([(neck[0], 0.385), (0.0, 0.385)]), 0.0),
        ]
    )


def _arc(center: ProfilePoint, radius: float, start: float, stop: float) -> Floats:
    """Return points (512, 2) along a circle, from the angle `start` to the angle `stop`, in degrees."""
    angles = np.radians(np.linspace(start, stop, 512))
    return np.asarray(center + radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1), np.float64)


def _profile(pieces: Sequence[tuple[Floats, float]]) -> RevolvedProfile:
    """Return the profile of pieces that are joined end to end; v grows with the length along the profile.

    `pieces` are pairs: the points (k, 2) of a piece, and the radius of the fillet at its end.
    """
    curves: list[Floats] = []
    head = 0.0  # the length at the start of the piece that the previous fillet replaces
    for (piece, radius), (following, _) in itertools.pairwise(pieces):
        fillet, cut = _fillet(piece, following, radius)
        curves += [_resample(piece, head, cut), fillet]
        head = cut
    curves.append(_resample(pieces[-1][0], head, 0.0))
    points = np.vstack([piece[:-1] for piece in curves] + [curves[-1][-1:]])
    points[[0, -1], 0] = 0.0
    return RevolvedProfile(points, _curve_normals(points), _arc_lengths(points) / _arc_lengths(points)[-1])


def _arc_lengths(points: Floats) -> Floats:
    """Return the length (k,) along a polyline from its start to each of its points (k, 2)."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def _points_at(piece: Floats, distances: Floats) -> Floats:
    """Return the points (n, 2) of a piece at distances (n,) along the piece from its start."""
    lengths = _arc_lengths(piece)
    return np.stack([np.interp(distances, lengths, piece[:, i]) for i in range(2)], axis=-1)


def _resample(piece: Floats, head: float, tail: float) -> Floats:
    """Resample a piece in even steps, without its first `head` and last `tail` metres."""
    length = _arc_lengths(piece)[-1] - head - tail
    assert length > 0.0, "fillets must fit on their piece"
    steps = max(2, int(np.ceil(length / _STEP)))
    return _points_at(piece, head + length * np.arange(steps + 1) / steps)


def _fillet(before: Floats, after: Floats, radius: float) -> tuple[Floats, float]:
    """Return the points (k, 2) of a fillet between two pieces, and the length that it replaces on each piece.

    The fillet is a rational quadratic Bézier curve with its control point in the corner. Between lines it is an arc of
    a circle. Between arcs of much larger radius, the tangents of fillet and arcs agree to a fraction of a degree.
    """
    corner = after[0]
    incoming, outgoing = before[-1] - before[-2], after[1] - after[0]
    turn = np.arccos(np.clip(incoming @ outgoing / np.linalg.norm(incoming) / np.linalg.norm(outgoing), -1.0, 1.0))
    cut = float(radius * np.tan(turn / 2.0))
    first = _points_at(before, _arc_lengths(before)[-1:] - cut)
    last = _points_at(after, np.array([cut]))
    t = np.linspace(0.0, 1.0, _FILLET_STEPS + 1)[:, None]
    weights = np.hstack([(1.0 - t) ** 2, 2.0 * np.cos(turn / 2.0) * t * (1.0 - t), t**2])
    return weights @ np.vstack([first, corner, last]) / weights.sum(axis=1, keepdims=True), cut


def _curve_normals(points: Floats) -> Floats:
    """Return unit normals (k, 2) on the right of a smooth curve, accurate to second order even with uneven steps."""
    legs = np.diff(points, axis=0)
    steps = np.linalg.norm(legs, axis=1, keepdims=True)
    directions = legs / steps
    inner = (directions[:-1] * steps[1:] + directions[1:] * steps[:-1]) / (steps[:-1] + steps[1:])
    tangents = np.vstack([[1.0, 0.0], inner, [-1.0, 0.0]])  # a smooth surface is level at its poles
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    return np.stack([tangents[:, 1], -tangents[:, 0]], axis=-1)


def _rotation(axis: int, angle: float) -> Floats:
    """Return the matrix (4, 4) of a rotation about coordinate axis 0, 1 or 2 by an angle in radians."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(4)
    matrix[[i, j], [i, j]] = np.cos(angle)
    matrix[i, j], matrix[j, i] = -np.sin(angle), np.sin(angle)
    return matrix
