"""Reads the picture that a look is fitted to: its linear light, alpha and noise.

- Immerkær, J. 1996. Fast Noise Variance Estimation. Computer Vision and Image Understanding 64(2).
- Lindbloom, B. Chromatic Adaptation; RGB/XYZ Matrices (brucelindbloom.com): the matrices of primaries.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import convolve

from lookdev.arrays import Floats
from lookdev.errors import LookdevError
from lookdev.images import open_image, whole_image
from lookdev.space import CHROMATICITIES, rgb_to_xyz_matrix, white_adaptation

REC709 = CHROMATICITIES["rec709"]
"""The chromaticities x and y of red, green, blue and white, 8 numbers; an EXR without ``chromaticities`` has these."""

_LINEAR_FORMATS = ("openexr", "hdr")
_BRIGHTNESS_LEVELS = 8  # the noise is estimated for each level of brightness
# The difference of two Laplacian filters (Immerkær's eq. 2). Its response is 0 where brightness is constant or linear.
_LAPLACIANS = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]])


@dataclass(frozen=True, eq=False)
class Photo:
    """A picture of an asset.

    Attributes
    ----------
    color : (H, W, 3)
        Linear Rec.709, premultiplied.
    alpha : (H, W)
        Alpha, or None if the file has none.
    noise : (H, W, 3)
        The standard error of `color`.
    weights : (H, W)
        The weight of each pixel in comparisons, in [0, 1].
    noise_from
        A text that states how the noise is known.
    notes
        Notes for the user.
    """

    file: Path
    color: Floats
    alpha: Floats | None
    noise: Floats
    weights: Floats
    noise_from: str
    notes: tuple[str, ...] = ()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.color.shape[1], self.color.shape[0]


def read_photo(file: Path, mask: Path | None = None) -> Photo:
    """Read a picture; `mask` is an image of the same size, whose last channel is the weight of each pixel.

    If the file's ``chromaticities`` differ from Rec.709, the picture is converted, with a note. The noise is the layer
    ``error`` of the file, which frames of lookdev have, or else an estimate from the finest detail of the picture.
    Pixels that are not finite have no weight. Raises LookdevError if the file is not a linear picture, or if the mask
    has another size.
    """
    with open_image(file, LookdevError) as image:
        file_format, names = image.format_name(), list(image.spec().channelnames)
        if file_format not in _LINEAR_FORMATS:
            raise LookdevError(
                f"{file}: is {file_format}, whose values are encoded for a display; a linear EXR would be right"
            )
        if not {*"RGB"} <= {*names}:
            raise LookdevError(f"{file}: has channels {', '.join(names[:12])}; R, G and B would be right")
        primaries = image.spec().getattribute("chromaticities")
        pixels = whole_image(image, file, range(len(names)), LookdevError).astype(np.float64)

    def layer(channels: list[str]) -> Floats | None:
        return pixels[..., [names.index(channel) for channel in channels]] if {*channels} <= {*names} else None

    color, alpha, noise = layer([*"RGB"]), layer(["A"]), layer([f"error.{channel}" for channel in "RGB"])
    assert color is not None
    notes = []
    weights = np.isfinite(color).all(axis=-1).astype(np.float64)
    if count := int((weights == 0.0).sum()):
        notes.append(f"{file}: {count} pixels are not finite and do not count")
        color = np.where(weights[..., None] > 0.0, color, 0.0)
    if primaries is not None and not np.allclose(primaries, REC709, atol=1e-4):
        matrix = matrix_to_rec709(tuple(primaries))
        color = color @ matrix.T
        noise = None if noise is None else np.sqrt(noise**2 @ (matrix**2).T)
        notes.append(f"{file}: its primaries are not Rec.709's: it was converted, white adapted by Bradford's matrix")
    if mask is not None:
        weights = weights * _read_mask(mask, color.shape[:2])
    if not weights.any():
        raise LookdevError(f"{mask or file}: no pixel counts")
    has_error_layer = noise is not None and bool(np.isfinite(noise).all()) and bool(noise.any())
    if not has_error_layer or noise is None:
        noise = estimate_noise(color, weights)
    source = "the file's layer 'error'" if has_error_layer else "the picture's finest detail (Immerkær 1996)"
    return Photo(file, color, None if alpha is None else alpha[..., 0], noise, weights, source, tuple(notes))


def _read_mask(file: Path, shape: tuple[int, ...]) -> Floats:
    """Return the last channel of an image, clipped to [0, 1]; raises LookdevError unless it has `shape`, (H, W)."""
    with open_image(file, LookdevError) as image:
        spec = image.spec()
        if (spec.height, spec.width) != shape:
            raise LookdevError(
                f"{file}: is {spec.width} x {spec.height} pixels large; the picture's {shape[1]} x {shape[0]} would be "
                "right"
            )
        pixels = whole_image(image, file, range(spec.nchannels), LookdevError)
    return np.clip(pixels[..., -1].astype(np.float64), 0.0, 1.0)


def matrix_to_rec709(primaries: tuple[float, ...]) -> Floats:
    """Return the matrix (3, 3) that converts colours from other primaries to Rec.709, and maps white to white.

    `primaries` has 8 numbers in the order of `REC709`.
    """
    adaptation = white_adaptation(primaries[6:8], REC709[6:8])
    return np.asarray(np.linalg.inv(rgb_to_xyz_matrix(REC709)) @ adaptation @ rgb_to_xyz_matrix(primaries))


def estimate_noise(color: Floats, weights: Floats) -> Floats:
    """Estimate the standard error (H, W, 3) of a picture from its finest detail.

    The standard error of a pixel is the median detail of all pixels with a similar brightness. Pixels whose
    neighbourhood has a weight below 1 are not sampled, if other pixels are left.
    """
    noise = np.empty_like(color)
    inside = convolve(weights, np.ones((3, 3)), mode="constant") > 8.99
    for channel in range(3):
        plane = color[..., channel]
        # For normal noise of standard error s, the response has standard error 6 s, and median magnitude 0.6745 * 6 s.
        response = np.abs(convolve(plane, _LAPLACIANS, mode="nearest")) / (6.0 * 0.6745)
        smooth = convolve(plane, np.full((3, 3), 1.0 / 9.0), mode="nearest")
        is_sampled = inside if inside.any() else weights > 0.0
        ends = np.quantile(smooth[is_sampled], np.linspace(0.0, 1.0, _BRIGHTNESS_LEVELS + 1))
        level = np.clip(np.searchsorted(ends, smooth, side="right") - 1, 0, _BRIGHTNESS_LEVELS - 1)
        medians = [np.median(response[is_sampled & (level == n)]) if (is_sampled & (level == n)).any() else 0.0
                   for n in range(_BRIGHTNESS_LEVELS)]  # fmt: skip
        noise[..., channel] = np.array(medians)[level]
    return noise
