"""The picture that is fitted: linear light, alpha and noise of a file.

- Immerkær, J. 1996. Fast Noise Variance Estimation. Computer Vision and Image Understanding 64(2).
- Lindbloom, B. Chromatic Adaptation; RGB/XYZ Matrices (brucelindbloom.com): the matrices of primaries.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve

from lookdev.errors import LookdevError
from lookdev.images import open_image, whole_image

Floats = NDArray[np.float64]

REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
"""x and y of red, green, blue and white: those of an EXR without ``chromaticities``."""

_LINEAR = ("openexr", "hdr")
_LEVELS = 8  # of brightness, each of which has its noise
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
# The difference of two Laplacians (Immerkær's eq. 2): surfaces that are planes in brightness do not enter.
_LAPLACIANS = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]])


@dataclass(frozen=True, eq=False)
class Photo:
    """A picture: premultiplied linear Rec.709 (H, W, 3), alpha (H, W) or None, standard error (H, W, 3).

    `counts` are the pixels that may be compared, (H, W) in [0, 1]; `noise_from` says where the error is from.
    """

    file: Path
    color: Floats
    alpha: Floats | None
    noise: Floats
    counts: Floats
    noise_from: str
    notes: tuple[str, ...] = ()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.color.shape[1], self.color.shape[0]


def read_photo(file: Path, mask: Path | None = None) -> Photo:
    """Read a picture; `mask` is an image of its size whose last channel says how much each pixel counts.

    Light by other primaries than Rec.709's, as the file's ``chromaticities`` say, is converted, with a note. The noise
    is that of the layer ``error``, which frames have, else it is estimated from the picture's finest detail. Pixels
    that are not finite do not count. Raises LookdevError where the file is no linear picture, or the mask not of it.
    """
    with open_image(file, LookdevError) as image:
        kind, names = image.format_name(), list(image.spec().channelnames)
        if kind not in _LINEAR:
            raise LookdevError(
                f"{file}: is {kind}, whose values are encoded for a display; a linear EXR would be right"
            )
        if not {*"RGB"} <= {*names}:
            raise LookdevError(f"{file}: has channels {', '.join(names[:12])}; R, G and B would be right")
        primaries = image.spec().getattribute("chromaticities")
        pixels = whole_image(image, file, range(len(names)), LookdevError).astype(np.float64)

    def layer(wanted: list[str]) -> Floats | None:
        return pixels[..., [names.index(each) for each in wanted]] if {*wanted} <= {*names} else None

    color, alpha, noise = layer([*"RGB"]), layer(["A"]), layer([f"error.{each}" for each in "RGB"])
    assert color is not None
    notes = []
    counts = np.isfinite(color).all(axis=-1).astype(np.float64)
    if broken := int((counts == 0.0).sum()):
        notes.append(f"{file}: {broken} pixels are not finite and do not count")
        color = np.where(counts[..., None] > 0.0, color, 0.0)
    if primaries is not None and not np.allclose(primaries, REC709, atol=1e-4):
        matrix = to_rec709(tuple(primaries))
        color = color @ matrix.T
        noise = None if noise is None else np.sqrt(noise**2 @ (matrix**2).T)
        notes.append(f"{file}: its primaries are not Rec.709's: it was converted, white adapted by Bradford's matrix")
    if mask is not None:
        counts = counts * _read_mask(mask, color.shape[:2])
    if not counts.any():
        raise LookdevError(f"{mask or file}: no pixel counts")
    from_file = noise is not None and bool(np.isfinite(noise).all()) and bool(noise.any())
    if not from_file or noise is None:
        noise = estimated_noise(color, counts)
    said = "the file's layer 'error'" if from_file else "the picture's finest detail (Immerkær 1996)"
    return Photo(file, color, None if alpha is None else alpha[..., 0], noise, counts, said, tuple(notes))


def _read_mask(file: Path, shape: tuple[int, ...]) -> Floats:
    with open_image(file, LookdevError) as image:
        spec = image.spec()
        if (spec.height, spec.width) != shape:
            raise LookdevError(
                f"{file}: is {spec.width} x {spec.height} pixels large; the picture's {shape[1]} x {shape[0]} would be "
                "right"
            )
        pixels = whole_image(image, file, range(spec.nchannels), LookdevError)
    return np.clip(pixels[..., -1].astype(np.float64), 0.0, 1.0)


def to_rec709(primaries: tuple[float, ...]) -> Floats:
    """Return the matrix from light by other primaries, with x and y as `REC709`, to Rec.709, white to white."""
    white_there, white_here = (_xyz(each[6:8]) for each in (primaries, REC709))
    adapted = np.linalg.inv(_BRADFORD) @ np.diag((_BRADFORD @ white_here) / (_BRADFORD @ white_there)) @ _BRADFORD
    return np.asarray(np.linalg.inv(_rgb_to_xyz(REC709)) @ adapted @ _rgb_to_xyz(primaries))


def _rgb_to_xyz(primaries: tuple[float, ...]) -> Floats:
    columns = np.stack([_xyz(primaries[i : i + 2]) for i in (0, 2, 4)], axis=-1)
    return np.asarray(columns * np.linalg.solve(columns, _xyz(primaries[6:8])))


def _xyz(place: tuple[float, ...]) -> Floats:
    x, y = place
    return np.array([x / y, 1.0, (1.0 - x - y) / y])


def estimated_noise(color: Floats, counts: Floats) -> Floats:
    """Return the standard error (H, W, 3) of a picture by itself: of pixels of like brightness, the median detail."""
    found = np.empty_like(color)
    inside = convolve(counts, np.ones((3, 3)), mode="constant") > 8.99
    for channel in range(3):
        plane = color[..., channel]
        # Of normal noise, the kernel's response has 6 times its standard error, whose median magnitude is .6745 of it.
        response = np.abs(convolve(plane, _LAPLACIANS, mode="nearest")) / (6.0 * 0.6745)
        smooth = convolve(plane, np.full((3, 3), 1.0 / 9.0), mode="nearest")
        chosen = inside if inside.any() else counts > 0.0
        ends = np.quantile(smooth[chosen], np.linspace(0.0, 1.0, _LEVELS + 1))
        level = np.clip(np.searchsorted(ends, smooth, side="right") - 1, 0, _LEVELS - 1)
        medians = [np.median(response[chosen & (level == n)]) if (chosen & (level == n)).any() else 0.0
                   for n in range(_LEVELS)]  # fmt: skip
        found[..., channel] = np.array(medians)[level]
    return found
