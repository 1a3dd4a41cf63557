"""Images of textures: converts files to linear float EXRs in the cache for renderers, and looks them up in NumPy.

The look-ups in NumPy are the reference with which tests compare shaders.

Channels follow UsdUVTexture: a single channel is repeated into r, g and b; two channels are value and alpha; a missing
alpha is 1. Values are never multiplied by alpha. Colours are converted to linear Rec.709 before filtering, from sRGB by
the piecewise curve of IEC 61966-2-1. Alpha is not converted.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import ArrayLike

from lookdev.arrays import Floats, Floats32, Indices
from lookdev.brdf import Array
from lookdev.cache import cached_file, file_digest
from lookdev.errors import OutputError, TextureError
from lookdev.images import check_file, open_image, read_strips, whole_image
from lookdev.material import WRAPS, Bump, Texture, Wrap
from lookdev.stage.colorspaces import to_linear_rec709

UDIM = "<UDIM>"
"""The part of the name of a set of tiles that stands for the number of a tile."""

# Cached files have these numbers in their names. Raise one when the conversion, or the computation of slopes, changes.
_CONVERTER_VERSION, _SLOPE_VERSION = 2, 1
_UDIM_NUMBER = re.compile(r"1[0-9]{3}")

# Wrap modes by the words of image files. OpenImageIO and RenderMan write "periodic" for repeat.
_WRAP_OF_WORD: dict[str, Wrap] = {"periodic": "repeat", **WRAPS}
_UNSIGNED_TYPES = (oiio.UINT8, oiio.UINT16, oiio.UINT32)
_STRIP_ROWS = 64  # rows of an image that are converted at once, to bound the memory
# The index of each `Channel` in arrays whose last axis is r, g, b, a.
_CHANNELS: dict[str, slice | int] = {"r": 0, "g": 1, "b": 2, "a": 3, "rgb": slice(0, 3)}


@dataclass(frozen=True)
class ImageHeader:
    """The channels, number type, wrap modes and colour space that an image file states.

    `channels` are the names of the channels. If `is_unsigned`, texels are unsigned integers, which encode 0 to 1. If
    `is_eight_bit`, they have 8 bits. `wraps` are the modes along s and t. `is_tagged_srgb` is whether the file itself
    states that it is sRGB.
    """

    channels: tuple[str, ...]
    is_eight_bit: bool
    is_unsigned: bool
    wraps: tuple[Wrap, Wrap]
    is_tagged_srgb: bool

    @property
    def is_srgb(self) -> bool:
        """Whether UsdUVTexture's ``auto`` means sRGB here: the file states sRGB, or has 3 or 4 channels of 8 bits."""
        return self.is_tagged_srgb or (self.is_eight_bit and len(self.channels) in (3, 4))


def image_header(file: Path) -> ImageHeader:
    """Read the header of an image.

    Raises
    ------
    TextureError
        The file is missing, is not an image, or its channels are neither gray, gray and alpha, RGB nor RGBA.
    """
    with open_image(file, TextureError) as image:
        spec = image.spec()
        _channel_indices(file, spec)
    s, _, t = spec.get_string_attribute("wrapmodes").partition(",")
    # UsdUVTexture defines: where the file states no wrap modes, the image is black outside.
    wrap_s, wrap_t = (_WRAP_OF_WORD.get(word.strip(), "black") for word in (s, t or s))
    is_eight_bit, is_unsigned = spec.format == oiio.UINT8, spec.format.basetype in _UNSIGNED_TYPES
    # The attribute oiio:ColorSpace is no evidence: OpenImageIO sets it also where a file states no colour space. Exif's
    # number for sRGB is 1.
    profile = spec.get_string_attribute("ICCProfile:profile_description")
    tagged = profile.startswith("sRGB") or spec.get_int_attribute("Exif:ColorSpace") == 1
    return ImageHeader(tuple(spec.channelnames), is_eight_bit, is_unsigned, (wrap_s, wrap_t), tagged)


