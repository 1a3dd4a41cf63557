"""Looks for tests that read images: textures, masks, normal maps and height maps."""

from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from lookdev.material import Bump, Coordinates, Formula, Layer, Texture
from lookdev.material.expression import parse


def image(file: Path, seed: int) -> Path:
    """Write an image of 8 x 8 random blocks of 2 x 2 pixels.

    Neighbouring pixels are equal, so that a look-up does not depend on the last digit of a coordinate.
    """
    blocks = np.random.default_rng(seed).integers(0, 256, (8, 8, 3)).astype(np.uint8)
    pixels = np.kron(blocks, np.ones((2, 2, 1), np.uint8))
    assert oiio.ImageBuf(pixels).write(str(file))
    return file


def painted(folder: Path) -> tuple[Layer, ...]:
    """Return Disney paint with textures and a normal map, under dust whose mask is an expression of a texture."""
    color = Texture(image(folder / "color.png", 1), "rgb", "sRGB")
    grain = image(folder / "grain.png", 2)
    rough = Texture(
        grain, "r", "raw", wrap_s="mirror", transform=(2.0, 0.0, 0.1, 0.0, 3.0, 0.2), scale=(0.6,) * 4, bias=(0.2,) * 4
    )
    normal = Texture(grain, "rgb", "raw", scale=(0.6, 0.6, 0.2, 1.0), bias=(-0.3, -0.3, 0.8, 0.0))
    mask = Formula(
        parse("smoothstep(t[0], 0.3, 0.7) * m"),
        {"t": Coordinates("st", (5.0, 0.0, 0.0, 0.0, 5.0, 0.0)), "m": rough},
        {"t": "color", "m": "float"},
    )
    return (
        Layer("Paint", "disney", {"baseColor": color, "roughness": rough, "metallic": 0.3, "normal": normal}),
        Layer("Dust", "disney", {"baseColor": (0.1, 0.4, 0.2), "roughness": 0.8}, mask),
    )


def sparkling(folder: Path) -> tuple[Layer, ...]:
    """Return flakes, a Disney layer with a thin film, the exponent `gamma` of GTR, and two normal maps.

    The specular and the clearcoat lobe have different normal maps.
    """
    grain = image(folder / "grain.png", 2)

    def flakes(repeat: float) -> Texture:
        transform = (repeat, 0.0, 0.0, 0.0, repeat, 0.0)
        return Texture(
            grain, "rgb", "raw", transform=transform, scale=(0.8, 0.8, 0.2, 1.0), bias=(-0.4, -0.4, 0.8, 0.0)
        )

    inputs = {
        "baseColor": (0.5, 0.1, 0.2),
        "metallic": 0.6,
        "roughness": 0.5,
        "gamma": 1.6,
        "filmThickness": 450.0,
        "clearcoat": 1.0,
        "clearcoatGloss": 0.2,
        "specularNormal": flakes(3.0),
        "clearcoatNormal": flakes(2.0),
    }
    return (Layer("Flakes", "disney", inputs),)


def embossed(folder: Path) -> tuple[Layer, ...]:
    """Return a Pixar layer, half metal, whose highlights have normals from a height map."""
    height = Texture(image(folder / "height.png", 3), "g", "raw", transform=(2.0, 1.0, 0.0, -1.0, 2.0, 0.0))
    color = Texture(image(folder / "color.png", 1), "rgb", "sRGB")
    inputs = {"surfaceColor": color, "roughness": 0.4, "metallic": 0.5, "highlightNormal": Bump(height, 0.01)}
    return (Layer("Emboss", "pixar", inputs),)
