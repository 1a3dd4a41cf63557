"""The camera of a pose, and a rectangle of the frame, as inputs of a kernel.

An input of a kernel is opaque to Dr.Jit, so the kernel need not be compiled again for another value.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr

from lookdev.arrays import Floats
from lookdev.mitsuba import sobol
from lookdev.mitsuba.geometry import Geometry
from lookdev.mitsuba.types import UV, AnyArray, Bool, Float, Mitsuba, Ray3f, UInt, Vector2f, Vector3f
from lookdev.rendering.adaptive import Region
from lookdev.scene import Camera, Pose


@dataclass(frozen=True, eq=False)
class KernelView:
    """The camera and the rotations of the lights in a pose. Points are relative to the centre of the geometry.

    The asset is fixed: the camera and the lights turn backwards instead.
    """

    origin: Vector3f  # the position of the camera
    right: Vector3f  # from the centre of the frame to its right edge, at depth 1
    up: Vector3f  # from the centre of the frame to its upper edge, at depth 1
    back: Vector3f  # from the centre of the frame, at depth 1, to the camera; a shift of the lens moves that centre
    turns: Vector2f  # rotations about z, radians: of lights that turn with the rig, and of all other lights
    width: int  # pixels
    height: int
    aperture: float  # diameter of the lens in metres; 0 for a pinhole
    focus: float  # depth of the plane in focus, metres
    near: float  # depth at which rays start, metres

    @classmethod
    def of(cls, mi: Mitsuba, camera: Camera, pose: Pose, resolution: tuple[int, int], center: Floats) -> KernelView:
        """Return the view of a pose (`lookdev.scene.Pose`); `center` (3,) is the centre of the geometry."""
        orbited = camera.orbit(-pose.element)
        right, up, back = orbited.frame
        width, height = resolution
        across, along = camera.half_width * right, camera.half_width * up
        shifted_back = back - 2.0 * camera.shift[0] * across - 2.0 * camera.shift[1] * along
        vectors = (orbited.position - center, across, along * height / width, shifted_back)
        opaque = [dr.opaque(mi.Float, float(x)) for vector in vectors for x in vector]
        angles = (math.radians(angle) for angle in (pose.lighting - pose.element, -pose.element))
        turns = mi.Vector2f(*(dr.opaque(mi.Float, angle) for angle in angles))
        lens = camera.lens
        aperture, focus = (lens.aperture, lens.focus) if lens else (0.0, 1.0)
        origin, right, up, back = (mi.Vector3f(*opaque[3 * i : 3 * i + 3]) for i in range(4))
        return cls(origin, right, up, back, turns, width, height, aperture, focus, camera.clip[0])

    def rays(self, mi: Mitsuba, x: Float, y: Float, u: Float, v: Float) -> Ray3f:
        """Return the rays through positions on the film, in pixels from the upper left; u and v sample the lens."""
        sx, sy = 2.0 * x / self.width - 1.0, 1.0 - 2.0 * y / self.height  # from -1 to 1 over the frame
        direction = sx * self.right + sy * self.up - self.back
        origin: AnyArray = mi.Point3f(self.origin)
        if self.aperture > 0.0:
            radius = 0.5 * self.aperture * dr.sqrt(u)
            s, c = dr.sincos(2.0 * math.pi * v)
            on_lens = radius * c * dr.normalize(self.right) + radius * s * dr.normalize(self.up)
            origin, direction = origin + on_lens, direction - on_lens / self.focus
        return mi.Ray3f(origin + self.near * direction, dr.normalize(direction))

    def first_hits(
        self, mi: Mitsuba, geometry: Geometry, pixel: UInt, index: UInt, scramble: UInt
    ) -> tuple[UInt, UV, Ray3f, Bool, Float]:
        """Trace camera rays of samples; return triangles, barycentric coordinates, rays, hit masks, and distances.

        pixel : the number of the pixel, row by row; index : the number of the sample in its pixel; scramble : the seed
        of the pixel's samples.
        """
        # The constants are arbitrary, so that the points on the pixel and on the lens are independent.
        u, v = sobol.points(mi.Float, index, sobol.hash_integers(scramble ^ 0x9E3779B9))
        on_lens = (
            sobol.points(mi.Float, index, sobol.hash_integers(scramble ^ 0x7F4A7C15))
            if self.aperture > 0.0
            else (0.0, 0.0)
        )
        row = pixel // self.width
        ray = self.rays(mi, mi.Float(pixel - row * self.width) + u, mi.Float(row) + v, *on_lens)
        triangle, uv, hit, distance = geometry.first_hit(ray)
        return triangle, uv, ray, hit, distance


@dataclass(frozen=True, eq=False)
class FramePart:
    """A rectangle of the frame, as inputs of a kernel: its upper left pixel, and its width in pixels."""

    left: UInt
    top: UInt
    width: UInt

    @classmethod
    def of(cls, mi: Mitsuba, region: Region) -> FramePart:
        """Return the rectangle of a region."""
        left, right = region.columns.start, region.columns.stop
        return cls(*(dr.opaque(mi.UInt32, number) for number in (left, region.rows.start, right - left)))