def resolve_texture(texture: Texture) -> Texture:
    """Return the texture with ``"auto"`` and ``"useMetadata"`` replaced by what its image states.

    Raises as `image_header`.
    """
    if texture.colorspace != "auto" and "useMetadata" not in (texture.wrap_s, texture.wrap_t):
        return texture
    tiles = udim_tiles(texture)
    header = image_header(next(iter(tiles.values())).file if tiles else texture.file)
    wrap_pairs = zip((texture.wrap_s, texture.wrap_t), header.wraps, strict=True)
    wrap_s, wrap_t = (image_wrap if wrap == "useMetadata" else wrap for wrap, image_wrap in wrap_pairs)
    automatic = "sRGB" if header.is_srgb else "raw"
    colorspace = automatic if texture.colorspace == "auto" else texture.colorspace
    return replace(texture, colorspace=colorspace, wrap_s=wrap_s, wrap_t=wrap_t)


def udim_tiles(texture: Texture) -> dict[int, Texture]:
    """Return the tiles of a UDIM set as textures of one image each, by tile number, of which 1001 is the first.

    The result is empty for a texture that is a single image. Raises TextureError for a set without tiles.
    """
    before, mark, after = texture.file.name.partition(UDIM)
    if not mark:
        return {}
    tiles = {}
    folder = texture.file.parent
    for file in sorted(folder.iterdir()) if folder.is_dir() else []:
        number = file.name.removeprefix(before).removesuffix(after)
        if file.name == f"{before}{number}{after}" and _UDIM_NUMBER.fullmatch(number):
            tiles[int(number)] = replace(texture, file=file, wrap_s="clamp", wrap_t="clamp")
    if not tiles:
        raise TextureError(f"{texture.file}: no tile of this set, such as {before}1001{after}")
    return tiles


def check_images(texture: Texture) -> None:
    """Read the headers of all images of a texture to find faults; raises as `image_header` and `udim_tiles`."""
    for tile in udim_tiles(texture).values() or [texture]:
        image_header(tile.file)


def is_uncentred_normal_map(texture: Texture) -> bool:
    """Return whether a normal map lacks negative x and y: texels are 0 to 1, and scale and bias do not centre them.

    A map has negative components if scale and bias take the middle value 0.5 to 0 in x and y. This also holds for a map
    with a flipped or weakened axis. The tolerance covers the middle 128 / 255 of 8 bits. Raises as `check_images`.
    """
    centred = all(abs(texture.bias[axis] + 0.5 * texture.scale[axis]) < 0.01 for axis in (0, 1))
    return not centred and image_header(next(iter(udim_tiles(texture).values()), texture).file).is_unsigned


def linear_texture(texture: Texture) -> Path:
    """Return the file of a texture's image as a linear float EXR (R, G, B, A), converted into the cache if missing.

    The conversion reads and writes strips of rows. The scale and bias of the texture are not applied.

    Raises
    ------
    TextureError
        The image is missing, cannot be read, has unknown channels or holds NaN or infinity.
    """
    check_file(texture.file, TextureError)
    texture = resolve_texture(texture)

    def linear_strips(image: oiio.ImageInput) -> Iterator[Floats]:
        for rgba in _read_rgba_strips(texture.file, image):
            rgba[..., :3] = to_linear_rec709(rgba[..., :3], texture.colorspace)
            yield rgba

    def write(path: Path) -> None:
        with open_image(texture.file, TextureError) as image:
            size = image.spec().full_width, image.spec().full_height
            _write_exr(path, size, linear_strips(image))

    key = f"{file_digest(texture.file)}-{texture.colorspace}-v{_CONVERTER_VERSION}"
    return cached_file("textures", key, ".exr", write).path


