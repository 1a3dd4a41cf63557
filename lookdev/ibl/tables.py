"""Importance sampling of an environment map: two tables, one look-up each in the shader, unbiased.

The design
----------
Radiance is looked up bilinearly: texel centres at ((i + 1/2) / W, (j + 1/2) / H), periodic along a row,
clamped over rows; row j counts from the top of the image, at ``v = 1 - (j + 1/2) / H``.

1. A target over texels: luminance, filtered with the bilinear footprint [1/8, 3/4, 1/8] in each axis so that
   the dark neighbours of a sun, bright once interpolated, get their share, times the cosine of the row's
   latitude.
2. M points of a scrambled 2D Sobol sequence go through the target's inverse CDF (rows, then columns). Only
   the texel (i, j) of each is kept, in Sobol order: any aligned block of 2^k entries is stratified over the
   light.
3. The probability of a texel is *by definition* its count among the M entries over M, so what the shader
   divides by is exactly what it samples, whatever the target was.
4. A direction: an entry (i, j) picked uniformly, then ((i + 1/2 + t1) / W, (j + 1/2 + t2) / H) with t1, t2 of
   the triangular density on [-1, 1], wrapped along the row, reflected at the poles. Tents on texel centres
   are the basis of bilinear interpolation and a reflected one is a clamped one, so the density over the unit
   square is exactly ``W H`` times the bilinear look-up of the texel probabilities; per solid angle it is that
   over ``2 pi^2 cos(latitude)``.

Where every texel around a point was counted zero times the density is 0: such a map is to be sampled together
with the BRDF, under multiple importance sampling.

The files
---------
``*.radiance.exr``: R, G, B radiance and A = W H count / M: one bilinear look-up of four channels gives the
light and its density. ``*.samples.exr``: R = i, G = j (exact in float32), B = 0; entry n is pixel (n mod
1024, n div 1024).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import convolve1d
from scipy.stats import qmc

from lookdev.cache import atomic_path, cache_dir
from lookdev.errors import EnvironmentMapError
from lookdev.ibl.environment import EnvironmentMap
from lookdev.ibl.mapping import direction_to_uv, uv_to_direction

Floats = NDArray[np.float64]

TABLE_VERSION = 1  # part of the digest: raise it with any change to what the tables hold
SAMPLES_WIDTH = 1024
SOBOL_SEED = 20120808
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # ITU-R BT.709-6, item 3.2

# The density is infinite at a pole itself, which a shading normal along z can ask for; this keeps it finite.
MIN_COS_LATITUDE = 1e-9


@dataclass(frozen=True)
class LightTables:
    """The files of an environment map prepared for the shader; see the module. `digest` names the content."""

    radiance: Path
    samples: Path
    width: int
    height: int
    sample_count: int
    digest: str


@dataclass(frozen=True, eq=False)
class LightDistribution:
    """The light and its sampling in float64, from the very arrays that the shader looks up.

    `table` (H, W, 4) radiance and ``W H p``; `texels` (M, 2) column and row of each entry.
    """

    table: Floats
    texels: NDArray[np.int64]

    @property
    def is_constant(self) -> bool:
        """Whether the same radiance comes from everywhere: sampling by the light is then pointless."""
        rgb = self.table[..., :3]
        return bool((rgb == rgb[0, 0]).all())

    def radiance(self, direction: ArrayLike) -> Floats:
        """Radiance (..., 3) that arrives from unit directions (..., 3), linear Rec.709."""
        return lookup(self.table, direction_to_uv(direction))[..., :3]

    def pdf(self, direction: ArrayLike) -> Floats:
        """Density (...) per steradian with which `sample` gives unit directions (..., 3)."""
        direction = np.asarray(direction, dtype=np.float64)
        cos_latitude = np.maximum(np.hypot(direction[..., 0], direction[..., 1]), MIN_COS_LATITUDE)
        pdf_uv = lookup(self.table, direction_to_uv(direction))[..., 3]
        return np.asarray(pdf_uv / (2.0 * np.pi**2 * cos_latitude))

    def sample(self, entry: ArrayLike, u: ArrayLike) -> Floats:
        """Sample unit directions (..., 3) towards the light.

        Parameters
        ----------
        entry : (...) integer in [0, M), uniform: the table entry.
        u : (..., 2) in [0, 1), uniform: the place within its tent.
        """
        height, width = self.table.shape[:2]
        xy = (self.texels[np.asarray(entry)] + 0.5 + _tent(np.asarray(u, dtype=np.float64))) / (width, height)
        y = np.abs(xy[..., 1])
        y = np.minimum(y, 2.0 - y)
        return uv_to_direction(np.stack([xy[..., 0] % 1.0, 1.0 - y], axis=-1))


def lookup(table: ArrayLike, uv: ArrayLike) -> Floats:
    """Look up a lat-long table bilinearly, periodic in u and clamped in v.

    Parameters
    ----------
    table : (H, W, C), row 0 at v = 1.
    uv : (..., 2).

    Returns
    -------
    (..., C) float64.
    """
    table = np.asarray(table, dtype=np.float64)
    height, width = table.shape[:2]
    u, v = np.moveaxis(np.asarray(uv, dtype=np.float64), -1, 0)
    x, y = u * width - 0.5, (1.0 - v) * height - 0.5
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    s, t = (x - column)[..., None], (y - row)[..., None]
    left, right = column % width, (column + 1) % width
    top, bottom = np.clip(row, 0, height - 1), np.clip(row + 1, 0, height - 1)
    upper = (1.0 - s) * table[top, left] + s * table[top, right]
    lower = (1.0 - s) * table[bottom, left] + s * table[bottom, right]
    return np.asarray((1.0 - t) * upper + t * lower)


def build_distribution(env: EnvironmentMap) -> LightDistribution:
    """Make the sampling tables of a map; the table's values are exactly representable in float32."""
    height, width = env.radiance.shape[:2]
    count = sample_count(width, height)
    texels = _draw_texels(_target(env.radiance), count)
    hits = np.bincount(texels[:, 1] * width + texels[:, 0], minlength=width * height).reshape(height, width)
    density = (width * height * hits / count).astype(np.float32)
    return LightDistribution(np.concatenate([env.radiance, density[..., None]], axis=-1).astype(np.float64), texels)


