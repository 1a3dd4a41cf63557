"""A dome light on Dr.Jit's arrays: radiance of directions, and sampling of directions.

Both work as in `lookdev/shaders/dome.osl.h`, and read the same tables: the files of `lookdev.light.dome`. Its modules
`bins` and `slots` define these terms:

- A bin is a set of similar shading normals. Each bin has a sampling distribution of its own.
- The distribution draws one of the dome's points, which are fixed directions, denser where the radiance is greater.
- A slot is a range of consecutive points. A bin has M slots of nearly equal probability, of which one is drawn.
- g is the widened cosine: the largest cosine between a direction and the normals of a cone that contains the bin.
- p is the pdf of the drawn directions. q is the pdf that p approximates: g times the mean of the radiance's channels,
  normalised. q needs no table.
"""

from __future__ import annotations

import math

import drjit as dr
import numpy as np

from lookdev.light.dome import Dome, bins, slots
from lookdev.light.dome.environment import read_exr
from lookdev.mitsuba import sobol
from lookdev.mitsuba.files import file_array, pad_to_rgba
from lookdev.mitsuba.frozen import device_array
from lookdev.mitsuba.types import Bool, Color3f, Float, Mitsuba, UInt, Vector3f


class DomeLight:
    """The radiance map of a dome light in a variant's arrays. Directions are in the dome's own axes.

    A `local` dome has a finite radius. `sampled` says whether directions are drawn by tables. It is false for a
    constant map that is not local.
    """

    def __init__(self, mi: Mitsuba, dome: Dome, *, local: bool = False) -> None:
        self._mi = mi
        self.number = mi.Float  # the type of numbers
        self.sampled = dome.slots_file is not None and not (dome.constant and not local)
        self._texels = file_array(mi.Float, dome.radiance_file, lambda path: pad_to_rgba(read_exr(path, "RGB")))
        self._width, self._height = dome.width, dome.height
        if self.sampled:
            assert dome.points_file and dome.slots_file and dome.bins_file  # noqa: PT018
            self._points = file_array(mi.Float, dome.points_file, lambda path: read_exr(path, "RGBA"))
            self._slots = file_array(mi.UInt32, dome.slots_file, lambda path: np.load(path).view(np.uint32))
            self._bins = file_array(mi.Float, dome.bins_file, np.load)
            # The number of cells in each row of bins, and the number of the row's first bin.
            self._cells, self._first = device_array(mi.UInt32, bins.CELLS), device_array(mi.UInt32, bins.FIRST)

    def radiance(self, w: Vector3f, active: Bool) -> Color3f:
        """Return the radiance from directions: interpolated bilinearly, periodic in azimuth, clamped at the poles."""
        mi = self._mi
        x = 0.5 - dr.atan2(w.y, w.x) / (2.0 * math.pi)
        y = dr.atan2(dr.sqrt(w.x * w.x + w.y * w.y), w.z) / math.pi
        column, row = x * self._width - 0.5, dr.clip(y * self._height - 0.5, 0.0, self._height - 1.0)
        i, j = dr.floor(column), dr.floor(row)
        s, t = column - i, row - j
        left, right = (mi.UInt32((mi.Int32(i) + 2 * self._width + k) % self._width) for k in (0, 1))
        top = mi.UInt32(j)
        bottom = dr.minimum(top + 1, self._height - 1)

        def texel(row: UInt, column: UInt) -> Color3f:
            """Return the radiance of texels."""
            rgba = dr.gather(mi.Vector4f, self._texels.array, row * self._width + column, active)
            return mi.Color3f(rgba.x, rgba.y, rgba.z)

        above = dr.lerp(texel(top, left), texel(top, right), s)
        below = dr.lerp(texel(bottom, left), texel(bottom, right), s)
        return dr.lerp(above, below, t)

    def bin(self, n: Vector3f) -> NormalBin:
        """Return the bins that contain normals. Bins are cells in rows of latitude (`lookdev.light.dome.bins`)."""
        mi = self._mi
        row = mi.UInt32(dr.clip(dr.acos(dr.clip(n.z, -1.0, 1.0)) * (bins.ROWS / math.pi), 0, bins.ROWS - 1))
        cells = dr.gather(mi.UInt32, self._cells, row)
        around = dr.atan2(n.y, n.x) / (2.0 * math.pi)
        cell = dr.minimum(mi.UInt32((around - dr.floor(around)) * mi.Float(cells)), cells - 1)
        azimuth = 2.0 * math.pi * (mi.Float(cell) + 0.5) / mi.Float(cells)
        theta = math.pi * (mi.Float(row) + 0.5) / bins.ROWS
        (s, c), (sine, cosine) = dr.sincos(azimuth), dr.sincos(theta)
        number = dr.gather(mi.UInt32, self._first, row) + cell
        numbers = dr.gather(mi.Vector2f, self._bins.array, number)
        return NormalBin(self, number, mi.Vector3f(sine * c, sine * s, cosine), numbers.x, numbers.y)

    @property
    def all_around(self) -> NormalBin:
        """The bin of all normals, for local domes: at a point, light does not come from the map's own directions."""
        mi = self._mi
        numbers = dr.gather(mi.Vector2f, self._bins.array, mi.UInt32(bins.COUNT))
        return NormalBin(self, mi.UInt32(bins.COUNT), None, numbers.x, numbers.y)


