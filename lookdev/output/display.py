"""From linear light to what a screen shows: OpenColorIO's views, as 8-bit PNG.

The config is OpenColorIO's built-in ACES CG config on every machine; ``$OCIO`` is not read.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import OpenImageIO as oiio
from numpy.typing import ArrayLike, NDArray

from lookdev.cache import atomic_path, from_memory
from lookdev.errors import OutputError, nearest_hint

if TYPE_CHECKING:
    import PyOpenColorIO as ocio

Floats = NDArray[np.float32]
Pixels = NDArray[np.uint8]

CONFIG = "cg-config-v2.2.0_aces-v1.3_ocio-v2.4"
SOURCE = "Linear Rec.709 (sRGB)"
DISPLAY = "sRGB - Display"
VIEWS: tuple[str, ...] = ("ACES 1.0 - SDR Video", "Un-tone-mapped", "Raw")


@lru_cache(maxsize=len(VIEWS))
def _processor(view: str) -> ocio.CPUProcessor:
    return view_processor(view).getDefaultCPUProcessor()


def view_processor(view: str) -> ocio.Processor:
    """Return OpenColorIO's transform of a view, from linear Rec.709 to [0, 1]; raises OutputError for another."""
    import PyOpenColorIO as ocio  # not at the top: a job writes its first picture late

    if view not in VIEWS:
        raise OutputError(f"no view '{view}' of {DISPLAY} ({nearest_hint(view, VIEWS)}; views: {', '.join(VIEWS)})")
    config = ocio.Config.CreateFromBuiltinConfig(CONFIG)
    return config.getProcessor(SOURCE, DISPLAY, view, ocio.TRANSFORM_DIR_FORWARD)


def to_display(rgb: ArrayLike, view: str) -> Pixels:
    """Return linear Rec.709 light (H, W, 3) as sRGB code values, (H, W, 3) uint8, rounded to nearest.

    `view` is one of `VIEWS`; ``Raw`` only quantises. Raises OutputError for another view or pixels that are not finite.
    """
    processor = _processor(view)
    shown = np.array(rgb, dtype=np.float32, order="C")  # a copy: OpenColorIO works in place
    broken = np.argwhere(~np.isfinite(shown).all(axis=-1))
    if broken.size:
        row, column = broken[0]
        raise OutputError(f"{len(broken)} pixels are NaN or infinite, the first in row {row}, column {column}")
    processor.applyRGB(shown)
    return (np.clip(shown, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def composite(beauty: ArrayLike, alpha: ArrayLike, background: ArrayLike) -> Floats:
    """Lay premultiplied beauty (H, W, 3) with alpha (H, W) over linear light (H, W, 3) or one colour (3,)."""
    uncovered = 1.0 - np.asarray(alpha, dtype=np.float32)[..., None]
    return np.asarray(beauty, dtype=np.float32) + uncovered * np.asarray(background, dtype=np.float32)


def write_png(path: Path, rgb: ArrayLike, alpha: ArrayLike | None, view: str) -> None:
    """Write linear light (H, W, 3) as a PNG, whole or not at all; raises OutputError as `to_display`, or on writing.

    With `alpha` (H, W), `rgb` is premultiplied; it is divided by alpha before the view transform, because PNG stores
    unassociated alpha, and pixels of alpha 0 become black. Without alpha, the picture is opaque.
    """
    if alpha is None:
        write_pixels(path, to_display(rgb, view))
        return
    coverage = np.asarray(alpha, dtype=np.float32)[..., None]
    # In float64 and bounded, because division by a tiny alpha overflows.
    straight = np.divide(np.asarray(rgb, np.float64), coverage, where=coverage > 0.0, out=np.zeros(np.shape(rgb)))
    straight = np.minimum(straight, np.finfo(np.float32).max)
    opacity = (np.clip(coverage, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    write_pixels(path, np.concatenate([to_display(straight, view), opacity], axis=-1))


def write_pixels(path: Path, pixels: Pixels) -> None:
    """Write (H, W, 3 or 4) sRGB-encoded pixels, alpha unassociated, as a PNG, whole or not at all, or OutputError."""
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, oiio.UINT8)
    spec.attribute("oiio:ColorSpace", "sRGB")
    spec.attribute("oiio:UnassociatedAlpha", 1)  # otherwise the writer divides by alpha again
    try:
        with atomic_path(path) as temporary, from_memory(temporary) as name:
            output = oiio.ImageOutput.create(str(temporary))
            if output is None:
                oiio.geterror()
                raise OutputError(f"{path}: cannot write this kind of file; a name that ends in .png would be right")
            written = output.open(name, spec) and output.write_image(np.ascontiguousarray(pixels))
            if not (output.close() and written):
                raise OutputError(f"{path}: cannot write the picture: {output.geterror().strip()}")
    except OSError as error:
        raise OutputError(f"{path}: cannot write the picture: {error.strerror}") from error
