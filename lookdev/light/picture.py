"""The texture of a rectangle light: look-ups, and sampling of directions in proportion to its radiance.

Sampling starts with the whole rectangle as one *cell*, at level 0. `LEVELS` times, it divides the cell into four
quadrants, and draws one of them as the cell of the next level. A quadrant's probability is proportional to the mean of
the texture over the quadrant times the quadrant's solid angle. Within the last cell, `spherical_rectangle` draws the
direction. The means are means of bilinear look-ups, so that a quadrant of mean 0 emits no light.

Code generation traces `draw_cell` and `cell_pdf` (`TexturedRectangle`), so their arrays may be symbolic.
"""

from __future__ import annotations

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.table import NumberTable
from lookdev.brdf.table import look_up as table_number
from lookdev.brdf.vectors import Array, Real
from lookdev.cache import Content
from lookdev.light.dome.environment import EnvironmentMap, write_exr
from lookdev.light.dome.warp import interpolate
from lookdev.light.spherical_rectangle import RectanglePoint, density, draw, project_part

LEVELS = 5
"""The number of divisions of a rectangle; 5 give 32 x 32 cells."""

CELL_SEGMENTS = 2
"""The argument `segments` of `project_rectangle` for the solid angle of a quadrant."""

_TINY = 1e-30  # replaces divisors of 0


def prepare_texture(image: EnvironmentMap) -> Content:
    """Write an image to the cache as the texture of a `RectLight`, top row first, and return the file."""
    return Content.store_written(".exr", lambda path: write_exr(path, "RGB", image.radiance))


def look_up(picture: Floats, u: Floats, v: Floats) -> Floats:
    """Return bilinear, clamped look-ups (..., C) in a texture (H, W, C); u is 0 at its left edge, v at its top edge."""
    height, width = picture.shape[:2]
    return interpolate(picture, u * width - 0.5, v * height - 0.5)


def mean_pyramid(picture: Floats, levels: int = LEVELS) -> tuple[Floats, ...]:
    """Return the means of a texture (H, W, 3) over the cells of each level: an array (2^k, 2^k) for level k.

    The luminance of a texel is the mean of its channels. Row and column 0 of an array are at (-x, -y) of the light. A
    black texture counts as white.
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


def flatten_pyramid(tree: tuple[Floats, ...]) -> Floats:
    """Return the means (n,) of a `mean_pyramid` from level 1 on, in the order in which `draw_cell` reads them."""
    return np.concatenate([level.ravel() for level in tree[1:]])


def _coverage(texels: int, cells: int) -> Floats:
    """Return the matrix (cells, texels) that maps a row of texels, interpolated linearly, to its means over cells."""
    edges = np.linspace(0.0, texels, cells + 1)
    # The integral of each texel's tent function from the left up to each cell's edge. Beyond the centres of the first
    # and the last texel, the interpolated value is constant.
    x = edges[:, None] - (np.arange(texels) + 0.5)
    tent = np.where(x < 0.0, 0.5 * np.maximum(1.0 + x, 0.0) ** 2, 1.0 - 0.5 * np.maximum(1.0 - x, 0.0) ** 2)
    tent[:, 0] -= 0.5 * np.maximum(0.5 - edges, 0.0) ** 2
    tent[:, -1] += 0.5 * np.maximum(edges - (texels - 0.5), 0.0) ** 2
    return np.asarray(np.diff(tent, axis=0) * cells / texels)


def draw_cell(means: NumberTable, start: Real, point: Floats, width: Real, height: Real, u: Floats) -> RectanglePoint:
    """Map points u (..., 2) of the unit square to points of the rectangle as seen from shading points (..., 3).

    `means` is a column of numbers that has the texture's `flatten_pyramid` from row `start` on.
    """
    u1, u2 = u[..., 0], u[..., 1]
    row, column = np.zeros_like(u1), np.zeros_like(u1)
    for level in range(1, LEVELS + 1):
        (low, low_right), (high, high_right) = _weights(means, start, level, point, width, height, row, column)
        right = low_right + high_right
        is_right, u1 = _choose(u1, right / np.maximum(low + high + right, _TINY))
        column = 2 * column + is_right
        upper, total = np.where(is_right > 0, high_right, high), np.where(is_right > 0, right, low + high)
        is_upper, u2 = _choose(u2, upper / np.maximum(total, _TINY))
        row = 2 * row + is_upper
    size = 1.0 / 2**LEVELS
    target = draw(project_part(point, width, height, column * size, row * size, size), np.stack([u1, u2], axis=-1))
    return target._replace(s=(column + target.s) * size, t=(row + target.t) * size)


def cell_pdf(
    means: NumberTable, start: Real, point: Floats, width: Real, height: Real, target: RectanglePoint
) -> Floats:
    """Return the pdf (...) per steradian with which `draw_cell` returns the points `target`."""
    cells = 2**LEVELS
    column, row = (np.floor(np.clip(f * cells, 0, cells - 1)) for f in (target.s, target.t))
    probability = np.ones_like(target.s)
    for level in range(1, LEVELS + 1):
        # The target is in row i and column j of this level, whose cells have `finest_cells` cells of the last level
        # along a side.
        finest_cells = 2 ** (LEVELS - level)
        i, j = np.floor(row / finest_cells), np.floor(column / finest_cells)
        upper, left = np.floor(i / 2), np.floor(j / 2)
        (low, low_right), (high, high_right) = _weights(means, start, level, point, width, height, upper, left)
        on_right = j > 2 * left
        weight = np.where(i > 2 * upper, np.where(on_right, high_right, high), np.where(on_right, low_right, low))
        probability = probability * weight / np.maximum(low + low_right + high + high_right, _TINY)
    size = 1.0 / cells
    cell = project_part(point, width, height, column * size, row * size, size)
    s, t = np.clip(target.s * cells - column, 0, 1), np.clip(target.t * cells - row, 0, 1)
    return probability * density(cell, RectanglePoint(s, t, target.x, target.y))


def _weights(
    means: NumberTable, start: Real, level: int, point: Floats, width: Real, height: Real, row: Floats, column: Floats
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return the weights (...) of a cell's quadrants, as (lower left, lower right), (upper left, upper right).

    `row` and `column` (...) are the cell's numbers in its level, and `level` is the level of the quadrants, one more.
    Left is at -x, lower at -y.
    """
    side = 2**level
    before = (side * side - 4) // 3  # the number of cells of levels 1 to level - 1: 4 + 16 + ...

    def quadrant_weight(i: int, j: int) -> Array:
        r, c = 2 * row + i, 2 * column + j
        angle = project_part(point, width, height, c / side, r / side, 1.0 / side, CELL_SEGMENTS).solid_angle
        return table_number(means, start + (before + r * side + c), 0.0) * angle

    return (quadrant_weight(0, 0), quadrant_weight(0, 1)), (quadrant_weight(1, 0), quadrant_weight(1, 1))


def _choose(u: Floats, second: Array) -> tuple[Floats, Floats]:
    """Return 1 with probability `second`, else 0, and a number that is again uniform: the rest of `u`, rescaled."""
    first = 1 - second
    is_second = u >= first
    remainder = np.where(is_second, (u - first) / np.maximum(second, _TINY), u / np.maximum(first, _TINY))
    return np.where(is_second, 1.0, 0.0), np.clip(remainder, 0, 1)
