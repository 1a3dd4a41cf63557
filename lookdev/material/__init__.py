"""What a look is: layers, inputs, textures and masks; `usd` reads them, `textures` makes them linear."""

from lookdev.material.look import (
    Bump,
    Coordinates,
    Displacement,
    Formula,
    Input,
    Layer,
    Look,
    Primvar,
    Texture,
    Varying,
    View,
)

__all__ = [
    "Bump",
    "Coordinates",
    "Displacement",
    "Formula",
    "Input",
    "Layer",
    "Look",
    "Primvar",
    "Texture",
    "Varying",
    "View",
]
