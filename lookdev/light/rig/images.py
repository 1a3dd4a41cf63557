"""Reading of the images of lights as linear Rec.709, and conversion of ball images to lat-long maps.

A *ball* is a square image with a disk: the environment's reflection in a sphere, of UsdLux's format ``mirroredBall`` or
``angular``. The middle of the disk reflects the direction towards the camera, which is +z of a dome whose pole is +y.
Right in the image is +x, and the rim is the direction behind the sphere. UsdLux states only that the radius of
``angular`` is linear in the angle. The directions here are those of Blender's mirror ball and of the light probes of
Debevec, "Rendering Synthetic Objects into Real Scenes", 1998.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lookdev.arrays import Floats, Floats32
from lookdev.cache import cached_file
from lookdev.errors import EnvironmentMapError
from lookdev.images import open_image, whole_image
from lookdev.light.dome.environment import EnvironmentMap, make_environment, read_exr, read_pixels, write_exr
from lookdev.light.dome.usd import BALLS
from lookdev.light.mapping import uv_to_direction
from lookdev.light.picture import look_up
from lookdev.stage.colorspaces import to_linear_rec709

LINEAR = (".exr", ".hdr")
"""Suffixes of files with linear values; other files are sRGB unless a colour space is stated."""

_VERSION = 1  # part of the key of a converted ball in the cache: raise it when the conversion changes
_STRIP = 1 << 18  # the number of directions that are looked up at once


def read_light_image(file: Path, space: str) -> EnvironmentMap:
    """Read an image as linear Rec.709, with bad texels repaired; `space` is the colour space that is stated, or "".

    Raises EnvironmentMapError if the image cannot be read.
    """
    if file.suffix.lower() in LINEAR:
        pixels = read_pixels(file)
    else:
        with open_image(file, EnvironmentMapError) as image:
            channels = image.spec().nchannels
            pixels = whole_image(image, file, range(min(channels, 3)), EnvironmentMapError)
        # An image of one or two channels is grey; a second channel is alpha.
        pixels = pixels if channels >= 3 else np.repeat(pixels[..., :1], 3, axis=-1)
        space = space or "sRGB"
    if space not in ("", "raw"):
        pixels = to_linear_rec709(pixels, space).astype(np.float32)
    return make_environment(file.stem, pixels, str(file))


def format_of_image(environment: EnvironmentMap) -> str:
    """Return the format that ``automatic`` means for a dome's image, from the file's metadata or aspect ratio.

    Raises EnvironmentMapError if neither determines the format.
    """
    with open_image(Path(environment.where), EnvironmentMapError) as image:
        stated = image.spec().get_string_attribute("textureformat")
    if stated.startswith("LatLong"):
        return "latlong"
    height, width = environment.radiance.shape[:2]
    if stated.startswith("CubeFace") or 4 * width == 3 * height:
        return "cubeMapVerticalCross"
    if width == 2 * height:
        return "latlong"
    raise EnvironmentMapError(
        f"{environment.where}: is {width} x {height} pixels large, and states no format; twice as wide as high, or "
        "inputs:texture:format = 'latlong', 'angular' or 'mirroredBall' would be right"
    )


@dataclass(frozen=True, eq=False)
class LightImage:
    """The image of a light. The image of a dome is a lat-long map.

    `mean` is the mean radiance (3,) over the image, or over the sphere for a dome. `error` is the relative error of
    the power of a map that was converted from a ball; None for other images.
    """

    environment: EnvironmentMap
    mean: tuple[float, ...]
    error: float | None = None


def load_light_image(file: Path, space: str, kind: str) -> LightImage:
    """Read the image of a light; `kind` is the format of a dome's image, "" for other lights.

    Raises EnvironmentMapError if the image cannot be read, or its format is not supported.
    """
    image, error = read_light_image(file, space), None
    if not kind:
        return LightImage(image, tuple(image.radiance.mean(axis=(0, 1), dtype=np.float64).tolist()))
    kind = format_of_image(image) if kind == "automatic" else kind
    if kind == "cubeMapVerticalCross":
        raise EnvironmentMapError(
            f"{file}: is a cube map, of format {kind}, which is not supported; a lat-long map would be right"
        )
    if kind in BALLS:
        repairs, (image, error) = image.repairs, unroll_ball(image, kind)
        image = replace(image, repairs=repairs)
    edges = np.cos(np.pi * np.arange(len(image.radiance) + 1) / len(image.radiance))
    mean = image.radiance.mean(axis=1, dtype=np.float64).T @ -np.diff(edges) / 2.0
    return LightImage(image, tuple(mean.tolist()), error)


def unroll_ball(ball: EnvironmentMap, kind: str) -> tuple[EnvironmentMap, float]:
    """Return the lat-long map of a ball's environment, and the relative error of the map's power.

    The map has as many rows as the ball. Each texel is the mean of 2 x 2 bilinear look-ups. Raises EnvironmentMapError
    unless the image is a square.
    """
    height, width = ball.radiance.shape[:2]
    if height != width:
        raise EnvironmentMapError(f"{ball.where}: is {width} x {height} pixels large; of format {kind}, it is a square")

    def write(path: Path) -> None:
        write_exr(path, "RGB", _unroll_pixels(ball.radiance.astype(np.float64), kind).astype(np.float32))

    key = hashlib.sha256(f"{ball.digest} {kind} {_VERSION}".encode()).hexdigest()
    file = cached_file("balls", key, ".exr", write).path
    environment = make_environment(ball.name, read_exr(file, "RGB"), ball.where)
    before, after = ball_power(ball.radiance, kind), _power(environment.radiance)
    return environment, abs(after - before) / before if before else 0.0


def ball_point(direction: Floats, kind: str) -> Floats:
    """Return the points (..., 2) of the unit disk at which a ball shows directions (..., 3) of a dome with pole +y."""
    x, y, z = np.moveaxis(direction, -1, 0)
    axis_distance = np.hypot(x, y)
    angle = np.arctan2(axis_distance, z)
    radius = angle / np.pi if kind == "angular" else np.sin(angle / 2.0)
    scale = radius / np.where(axis_distance > 0.0, axis_distance, 1.0)
    return np.stack([scale * x, scale * y], axis=-1)


def ball_power(radiance: Floats32, kind: str) -> float:
    """Return the integral of the mean channel of a ball (N, N, 3) over the sphere."""
    count = len(radiance)
    middles = (np.arange(count) + 0.5) * 2.0 / count - 1.0
    radius = np.hypot(middles[:, None], middles)
    # `angular` and 4.0 are steradians per unit of area of the disk, which are constant for a mirrored ball.
    angular = np.pi * np.pi * np.sinc(np.minimum(radius, 1.0))
    solid = np.where(radius < 1.0, angular if kind == "angular" else 4.0, 0.0)
    # The rim cuts texels, so that the sum of the solid angles is slightly wrong. It is scaled to 4 pi.
    solid *= 4.0 * np.pi / solid.sum()
    return float((radiance.mean(axis=-1, dtype=np.float64) * solid).sum())


def _power(radiance: Floats32) -> float:
    """Return the integral of the mean channel of a lat-long map (H, W, 3) over the sphere."""
    rows = len(radiance)
    edges = np.cos(np.pi * np.arange(rows + 1) / rows)
    return float((radiance.mean(axis=(1, 2), dtype=np.float64) * -np.diff(edges)).sum() * 2.0 * np.pi)


def _unroll_pixels(ball: Floats, kind: str) -> Floats:
    """Return the lat-long map (N, 2 N, 3) of the environment of a ball (N, N, 3)."""
    rows = len(ball)
    fine_rows = 2 * rows  # rows of look-ups: each texel is the mean of 2 x 2
    pixels = np.empty((rows, 2 * rows, 3))
    step = max(1, _STRIP // (4 * fine_rows))
    u = (np.arange(2 * fine_rows) + 0.5) / (2 * fine_rows)
    # Points are moved into this radius, within which bilinear look-ups read no texel beyond the rim.
    inner_radius = 1.0 - 2.0 * np.sqrt(2.0) / rows
    for first in range(0, rows, step):
        last = min(first + step, rows)
        v = 1.0 - (np.arange(2 * first, 2 * last) + 0.5) / fine_rows
        towards = uv_to_direction(np.stack(np.broadcast_arrays(u, v[:, None]), axis=-1))
        # The map's x, y and z axes are the dome's z, x and y axes: `lookdev.light.dome.usd.DOME_Y`.
        point = ball_point(towards[..., (1, 2, 0)], kind)
        radius = np.hypot(point[..., 0], point[..., 1])[..., None]
        point *= np.minimum(1.0, inner_radius / np.maximum(radius, inner_radius))
        texels = look_up(ball, (1.0 + point[..., 0]) / 2.0, (1.0 - point[..., 1]) / 2.0)
        pixels[first:last] = texels.reshape(last - first, 2, 2 * rows, 2, 3).mean(axis=(1, 3))
    return pixels
