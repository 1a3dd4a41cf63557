"""The pixel values of frames for the review page: their script, and their comparison with another version.

The values are in a script because a page from ``file://`` may run scripts, but not read other files. Two versions of a
pixel count as different if the noise of both does not explain the difference.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lookdev.arrays import Floats32
from lookdev.cache import write_file
from lookdev.metrics import noise_ratio, pooled_error, relmse
from lookdev.output.display import composite_layers
from lookdev.output.exr import frame_space, read_layer, read_rec709
from lookdev.space import REC709, error_in_rec709

NOISE_LIMIT = 3.0
"""Two versions of a pixel differ by more than noise if their z (`lookdev.metrics.noise_ratio`) is larger than this.

Where noise is Gaussian, at most 0.27 % of pixels exceed it by chance.
"""

SQUARE = 7
"""Side in pixels of the squares over which z is computed: in comparisons here, and on the page by default."""

CHANGED_SHARE = 0.003
"""A frame counts as changed if z exceeds `NOISE_LIMIT` in a larger share of the asset's pixels."""

_ZLIB_LEVEL = 4  # higher levels do not compress noise better
_HALF_MAX = float(np.finfo(np.float16).max)


@dataclass(frozen=True)
class PremultipliedPixels:
    """A frame: beauty (H, W, 3), premultiplied linear Rec.709, alpha (H, W), and the error of the colour (H, W).

    `error` is the `pooled_error` of `lookdev.metrics`, or None if the frame does not have it.
    """

    beauty: Floats32
    alpha: Floats32
    error: Floats32 | None


def read_pixels(frame: Path, props_file: Path | None = None) -> PremultipliedPixels:
    """Return the pixels of a frame, rounded to half floats, with the reference props of another frame over it, if any.

    Raises OutputError where a frame is damaged.
    """
    (beauty, alpha), error = read_rec709(frame), _read_error(frame)
    if props_file is not None:
        props, props_error = read_rec709(props_file), _read_error(props_file)
        beauty, alpha = composite_layers(props, (beauty, alpha))
        if error is not None:  # the errors of the two pictures are independent, so that their squares add
            error = None if props_error is None else np.hypot((1.0 - props[1]) * error, props_error)
    return PremultipliedPixels(
        _round_to_half(beauty), _round_to_half(alpha), None if error is None else _round_to_half(error)
    )


def _read_error(frame: Path) -> Floats32 | None:
    """Return the pooled error (H, W) of a frame in linear Rec.709, or None if the frame has no errors.

    `read_frame` must have read the file before, because the checksum is not verified here.
    """
    error, space = read_layer(frame, "error"), frame_space(frame)
    if error is None:
        return None
    return pooled_error(error if space == REC709 else error_in_rec709(error, space).astype(np.float32))


def write_pixels_script(path: Path, name: str, pixels: PremultipliedPixels) -> None:
    """Write a script that calls ``review.put(name, {...})``, complete or not at all.

    ``data`` has half floats, plane by plane: red, green, blue, alpha, and the error if it is known. In a plane, all
    high bytes precede all low bytes, because high bytes compress to a fifth and low bytes are noise. The bytes are
    compressed by zlib, and encoded in base64.
    """
    planes = [*np.moveaxis(pixels.beauty, -1, 0), pixels.alpha, *([] if pixels.error is None else [pixels.error])]
    halves = np.stack(planes).astype(">f2").reshape(len(planes), -1, 1)
    packed = zlib.compress(halves.view(np.uint8).swapaxes(1, 2).tobytes(), _ZLIB_LEVEL)
    height, width = pixels.alpha.shape
    entry = {"width": width, "height": height, "planes": len(planes), "data": base64.b64encode(packed).decode("ascii")}
    write_file(path, f"review.put({json.dumps(name)}, {json.dumps(entry)});\n")


def _round_to_half(values: Floats32) -> Floats32:
    """Return the nearest half floats; values beyond their range become the largest or the smallest half float."""
    return np.clip(values, -_HALF_MAX, _HALF_MAX).astype(np.float16).astype(np.float32)


@dataclass(frozen=True)
class Comparison:
    """The comparison of a frame with the same frame of another version.

    `changed` are the inputs of the render that differ, such as "look" or "camera" (see `changed_parts`). `relmse` is
    the relMSE of the frame against the frame of the other version. `beyond` is the share of the asset's pixels whose z
    exceeds `NOISE_LIMIT`, or None if an error is not known. Both are None if the frames differ in size.
    """

    changed: tuple[str, ...]
    relmse: float | None = None
    beyond: float | None = None

    @property
    def visible(self) -> bool:
        """Whether pixels differ by more than noise explains; if the noise is not known, whether they differ at all."""
        if self.beyond is not None:
            return self.beyond > CHANGED_SHARE
        return self.relmse is None or self.relmse > 0.0


def compare_frames(
    new: PremultipliedPixels, old: PremultipliedPixels, header: Mapping[str, str], old_header: Mapping[str, str]
) -> Comparison:
    """Compare a frame with the same frame of another version, by their pixels and headers."""
    changed = changed_parts(header, old_header)
    if new.alpha.shape != old.alpha.shape:
        return Comparison(changed)
    alpha = np.maximum(new.alpha, old.alpha)
    error = relmse(new.beauty, old.beauty, alpha)
    if new.error is None or old.error is None:
        return Comparison(changed, error)
    z = noise_ratio(new.beauty, old.beauty, new.error, old.error, SQUARE)
    covered = alpha > 0.0
    return Comparison(changed, error, float((z[covered] > NOISE_LIMIT).mean()) if covered.any() else 0.0)


def changed_parts(header: Mapping[str, str], old: Mapping[str, str]) -> tuple[str, ...]:
    """Return the inputs of the render that differ by two headers: "look", "light", "camera" and so on.

    A header has a digest of each input, ``digest.<input>``, and a digest of all inputs, ``digest``.
    """
    prefix = "digest."
    keys = sorted({key for key in (*header, *old) if key.startswith(prefix)})
    parts = [key.removeprefix(prefix) for key in keys if header.get(key) != old.get(key)]
    names = tuple("light" if part == "ibl" else part for part in parts)
    return names or (("digest",) if header.get("digest") != old.get("digest") else ())
