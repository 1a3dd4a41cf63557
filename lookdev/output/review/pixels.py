"""The numbers of a frame as a script that a page from ``file://`` may read."""

from __future__ import annotations

import base64
import json
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lookdev.arrays import Floats32
from lookdev.cache import atomic_path
from lookdev.metrics import pooled_error
from lookdev.output.display import laid_over
from lookdev.output.exr import read_layer, read_shown, space_of
from lookdev.space import REC709, error_in_rec709

PLANES = "RGBAE"
"""Of a script: colour, alpha, and the standard error of the colour where it is known."""

_LEVEL = 4  # of zlib: noise packs no better at higher ones
_LARGEST = float(np.finfo(np.float16).max)


@dataclass(frozen=True)
class Pixels:
    """Premultiplied linear Rec.709 (H, W, 3), alpha (H, W), and the error of the colour (H, W); None: not known."""

    beauty: Floats32
    alpha: Floats32
    error: Floats32 | None


def read_pixels(frame: Path, over: Path | None = None) -> Pixels:
    """Return what a page shows of a frame, rounded as it is there, under another frame that is laid over it.

    Raises OutputError where one is damaged.
    """
    (beauty, alpha), error = read_shown(frame), _error(frame)
    if over is not None:
        props, of_props = read_shown(over), _error(over)
        beauty, alpha = laid_over(props, (beauty, alpha))
        if error is not None:
            error = None if of_props is None else np.hypot((1.0 - props[1]) * error, of_props)
    return Pixels(_rounded(beauty), _rounded(alpha), None if error is None else _rounded(error))


def _error(frame: Path) -> Floats32 | None:
    """Return the pooled error of a frame that was read, (H, W), in linear Rec.709; None where it is not known."""
    error, space = read_layer(frame, "error"), space_of(frame)
    if error is None:
        return None
    return pooled_error(error if space == REC709 else error_in_rec709(error, space).astype(np.float32))


def write_pixels_script(path: Path, name: str, pixels: Pixels) -> None:
    """Write a script that calls ``review.put(name, {...})``, whole or not at all.

    ``data`` is base64 of zlib of half floats, plane by plane in the order of `PLANES`, the high bytes of each before
    its low bytes: the first pack to a fifth, the second are noise.
    """
    planes = [*np.moveaxis(pixels.beauty, -1, 0), pixels.alpha, *([] if pixels.error is None else [pixels.error])]
    halves = np.stack(planes).astype(">f2").reshape(len(planes), -1, 1)
    packed = zlib.compress(halves.view(np.uint8).swapaxes(1, 2).tobytes(), _LEVEL)
    height, width = pixels.alpha.shape
    entry = {"width": width, "height": height, "planes": len(planes), "data": base64.b64encode(packed).decode("ascii")}
    with atomic_path(path) as temporary:
        temporary.write_text(f"review.put({json.dumps(name)}, {json.dumps(entry)});\n", encoding="ascii")


def _rounded(values: Floats32) -> Floats32:
    """Return the half floats nearest to values, those beyond their range at its end."""
    return np.clip(values, -_LARGEST, _LARGEST).astype(np.float16).astype(np.float32)
