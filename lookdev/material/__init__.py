"""What a look is: layers, inputs, textures and masks; `usd` reads them, `textures` makes them linear."""

from lookdev.material.look import (
    Bump,
    Color,
    Coordinates,
    Formula,
    Input,
    Layer,
    Look,
    Primvar,
    Source,
    Texture,
    Varying,
    Wrap,
)

__all__ = [
    "Bump",
    "Color",
    "Coordinates",
    "Formula",
    "Input",
    "Layer",
    "Look",
    "Primvar",
    "Source",
    "Texture",
    "Varying",
    "Wrap",
]
