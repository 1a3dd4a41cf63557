"""The camera of a scene and its rays, and the rotations of asset and light in a frame of a turntable."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from lookdev.arrays import Floats


@dataclass(frozen=True, order=True)
class Pose:
    """The rotations of the asset (`element`) and of the light (`lighting`) about the world's z axis.

    Angles are in degrees in [0, 360). Renderers apply equivalent rotations that keep acceleration structures and
    importance maps valid. With generated OSL, the asset is fixed, the camera orbits by ``-element`` and the light turns
    by ``lighting - element``. With Cycles' own lights, the light is fixed, the asset turns by ``element - lighting``
    and the camera orbits by ``-lighting``.
    """

    element: float
    lighting: float


@dataclass(frozen=True)
class Lens:
    """A thin lens: points at depth `focus` are sharp; `aperture` is the lens's diameter. Both are in metres."""

    aperture: float
    focus: float


@dataclass(frozen=True)
class Camera:
    """A perspective camera that looks at `target` from `distance`; `fov` is the horizontal angle of view.

    Angles are in degrees, lengths in metres. As seen from the target, the unrotated camera is at the azimuth `azimuth`
    - 90 degrees, at the angle `elevation` above the horizon. With azimuth 0 it is on the side of -y and looks along +y.
    `roll` rotates the camera about its line of sight, counter-clockwise as the camera sees the world. The camera orbits
    the vertical axis through `axis` (x, y), or through `target` if `axis` is None. `shift` moves the frame to the right
    and up over the image, in widths of the frame. Without a `lens`, the camera is a pinhole camera.
    """

    fov: float
    elevation: float
    target: tuple[float, float, float]
    distance: float
    azimuth: float = 0.0
    roll: float = 0.0
    axis: tuple[float, float] | None = None
    shift: tuple[float, float] = (0.0, 0.0)
    lens: Lens | None = None

    @property
    def pivot(self) -> tuple[float, float]:
        """The x and y of the vertical axis that the camera orbits."""
        return self.target[:2] if self.axis is None else self.axis

    @property
    def clip(self) -> tuple[float, float]:
        """The smallest and the largest visible depth, in metres."""
        return 1e-3 * self.distance, 1e3 * self.distance

    @property
    def half_width(self) -> float:
        """Half the width of the frame at depth 1: the tangent of half the angle of view."""
        return math.tan(math.radians(self.fov) / 2.0)

    @property
    def frame(self) -> Floats:
        """The camera's unit vectors to the right, up and backwards in the world, as the rows of a matrix (3, 3)."""
        azimuth, elevation = math.radians(self.azimuth - 90.0), math.radians(self.elevation)
        right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
        level, raised = math.cos(elevation), math.sin(elevation)
        back = np.array([level * math.cos(azimuth), level * math.sin(azimuth), raised])
        up = np.cross(back, right)
        sine, cosine = math.sin(math.radians(self.roll)), math.cos(math.radians(self.roll))
        return np.stack([cosine * right + sine * up, cosine * up - sine * right, back])

    @property
    def position(self) -> Floats:
        """The point of view, (3,)."""
        return np.asarray(np.array(self.target) + self.distance * self.frame[2])

    def orbit(self, degrees: float) -> Self:
        """Return the camera after it has orbited its axis, counter-clockwise seen from above."""
        (x, y), turn = self.pivot, math.radians(degrees)
        dx, dy = self.target[0] - x, self.target[1] - y
        sine, cosine = math.sin(turn), math.cos(turn)
        target = (x + cosine * dx - sine * dy, y + sine * dx + cosine * dy, self.target[2])
        return replace(self, target=target, axis=(x, y), azimuth=self.azimuth + degrees)

    def move(self, offset: tuple[float, float, float]) -> Self:
        """Return the camera, with the axis of its orbit, moved by an offset in metres."""
        (x, y), (dx, dy, dz) = self.pivot, offset
        target = (self.target[0] + dx, self.target[1] + dy, self.target[2] + dz)
        return replace(self, target=target, axis=(x + dx, y + dy))


def camera_rays(
    camera: Camera, pose: Pose, resolution: tuple[int, int], x: ArrayLike, y: ArrayLike, u: Floats | None = None
) -> tuple[Floats, Floats]:
    """Return the origins and the unit directions (..., 3) of the rays through points of the frame.

    `x` and `y` (...) are in pixels from the upper left corner. For a thin lens, `u` (..., 2) has points of the unit
    square, which are mapped to the points where the rays leave the lens. Without `u`, and for a pinhole camera, all
    rays have the same origin, (3,).
    """
    orbited = camera.orbit(-pose.element)
    right, up, back = orbited.frame
    width, height = resolution
    shift_x, shift_y = camera.shift
    # The offsets to the right and up, at depth 1, from the camera's axis.
    sx = (2.0 * np.asarray(x, dtype=np.float64) / width - 1.0 + 2.0 * shift_x) * camera.half_width
    sy = ((1.0 - 2.0 * np.asarray(y, dtype=np.float64) / height) * height / width + 2.0 * shift_y) * camera.half_width
    direction = -back + sx[..., None] * right + sy[..., None] * up
    origin = orbited.position
    if camera.lens is not None and u is not None:
        radius, angle = 0.5 * camera.lens.aperture * np.sqrt(u[..., 0]), 2.0 * np.pi * u[..., 1]
        lens_offset = (radius * np.cos(angle))[..., None] * right + (radius * np.sin(angle))[..., None] * up
        # All rays through one point of the frame meet in the plane of focus.
        origin, direction = origin + lens_offset, direction - lens_offset / camera.lens.focus
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    return origin, direction
