"""Environment maps and textures with one thing wrong."""

from __future__ import annotations

import random
import tempfile
from functools import cache, partial
from pathlib import Path

from cases import Case, Kind, Reading
from image_files import ENVIRONMENTS, RGB, TEXTURES, exr

from lookdev.errors import TextureError
from lookdev.images import open_image, whole_image
from lookdev.light import load_environment
from lookdev.material import Texture
from lookdev.material.textures import linear_texture, slope_texture


def read_environment(file: Path, exposure: float) -> Reading:
    """Read a map as a job does."""
    environment = load_environment(file)
    environment.check_exposed(exposure)
    radiance = environment.radiance
    notes = (f"{file.name}: {environment.repairs}",) if environment.repairs else ()
    return Reading({"shape": radiance.shape, "radiance": radiance.tobytes()}, notes)


def read_texture(file: Path, exposure: float = 0.0) -> Reading:
    """Convert a texture, and its slopes, as a job does."""
    result: dict[str, object] = {}
    for texture in (Texture(file, "r", "raw", "clamp", "clamp"), Texture(file, "rgb", "raw", "repeat", "mirror")):
        for made in (linear_texture, slope_texture) if texture.channel == "r" else (linear_texture,):
            linear = made(texture)
            with open_image(linear, TextureError) as image:
                pixels = whole_image(image, linear, range(3), TextureError)
            result[f"{made.__name__} {len(result)}"] = pixels.shape, pixels.tobytes()
    return Reading(result)


@cache
def _sound(read: str, suffix: str) -> Reading:
    """Return what the sound image reads as, or that of another format by its suffix."""
    every = ENVIRONMENTS if read == "environment" else TEXTURES
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, f"map{suffix or '.exr'}")
        write = every[f"{suffix} longer"].right if suffix else exr(RGB)
        assert write
        write(file, random.Random(0))
        return READERS[read](file, 0.0)


READERS = {"environment": read_environment, "texture": read_texture}


def _make(read: str, rng: random.Random, number: int, folder: Path) -> Case:
    every = ENVIRONMENTS if read == "environment" else TEXTURES
    name = list(every)[number % len(every)]
    wrong = every[name]
    file = folder / wrong.name
    wrong.write(file, rng)
    return Case(
        name,
        wrong.expected,
        lambda: READERS[read](file, wrong.exposure),
        lambda: _sound(read, file.suffix if wrong.right else ""),
        (str(file),),
        (file.name,),
    )


IMAGES = (
    Kind("environments", partial(_make, "environment"), 3 * len(ENVIRONMENTS)),
    Kind("textures", partial(_make, "texture"), 2 * len(TEXTURES)),
)