def slope_texture(height: Texture) -> Path:
    """Return the file of the slopes of a height map as a float EXR, computed into the cache if missing.

    Channel R is the derivative of the height with respect to s, and G the derivative with respect to t. Here s runs
    rightwards and t upwards over the image, from 0 to 1. The height is the channel of `height`, linear, times the
    channel's scale. The derivatives are central differences of texels. Beyond an edge, the neighbour is the texel at
    the opposite edge (wrap mode repeat) or at the edge itself (mirror, clamp, black).

    Raises
    ------
    TextureError
        As `linear_texture`; or the channel of `height` is ``"rgb"``.
    """
    if height.channel == "rgb":
        raise TextureError(f"{height.file}: a height is one channel, r, g, b or a, not rgb")
    height = resolve_texture(height)
    channel = "rgba".index(height.channel)
    linear = linear_texture(height)
    slope_key = f"{height.channel}-{height.scale[channel]!r}-{height.wrap_s}-{height.wrap_t}"

    def slope_strips(texels: Floats32) -> Iterator[Floats]:
        rows, columns = texels.shape
        # The rows from -1 to `rows`, wrapped, so that every row has a neighbour above and below. Row 0 is the top.
        neighbour_rows = np.arange(-1, rows + 1)
        neighbour_rows = neighbour_rows % rows if height.wrap_t == "repeat" else np.clip(neighbour_rows, 0, rows - 1)
        for first in range(0, rows, _STRIP_ROWS):
            last = min(first + _STRIP_ROWS, rows)
            heights = texels[neighbour_rows[first : last + 2]].astype(np.float64) * height.scale[channel]
            padded = np.pad(heights[1:-1], ((0, 0), (1, 1)), mode="wrap" if height.wrap_s == "repeat" else "edge")
            # The difference of two neighbours spans two texels, and a texel is 1 / columns wide and 1 / rows high.
            slopes = np.zeros((last - first, columns, 4))
            slopes[..., 0] = (padded[:, 2:] - padded[:, :-2]) * (0.5 * columns)
            slopes[..., 1] = (heights[:-2] - heights[2:]) * (0.5 * rows)
            slopes[..., 3] = 1.0
            yield slopes

    def write(path: Path) -> None:
        with open_image(linear, TextureError) as image:
            texels = whole_image(image, linear, range(channel, channel + 1), TextureError)[..., 0]
        _write_exr(path, texels.shape[::-1], slope_strips(texels))

    key = f"{linear.stem}-slope-{slope_key}-v{_SLOPE_VERSION}"
    return cached_file("textures", key, ".exr", write).path


def image_file(source: Texture | Bump) -> Path:
    """Return the file that a shader reads: `slope_texture` of a bump map, else `linear_texture`; raises as these."""
    return slope_texture(source.height) if isinstance(source, Bump) else linear_texture(source)


def texture_value(texture: Texture, texels: Array) -> Array:
    """Return the value of a texture at some points from its linear texels (..., 4) there.

    The shape is (...), or (..., 3) for the channel ``"rgb"``.
    """
    return (texels * np.array(texture.scale) + np.array(texture.bias))[..., _CHANNELS[texture.channel]]


def sample_texture(texture: Texture, st: ArrayLike) -> Floats:
    """Return the value of a texture at texture coordinates `st` (..., 2): `texture_value` of `image_texels`."""
    return np.asarray(texture_value(texture, image_texels(texture, st)))


def image_texels(texture: Texture, st: ArrayLike) -> Floats:
    """Look up all channels of a texture bilinearly, in float64, without its scale and bias.

    Tests compare shaders with this reference. Texel (i, j) has its centre at ((i + 0.5) / width, (j + 0.5) / height).
    In wrap mode ``black``, texels outside the image are 0.

    Parameters
    ----------
    st : array_like, shape (..., 2)
        Texture coordinates of the mesh, before `Texture.transform`; (0, 0) is the image's lower left corner.

    Returns
    -------
    ndarray, shape (..., 4)

    Raises
    ------
    TextureError
        As `linear_texture`.
    """
    texture = resolve_texture(texture)
    return _look_up(linear_texture, texture, _to_image_st(texture, st))


def sample_slopes(texture: Texture, st: ArrayLike) -> Floats:
    """Return the derivatives of a height map with respect to `st`, (..., 2).

    They are `image_slopes` times the matrix of the texture's transform (chain rule).
    """
    return np.asarray(image_slopes(texture, st) @ _transform_matrix(texture)[:, :2])


