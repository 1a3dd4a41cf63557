"""Cameras that frame an asset: `frame_fill` by the region that it covers while it turns, `frame_camera` by its sphere.

All frames of a turntable have the same camera, so that the asset's size is constant.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from lookdev.arrays import Floats
from lookdev.asset.bounds import turning_axis
from lookdev.errors import AssetError
from lookdev.scene.camera import Camera

Arc = tuple[float, float]
"""A range of rotation angles of an asset, in degrees: the first angle, and the signed angle from it to the last."""

DEFAULT_FOV = math.degrees(2.0 * math.atan(36.0 / (2.0 * 50.0)))
"""Horizontal angle of view, degrees, of a 50 mm lens with a 36 mm wide sensor."""

DEFAULT_FILL = 0.7
"""The fraction of the frame's width or height that the turning asset fills."""

FULL_TURN: tuple[Arc, ...] = ((0.0, 360.0),)

_STEPS = 100
"""The maximum number of Newton steps; about five are usual."""

_MIN_GAP = 1e-4
"""The minimum distance of the camera from the asset, relative to the asset's depth.

Without it, the camera would touch a needle that points at it.
"""


def frame_camera(
    center: tuple[float, float, float],
    radius: float,
    resolution: tuple[float, float],
    *,
    fov: float = DEFAULT_FOV,
    elevation: float = 10.0,
    margin: float = 1.1,
) -> Camera:
    """Return a camera whose frame just contains the bounding sphere of an asset, enlarged by `margin`.

    The camera's distance is ``radius margin / sin(half)``, where `half` is half the smaller of the two angles of view.

    Parameters
    ----------
    center, radius
        The asset's bounding sphere in world space, in metres.
    resolution
        The width and height of the frame in (square) pixels.
    fov, elevation
        The horizontal angle of view, and the camera's angle above the horizon, in degrees.
    margin
        A factor of the radius.

    Raises
    ------
    AssetError
        The radius is not finite and positive.
    """
    if not (math.isfinite(radius) and radius > 0.0):
        raise AssetError(f"the asset's bounding radius is {radius} m: it must have a finite, positive size")
    width, height = resolution
    half_width = math.radians(fov) / 2.0
    half_height = math.atan(math.tan(half_width) * height / width)
    x, y, z = map(float, center)
    return Camera(fov, elevation, (x, y, z), float(radius) * margin / math.sin(min(half_width, half_height)))


