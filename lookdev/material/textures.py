"""Image files made ready for shading: linear float EXR in the cache, and the reference look-up in NumPy.

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

_WRAPS: dict[str, Wrap] = {
    "black": "black",
    "clamp": "clamp",
    "repeat": "repeat",
    "periodic": "repeat",  # OpenImageIO's and RenderMan's word
    "mirror": "mirror",
}
_CHANNELS: dict[str, slice | int] = {"r": 0, "g": 1, "b": 2, "a": 3, "rgb": slice(0, 3)}


@dataclass(frozen=True)
class ImageHeader:
    """What a look has to know of an image: channel names, depth, and the file's own wrap modes."""

    channels: tuple[str, ...]
    eight_bit: bool
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
    pixels = _linear_pixels(linear_texture(texture))
    height, width = pixels.shape[:2]
    matrix = np.array(texture.transform, np.float64).reshape(2, 3)
    s, t = np.moveaxis(np.asarray(st, np.float64) @ matrix[:, :2].T + matrix[:, 2], -1, 0)
    columns = _taps(s, width, texture.wrap_s)
    rows = _taps(1.0 - t, height, texture.wrap_t)  # row 0 is the top of the image, t 0 the bottom
    channel = _CHANNELS[texture.channel]
    value = np.zeros((*np.shape(s), 4))
    for row, row_weight in rows:
        for column, column_weight in columns:
            value += (row_weight * column_weight)[..., np.newaxis] * pixels[row, column]
    scaled: NDArray[np.float64] = value * np.array(texture.scale) + np.array(texture.bias)
    return scaled[..., channel]


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
    return ImageHeader(tuple(spec.channelnames), spec.format == oiio.UINT8, (wrap_s, wrap_t))


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
