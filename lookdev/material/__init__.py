"""Looks as plain data: layers, inputs, textures and masks. `usd` reads them, `textures` makes images linear."""

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
