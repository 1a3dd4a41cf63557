"""Make the textures of the example looks: ``python materials/textures/make_textures.py [folder]``.

Each is 512x512, 8-bit gray, tiling in both directions: noise is made in the frequency domain or on a torus.
Gray levels are few where that is not seen, because noise does not compress. Each run gives the same numbers.

    flakes.png   how much of a metal flake shows, 0 between flakes: a mask
    dirt.png     dust that has settled in patches, with fine grain: a mask
    brushed.png  brushing streaks along t, about 0.5 on average: added to a roughness
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

SIZE = 512
Image = NDArray[np.float64]


def noise(seed: int, low: float, high: float, stretch: float = 1.0, fall: float = 1.0) -> Image:
    """Tileable Gaussian noise, 1/f^fall between `low` and `high` cycles an edge, mean 0 and deviation 1.

    `stretch` lengthens its features along t (the rows) by that factor.
    """
    f_t, f_s = np.meshgrid(np.fft.fftfreq(SIZE, 1 / SIZE), np.fft.fftfreq(SIZE, 1 / SIZE), indexing="ij")
    frequency = np.maximum(np.hypot(f_s, stretch * f_t), low)
    spectrum = np.exp(-((frequency / high) ** 2)) / frequency**fall
    spectrum[0, 0] = 0.0
    white = np.random.default_rng(seed).standard_normal((SIZE, SIZE))
    image = np.fft.ifft2(np.fft.fft2(white) * spectrum).real
    return image / image.std()


def smoothstep(low: float, high: float, value: Image) -> Image:
    """Ramp from 0 at `low` to 1 at `high` without corners."""
    x = np.clip((value - low) / (high - low), 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


def flakes() -> Image:
    """Platelets of 3 to 7 texels, elliptic, each with a brightness of its own as if tilted at random."""
    rng = np.random.default_rng(20)
    image = np.zeros((SIZE, SIZE))
    reach = np.arange(-9, 10)
    for _ in range(3600):
        centre, angle = rng.uniform(0, SIZE, 2), rng.uniform(0, np.pi)
        radius, flatness, brightness = rng.uniform(1.5, 3.5), rng.uniform(0.55, 1.0), rng.beta(1.2, 2.2)
        rows, columns = (np.floor(position) + reach for position in centre)
        t, s = np.meshgrid(rows + 0.5 - centre[0], columns + 0.5 - centre[1], indexing="ij")
        along, across = np.cos(angle) * s + np.sin(angle) * t, np.cos(angle) * t - np.sin(angle) * s
        inside = np.clip(radius - np.hypot(along, across / flatness) + 0.5, 0.0, 1.0)
        index = np.ix_(rows.astype(int) % SIZE, columns.astype(int) % SIZE)
        image[index] = np.maximum(image[index], inside * brightness)
    return image


def dirt() -> Image:
    """Patches (large noise through a threshold) of uneven thickness, over a thin film with grain."""
    patches = smoothstep(-0.7, 1.9, noise(31, 2.0, 100.0, fall=1.7))
    grain = smoothstep(-2.2, 2.2, noise(32, 40.0, 120.0))
    specks = smoothstep(2.4, 3.0, noise(33, 60.0, 90.0))
    return np.clip(0.05 * grain + 0.85 * patches * (0.6 + 0.4 * grain) + 0.3 * specks, 0.0, 1.0)


def brushed() -> Image:
    """Fine scratches over broader bands, both long along t."""
    fine, bands = noise(41, 60.0, 400.0, stretch=90.0), noise(42, 6.0, 60.0, stretch=24.0)
    return np.clip(0.5 + 0.13 * fine + 0.09 * bands, 0.0, 1.0)


TEXTURES = {"flakes.png": (flakes, 255), "dirt.png": (dirt, 31), "brushed.png": (brushed, 63)}
"""File name to its maker and the number of gray steps."""


def pixels(name: str) -> NDArray[np.uint8]:
    """Return a texture as 8-bit gray values, shape (512, 512)."""
    make, steps = TEXTURES[name]
    return np.rint(np.rint(make() * steps) * (255.0 / steps)).astype(np.uint8)


def main(folder: Path) -> None:
    """Write all textures into `folder`."""
    for name in TEXTURES:
        output = oiio.ImageOutput.create(str(folder / name))
        spec = oiio.ImageSpec(SIZE, SIZE, 1, oiio.UINT8)
        spec["png:compressionLevel"] = 9
        image = np.ascontiguousarray(pixels(name)[..., np.newaxis])
        if not (output.open(str(folder / name), spec) and output.write_image(image) and output.close()):
            raise SystemExit(f"{folder / name}: {output.geterror()}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