def frame_fill(
    points: Floats,
    resolution: tuple[float, float],
    *,
    fov: float = DEFAULT_FOV,
    elevation: float = 10.0,
    fill: float = DEFAULT_FILL,
    arcs: Sequence[Arc] = FULL_TURN,
) -> Camera:
    """Return a camera in whose frame the turning asset fills the fraction `fill` of the width or the height.

    The asset turns about its `turning_axis`. The union of its silhouettes at all angles of the arcs fills the fraction
    `fill` of the frame's width or of its height, whichever is reached first. It is centred in the frame.

    The distance follows from planes through the camera that touch the asset. Let x be to the right, y up, and z towards
    the camera, relative to a point of the axis, and let the camera be at (a, b, d). A point is between the two planes
    through the camera with slopes ±t to the right and left if ``±(x - a) <= t (d - z)``. This is linear in the point,
    so it holds for all points if ``S(±1, 0, t) <= ±a + t d``, with their support function ``S(v) = max v.(x, y, z)``.
    The planes touch on both sides if ``d = (S(1, 0, t) + S(-1, 0, t)) / 2t`` and
    ``a = (S(1, 0, t) - S(-1, 0, t)) / 2``. The same holds up and down, with b for a. The camera's d is the greater of
    the two distances. In the other direction, planes of a smaller slope touch on both sides.

    Parameters
    ----------
    points : (n, 3)
        The `outline` of the asset in world space, in metres, or the outlines of several assets.
    resolution
        The width and height of the frame in (square) pixels.
    fov, elevation
        The horizontal angle of view, and the camera's angle above the horizon, in degrees.
    fill
        The fraction of the frame's width or height.
    arcs
        The angles to which the asset turns, as `Pose.element`.

    Raises
    ------
    AssetError
        The points are not finite, or all equal.
    """
    columns = np.ascontiguousarray(points.T)
    size = float(np.ptp(columns, axis=1).max()) if len(points) else 0.0
    if not (math.isfinite(size) and size > 0.0):
        raise AssetError(f"the asset is {size} m large: it must have a finite, positive size")
    axis = turning_axis(points)
    base = np.array([*axis, 0.5 * (columns[2].min() + columns[2].max())])
    unit_camera = Camera(fov, elevation, (0.0, 0.0, 0.0), 1.0)
    frame = unit_camera.frame
    farthest_point = _farthest_point_function((columns - base[:, None]).T, arcs)

    def support_values(direction: int, slope: float) -> tuple[float, float, float]:
        """Return S on both sides and the derivative of their sum by the slope; direction 0 is along x, 1 along y."""
        normals = np.array([[direction == 0, direction == 1, slope]] * 2, np.float64)
        normals[1, :2] *= -1.0
        ahead, behind = (farthest_point(normal @ frame) @ frame.T for normal in normals)
        return float(ahead @ normals[0]), float(behind @ normals[1]), float(ahead[2] + behind[2])

    width, height = resolution
    slopes = fill * unit_camera.half_width, fill * unit_camera.half_width * height / width
    nearest, farthest = float(farthest_point(frame[2]) @ frame[2]), float(farthest_point(-frame[2]) @ frame[2])
    depth = max(sum(support_values(direction, slope)[:2]) / (2.0 * slope) for direction, slope in enumerate(slopes))
    depth = max(depth, nearest + _MIN_GAP * (nearest - farthest))
    offset = []
    for direction, max_slope in enumerate(slopes):
        # S(v) + S(-v) - 2 t d is convex in t and falls, so that Newton's steps from 0 never pass its zero.
        slope = 0.0
        for _ in range(_STEPS):
            ahead, behind, growth = support_values(direction, slope)
            step = (ahead + behind - 2.0 * slope * depth) / (2.0 * depth - growth)
            if step <= 1e-12 * slope:
                break
            slope = min(slope + step, max_slope)
        offset.append(0.5 * (ahead - behind))
    # The target is between the nearest and the farthest point, so that both are well within the camera's clip range.
    distance = math.sqrt((depth - nearest) * (depth - farthest))
    target = base + np.array([*offset, depth - distance]) @ frame
    # Numbers are rounded, so that frames have the same digest on every machine.
    digits = 9 - math.floor(math.log10(distance))
    x, y, z = np.round(target, digits).tolist()
    return Camera(fov, elevation, (x, y, z), round(distance, digits), axis=axis)


def _farthest_point_function(points: Floats, arcs: Sequence[Arc]) -> Callable[[Floats], Floats]:
    """Return a function that maps a direction to the farthest point along it, of points (n, 3) at all angles of arcs.

    The points turn about the z axis. Let r be the distance of a point from the axis, and psi the angle about the axis
    from the point to a direction w. After a turn by t, the point's dot product with w is
    ``r |w_xy| cos(psi - t) + z w_z``. In an arc of t from 0 to s, it is greatest at t = psi if psi is in the arc, which
    means ``cos(psi - s/2) >= cos(s/2)``. Otherwise it is greatest at one of the ends.
    """
    radius, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    ranges = [(math.radians(min(start, start + sweep)), math.radians(abs(sweep))) for start, sweep in arcs]
    is_full_turn = any(sweep >= 2.0 * math.pi for _, sweep in ranges)
    ranges = ranges[:1] if is_full_turn else ranges

    def farthest_of_arc(w: Floats, start: float, sweep: float) -> Iterator[Floats]:
        """Yield the farthest point along w at each end of an arc, and in between if psi is in the arc."""
        horizontal_length = math.hypot(w[0], w[1])
        for end in () if is_full_turn else dict.fromkeys((start, start + sweep)):
            turn = _rotation_about_z(end)
            yield turn @ points[(points @ (w @ turn)).argmax()]
        if is_full_turn or sweep > 0.0:
            values = horizontal_length * radius + w[2] * z
            if not is_full_turn:
                half = points @ (w * [1.0, 1.0, 0.0] @ _rotation_about_z(start + 0.5 * sweep))
                # Points whose psi is not in the arc are excluded.
                values[half < horizontal_length * math.cos(0.5 * sweep) * radius] = -np.inf
            best = int(values.argmax())
            if values[best] > -np.inf:
                along = w[:2] / horizontal_length if horizontal_length > 0.0 else np.array([1.0, 0.0])
                yield np.array([*(radius[best] * along), z[best]])

    def farthest_point(w: Floats) -> Floats:
        return max((point for arc in ranges for point in farthest_of_arc(w, *arc)), key=lambda point: float(point @ w))

    return farthest_point


def _rotation_about_z(angle: float) -> Floats:
    """Return the matrix (3, 3) of a rotation about the z axis."""
    sine, cosine = math.sin(angle), math.cos(angle)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
