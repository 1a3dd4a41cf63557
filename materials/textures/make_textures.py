"""Make the textures of the example looks: ``python materials/textures/make_textures.py [folder]``.

Each is 512x512, 8-bit gray, tiling in both directions: noise is made in the frequency domain or on a torus.
Gray levels are few where that is not seen, because noise does not compress. Each run gives the same numbers.

    flakes.png      how much of a metal flake shows, 0 between flakes: a mask
    dirt.png        dust that has settled in patches, with fine grain: a mask
    brushed.png     brushing streaks along t, about 0.5 on average: added to a roughness, or a height
    wear.png        where paint has come off, in chips and scratches: a mask, and the depth of a height
    wood.png        growth rings and fibres along s, 1 where the wood is darkest: a mask, and the depth of a height
    leaf.png        where one leaf is, its tip at the top, without the stalk: a presence
    leaf_veins.png  its midrib, stalk, side veins and the net between them: a mask, and a height
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


def wear() -> Image:
    """Chips with ragged edges, in groups where paint was rubbed off, and scratches of any direction."""
    chips = noise(51, 3.0, 40.0, fall=1.5) + 0.3 * noise(52, 30.0, 160.0, fall=0.8)
    image = smoothstep(1.75, 1.9, chips)
    rng = np.random.default_rng(53)
    for _ in range(70):
        start, angle, bend = rng.uniform(0, SIZE, 2), rng.uniform(0, 2 * np.pi), rng.normal(0, 0.004)
        along = np.arange(0.0, rng.uniform(20, 160), 0.5)
        angles = angle + bend * along
        path = start[:, np.newaxis] + 0.5 * np.cumsum([np.sin(angles), np.cos(angles)], axis=1)
        depth = rng.uniform(0.3, 1.0) * np.sin(np.pi * along / along[-1])
        corner = np.floor(path - 0.5).astype(int)
        rest = path - 0.5 - corner
        for t, s in ((0, 0), (0, 1), (1, 0), (1, 1)):  # a line one texel wide, filtered bilinearly
            near = np.abs(1 - t - rest[0]) * np.abs(1 - s - rest[1])
            np.maximum.at(image, ((corner[0] + t) % SIZE, (corner[1] + s) % SIZE), np.sqrt(near) * depth)
    return image


def wood() -> Image:
    """A board sawn off the heart of a log: each ring darkens slowly and ends at once; pores and fibres along s."""
    t, s = (np.mgrid[:SIZE, :SIZE] + 0.5) / SIZE
    bow = 0.22 + 0.09 * np.sin(2 * np.pi * s) + 0.02 * turned(noise(61, 1.0, 3.0, stretch=2.0, fall=1.5))
    radius = np.hypot(t - 0.5, bow) + 0.004 * turned(noise(62, 3.0, 30.0, stretch=8.0, fall=1.5))
    age = 26.0 * radius % 1.0
    rings = age**2 * smoothstep(1.0, 0.9, age)
    fibres, pores = (turned(noise(seed, 40.0, 400.0, stretch=25.0)) for seed in (63, 64))
    return np.clip(0.12 + 0.55 * rings + 0.07 * fibres + 0.3 * smoothstep(1.6, 2.2, pores), 0.0, 1.0)


def turned(image: Image) -> Image:
    """Turn a texture by a quarter: what ran along t runs along s."""
    return image.T


def leaf_frame() -> tuple[Image, Image, Image]:
    """Return, of every texel: the distance right of the midrib, the place along it, 0 to 1 inside, half the width."""
    row, column = (np.mgrid[:SIZE, :SIZE] + 0.5) / SIZE * 2.0 - 1.0
    along = (0.62 - row) / 1.52
    inside = np.clip(along, 0.0, 1.0)
    tooth = along * 22.0 % 1.0
    teeth = 1.0 - 0.05 * np.where(tooth < 0.75, tooth / 0.75, (1.0 - tooth) / 0.25) * smoothstep(0.0, 0.2, inside)
    midrib = 0.05 * np.sin(2.2 * row + 0.4)
    return column - midrib, along, 1.45 * inside**0.55 * (1.0 - inside) ** 0.95 * teeth


def leaf() -> Image:
    """An ovate leaf with a toothed edge, which is two texels wide, so that it is smooth when enlarged."""
    across, along, half_width = leaf_frame()
    edge = smoothstep(-1.0, 1.0, (half_width - np.abs(across)) * (SIZE / 2))
    return np.where((along > 0.0) & (along < 1.0), edge, 0.0)


def leaf_veins() -> Image:
    """A tapering midrib and stalk, side veins that bow towards the tip, and a net of the finest veins."""
    across, along, half_width = leaf_frame()
    out = np.abs(across)
    rib = smoothstep(1.0, 0.5, out / (0.005 + 0.016 * (1.0 - along))) * smoothstep(-0.23, -0.21, along)
    rib *= smoothstep(0.98, 0.9, along)
    # Along a side vein this is constant; left and right alternate.
    level = (along - 0.25 * out - 0.45 * out**2) * 9.0 + np.where(across > 0.0, 0.5, 0.0)
    distance = np.abs(level - np.rint(level)) / 9.0
    inwards = np.clip(1.0 - out / np.maximum(half_width, 1e-6), 0.0, 1.0)
    sides = smoothstep(1.0, 0.4, distance / (0.002 + 0.007 * inwards)) * smoothstep(0.0, 0.2, inwards)
    sides *= (np.rint(level) >= 1.0) & (along < 0.95)
    net = smoothstep(0.2, 0.0, np.abs(noise(71, 22.0, 26.0, fall=3.0)))
    return np.maximum(rib, leaf() * np.maximum(0.8 * sides, 0.35 * net))


TEXTURES = {
    "flakes.png": (flakes, 255),
    "dirt.png": (dirt, 31),
    "brushed.png": (brushed, 63),
    "wear.png": (wear, 63),
    "wood.png": (wood, 63),
    "leaf.png": (leaf, 255),
    "leaf_veins.png": (leaf_veins, 255),
}
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