def image_slopes(texture: Texture, st: ArrayLike) -> Floats:
    """Look up the derivatives of a height map with respect to the image's coordinates, (..., 2), bilinearly.

    `st` is as in `image_texels`. The derivatives account for the wrap modes: in mirrored copies of the image they have
    the opposite sign, and beyond a clamped edge they are 0. Raises as `slope_texture`.
    """
    texture = resolve_texture(texture)
    image_st = _to_image_st(texture, st)
    slopes = _look_up(slope_texture, texture, image_st)[..., :2]
    wraps = (texture.wrap_s, texture.wrap_t)
    factors = np.stack([_wrap_derivative(image_st[..., axis], wrap) for axis, wrap in enumerate(wraps)], axis=-1)
    return np.asarray(slopes * factors)


def _transform_matrix(texture: Texture) -> Floats:
    """Return the transform of a texture's coordinates as a matrix (2, 3)."""
    return np.array(texture.transform, np.float64).reshape(2, 3)


def _to_image_st(texture: Texture, st: ArrayLike) -> Floats:
    """Convert texture coordinates of the mesh, (..., 2), to coordinates of the image, (..., 2)."""
    matrix = _transform_matrix(texture)
    return np.asarray(np.asarray(st, np.float64) @ matrix[:, :2].T + matrix[:, 2])


def _look_up(prepare: Callable[[Texture], Path], texture: Texture, image_st: Floats) -> Floats:
    """Look up all four channels of an image bilinearly, at the image's coordinates, by the wrap modes of `texture`.

    `prepare` returns the file to read: it is `linear_texture` or `slope_texture`.
    """
    value = np.zeros((*image_st.shape[:-1], 4))
    if tiles := udim_tiles(texture):
        # UDIM numbers the unit squares from 1001, ten to a row; squares left and right of a row have no tile.
        s, t = np.floor(image_st[..., 0]), np.floor(image_st[..., 1])
        number = np.where((s >= 0.0) & (s < 10.0), 1001.0 + s + 10.0 * t, 0.0)
        for tile_number, tile in tiles.items():
            in_tile = number == tile_number
            value[in_tile] = _look_up(prepare, tile, (image_st - np.floor(image_st))[in_tile])
        return value
    pixels = _linear_pixels(prepare(texture))
    height, width = pixels.shape[:2]
    columns = _bilinear_taps(image_st[..., 0], width, texture.wrap_s)
    # Row 0 is the top of the image, and t = 0 its bottom.
    rows = _bilinear_taps(1.0 - image_st[..., 1], height, texture.wrap_t)
    for row, row_weight in rows:
        for column, column_weight in columns:
            value += (row_weight * column_weight)[..., np.newaxis] * pixels[row, column]
    return value


def _wrap_derivative(coordinate: Floats, wrap: str) -> Floats:
    """Return the derivative of the wrapped coordinate with respect to the coordinate.

    For ``black`` it is 1 everywhere, because the look-up of slopes itself returns 0 outside the image.
    """
    if wrap == "mirror":
        return np.where(np.mod(np.floor(coordinate), 2.0) == 1.0, -1.0, 1.0)
    if wrap == "clamp":
        return np.where((coordinate >= 0.0) & (coordinate <= 1.0), 1.0, 0.0)
    return np.ones_like(coordinate)


def _bilinear_taps(coordinate: Floats, size: int, wrap: str) -> list[tuple[Indices, Floats]]:
    """Return pairs (index, weight) for the two texels of a bilinear look-up along one axis of `size` texels."""
    position = coordinate * size - 0.5
    lower = np.floor(position)
    fraction = position - lower
    taps = []
    for index, weight in ((lower, 1.0 - fraction), (lower + 1.0, fraction)):
        if wrap == "repeat":
            texel = np.mod(index, size)
        elif wrap == "mirror":
            # A period is the image and its mirrored copy. Over the copy, the indices of texels count down.
            texel = np.mod(index, 2 * size)
            texel = np.minimum(texel, 2 * size - 1 - texel)
        else:
            texel = np.clip(index, 0, size - 1)
        if wrap == "black":
            weight = np.where(texel == index, weight, 0.0)
        taps.append((texel.astype(np.intp), weight))
    return taps


@lru_cache(maxsize=16)
def _linear_pixels(linear: Path) -> Floats:
    """Return the pixels (height, width, 4) of a converted image."""
    with open_image(linear, TextureError) as image:
        return whole_image(image, linear, range(4), TextureError).astype(np.float64)


