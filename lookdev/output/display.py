"""Conversion of pictures from linear light to code values of a display, and the writer of 8-bit image files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import ArrayLike

from lookdev.arrays import Bytes, Floats32
from lookdev.cache import atomic_path, memory_file, output_errors
from lookdev.errors import OutputError
from lookdev.output.color import DisplayView


def to_display(rgb: ArrayLike, view: DisplayView | str) -> Bytes:
    """Return linear Rec.709 light (H, W, 3) as code values of a display, (H, W, 3) uint8, rounded to nearest.

    `view` is a view, or the name of one of `lookdev.output.color.VIEWS`; ``Raw`` only quantises. Raises what
    `display_codes` raises.
    """
    return quantise(display_codes(rgb, view))


def display_codes(rgb: ArrayLike, view: DisplayView | str) -> Floats32:
    """Return linear Rec.709 light (H, W, 3) as code values of a display, (H, W, 3) in [0, 1].

    `view` is as in `to_display`. Raises what `DisplayView.processor` raises, and OutputError for pixels that are not
    finite.
    """
    display_view = DisplayView(view) if isinstance(view, str) else view
    codes = np.array(rgb, dtype=np.float32, order="C")  # a copy: OpenColorIO works in place
    broken = np.argwhere(~np.isfinite(codes).all(axis=-1))
    if broken.size:
        row, column = broken[0]
        raise OutputError(f"{len(broken)} pixels are NaN or infinite, the first in row {row}, column {column}")
    display_view.processor.applyRGB(codes)
    return np.clip(codes, 0.0, 1.0)


def straight_codes(rgb: ArrayLike, alpha: ArrayLike, view: DisplayView | str) -> Floats32:
    """Return premultiplied light (H, W, 3) with alpha (H, W) as code values and straight alpha, (H, W, 4) in [0, 1].

    Light is divided by alpha before the view; pixels of alpha 0 become black. Raises what `display_codes` raises.
    """
    coverage = np.asarray(alpha, dtype=np.float32)[..., None]
    # Division by a tiny alpha would overflow float32, so it is in float64, and the result is bounded.
    straight = np.divide(np.asarray(rgb, np.float64), coverage, where=coverage > 0.0, out=np.zeros(np.shape(rgb)))
    straight = np.minimum(straight, np.finfo(np.float32).max)
    return np.concatenate([display_codes(straight, view), np.clip(coverage, 0.0, 1.0)], axis=-1)


def quantise(codes: Floats32) -> Bytes:
    """Return code values in [0, 1] as 8 bits, rounded to nearest."""
    return (codes * np.float32(255.0) + np.float32(0.5)).astype(np.uint8)


def composite(beauty: ArrayLike, alpha: ArrayLike, background: ArrayLike) -> Floats32:
    """Return premultiplied light (H, W, 3) with alpha (H, W) over an opaque background, (H, W, 3) or a colour (3,)."""
    uncovered = 1.0 - np.asarray(alpha, dtype=np.float32)[..., None]
    return np.asarray(beauty, dtype=np.float32) + uncovered * np.asarray(background, dtype=np.float32)


def composite_layers(over: tuple[Floats32, Floats32], under: tuple[Floats32, Floats32]) -> tuple[Floats32, Floats32]:
    """Return one premultiplied picture over another; a picture is its light (H, W, 3) and its alpha (H, W)."""
    (light, alpha), (light_under, alpha_under) = over, under
    return composite(light, alpha, light_under), alpha + (1.0 - alpha) * alpha_under


def write_pixels(path: Path, pixels: Bytes) -> None:
    """Write sRGB-encoded pixels (H, W, 3 or 4) as a PNG, complete or not at all; alpha is unassociated.

    Raises OutputError where the file cannot be written.
    """
    with output_errors(path, "cannot write the picture"):
        # Without the second attribute, the writer would divide the pixels by alpha.
        write_image(path, pixels, {"oiio:ColorSpace": "sRGB", "oiio:UnassociatedAlpha": 1})


def write_image(path: Path, pixels: Bytes, attributes: Mapping[str, str | int]) -> None:
    """Write pixels (H, W, channels) in the format that the suffix of the path names, complete or not at all.

    `attributes` are attributes that OpenImageIO's writer of the format reads.

    Raises OutputError where OpenImageIO cannot write the file, and OSError where the file system cannot store it.
    """
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, oiio.UINT8)
    for key, value in attributes.items():
        spec.attribute(key, value)
    with atomic_path(path) as temporary, memory_file(temporary) as name:
        output = oiio.ImageOutput.create(str(temporary))
        if output is None:
            oiio.geterror()
            raise OutputError(f"{path}: cannot write this kind of file; a name that ends in .png would be right")
        written = output.open(name, spec) and output.write_image(np.ascontiguousarray(pixels))
        if not (output.close() and written):
            raise OutputError(f"{path}: cannot write the picture: {output.geterror().strip()}")
