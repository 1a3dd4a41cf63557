"""Dome light: an environment map at infinity, whose radiance is the same at every shading point.

The radiance is looked up bilinearly (`warp.lookup`). In NumPy, `Dome.sample` draws directions in proportion to the
radiance. The shader draws directions nearly in proportion to radiance times the cosine to the shading normal, with
three tables:

- `points`: directions that are distributed in proportion to the radiance, along a curve over the sphere.
- `bins`: groups of shading normals. The *widened cosine* of a bin replaces the cosine of its normals.
- `slots`: for each bin, ranges of consecutive points; all ranges of a bin have the same probability.

A sample draws a slot of the shading normal's bin, then a point of the slot. Slots and bins are array parameters of the
shader, because a look-up in a texture costs ten times as much (CPU, Blender 4.5). The points and the radiance are
textures: the points are too many for an array, and the radiance needs interpolation.

The shader reverses the bits of the sample number to get the slot's number. Any aligned block of 2^k sample numbers is
therefore spread evenly along the curve of the points, and so over the light. A converged picture is a quadrature over
all points. The expectation of this quadrature over the random choice of the points is the integral; docs/accuracy.md
states the error of one set of points.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from lookdev.arrays import Floats, Floats32, Ints32
from lookdev.cache import Content, cached_file, cached_files, load_cached_files
from lookdev.errors import EnvironmentMapError
from lookdev.light import native
from lookdev.light.base import CodedLight, LightCode
from lookdev.light.dome import bins, points, slots
from lookdev.light.dome.environment import EnvironmentMap, make_environment, map_in_space, read_exr, write_exr
from lookdev.light.dome.warp import BilinearWarp, lookup_towards
from lookdev.light.emission import WHITE, Emission
from lookdev.light.placement import WORLD_AXES, Axes, checked_axes, to_local, to_world
from lookdev.space import Color, Space

TABLE_VERSION = 4
"""The version of the tables, part of `Dome.map_digest`: raise it with any change to the content of the tables."""


@dataclass(frozen=True)
class Dome(CodedLight):
    """A dome light, with the files that the shader reads: its map of radiance, and tables if the shader samples it.

    `width` and `height` are the map's size in texels. `map_digest` identifies the map and its tables in the cache,
    and `constant` is whether all texels are equal. The map's directions are relative to `axes`. The emission's colour
    multiplies the map. `sample` draws directions in proportion to the mean of the map's channels, or uniformly if the
    map is black.
    """

    kind = "dome"

    radiance_file: Content
    points_file: Content | None
    slots_file: Content | None
    bins_file: Content | None
    width: int
    height: int
    map_digest: str
    constant: bool = False
    axes: Axes = WORLD_AXES
    emission: Emission = WHITE

    def __post_init__(self) -> None:
        checked_axes(self.axes)
        if self.emission.falloff is not None or self.emission.shaping is not None:
            raise EnvironmentMapError("a dome light has neither falloff nor shaping: it is all around, infinitely far")

    @property
    def digest(self) -> str:
        axes_and_emission = (self.axes, self.emission.without_names)
        if axes_and_emission == (WORLD_AXES, WHITE):
            return self.map_digest
        return hashlib.sha256(f"{self.map_digest} {axes_and_emission!r}".encode()).hexdigest()

    @property
    def map_dome(self) -> Dome:
        return self

    @property
    def emitted_radiance(self) -> Color:
        if not self.constant:
            return self.emission.color
        r, g, b = self.radiance(np.zeros(3), np.array((0.0, 0.0, 1.0))).tolist()
        return r, g, b

    def _convert(self, space: Space) -> Dome:
        return self.convert_map(space, local=False)

    def convert_map(self, space: Space, *, local: bool) -> Dome:
        """Return the dome in a colour space, with the emission's colour multiplied into the map.

        `local` is the argument of `prepare_light`.
        """
        converted = map_in_space(self.table, self.emission.color, self.map_digest, space)
        emission = replace(self.emission.in_space(space), color=WHITE.color)
        return replace(prepare_light(converted, local=local), axes=self.axes, emission=emission)

    def native_gap(self) -> str | None:
        return native.missing_features(self.emission, "camera")

    @property
    def native_images(self) -> tuple[Content, ...]:
        return (self.radiance_file,)

    @cached_property
    def table(self) -> Floats:
        """The map's radiance (H, W, 3), row 0 at the zenith; EnvironmentMapError if its file is missing or broken."""
        return read_exr(self.radiance_file.path, "RGB").astype(np.float64)

    @cached_property
    def _warp(self) -> BilinearWarp:
        return BilinearWarp(self.table.mean(axis=-1))

    def radiance(self, point: Floats, direction: Floats) -> Floats:
        return np.asarray(lookup_towards(self.table, to_local(self.axes, direction)) * np.array(self.emission.color))

    def pdf(self, point: Floats, direction: Floats) -> Floats:
        return self._warp.pdf(to_local(self.axes, direction))

    def sample(self, point: Floats, u: Floats) -> Floats:
        return to_world(self.axes, self._warp.draw_directions(u))

    def code(self, *, sampled: bool) -> LightCode:
        constants = {"WIDTH": self.width, "HEIGHT": self.height}
        lines = tuple(f"#define DOME_{name} {value}" for name, value in constants.items())
        parameters, arrays = self.files("dome", sampled=sampled)
        return LightCode((*lines, *self.table_constants()), parameters, arrays)

    @staticmethod
    def table_constants() -> tuple[str, ...]:
        """Return the preprocessor lines with the sizes of the tables, which all domes share."""
        constants = {
            "SLOTS": slots.SLOTS,
            "SLOTS_SHIFT": 33 - slots.SLOTS.bit_length(),  # from 32 bits to the bits of a slot's number
            "CODE_BITS": slots.CODE_BITS,
            "MOST_POINTS": slots.MOST_POINTS,
            "ALL": bins.COUNT,  # the number of the additional bin, for all directions
            "ALL_SLOTS": (bins.COUNT + 1) * slots.SLOTS,
            "BIN_NUMBERS": 2 * (bins.COUNT + 1),
            "ROWS": bins.ROWS,
            "CELLS": f"{{{', '.join(map(str, bins.CELLS))}}}",
            "FIRST": f"{{{', '.join(map(str, bins.FIRST))}}}",
            "COS_RADIUS": repr(math.cos(bins.RADIUS)),
            "SIN_RADIUS": repr(math.sin(bins.RADIUS)),
        }
        return tuple(f"#define DOME_{name} {value}" for name, value in constants.items())

    def files(self, name: str, *, sampled: bool) -> tuple[dict[str, Content], dict[str, Content]]:
        """Return the files that a shader reads as textures, and those that it reads as arrays.

        The keys of both are names of shader parameters, which begin with `name`.
        """
        textures, arrays = {f"{name}_radiance": self.radiance_file}, {}
        if sampled:
            assert self.points_file and self.slots_file and self.bins_file  # noqa: PT018
            textures[f"{name}_points"] = self.points_file
            arrays = {f"{name}_slots": self.slots_file, f"{name}_bins": self.bins_file}
        return textures, arrays


