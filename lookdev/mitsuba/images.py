"""Look-ups of texture images on Dr.Jit's arrays: bilinear, wrapped and tiled as in `lookdev/shaders/texture.h`."""

from __future__ import annotations

import drjit as dr

from lookdev.codegen.source import ImageBinding
from lookdev.mitsuba.files import FileArray, file_array, read_image
from lookdev.mitsuba.types import UV, Bool, Float, Mitsuba, UInt, Vector4f


class Images:
    """The images of a texture in a variant's arrays: one image, or several UDIM tiles.

    `binding` describes the images. The keys of its `files` are the numbers of the tiles, or only 0 for a single image.
    """

    def __init__(self, mi: Mitsuba, binding: ImageBinding) -> None:
        self._mi = mi
        self._binding = binding
        self._tiles = {number: file_array(mi.Float, file, read_image) for number, file in binding.files.items()}

    def texels(self, uv: UV, active: Bool) -> tuple[Float, Float, Float, Float]:
        """Return the four channels at coordinates of the UV set, or 0 where there is no tile.

        If the channels are slopes of heights, they change sign where the image is mirrored, and are 0 beyond a clamped
        edge.
        """
        binding = self._binding
        m = binding.transform  # an affine map from the UV set to coordinates s, t of the image, two rows of three
        s, t = (m[k] * uv.x + m[k + 1] * uv.y + m[k + 2] for k in (0, 3))
        if 0 in self._tiles:
            texels = bilinear(self._mi, self._tiles[0], s, t, binding.wrap_s, binding.wrap_t, active)
            signs = _wrap_slope(s, binding.wrap_s), _wrap_slope(t, binding.wrap_t)
        else:
            # Tile 1001 + i + 10 j has s in [i, i + 1) and t in [j, j + 1).
            i, j = dr.floor(s), dr.floor(t)
            texels, signs = self._mi.Vector4f(0.0), (1.0, 1.0)
            for number, tile in self._tiles.items():
                in_tile = (i == (number - 1001) % 10) & (j == (number - 1001) // 10)
                texel = bilinear(self._mi, tile, s - i, t - j, "clamp", "clamp", active & in_tile)
                texels = dr.select(in_tile, texel, texels)
        if binding.slopes:
            return texels.x * signs[0], texels.y * signs[1], texels.z, texels.w
        return texels.x, texels.y, texels.z, texels.w


def bilinear(mi: Mitsuba, image: FileArray, s: Float, t: Float, wrap_s: str, wrap_t: str, active: Bool) -> Vector4f:
    """Return the four channels of an image at coordinates s and t, from (0, 0) lower left to (1, 1) upper right."""
    texels, (height, width, _) = image.array, image.shape
    x, y = s * width - 0.5, (1.0 - t) * height - 0.5
    i, j = dr.floor(x), dr.floor(y)
    total = mi.Vector4f(0.0)
    for dy, weight_y in ((0, 1.0 - (y - j)), (1, y - j)):
        row, inside_y = _wrap(mi, j + dy, height, wrap_t)
        for dx, weight_x in ((0, 1.0 - (x - i)), (1, x - i)):
            column, inside_x = _wrap(mi, i + dx, width, wrap_s)
            inside = active & inside_x & inside_y
            total += weight_x * weight_y * dr.gather(mi.Vector4f, texels, row * width + column, inside)
    return total


def _wrap(mi: Mitsuba, position: Float, size: int, wrap: str) -> tuple[UInt, Bool | bool]:
    """Return the index of the texel at an integer position along an axis, and whether there is a texel.

    `size` is the number of texels along the axis. Beyond the edges of an image that is not wrapped, there is no texel.
    """
    match wrap:
        case "repeat":
            position = position - size * dr.floor(position / size)
        case "mirror":
            position = position - 2 * size * dr.floor(position / (2 * size))
            position = dr.minimum(position, 2 * size - 1 - position)
        case "clamp":
            pass
        case _:
            return mi.UInt32(dr.clip(position, 0, size - 1)), (position >= 0.0) & (position <= size - 1.0)
    return mi.UInt32(dr.clip(position, 0, size - 1)), True


def _wrap_slope(position: Float, wrap: str) -> Float | float:
    """Return the derivative of the wrapped coordinate: -1 in mirrored copies, 0 beyond a clamped edge, else 1."""
    if wrap == "mirror":
        half = 0.5 * dr.floor(position)
        return dr.select(half != dr.floor(half), -1.0, 1.0)
    return dr.select((position < 0.0) | (position > 1.0), 0.0, 1.0) if wrap == "clamp" else 1.0
