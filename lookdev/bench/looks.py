"""The looks that are rendered."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

from lookdev.cache import cached_file
from lookdev.material import Input, Layer, Look, Texture
from lookdev.output.exr import write_frame

MOST_LAYERS = 8

_MASK_SIZE = 256
# The name of the file is its only digest: increase it with any change.
_MASK_VERSION = 1


@dataclass(frozen=True)
class BenchLook:
    """A look to render, and its description."""

    help: str
    make: Callable[[], Look]


def layered(layers: int) -> Look:
    """Return a stack of Disney layers; masks above the base are textures, so that no layer folds away."""
    stack = [Layer("layer0", "disney", {"baseColor": (0.35, 0.06, 0.04), "roughness": 0.35, "clearcoat": 0.5})]
    for number in range(1, layers):
        share = number / MOST_LAYERS
        inputs: dict[str, Input] = {
            "baseColor": (0.8 * share, 0.3, 0.7 - 0.6 * share),
            "metallic": float(number % 2),
            "roughness": 0.2 + 0.6 * share,
            "sheen": share,
            "anisotropic": 0.5 * (number % 3),
        }
        stack.append(Layer(f"layer{number}", "disney", inputs, _mask(number)))
    return Look(f"{layers} layers", tuple(stack))


def different(number: int) -> Look:
    """Return one of many looks of a Disney layer, all of them different: eight programs, in colours of their own."""
    share = number / (number + 4.0)
    inputs: dict[str, Input] = {
        "baseColor": (0.2 + 0.6 * share, 0.5, 0.7 - 0.5 * share),
        "roughness": 0.25 + 0.5 * share,
        "metallic": float(number & 1),
        "clearcoat": float(number >> 1 & 1),
        "anisotropic": 0.7 * (number >> 2 & 1),
    }
    return Look(f"look{number}", (Layer("Layer", "disney", inputs),))


def _plastic() -> Look:
    return Look("plastic", (Layer("Plastic", "disney", {"baseColor": (0.1, 0.2, 0.5), "roughness": 0.3}),))


def _car_paint() -> Look:
    paint: dict[str, Input] = {"baseColor": (0.46, 0.02, 0.02), "roughness": 0.4}
    return Look("car_paint", (Layer("Paint", "disney", paint | {"clearcoat": 1.0, "clearcoatGloss": 0.9}),))


def _metal() -> Look:
    inputs: dict[str, Input] = {"baseColor": (0.9, 0.75, 0.5), "metallic": 1.0, "roughness": 0.35, "anisotropic": 0.8}
    return Look("metal", (Layer("Metal", "disney", inputs),))


def _brushed() -> Look:
    inputs: dict[str, Input] = {"baseColor": (0.91, 0.92, 0.92), "metallic": 1.0, "roughness": 0.3, "anisotropic": 0.9}
    return Look("brushed_metal", (Layer("Brushed", "disney", inputs),))


def _copper() -> Look:
    inputs: dict[str, Input] = {"baseColor": (0.95, 0.64, 0.54), "metallic": 1.0, "roughness": 0.25}
    return Look("copper", (Layer("Copper", "disney", inputs),))


def _transmitting() -> Look:
    body: dict[str, Input] = {"surfaceColor": (0.8, 0.55, 0.3), "roughness": 0.4, "clear": 0.5, "back": 0.4}
    varnish: dict[str, Input] = {"surfaceColor": (0.9, 0.95, 0.9), "roughness": 0.15, "clear": 0.9}
    return Look("pixar", (Layer("Body", "pixar", body), Layer("Varnish", "pixar", varnish, 1.0, "transmit")))


LOOKS: dict[str, BenchLook] = {
    "plastic": BenchLook("blue plastic, one Disney layer", _plastic),
    "car_paint": BenchLook("red paint under a clear coat, one Disney layer", _car_paint),
    "metal": BenchLook("anisotropic metal, one Disney layer", _metal),
    "brushed_metal": BenchLook("aluminium, brushed strongly, one Disney layer", _brushed),
    "copper": BenchLook("isotropic metal, smooth enough to see itself in its recesses, one Disney layer", _copper),
    "stack": BenchLook("six Disney layers, their masks textures", lambda: layered(6)),
    "pixar": BenchLook("two Pixar layers that transmit light, and each other's light", _transmitting),
}


def _mask(number: int) -> Texture:
    """Return a cloudy texture; the file is made if it does not exist."""

    def write(file: Path) -> None:
        clouds = gaussian_filter(np.random.default_rng(number).random((_MASK_SIZE, _MASK_SIZE)), 8.0, mode="wrap")
        levels = np.clip(0.5 + 0.25 * (clouds - clouds.mean()) / clouds.std(), 0.0, 1.0)
        write_frame(file, np.repeat(levels[..., None], 3, axis=-1), np.ones_like(levels), {})

    return Texture(cached_file("bench", f"mask{number}.{_MASK_VERSION}", ".exr", write).path, "r", "raw")
