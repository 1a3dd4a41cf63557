"""Image files made ready for shading: linear float EXR in the cache, and the reference look-ups in NumPy.

Channels follow UsdUVTexture: one channel is repeated into r, g and b; two are value and alpha; alpha is 1
where there is none. Values are never multiplied by alpha. sRGB is decoded by the exact piecewise curve of
IEC 61966-2-1, before any filtering; alpha is never decoded.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import ArrayLike, NDArray

from lookdev.cache import atomic_path, cache_dir, file_digest
from lookdev.errors import TextureError
from lookdev.material.look import Bump, Texture, Wrap

CONVERTER_VERSION = 1
"""Part of a linear texture's name: raise it when the conversion changes."""

SLOPE_VERSION = 1
"""The same for what `slope_texture` adds to it."""

UDIM = "<UDIM>"
"""What stands for a tile's number in the name of a set."""

_UDIM_NUMBER = re.compile(r"1[0-9]{3}")
MOST_PIXELS = 1 << 28
"""Pixels that an image may have, 16384 x 16384: a small file can claim any number, and all are held in memory."""

_WRAPS: dict[str, Wrap] = {
    "black": "black",
    "clamp": "clamp",
    "repeat": "repeat",
    "periodic": "repeat",  # OpenImageIO's and RenderMan's word
    "mirror": "mirror",
}
_UNSIGNED = (oiio.UINT8, oiio.UINT16, oiio.UINT32)
_CHANNELS: dict[str, slice | int] = {"r": 0, "g": 1, "b": 2, "a": 3, "rgb": slice(0, 3)}


@dataclass(frozen=True)
class ImageHeader:
    """What a look has to know of an image: channel names, depth, and the file's own wrap modes.

    An `unsigned` image holds whole numbers that stand for 0 to 1.
    """

    channels: tuple[str, ...]
    eight_bit: bool
    unsigned: bool
    wraps: tuple[Wrap, Wrap]

    @property
    def is_srgb(self) -> bool:
        """What UsdUVTexture's sourceColorSpace ``auto`` means here: 8-bit images of 3 or 4 channels are sRGB.

        The specification lets metadata of the file overrule this; none is consulted, because OpenImageIO
        reports a colour space also for files that state none.
        """
        return self.eight_bit and len(self.channels) in (3, 4)


def image_header(file: Path) -> ImageHeader:
    """Read the header of an image.

    Raises
    ------
    TextureError
        The file is missing, is no image, or its channels are neither gray, gray and alpha, RGB nor RGBA.
    """
    return _header(_open(file).spec())


def resolved(texture: Texture) -> Texture:
    """Return the texture with what it left to its image answered by the image's header.

    Raises
    ------
    TextureError
        As `image_header`; or a set of tiles has none.
    """
    if texture.colorspace != "auto" and "useMetadata" not in (texture.wrap_s, texture.wrap_t):
        return texture
    tiles = udim_tiles(texture)
    header = image_header(next(iter(tiles.values())).file if tiles else texture.file)
    wraps = [
        own if said == "useMetadata" else said
        for said, own in zip((texture.wrap_s, texture.wrap_t), header.wraps, strict=True)
    ]
    colorspace = texture.colorspace
    if colorspace == "auto":
        colorspace = "sRGB" if header.is_srgb else "raw"
    return replace(texture, colorspace=colorspace, wrap_s=wraps[0], wrap_t=wraps[1])