class NormalBin:
    """A bin of normals, from which directions are drawn.

    Parameters
    ----------
    number, axis
        Its number, and the direction at its centre. The bin of all normals has no axis.
    scale
        1 over the integral, over the sphere, of g times the mean of the radiance's channels; 0 where no light arrives.
    share
        M / sum(g), for M slots and the sum over all points.
    """

    def __init__(self, light: DomeLight, number: UInt, axis: Vector3f | None, scale: Float, share: Float) -> None:
        self._light = light
        self._number = number
        self._axis = axis
        self.scale = scale
        self._share = share

    def pdf(self, w: Vector3f, radiance: Color3f) -> Float:
        """Return the pdf q over solid angle of directions `w` with a radiance, for weights of importance sampling."""
        return self.scale * self._widened_cosine(w) * dr.mean(radiance)

    def draw_numbered(self, number: UInt, seed: UInt, active: Bool) -> tuple[Vector3f, Color3f, Float]:
        """Return the direction of a numbered sample, its radiance, and q / p, which is 0 where no direction is drawn.

        The points lie along a curve on the sphere. The bits of the number are reversed to select the slot, so that
        consecutive samples are far apart on this curve.
        """
        kind = self._light.number
        # The constants are arbitrary odd numbers, so that this random number differs from others of the seed.
        u = sobol.random(kind, seed ^ (number * 0x2C1B3C6D + 0x297A2D39))
        # The slot is the upper log2(SLOTS) bits of the reversed number.
        return self._sample(dr.brev(number) >> (33 - slots.SLOTS.bit_length()), u, active)

    def draw_uniform(self, u1: Float, u2: Float, active: Bool) -> tuple[Vector3f, Color3f, Float]:
        """Return a direction, its radiance and q / p as `draw_numbered`, from two uniform numbers in [0, 1)."""
        slot = dr.minimum(dr.uint32_array_t(self._light.number)(u1 * slots.SLOTS), slots.SLOTS - 1)
        return self._sample(slot, u2, active)

    def _sample(self, slot: UInt, u: Float, active: Bool) -> tuple[Vector3f, Color3f, Float]:
        """Return one of the points of a slot, its radiance, and q / p; `u` in [0, 1) selects the point.

        An entry of the table of slots has the number of the slot's first point and a code. The code is the number of
        points, or the number of slots that a single point fills (`lookdev.light.dome.slots.pack_ranges`). A point has
        an azimuth, the cosine of its polar angle, the mean m of its radiance's channels, and the shares of red and
        green in 3 m. These shares are in units of 1 / 4095 and packed into one number.
        """
        light = self._light
        mi = light._mi
        packed = dr.gather(mi.UInt32, light._slots.array, self._number * slots.SLOTS + slot, active)
        code = packed & ((1 << slots.CODE_BITS) - 1)
        single = code > slots.MOST_POINTS
        count = dr.select(single, 1, code)
        times = dr.select(single, code - slots.MOST_POINTS + 1, 1)
        point = (packed >> slots.CODE_BITS) + dr.minimum(mi.UInt32(mi.Float(count) * u), dr.maximum(count, 1) - 1)
        values = dr.gather(mi.Vector4f, light._points.array, point, active)
        s, c = dr.sincos(values.x)
        horizontal = dr.safe_sqrt(1.0 - values.y * values.y)
        w = mi.Vector3f(horizontal * c, horizontal * s, values.y)
        red = dr.floor(values.w / 4096.0)
        green = values.w - 4096.0 * red
        color = mi.Color3f(red, green, dr.maximum(4095.0 - red - green, 0.0)) * (3.0 / 4095.0 * values.z)
        ratio = self._share * mi.Float(count) / mi.Float(times) * self._widened_cosine(w)
        return w, color, dr.select(code > 0, ratio, 0.0)

    def _widened_cosine(self, w: Vector3f) -> Float | float:
        """Return g: the cosine between directions and the nearest direction in the bin's cone, at least 0."""
        if self._axis is None:
            return 1.0
        cosine = dr.dot(w, self._axis)
        near, far = math.cos(bins.RADIUS), math.sin(bins.RADIUS)
        rotated = dr.maximum(near * cosine + far * dr.safe_sqrt(1.0 - cosine * cosine), 0.0)
        return dr.select(cosine > near, 1.0, rotated)
