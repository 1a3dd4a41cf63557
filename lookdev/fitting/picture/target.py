"""How renders are compared with a picture: pixels in blocks, weights, and a square without the noise of renders.

The squared difference of a noisy render has its variance as a bias, which favours parameters of little noise. Of two
independent renders a and b, w (a - y) (b - y) has the mean w (mean - y)^2, and with derivatives of a third render its
gradient has no bias either.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import gcd

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve

from lookdev.errors import LookdevError
from lookdev.fitting.picture.photo import Photo

Floats = NDArray[np.float64]

_RELATIVE = 0.02
"""Of a pixel's brightness: no pixel is believed to a smaller error, so that few do not outweigh all."""

_DARK = 0.02
"""Of the mean brightness: the same for dark pixels."""


def block_of(size: tuple[int, int], pixels: int) -> int:
    """Return the side of the blocks of a picture's pixels that are one pixel of renders.

    It divides width and height, and leaves at least so many blocks; a film of boxes makes a block's mean its pixel.
    """
    common = gcd(*size)
    sides = [each for each in range(1, common + 1) if common % each == 0]
    return max(each for each in sides if each == 1 or size[0] * size[1] >= pixels * each**2)


@dataclass(frozen=True, eq=False)
class Target:
    """A picture as renders are compared with it: `value` and `variance` (H, W, C), `weight` (H, W, C), 0 if left out.

    The fourth channel, of looks that can be seen through, is alpha.
    """

    value: Floats
    variance: Floats
    weight: Floats

    @classmethod
    def of(cls, photo: Photo, block: int, covered: Floats, gain: float, *, see_through: bool) -> Target:
        """Return the target of a picture that is divided by `gain`, the exposure of renders.

        Of blocks of pixels the mean is compared, where all of them count, and where the asset covers them whole:
        `covered` (H, W) is that of a render. A look that can be seen through is compared everywhere, and by alpha.
        Raises LookdevError where nothing is left.
        """
        color, variance = blocks(photo.color, block) / gain, blocks(photo.noise**2, block) / (block * gain) ** 2
        counts = _least(photo.counts, block)
        if photo.alpha is not None and not see_through:
            counts = counts * (_least(photo.alpha, block) >= 1.0 - 1e-4)
        if see_through:
            if photo.alpha is None:
                raise LookdevError(
                    f"{photo.file}: the look can be seen through, and the picture has no alpha to compare with; an EXR "
                    "with channel A, premultiplied, would be right"
                )
            alpha = blocks(photo.alpha[..., None], block)
            noise = np.full_like(alpha, max(float(np.mean(variance / np.maximum(color, 1e-3) ** 2)), 1e-6))
            color, variance = np.concatenate([color, alpha], -1), np.concatenate([variance, noise], -1)
        else:
            counts = counts * (covered >= 1.0 - 1e-6)
        if (counts > 0.0).sum() < 16:
            raise LookdevError(
                f"{photo.file}: {int((counts > 0.0).sum())} blocks of {block} x {block} pixels are of the asset alone; "
                "a picture of the job's camera, whose alpha and mask leave some, would be right"
            )
        # A pixel's own noise must not decide its weight: neighbours do.
        near = _neighbours(color, counts)
        noise = _neighbours(variance, counts)
        floor = _DARK * (color * counts[..., None]).sum(axis=(0, 1)) / counts.sum()
        weight = counts[..., None] / (noise + (_RELATIVE * near) ** 2 + floor**2 + 1e-12)
        return cls(color, variance, weight)

    def loss(self, a: Floats, b: Floats) -> float:
        """Return the weighted squared difference from the mean of independent renders (H, W, C), without bias.

        Relative to the weighted square of the picture; it can be below 0 where it is less than the renders' noise.
        """
        return float((self.weight * (a - self.value) * (b - self.value)).sum() / self.scale)

    @property
    def scale(self) -> float:
        """The weighted square of the picture."""
        return float((self.weight * self.value**2).sum())

    @property
    def noise(self) -> float:
        """The part of the loss that is the picture's own noise."""
        return float((self.weight * self.variance).sum() / self.scale)


def blocks(values: Floats, side: int) -> Floats:
    """Return the means (h, w, C) of blocks of pixels (H, W, C)."""
    height, width, channels = values.shape
    return np.asarray(values.reshape(height // side, side, width // side, side, channels).mean(axis=(1, 3)))


def _least(values: Floats, side: int) -> Floats:
    height, width = values.shape
    return np.asarray(values.reshape(height // side, side, width // side, side).min(axis=(1, 3)))


def _neighbours(values: Floats, counts: Floats) -> Floats:
    """Return the means (H, W, C) of the 24 neighbours that count, or of all pixels where there are none."""
    kernel = np.ones((5, 5))
    kernel[2, 2] = 0.0
    total = convolve(counts, kernel, mode="constant")
    found = np.empty_like(values)
    for channel in range(values.shape[-1]):
        plane = values[..., channel]
        near = convolve(plane * counts, kernel, mode="constant") / np.maximum(total, 1e-12)
        found[..., channel] = np.where(total > 0.0, near, np.average(plane, weights=counts))
    return found