def udim_tiles(texture: Texture) -> dict[int, Texture]:
    """Return the tiles of a set by their number, 1001 and up, in order; none for a single image.

    Raises
    ------
    TextureError
        The name is one of a set, and there is no tile of it.
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


def linear_texture(texture: Texture) -> Path:
    """Return the texture's image as a linear float EXR (R, G, B, A), converted once into the cache.

    The name holds the digest of the image's content, the colour space and the version of this conversion, so
    the path itself identifies the pixels.

    Raises
    ------
    TextureError
        The image is missing, cannot be read, has unknown channels or holds NaN or infinity.
    """
    if not texture.file.is_file():
        raise TextureError(f"{texture.file}: no such image file")
    texture = resolved(texture)
    name = f"{file_digest(texture.file)}-{texture.colorspace}-v{CONVERTER_VERSION}.exr"
    linear = cache_dir("textures") / name
    if not linear.exists():
        rgba = _read_rgba(texture.file)
        if texture.colorspace == "sRGB":
            rgba[..., :3] = srgb_to_linear(rgba[..., :3])
        _write_exr(linear, rgba)
    return linear


def slope_texture(height: Texture) -> Path:
    """Return the slopes of a height map as a float EXR, derived once into the cache: R = dh/ds, G = dh/dt.

    They are central differences of neighbouring texels of the one channel that `height` names, linear and times its
    scale, per unit of the image's own s and t (rightwards and upwards). At the edges the neighbour is the one of the
    wrap mode: of the other edge (repeat), the texel itself (mirror, clamp, black).

    Raises
    ------
    TextureError
        As `linear_texture`; or `height` names three channels.
    """
    if height.channel == "rgb":
        raise TextureError(f"{height.file}: a height is one channel, r, g, b or a, not rgb")
    height = resolved(height)
    channel = "rgba".index(height.channel)
    linear = linear_texture(height)
    how = f"{height.channel}-{height.scale[channel]!r}-{height.wrap_s}-{height.wrap_t}"
    slopes = linear.with_name(f"{linear.stem}-slope-{how}-v{SLOPE_VERSION}.exr")
    if not slopes.exists():
        h = _read_rgba(linear)[..., channel] * height.scale[channel]
        rows, columns = h.shape
        across = np.pad(h, ((0, 0), (1, 1)), mode="wrap" if height.wrap_s == "repeat" else "edge")
        down = np.pad(h, ((1, 1), (0, 0)), mode="wrap" if height.wrap_t == "repeat" else "edge")
        dh_ds = (across[:, 2:] - across[:, :-2]) * (0.5 * columns)
        dh_dt = (down[:-2] - down[2:]) * (0.5 * rows)  # row 0 is the top of the image
        _write_exr(slopes, np.stack([dh_ds, dh_dt, np.zeros_like(h), np.ones_like(h)], axis=-1))
    return slopes


def image_file(source: Texture | Bump) -> Path:
    """Return the image that a shader reads: a texture's linear one, a height map's slopes; errors as theirs."""
    return slope_texture(source.height) if isinstance(source, Bump) else linear_texture(source)


def srgb_to_linear(encoded: ArrayLike) -> NDArray[np.float64]:
    """Decode sRGB to linear values: the piecewise curve of IEC 61966-2-1."""
    value = np.asarray(encoded, np.float64)
    # The power is taken only where it is used: negative values of a float image have none.
    return np.where(value <= 0.04045, value / 12.92, ((np.maximum(value, 0.04045) + 0.055) / 1.055) ** 2.4)


def sample_texture(texture: Texture, st: ArrayLike) -> NDArray[np.float64]:
    """Look a texture up bilinearly, in float64: the reference that shaders are compared with.

    Texel (i, j) has its centre at ((i + 0.5) / width, (j + 0.5) / height); `st` (0, 0) is the image's lower
    left corner. Wrap mode ``black`` filters towards 0 outside; scale and bias come last.

    Parameters
    ----------
    st : array_like, shape (..., 2)
        Texture coordinates as the mesh has them, before `Texture.transform`.

    Returns
    -------
    ndarray, shape (...) for a single channel, (..., 3) for ``rgb``

    Raises
    ------
    TextureError
        As `linear_texture`.
    """
    scaled: NDArray[np.float64] = image_texels(texture, st) * np.array(texture.scale) + np.array(texture.bias)
    return scaled[..., _CHANNELS[texture.channel]]


def image_texels(texture: Texture, st: ArrayLike) -> NDArray[np.float64]:
    """Look all four channels up, (..., 4), as `sample_texture`, without scale and bias."""
    texture = resolved(texture)
    return _look_up(linear_texture, texture, _image_st(texture, st))


def sample_slopes(texture: Texture, st: ArrayLike) -> NDArray[np.float64]:
    """Look the slopes of a height map up bilinearly, in float64: the reference that shaders are compared with.

    Parameters
    ----------
    st : array_like, shape (..., 2)
        Texture coordinates as the mesh has them, before `Texture.transform`.

    Returns
    -------
    ndarray, shape (..., 2)
        The derivatives of the height with respect to those coordinates, by the chain rule through the wrap modes and
        the transform: mirrored copies lean the other way, and beyond a clamped edge the height stays as it is.

    Raises
    ------
    TextureError
        As `slope_texture`.
    """
    chained: NDArray[np.float64] = image_slopes(texture, st) @ _matrix(texture)[:, :2]
    return chained


def image_slopes(texture: Texture, st: ArrayLike) -> NDArray[np.float64]:
    """Look the slopes of a height map up, (..., 2), as `sample_slopes`, by the image's own coordinates."""
    texture = resolved(texture)
    image_st = _image_st(texture, st)
    slopes = _look_up(slope_texture, texture, image_st)[..., :2]
    wraps = (texture.wrap_s, texture.wrap_t)
    along = np.stack([_wrap_slope(image_st[..., axis], wrap) for axis, wrap in enumerate(wraps)], axis=-1)
    return np.asarray(slopes * along)


