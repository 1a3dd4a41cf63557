"""Compares renders with the picture of a fit, by a weighted squared difference without bias.

Let y be the value of a pixel of the picture, and w its weight. The squared difference of a noisy render has the
variance of the render as a bias, which would favour parameters with little noise. So two independent renders a and b
are used: the expectation of w (a - y) (b - y) is w (m - y)^2, where m is the render without noise. With derivatives
from a third render, the gradient has no bias either. A large picture is compared in square blocks of pixels, each with
one pixel of the renders.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import gcd

import numpy as np
from scipy.ndimage import convolve

from lookdev.arrays import Floats
from lookdev.errors import LookdevError
from lookdev.fitting.picture.photo import Photo

_MIN_RELATIVE_ERROR = 0.02
"""The least error of a pixel, relative to its brightness, so that a few pixels do not outweigh all others.

It is added to the noise of the pixel, as a variance.
"""

_MIN_DARK_ERROR = 0.02
"""The least error of a dark pixel, relative to the mean brightness of the picture; it is added as a variance, too."""


def block_side(size: tuple[int, int], pixels: int) -> int:
    """Return the side of the square blocks of the picture; a block is compared with one pixel of a render.

    `size` is the width and the height of the picture. The side divides both. It is the largest side that leaves at
    least `pixels` blocks, or 1 if there is none. Renders have a box filter, so the mean of a block corresponds to a
    pixel of a render.
    """
    common = gcd(*size)
    sides = [side for side in range(1, common + 1) if common % side == 0]
    return max(side for side in sides if side == 1 or size[0] * size[1] >= pixels * side**2)


@dataclass(frozen=True, eq=False)
class Target:
    """The target of a fit: the picture at the resolution of the renders.

    All arrays have the shape (H, W, C). The channels are RGB and, for a look that can be seen through, alpha. `weight`
    is 0 for pixels that are not compared.
    """

    value: Floats
    variance: Floats
    weight: Floats

    @classmethod
    def from_photo(cls, photo: Photo, block: int, covered: Floats, gain: float, *, see_through: bool) -> Target:
        """Return the target for a picture, divided by `gain`, the factor of exposure that renders do not include.

        `block` is the side of a block. A block is compared if all of its pixels have weight and the asset covers it
        completely; `covered` (H, W) is the alpha of a render. A look that can be seen through (`see_through`) is
        compared everywhere, and in alpha, too. Raises LookdevError if too few blocks are left.
        """
        color = block_means(photo.color, block) / gain
        variance = block_means(photo.noise**2, block) / (block * gain) ** 2
        weights = _block_minima(photo.weights, block)
        if photo.alpha is not None and not see_through:
            weights = weights * (_block_minima(photo.alpha, block) >= 1.0 - 1e-4)
        if see_through:
            if photo.alpha is None:
                raise LookdevError(
                    f"{photo.file}: the look can be seen through, and the picture has no alpha to compare with; an EXR "
                    "with channel A, premultiplied, would be right"
                )
            # The variance of alpha is unknown. The mean relative variance of the colours takes its place.
            alpha = block_means(photo.alpha[..., None], block)
            noise = np.full_like(alpha, max(float(np.mean(variance / np.maximum(color, 1e-3) ** 2)), 1e-6))
            color, variance = np.concatenate([color, alpha], -1), np.concatenate([variance, noise], -1)
        else:
            weights = weights * (covered >= 1.0 - 1e-6)
        if (weights > 0.0).sum() < 16:
            count = f"{int((weights > 0.0).sum())} blocks of {block} x {block} pixels"
            raise LookdevError(
                f"{photo.file}: only {count} show nothing but the asset; "
                "a picture of the job's camera, whose alpha and mask leave some, would be right"
            )
        # The weight of a pixel depends on its neighbours alone: if it depended on the pixel, noise would bias the loss.
        mean_color = _mean_of_neighbours(color, weights)
        noise = _mean_of_neighbours(variance, weights)
        floor = _MIN_DARK_ERROR * (color * weights[..., None]).sum(axis=(0, 1)) / weights.sum()
        weight = weights[..., None] / (noise + (_MIN_RELATIVE_ERROR * mean_color) ** 2 + floor**2 + 1e-12)
        return cls(color, variance, weight)

    def loss(self, a: Floats, b: Floats) -> float:
        """Return the weighted squared difference of two independent renders (H, W, C) from the picture, without bias.

        The difference is divided by the weighted square of the picture. If it is smaller than the noise of the renders,
        the result may be negative.
        """
        return float((self.weight * (a - self.value) * (b - self.value)).sum() / self.scale)

    @property
    def scale(self) -> float:
        """The sum of the weighted squares of the picture; losses are divided by it."""
        return float((self.weight * self.value**2).sum())

    @property
    def noise(self) -> float:
        """The part of the loss that the noise of the picture causes."""
        return float((self.weight * self.variance).sum() / self.scale)


def block_means(values: Floats, side: int) -> Floats:
    """Return the means (H / side, W / side, C) of square blocks of pixels (H, W, C)."""
    height, width, channels = values.shape
    return np.asarray(values.reshape(height // side, side, width // side, side, channels).mean(axis=(1, 3)))


def _block_minima(values: Floats, side: int) -> Floats:
    """Return the minima (H / side, W / side) of square blocks of pixels (H, W)."""
    height, width = values.shape
    return np.asarray(values.reshape(height // side, side, width // side, side).min(axis=(1, 3)))


def _mean_of_neighbours(values: Floats, weights: Floats) -> Floats:
    """Return the weighted mean (H, W, C) of each pixel's 24 neighbours, or of all pixels if they have no weight."""
    kernel = np.ones((5, 5))
    kernel[2, 2] = 0.0
    total = convolve(weights, kernel, mode="constant")
    means = np.empty_like(values)
    for channel in range(values.shape[-1]):
        plane = values[..., channel]
        mean = convolve(plane * weights, kernel, mode="constant") / np.maximum(total, 1e-12)
        means[..., channel] = np.where(total > 0.0, mean, np.average(plane, weights=weights))
    return means