def prepare_light(env: EnvironmentMap, *, sampled: bool = True, local: bool = False) -> Dome:
    """Return the dome light of a map, and write its files to the cache unless the cache has them.

    Without `sampled`, the tables with which a shader draws directions are not made: NumPy and Cycles' world need none.
    A constant map needs none either, unless the dome is part of a `LocalDome`, which `local` states.

    Raises
    ------
    OutputError
        The files cannot be written.
    """
    digest = hashlib.sha256(f"{env.digest} light tables {TABLE_VERSION}".encode()).hexdigest()
    height, width = env.radiance.shape[:2]

    def write_table(table: Ints32 | Floats32) -> Content:
        return Content.store_written(".npy", lambda path: np.save(path, table))

    def write_tables() -> tuple[Content, ...]:
        radiance = env.radiance.astype(np.float64)
        warp = BilinearWarp(radiance.mean(axis=-1))
        pixels, directions = points.draw_points(radiance, warp, points.SIDE)
        slot_table, bin_table = slots.cut_slots(directions, warp.integral)
        # Compression would save a quarter of 16 MB, and delay every start of a render by 0.1 s.
        texture = pixels.reshape(points.SIDE, points.SIDE, 4)
        points_file = Content.store_written(".exr", lambda path: write_exr(path, "RGBA", texture, compressed=False))
        return points_file, write_table(slot_table), write_table(bin_table)

    write_radiance = partial(write_exr, channels="RGB", values=env.radiance)
    radiance_file = cached_file("ibl", f"{digest}.radiance", ".exr", write_radiance)
    points_file = slots_file = bins_file = None
    if sampled and (local or not env.is_constant):
        points_file, slots_file, bins_file = cached_files("ibl", f"{digest}.tables", write_tables)
    return Dome(radiance_file, points_file, slots_file, bins_file, width, height, digest, env.is_constant)


def load_cached_dome(digest: str, width: int, height: int, constant: bool, sampled: bool) -> Dome | None:
    """Return the dome whose files `prepare_light` has written for a `map_digest`; None if a file is missing."""
    radiance = load_cached_files("ibl", f"{digest}.radiance")
    tables = () if constant or not sampled else load_cached_files("ibl", f"{digest}.tables")
    if radiance is None or tables is None:
        return None
    points_file, slots_file, bins_file = tables or (None, None, None)
    return Dome(radiance[0], points_file, slots_file, bins_file, width, height, digest, constant)


def example_map() -> EnvironmentMap:
    """Return a small map of a dim sky with a broad sun and a black ground."""
    radiance = np.full((16, 32, 3), (0.2, 0.3, 0.5))
    radiance[3:6, 9:13], radiance[12:] = (9.0, 7.0, 4.0), 0.0
    return make_environment("example", radiance)


def example_dome() -> Dome:
    """Return the dome light of `example_map`."""
    return prepare_light(example_map())