def _channel_indices(file: Path, spec: oiio.ImageSpec) -> tuple[list[int], int | None]:
    """Return the indices of a file's channels for r, g and b, and the index for alpha or None, as UsdUVTexture defines.

    Raises TextureError where the channels are neither gray, gray and alpha, RGB nor RGBA.
    """
    names = list(spec.channelnames)
    if len(names) > 2 and not {"R", "G", "B"} <= set(names):
        listing = ", ".join(names[:20])
        raise TextureError(f"{file}: no channels R, G, B among {listing}; gray or RGB(A) is right")
    if len(names) <= 2:
        return [0, 0, 0], 1 if len(names) == 2 else None
    return [names.index(name) for name in "RGB"], names.index("A") if "A" in names else None


def _read_rgba_strips(file: Path, image: oiio.ImageInput) -> Iterator[Floats]:
    """Yield strips (rows, width, 4) of an open image's display window, from the top down.

    Pixels of the display window outside the data window are 0. Raises TextureError for values that are not finite.
    """
    spec = image.spec()
    color, alpha = _channel_indices(file, spec)
    # The upper left corner of the data window, relative to the display window's; negative if it lies outside.
    left, top = spec.x - spec.full_x, spec.y - spec.full_y

    def blank_strips(rows: int) -> Iterator[Floats]:
        for first in range(0, rows, _STRIP_ROWS):
            yield blank_rows(min(_STRIP_ROWS, rows - first))

    def blank_rows(rows: int) -> Floats:
        rgba = np.zeros((rows, spec.full_width, 4))
        if alpha is None:
            rgba[..., 3] = 1.0
        return rgba

    yield from blank_strips(min(top, spec.full_height))
    columns_inside = slice(max(left, 0), max(min(left + spec.width, spec.full_width), 0))
    bad = 0
    for first, pixels in read_strips(image, file, range(spec.nchannels), TextureError):
        bad += np.count_nonzero(~np.isfinite(pixels))
        begin = max(top + first, 0)
        # The part of the strip inside the display window. Columns beyond its right edge are cut off below.
        inside = pixels[max(-top - first, 0) : max(spec.full_height - top - first, 0), max(-left, 0) :]
        if len(inside) and begin < spec.full_height:
            rgba = blank_rows(len(inside))
            inside = inside[:, : max(columns_inside.stop - columns_inside.start, 0)]
            rgba[:, columns_inside, :3] = inside[..., color]
            if alpha is not None:
                rgba[:, columns_inside, 3] = inside[..., alpha]
            yield rgba
    if bad:
        raise TextureError(f"{file}: {bad} values are NaN or infinite; a texture must be finite everywhere")
    yield from blank_strips(spec.full_height - max(min(top + spec.height, spec.full_height), 0))


def _write_exr(file: Path, size: Sequence[int], parts: Iterator[Floats]) -> None:
    """Write `parts`, strips (rows, width, 4) from the top down, to an EXR of a `size` (width, height).

    Raises OSError where the file cannot be written.
    """
    width, height = size
    spec = oiio.ImageSpec(width, height, 4, oiio.FLOAT)
    spec["compression"] = "zip"
    # Files of equal texels must be equal, because digests of frames contain digests of these files. OpenImageIO would
    # write the present time here.
    spec["DateTime"] = "2000:01:01 00:00:00"
    output = oiio.ImageOutput.create(str(file))
    written, row = output.open(str(file), spec), 0
    try:
        for rgba in parts if written else ():
            written = output.write_scanlines(row, row + len(rgba), 0, np.ascontiguousarray(rgba, np.float32))
            if not written:
                break
            row += len(rgba)
    finally:
        closed = output.close()
    if not (written and closed and _has_last_row(file, height)):
        raise OSError(errno.EIO, "a texture cannot be written; is the disk full?")


def _has_last_row(file: Path, height: int) -> bool:
    """Return whether a written EXR has its last row.

    OpenImageIO reports no error when it loses rows while it closes a file, as on a full disk.
    """
    try:
        with open_image(file, OutputError) as image:
            return image.read_scanlines(0, 0, height - 1, height, 0, 0, 4, oiio.FLOAT) is not None
    except OutputError:
        return False
