"""Shaders of layers, under a dome whose files do not exist."""

from pathlib import Path
from typing import Any

from lookdev.codegen.osl.surface import generate_surface
from lookdev.codegen.setting import SourceSetting
from lookdev.codegen.source import ShaderSource
from lookdev.light import Dome
from lookdev.material import Bump, Formula, Layer, Look, Texture, ViewCosine
from lookdev.material.expression import parse
from lookdev.scene import Sampling

DOME = Dome(*(Path(f"{part}.exr") for part in "rpsb"), 64, 32, "119147")


def own_file(source: Texture | Bump) -> Path:
    return source.height.file if isinstance(source, Bump) else source.file


def no_textures(texture: Texture | Bump) -> Path:
    raise AssertionError(f"{texture} is opened")


def of_view(text: str) -> Formula:
    return Formula(parse(text), {"view": ViewCosine()}, {"view": "float"})


def surface(*layers: Layer, resolve: Any = own_file, **options: Any) -> ShaderSource:
    """Return the shader of layers, by default with one sample of each kind and one bounce."""
    directions = {"brdf_samples": 1, "ibl_samples": 1, "bounces": 1} | options
    setting_options = {name: directions.pop(name) for name in ("lights", "shadows", "catching") if name in directions}
    setting = SourceSetting(
        setting_options.pop("lights", (DOME,)), (8, 8), Sampling(**directions), resolve=resolve, **setting_options
    )
    return generate_surface(Look("test", layers), setting)