def prepare_light(env: EnvironmentMap) -> LightTables:
    """Write the tables of a map to the cache, unless they are there, and say where.

    Raises
    ------
    EnvironmentMapError
        The files cannot be written.
    """
    digest = hashlib.sha256(f"{env.digest} light tables {TABLE_VERSION}".encode()).hexdigest()
    folder = cache_dir("ibl")
    height, width = env.radiance.shape[:2]
    count = sample_count(width, height)
    radiance, samples = folder / f"{digest}.radiance.exr", folder / f"{digest}.samples.exr"
    if not (radiance.is_file() and samples.is_file()):
        light = build_distribution(env)
        _write_exr(radiance, "RGBA", light.table)
        entries = np.concatenate([light.texels, np.zeros((count, 1))], axis=-1)
        _write_exr(samples, "RGB", entries.reshape(-1, SAMPLES_WIDTH, 3))
    return LightTables(radiance, samples, width, height, count, digest)


def read_distribution(tables: LightTables) -> LightDistribution:
    """Read back what `prepare_light` wrote: the light as the shader sees it.

    Raises
    ------
    EnvironmentMapError
        A file is missing or broken.
    """
    texels = _read_exr(tables.samples, "RG").reshape(-1, 2)
    return LightDistribution(_read_exr(tables.radiance, "RGBA").astype(np.float64), texels.astype(np.int64))


def sample_count(width: int, height: int) -> int:
    """Choose M: the power of two at or above half the texels, within [2^16, 2^22].

    Half the texels is the knee: four times as many lower the variance of a diffuse surface, both strategies
    combined, by 5 % (``city``) to 10 % (``forest``); a quarter as many raise it by 25 to 55 %. The table then
    takes at most as much memory as the radiance. Below, a pixel wants a choice of many blocks; above (maps
    beyond 4096 wide) building it would take longer than the few seconds it does.
    """
    return int(min(2**22, max(2**16, 1 << (width * height // 2 - 1).bit_length())))


def _target(radiance: NDArray[np.float32]) -> Floats:
    """Make the wanted weight of each texel (H, W): filtered luminance times cosine of latitude."""
    height = radiance.shape[0]
    luminance = radiance.astype(np.float64) @ LUMINANCE
    footprint = [0.125, 0.75, 0.125]
    luminance = convolve1d(luminance, footprint, axis=0, mode="nearest")
    luminance = convolve1d(luminance, footprint, axis=1, mode="wrap")
    if not luminance.any():
        luminance = np.ones_like(luminance)  # an all-black map: any distribution is right, this one is valid
    return np.asarray(luminance * np.sin(np.pi * (np.arange(height) + 0.5) / height)[:, None])


def _draw_texels(target: Floats, count: int) -> NDArray[np.int64]:
    """Warp `count` Sobol points through the inverse CDF of `target` (H, W) to columns and rows (M, 2)."""
    height, width = target.shape
    points = qmc.Sobol(2, scramble=True, rng=SOBOL_SEED).random(count)
    cdf = np.cumsum(target)
    row_end = cdf[width - 1 :: width]
    row_start = np.concatenate([[0.0], row_end[:-1]])
    row = np.searchsorted(row_end, points[:, 1] * row_end[-1], side="right")
    row = np.minimum(row, height - 1)
    texel = np.searchsorted(cdf, row_start[row] + points[:, 0] * (row_end - row_start)[row], side="right")
    column = np.clip(texel - row * width, 0, width - 1)  # a sum rounded past the row's end stays in the row
    return np.stack([column, row], axis=-1)


def _tent(u: Floats) -> Floats:
    """Invert the CDF of the triangular density ``1 - |t|`` on [-1, 1]."""
    return np.where(u < 0.5, np.sqrt(2.0 * u) - 1.0, 1.0 - np.sqrt(np.maximum(2.0 - 2.0 * u, 0.0)))


def _write_exr(path: Path, channels: str, values: Floats | NDArray[np.float32]) -> None:
    planes = {name: np.ascontiguousarray(values[..., i], dtype=np.float32) for i, name in enumerate(channels)}
    header = {"compression": OpenEXR.ZIPS_COMPRESSION, "type": OpenEXR.scanlineimage}
    try:
        with atomic_path(path) as temporary, OpenEXR.File(header, planes) as exr:
            exr.write(str(temporary))
    except (RuntimeError, OSError) as error:
        raise EnvironmentMapError(f"{path}: cannot write the light's tables: {error}") from error


def _read_exr(path: Path, channels: str) -> NDArray[np.float32]:
    try:
        with OpenEXR.File(str(path), separate_channels=True) as exr:
            return np.stack([exr.channels()[name].pixels for name in channels], axis=-1)
    except (RuntimeError, ValueError, KeyError) as error:
        raise EnvironmentMapError(f"{path}: unreadable ({error}); remove it and it is made again") from error