def _matrix(texture: Texture) -> NDArray[np.float64]:
    return np.array(texture.transform, np.float64).reshape(2, 3)


def _image_st(texture: Texture, st: ArrayLike) -> NDArray[np.float64]:
    matrix = _matrix(texture)
    transformed: NDArray[np.float64] = np.asarray(st, np.float64) @ matrix[:, :2].T + matrix[:, 2]
    return transformed


def _look_up(
    prepare: Callable[[Texture], Path], texture: Texture, image_st: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Look all four channels of the prepared image up, at coordinates of it, wrapped as `texture` says."""
    value = np.zeros((*image_st.shape[:-1], 4))
    if tiles := udim_tiles(texture):
        s, t = np.floor(image_st[..., 0]), np.floor(image_st[..., 1])
        number = np.where((s >= 0.0) & (s < 10.0), 1001.0 + s + 10.0 * t, 0.0)
        for each, tile in tiles.items():
            here = number == each
            value[here] = _look_up(prepare, tile, (image_st - np.floor(image_st))[here])
        return value
    pixels = _linear_pixels(prepare(texture))
    height, width = pixels.shape[:2]
    columns = _taps(image_st[..., 0], width, texture.wrap_s)
    rows = _taps(1.0 - image_st[..., 1], height, texture.wrap_t)  # row 0 is the top of the image, t 0 the bottom
    for row, row_weight in rows:
        for column, column_weight in columns:
            value += (row_weight * column_weight)[..., np.newaxis] * pixels[row, column]
    return value


def _wrap_slope(coordinate: NDArray[np.float64], wrap: str) -> NDArray[np.float64]:
    """Return the derivative of the wrapped coordinate by the coordinate: what is black outside needs none."""
    if wrap == "mirror":
        return np.where(np.mod(np.floor(coordinate), 2.0) == 1.0, -1.0, 1.0)
    if wrap == "clamp":
        return np.where((coordinate >= 0.0) & (coordinate <= 1.0), 1.0, 0.0)
    return np.ones_like(coordinate)


def _taps(coordinate: NDArray[np.float64], size: int, wrap: str) -> list[tuple[NDArray[np.intp], NDArray[np.float64]]]:
    """Give the two texels along one axis that a bilinear look-up reads, with their weights."""
    position = coordinate * size - 0.5
    lower = np.floor(position)
    fraction = position - lower
    taps = []
    for index, weight in ((lower, 1.0 - fraction), (lower + 1.0, fraction)):
        if wrap == "repeat":
            texel = np.mod(index, size)
        elif wrap == "mirror":
            texel = np.mod(index, 2 * size)
            texel = np.minimum(texel, 2 * size - 1 - texel)
        else:
            texel = np.clip(index, 0, size - 1)
        if wrap == "black":
            weight = np.where(texel == index, weight, 0.0)
        taps.append((texel.astype(np.intp), weight))
    return taps


@lru_cache(maxsize=16)
def _linear_pixels(linear: Path) -> NDArray[np.float64]:
    return _read_rgba(linear)


def _open(file: Path) -> oiio.ImageBuf:
    """Open an image, header only as yet, whose channels a UsdUVTexture can give a meaning."""
    if not file.is_file():
        raise TextureError(f"{file}: no such image file")
    as_stored = oiio.ImageSpec()
    as_stored["oiio:UnassociatedAlpha"] = 1
    image = oiio.ImageBuf(str(file), 0, 0, as_stored)
    names = image.spec().channelnames  # this reads the header
    if image.has_error:
        raise TextureError(f"{file}: cannot be read as an image: {image.geterror()}")
    width, height = image.spec().full_width, image.spec().full_height
    if max(width * height, image.spec().image_pixels()) > MOST_PIXELS:
        raise TextureError(f"{file}: is {width} x {height} pixels large; at most {MOST_PIXELS} pixels would be right")
    if len(names) > 2 and not {"R", "G", "B"} <= set(names):
        raise TextureError(f"{file}: no channels R, G, B among {', '.join(names)}; gray or RGB(A) is right")
    return image


def _header(spec: oiio.ImageSpec) -> ImageHeader:
    s, _, t = spec.get_string_attribute("wrapmodes").partition(",")
    # UsdUVTexture: a file that says nothing is black outside.
    wrap_s, wrap_t = (_WRAPS.get(word.strip(), "black") for word in (s, t or s))
    return ImageHeader(
        tuple(spec.channelnames), spec.format == oiio.UINT8, spec.format.basetype in _UNSIGNED, (wrap_s, wrap_t)
    )


def _read_rgba(file: Path) -> NDArray[np.float64]:
    """Read an image as (height, width, 4), top row first; what lies outside an EXR's data window is 0."""
    image = _open(file)
    names = list(image.spec().channelnames)
    pixels = image.get_pixels(oiio.FLOAT, image.roi_full)
    if pixels is None or image.has_error:
        raise TextureError(f"{file}: cannot be read as an image: {image.geterror()}")
    bad = np.count_nonzero(~np.isfinite(pixels))
    if bad:
        raise TextureError(f"{file}: {bad} values are NaN or infinite; a texture must be finite everywhere")
    rgba = np.ones((*pixels.shape[:2], 4))
    if len(names) <= 2:
        rgba[..., :3] = pixels[..., :1]
        alpha = names[1:]
    else:
        rgba[..., :3] = pixels[..., [names.index(name) for name in "RGB"]]
        alpha = [name for name in names if name == "A"]
    if alpha:
        rgba[..., 3] = pixels[..., names.index(alpha[0])]
    return rgba


def _write_exr(file: Path, rgba: NDArray[np.float64]) -> None:
    height, width = rgba.shape[:2]
    spec = oiio.ImageSpec(width, height, 4, oiio.FLOAT)
    spec["compression"] = "zip"
    with atomic_path(file) as temporary:
        output = oiio.ImageOutput.create(str(temporary))
        done = (
            output is not None
            and output.open(str(temporary), spec)
            and output.write_image(np.ascontiguousarray(rgba, np.float32))
            and output.close()
        )
        if not done:
            reason = output.geterror() if output is not None else oiio.geterror()
            raise TextureError(f"{file}: cannot be written: {reason}")
