"""Image files made ready for shading: linear float EXR in the cache, and the reference look-ups in NumPy.

Channels follow UsdUVTexture: one channel is repeated into r, g and b; two are value and alpha; alpha is 1
where there is none. Values are never multiplied by alpha. sRGB is decoded by the exact piecewise curve of
IEC 61966-2-1, before any filtering; alpha is never decoded.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import ArrayLike, NDArray

from lookdev.cache import atomic_path, cache_dir, file_digest
from lookdev.errors import TextureError
from lookdev.material.look import Texture, Wrap

CONVERTER_VERSION = 1
"""Part of a linear texture's name: raise it when the conversion changes."""

SLOPE_VERSION = 1
"""The same for what `slope_texture` adds to it."""

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
    value = _look_up(linear_texture(texture), texture, _image_st(texture, st))
    scaled: NDArray[np.float64] = value * np.array(texture.scale) + np.array(texture.bias)
    return scaled[..., _CHANNELS[texture.channel]]


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
    image_st = _image_st(texture, st)
    slopes = _look_up(slope_texture(texture), texture, image_st)[..., :2]
    wraps = (texture.wrap_s, texture.wrap_t)
    along = np.stack([_wrap_slope(image_st[..., axis], wrap) for axis, wrap in enumerate(wraps)], axis=-1)
    chained: NDArray[np.float64] = (slopes * along) @ _matrix(texture)[:, :2]
    return chained


def _matrix(texture: Texture) -> NDArray[np.float64]:
    return np.array(texture.transform, np.float64).reshape(2, 3)


def _image_st(texture: Texture, st: ArrayLike) -> NDArray[np.float64]:
    matrix = _matrix(texture)
    transformed: NDArray[np.float64] = np.asarray(st, np.float64) @ matrix[:, :2].T + matrix[:, 2]
    return transformed


def _look_up(linear: Path, texture: Texture, image_st: NDArray[np.float64]) -> NDArray[np.float64]:
    """Look all four channels of a float EXR up, at coordinates of the image, wrapped as `texture` says."""
    pixels = _linear_pixels(linear)
    height, width = pixels.shape[:2]
    columns = _taps(image_st[..., 0], width, texture.wrap_s)
    rows = _taps(1.0 - image_st[..., 1], height, texture.wrap_t)  # row 0 is the top of the image, t 0 the bottom
    value = np.zeros((*image_st.shape[:-1], 4))
    for row, row_weight in rows:
        for column, column_weight in columns:
            value += (row_weight * column_weight)[..., np.newaxis] * pixels[row, column]
    return value


def _wrap_slope(coordinate: NDArray[np.float64], wrap: Wrap) -> NDArray[np.float64]:
    """Return the derivative of the wrapped coordinate by the coordinate: what is black outside needs none."""
    if wrap == "mirror":
        return np.where(np.mod(np.floor(coordinate), 2.0) == 1.0, -1.0, 1.0)
    if wrap == "clamp":
        return np.where((coordinate >= 0.0) & (coordinate <= 1.0), 1.0, 0.0)
    return np.ones_like(coordinate)


def _taps(coordinate: NDArray[np.float64], size: int, wrap: Wrap) -> list[tuple[NDArray[np.intp], NDArray[np.float64]]]:
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
