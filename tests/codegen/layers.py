"""Shaders of layers, under a dome whose files are not there."""

from pathlib import Path
from typing import Any

from lookdev.codegen import ShaderSource
from lookdev.codegen.osl.surface import generate_surface
from lookdev.light import Dome
from lookdev.material import Bump, Formula, Layer, Look, Texture, View
from lookdev.material.expression import parse

DOME = Dome(*(Path(f"{part}.exr") for part in "rpsb"), 64, 32, "119147")


def own_file(source: Texture | Bump) -> Path:
    return source.height.file if isinstance(source, Bump) else source.file


def no_textures(texture: Texture | Bump) -> Path:
    raise AssertionError(f"{texture} is opened")


def of_view(text: str) -> Formula:
    return Formula(parse(text), {"view": View()}, {"view": "float"})


def surface(*layers: Layer, resolve: Any = own_file, **options: Any) -> ShaderSource:
    """Return the shader of layers, by default with one sample of each kind and one bounce."""
    defaults: dict[str, Any] = {"brdf_samples": 1, "ibl_samples": 1, "bounces": 1, "lights": (DOME,)}
    return generate_surface(Look("test", layers), resolve, resolution=(8, 8), **defaults | options)
