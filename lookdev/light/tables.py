"""Importance sampling of an environment map: what the shader looks up, and the same in float64.

The design
----------
Radiance is looked up bilinearly: texel centres at ((i + 1/2) / W, (j + 1/2) / H), periodic along a row,
clamped over rows; row j counts from the top of the image, at ``v = 1 - (j + 1/2) / H``.

A point of a surface with normal n wants directions in proportion to radiance times cosine.

1. *Points*: N directions in proportion to m, the mean of the channels of the radiance (`warp`), one from each cell of
   a square grid of their random numbers, in the order of a Hilbert curve through that grid.
2. Normals are put into `bins`. For each bin the curve is cut into M *slots*, ranges of points with as nearly as can be
   the same sum of g, the bin's widened cosine. A sample is a slot, each as probable, and in it a point, each as
   probable: it has the probability 1 / (M c), where c is the count of its slot (times the number of slots that a point
   fills which outweighs one).
3. That is nearly the density q = m g / integral, which needs no table. q weighs a sample against others (multiple
   importance sampling); what is left is the factor q / p = g M c / sum(g), close to 1.

Slots and bins are arrays in the shader: a look-up in a texture costs ten times as much (CPU, Blender 4.5). The points
are too many for that; radiance wants to be interpolated.

The shader takes slots by numbers whose bits are reversed: any aligned block of 2^k numbers is spread evenly along the
curve, and so over the light. A picture that has converged is a quadrature with N points: over the choice of their
random numbers it is right, and for those that there are, it is off by what docs/accuracy.md says.

The files
---------
``*.radiance.exr``: R, G, B radiance.
``*.points.exr``, 1024 x 1024: point n is pixel (n mod 1024, n div 1024). R = azimuth, radians; G = z; B = m; A = the
colour, two integers of 12 bits: red and green, in parts of 3 m.
``*.slots.npy``: slot n of bin b is integer b M + n, `packed`.
``*.bins.npy``: two numbers for each bin, 1 / integral, 0 where no light reaches it, and M / sum(g).
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np
import OpenEXR
from numpy.typing import ArrayLike, NDArray
from scipy.stats import qmc

from lookdev.cache import Content, atomic_path, cache_dir
from lookdev.errors import EnvironmentMapError
from lookdev.light import bins
from lookdev.light.environment import EnvironmentMap
from lookdev.light.mapping import uv_to_direction
from lookdev.light.warp import BilinearWarp, lookup, lookup_towards

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TABLE_VERSION = 3  # part of the digest: raise it with any change to what the tables hold
POINTS_SIDE = 1024
"""Of the grid of random numbers, and of the file: N is its square."""

SLOTS = 2**12
"""Of each bin, M."""

MOST_POINTS = 3583
"""The largest count of a slot that `packed` has a code for."""

CODE_BITS = 12
"""Of a packed slot; above them is its first point."""

_MOST_TIMES = 2**CODE_BITS - MOST_POINTS
# No point counts for less than the mass of a slot over this: no slot has more than `MOST_POINTS` then.
_FEW_POINTS = 2300
_TILE_SIDE = 4096

COLOR_STEPS = 4095
"""The largest of the 12-bit integers."""

SOBOL_SEED = 20120808


@dataclass(frozen=True)
class LightTables:
    """The files of an environment map prepared for the shader; see the module.

    `digest` names the content. Where the same radiance comes from everywhere, it is `constant`, and `radiance` is all
    that there is: nothing is sampled by it, and the other files are None.
    """

    kind: ClassVar[str] = "dome"

    radiance: Content
    points: Content | None
    slots: Content | None
    bins: Content | None
    width: int
    height: int
    digest: str
    constant: bool = False


@dataclass(frozen=True, eq=False)
class LightDistribution:
    """The light in float64, from the very texels that the shader looks up, and its own sampling, over the sphere.

    `table` (H, W, 3) is its radiance.
    """

    table: Floats

    @cached_property
    def _mean(self) -> Floats:
        return np.asarray(self.table.mean(axis=-1))

    @cached_property
    def _warp(self) -> BilinearWarp:
        return BilinearWarp(self._mean)

    @property
    def is_black(self) -> bool:
        """Whether no light comes from anywhere."""
        return not self.table.any()

    @property
    def is_constant(self) -> bool:
        """Whether the same radiance comes from everywhere: sampling by the light is then pointless."""
        return bool((self.table == self.table[0, 0]).all())

    def radiance(self, direction: ArrayLike) -> Floats:
        """Radiance (..., 3) that arrives from unit directions (..., 3), linear Rec.709."""
        return lookup_towards(self.table, direction)

    def pdf(self, direction: ArrayLike) -> Floats:
        """Density (...) per steradian with which `sample` gives unit directions (..., 3)."""
        if self.is_black:
            return np.full(np.shape(direction)[:-1], 0.25 / np.pi)
        return np.asarray(self.radiance(direction).mean(axis=-1) / self._warp.integral)

    def sample(self, u: ArrayLike) -> Floats:
        """Map uniform points (N, 2) to unit directions (N, 3) towards the light."""
        return _directions(self._warp.places(u))

    @property
    def integral(self) -> float:
        """The mean of the channels of the radiance, integrated over the sphere."""
        return self._warp.integral

    def points(self, side: int = POINTS_SIDE) -> tuple[NDArray[np.float32], Floats]:
        """Draw the points of the shader's table.

        Returns
        -------
        (side^2, 4), (side^2, 3)
            What the file holds, and the unit directions.
        """
        # A power of two of Sobol points has one in each cell of the grid.
        u = qmc.Sobol(2, scramble=True, rng=SOBOL_SEED).random(side * side)
        u = u[np.argsort(along_hilbert(np.floor(u * side).astype(np.int64), side))]
        places = self._warp.places(u)
        x, y = np.moveaxis(places, -1, 0)
        color = lookup(self.table, np.stack([x, 1.0 - y], axis=-1))
        mean = color.mean(axis=-1)
        share = color / (3.0 * np.where(mean > 0.0, mean, 1.0)[:, None])
        red, green = np.moveaxis(np.rint(share[:, :2] * COLOR_STEPS), -1, 0)
        columns = np.pi * (1.0 - 2.0 * x), np.cos(np.pi * y), mean, red * (COLOR_STEPS + 1) + green
        return np.stack(columns, axis=-1).astype(np.float32), _directions(places)


def prepare_light(env: EnvironmentMap) -> LightTables:
    """Write the tables of a map to the cache, unless they are there, and say where.

    Raises
    ------
    EnvironmentMapError
        The files cannot be written.
    """
    light = LightDistribution(env.radiance.astype(np.float64))
    digest = hashlib.sha256(f"{env.digest} light tables {TABLE_VERSION}".encode()).hexdigest()
    folder = cache_dir("ibl")
    height, width = env.radiance.shape[:2]
    radiance, points_file = (folder / f"{digest}.{part}.exr" for part in ("radiance", "points"))
    slots_file, bins_file = (folder / f"{digest}.{part}.npy" for part in ("slots", "bins"))
    if not radiance.is_file():
        _write_exr(radiance, "RGB", env.radiance)
    if not light.is_constant and not all(file.is_file() for file in (points_file, slots_file, bins_file)):
        points, towards = light.points()
        slots, numbers = cut_slots(towards, light.integral)
        _write_exr(points_file, "RGBA", points.reshape(POINTS_SIDE, POINTS_SIDE, 4))
        _write_npy(slots_file, slots)
        _write_npy(bins_file, numbers)
    drawn, cut_up, weights = (
        None if light.is_constant else Content.of(file) for file in (points_file, slots_file, bins_file)
    )
    return LightTables(Content.of(radiance), drawn, cut_up, weights, width, height, digest, light.is_constant)


def read_distribution(tables: LightTables) -> LightDistribution:
    """Read back the radiance that `prepare_light` wrote.

    Raises
    ------
    EnvironmentMapError
        A file is missing or broken.
    """
    return LightDistribution(_read_exr(tables.radiance.path, "RGB").astype(np.float64))


def cut_slots(towards: Floats, integral: float) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Cut the curve of the points into the slots of each bin.

    Parameters
    ----------
    towards : (N, 3)
        The points, in proportion to the light, whose `integral` over the sphere is given. Not more than 387 M: four
        thirds of that and `_FEW_POINTS` is the most that a slot may have.

    Returns
    -------
    (COUNT, M), (COUNT, 2)
        What the files hold; bins that no light reaches have empty slots.
    """
    slots, numbers = np.zeros((bins.COUNT, SLOTS), np.int32), np.zeros((bins.COUNT, 2), np.float32)
    # In float32, as the shader: g is but a weight.
    x, y, z = (np.ascontiguousarray(column, np.float32) for column in towards.T)

    def fill(number: int) -> None:
        a, b, c = bins.AXES[number].astype(np.float32)
        seen = bins.widened(a * x + b * y + c * z)
        total = float(seen.sum(dtype=np.float64))
        if total > 0.0:
            slots[number] = packed(*cut(seen, SLOTS, least=total / (SLOTS * _FEW_POINTS)))
            numbers[number] = len(towards) / (integral * total), SLOTS / total

    # NumPy lets go of the interpreter's lock.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(fill, range(bins.COUNT)))
    return slots, numbers


