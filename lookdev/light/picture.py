"""The texture of a rectangle light: look-ups, and directions in proportion to luminance within its solid angle.

A rectangle is divided into quadrants, `LEVELS` times. At each level a quadrant is chosen in proportion to the mean of
the texture times the quadrant's solid angle; within the last one directions are those of `spherical_rectangle`. The
mean is over bilinear look-ups: where it is 0, no light is sent from anywhere in the quadrant.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.cache import Content
from lookdev.light.dome.environment import EnvironmentMap
from lookdev.light.dome.files import write_exr
from lookdev.light.plane import seen_part
from lookdev.light.spherical_rectangle import Point, density, draw

Floats = NDArray[Any]

LEVELS = 5
"""Times that a texture is divided, to 32 x 32 cells."""

CELL_SEGMENTS = 2
"""Of the solid angle of a quadrant."""

_TINY = 1e-30


def prepare_texture(image: EnvironmentMap) -> Content:
    """Write the texture of a `RectLight` to the cache: the image as it stands, its top row first."""
    return Content.written(".exr", lambda path: write_exr(path, "RGB", image.radiance))


def look_up(picture: Floats, u: Floats, v: Floats) -> Floats:
    """Look up a texture (H, W, C) at u from its first column on and v from its first row on, bilinearly and clamped."""
    height, width = picture.shape[:2]
    x, y = u * width - 0.5, v * height - 0.5
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    s, t = (x - column)[..., None], (y - row)[..., None]
    left, right = (np.clip(column + k, 0, width - 1) for k in (0, 1))
    top, bottom = (np.clip(row + k, 0, height - 1) for k in (0, 1))
    upper = (1.0 - s) * picture[top, left] + s * picture[top, right]
    lower = (1.0 - s) * picture[bottom, left] + s * picture[bottom, right]
    return np.asarray((1.0 - t) * upper + t * lower)


def luminance_tree(picture: Floats, levels: int = LEVELS) -> tuple[Floats, ...]:
    """Return the means over 1, 4, 16, ... cells of a texture (H, W, 3): of each level (2^k, 2^k), row and column 0 at
    (-x, -y) of the light. A black texture counts as white.
    """
    values = picture.mean(axis=-1)[::-1, ::-1]
    if not values.any():
        values = np.ones_like(values)
    cells = 2**levels
    finest = _coverage(len(values), cells) @ values @ _coverage(values.shape[1], cells).T
    tree = [finest]
    for _ in range(levels):
        side = len(tree[0]) // 2
        tree.insert(0, tree[0].reshape(side, 2, side, 2).mean(axis=(1, 3)))
    return tuple(tree)


def _coverage(texels: int, cells: int) -> Floats:
    """Return the weights (cells, texels) of texels in the means of linear interpolation over cells."""
    edges = np.linspace(0.0, texels, cells + 1)
    # The integral of each texel's tent up to the edges; beyond the outermost middles the values go on.
    x = edges[:, None] - (np.arange(texels) + 0.5)
    tent = np.where(x < 0.0, 0.5 * np.maximum(1.0 + x, 0.0) ** 2, 1.0 - 0.5 * np.maximum(1.0 - x, 0.0) ** 2)
    tent[:, 0] -= 0.5 * np.maximum(0.5 - edges, 0.0) ** 2
    tent[:, -1] += 0.5 * np.maximum(edges - (texels - 0.5), 0.0) ** 2
    return np.asarray(np.diff(tent, axis=0) * cells / texels)


def draw_cell(tree: tuple[Floats, ...], place: Floats, width: Any, height: Any, u: Floats) -> Point:
    """Map points u (N, 2) of the unit square to points of the rectangle, for places (N, 3)."""
    row, column = (np.zeros(len(place), np.int64) for _ in range(2))
    u1, u2 = u[..., 0], u[..., 1]
    for level in range(1, len(tree)):
        weight = _weights(tree[level], place, width, height, row, column)
        right = weight[:, :, 1].sum(axis=1) / np.maximum(weight.sum(axis=(1, 2)), _TINY)
        chosen, u1 = _choose(u1, right)
        column = 2 * column + chosen
        above = weight[np.arange(len(place)), :, chosen]
        chosen, u2 = _choose(u2, above[:, 1] / np.maximum(above.sum(axis=1), _TINY))
        row = 2 * row + chosen
    size = 1.0 / len(tree[-1])
    seen = seen_part(place, width, height, column * size, row * size, size)
    point = draw(seen, np.stack([u1, u2], axis=-1))
    return point._replace(s=(column + point.s) * size, t=(row + point.t) * size)


def cell_density(tree: tuple[Floats, ...], place: Floats, width: Any, height: Any, point: Point) -> Floats:
    """Return the pdf (...) per steradian with which `draw_cell` gives points."""
    shape = point.s.shape
    place = np.broadcast_to(place, (*shape, 3)).reshape(-1, 3)
    s, t, x, y = (values.ravel() for values in point)
    cells = len(tree[-1])
    column, row = (np.clip((f * cells).astype(np.int64), 0, cells - 1) for f in (s, t))
    share, every = np.ones_like(s), np.arange(len(s))
    for level in range(1, len(tree)):
        down = len(tree) - 1 - level
        i, j = row >> down, column >> down
        weight = _weights(tree[level], place, width, height, i >> 1, j >> 1)
        share = share * weight[every, i & 1, j & 1] / np.maximum(weight.sum(axis=(1, 2)), _TINY)
    size = 1.0 / cells
    seen = seen_part(place, width, height, column * size, row * size, size)
    part = Point(np.clip(s * cells - column, 0, 1), np.clip(t * cells - row, 0, 1), x, y)
    return np.asarray((share * density(seen, part)).reshape(shape))


def _weights(means: Floats, place: Floats, width: Any, height: Any, row: Any, column: Any) -> Floats:
    """Return the weights (N, 2, 2) of the quadrants of cells."""
    size = 1.0 / len(means)
    weight = np.empty((len(place), 2, 2), place.dtype)
    for i in (0, 1):
        for j in (0, 1):
            r, c = 2 * row + i, 2 * column + j
            seen = seen_part(place, width, height, c * size, r * size, size, CELL_SEGMENTS)
            weight[:, i, j] = means[r, c] * seen.solid_angle
    return weight


def _choose(u: Floats, second: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Choose 1 with probability `second`, else 0, and return what is left of u, again uniform."""
    first = 1 - second
    chosen = u >= first
    left = np.where(chosen, (u - first) / np.maximum(second, _TINY), u / np.maximum(first, _TINY))
    return chosen.astype(np.int64), np.clip(left, 0, 1)
