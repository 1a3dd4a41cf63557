"""What a look is: layers, inputs, textures and masks; `usd` reads them, `textures` makes them linear."""

from lookdev.material.look import Bump, Color, Input, Layer, Look, Primvar, Texture, Wrap

__all__ = ["Bump", "Color", "Input", "Layer", "Look", "Primvar", "Texture", "Wrap"]