def packed(first: Ints, count: Ints, times: Ints) -> NDArray[np.int32]:
    """Write ranges of `cut` as integers: 20 bits of the first point, 12 of a code.

    The code is the count up to `MOST_POINTS`; above, it stands for a single point that fills ``code - MOST_POINTS + 1``
    slots. 0 is an empty slot: some of the slots of a point that would fill more than there are codes for.
    """
    # Slots of one point follow each other.
    place = np.arange(len(first)) - np.searchsorted(first, first)
    code = np.where(times > 1, MOST_POINTS - 1 + np.minimum(times, _MOST_TIMES), count)
    return np.where(place < _MOST_TIMES, first << CODE_BITS | code, 0).astype(np.uint32).view(np.int32)


def cut(values: Floats | NDArray[np.float32], number: int, least: float = 0.0) -> tuple[Ints, Ints, Ints]:
    """Cut a row of values (n,), not negative and not all zero, into ranges of nearly the same sum.

    Values below `least` count as that, so that no range is long. Where the values are zero for longer than a range, one
    ends: it would be drawn from in vain.

    Returns
    -------
    three arrays (number,)
        First place and count of each range, and how many of the ranges are this very one; of several the count is 1.
        Together they cover all that is above zero, none of it twice.
    """
    kept, weights = np.flatnonzero(values), np.maximum(values, least)
    reached = np.cumsum(weights, dtype=np.float64)
    longest = max(1, len(kept) // number)
    while (parted := np.flatnonzero(np.diff(kept) > longest)).size > number // 4:
        longest *= 2
    begin, end = kept[np.append(0, parted + 1)], kept[np.append(parted, len(kept) - 1)] + 1
    before = reached[begin] - weights[begin]
    mass = reached[end - 1] - before
    # Each stretch has at least one range, the heaviest what rounding down leaves.
    shares = 1 + np.floor((number - len(mass)) * mass / mass.sum()).astype(np.int64)
    shares[np.argsort(-mass, kind="stable")[: number - shares.sum()]] += 1
    stretch = np.repeat(np.arange(len(mass)), shares)
    within = np.arange(number) - np.repeat(np.cumsum(shares) - shares, shares)
    wanted = before[stretch] + mass[stretch] * within / shares[stretch]
    first = np.clip(np.searchsorted(reached, wanted, side="right"), begin[stretch], end[stretch] - 1)
    # A value may be too small to show in a sum.
    first = np.where(within == 0, begin[stretch], first)
    # What outweighs a range has several: all but the last of those that begin with it, if something follows in that.
    starts, group, times = np.unique(first, return_inverse=True, return_counts=True)
    times = times[group]
    count = np.minimum(np.append(starts[1:], len(values))[group], end[stretch]) - first
    so_far = np.cumsum(values > 0.0)
    parted_off = (times > 1) & (so_far[first + count - 1] > so_far[first])
    rest = parted_off & np.append(np.diff(group) > 0, True)
    count = np.where(rest, count - 1, np.where(times > 1, 1, count))
    return first + rest, count, np.where(rest, 1, times - parted_off)


def along_hilbert(cells: Ints, side: int) -> Ints:
    """Return how far along a Hilbert curve cells (N, 2) of a square lie, whose side is a power of two."""
    x, y = cells.T.copy()
    place = np.zeros(len(cells), np.int64)
    step = side // 2
    while step:
        right, up = (x & step) > 0, (y & step) > 0
        place += step * step * ((3 * right) ^ up)
        # Each quarter is the curve turned about.
        flip = ~up & right
        x, y = np.where(flip, side - 1 - x, x), np.where(flip, side - 1 - y, y)
        x, y = np.where(up, x, y), np.where(up, y, x)
        step //= 2
    return place


def _directions(places: Floats) -> Floats:
    return uv_to_direction(np.stack([places[:, 0], 1.0 - places[:, 1]], axis=-1))


def _write_exr(path: Path, channels: str, values: Floats | NDArray[np.float32]) -> None:
    planes = {name: np.ascontiguousarray(values[..., i], dtype=np.float32) for i, name in enumerate(channels)}
    # OpenImageIO, which answers texture() on 4.5, cuts an image that is not tiled into tiles of 64 x 64, and to change
    # the tile costs more than to look something up in it. A thread holds on to two.
    tile = OpenEXR.TileDescription()
    tile.ySize, tile.xSize = (min(side, _TILE_SIDE) for side in values.shape[:2])
    tile.mode, tile.roundingMode = OpenEXR.LevelMode.ONE_LEVEL, OpenEXR.LevelRoundingMode.ROUND_DOWN
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.tiledimage, "tiles": tile}
    with _writing(path) as temporary, OpenEXR.File(header, planes) as exr:
        exr.write(str(temporary))


def _write_npy(path: Path, values: NDArray[np.int32] | NDArray[np.float32]) -> None:
    with _writing(path) as temporary, temporary.open("wb") as file:
        np.save(file, values)


@contextmanager
def _writing(path: Path) -> Iterator[Path]:
    try:
        with atomic_path(path) as temporary:
            yield temporary
    except (RuntimeError, OSError) as error:
        raise EnvironmentMapError(f"{path}: cannot write the light's tables: {error}") from error


def _read_exr(path: Path, channels: str) -> NDArray[np.float32]:
    try:
        with OpenEXR.File(str(path), separate_channels=True) as exr:
            return np.stack([exr.channels()[name].pixels for name in channels], axis=-1)
    except (RuntimeError, ValueError, KeyError) as error:
        raise EnvironmentMapError(f"{path}: unreadable ({error}); remove it and it is made again") from error
