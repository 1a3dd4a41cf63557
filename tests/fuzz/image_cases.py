"""Environment maps and textures with one thing wrong."""

import random
import tempfile
from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from cases import Case, Kind, Reading, Shown, planned_kind
from image_files import ENVIRONMENTS, RGB, TEXTURES, Wrong, exr
from numpy.typing import NDArray
from pictures import job, table
from usd_pictures import probe
from usd_text import image, material, shader

from lookdev.errors import TextureError
from lookdev.images import open_image, whole_image
from lookdev.light import load_environment
from lookdev.light.dome.environment import check_exposed
from lookdev.material import Texture
from lookdev.material.textures import linear_texture, slope_texture

_TEXTURED = '#usda 1.0\n( defaultPrim = "M" )\n' + material(
    "M",
    "color3f inputs:baseColor.connect = </M/Map.outputs:rgb>",
    "normal3f inputs:normal.connect = </M/Bump.outputs:normal>",
    more=image("M", "FILE")
    + shader("Bump", "LookdevBump", "float inputs:height.connect = </M/Map.outputs:r>", "float inputs:scale = 0.02"),
)


def read_environment(file: Path, exposure: float) -> Reading:
    """Read a map as a job does."""
    environment = load_environment(file)
    check_exposed(float(environment.radiance.max()), exposure, environment.where)
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
    with tempfile.TemporaryDirectory() as folder:
        _right(read, Path(folder), suffix)
        return READERS[read](Path(folder, f"map{suffix or '.exr'}"), 0.0)


REPAIRED: dict[str, dict[int, float | None]] = {
    "NaN": {2: None},
    "infinite": {2: float(RGB.max())},
    "negative": {2: 0.0, 3: 0.0},
    "NaN and negative": {3: 0.0, 2: None},
}
"""What becomes of bad texels, by their rows, in this order; None: the mean of their neighbours."""

READERS = {"environment": read_environment, "texture": read_texture}


def _every(read: str) -> Mapping[str, Wrong]:
    return ENVIRONMENTS if read == "environment" else TEXTURES


def _make(read: str, rng: random.Random, planned: tuple[str, ...], folder: Path) -> Case:
    name = planned[1]
    wrong = _every(read)[name]
    file = folder / wrong.name
    wrong.write(file, rng)
    return Case(
        name,
        wrong.expected,
        lambda: READERS[read](file, wrong.exposure),
        lambda: _sound(read, file.suffix if wrong.right else ""),
        (str(file),),
        (file.name,),
        Shown(
            _job(read, folder, file.name, wrong.exposure),
            {
                "sound": lambda place, notes: _right(read, place, file.suffix if wrong.right else ""),
                "repaired": lambda place, notes: _repaired(read, place, name),
            },
        ),
    )


def _job(read: str, folder: Path, name: str, exposure: float = 0.0) -> str:
    """Write a look that shows a map, and return the job."""
    if read == "environment":
        (folder / "look.usda").write_text(probe())
        return job('builtin = "sphere"', 'material = "look.usda"', table(file=name, exposure=exposure))
    (folder / "look.usda").write_text(_TEXTURED.replace("FILE", name))
    return job('builtin = "sphere"', 'material = "look.usda"')


def _right(read: str, folder: Path, suffix: str, pixels: NDArray[Any] = RGB) -> str:
    file = folder / f"map{suffix or '.exr'}"
    write = _every(read)[f"{suffix} longer"].right if suffix else exr(pixels)
    assert write
    write(file, random.Random(0))
    return _job(read, folder, file.name)


def _repaired(read: str, folder: Path, name: str) -> str:
    """Write the map that is left of one with bad texels, at [2, 3] and [3, 3]."""
    pixels = RGB.copy()
    for bad, value in REPAIRED.get(name, {}).items():
        around = [pixels[bad + y, 3 + x] for y in (-1, 0, 1) for x in (-1, 0, 1) if (y, x) != (0, 0)]
        pixels[bad, 3] = np.mean(around, axis=0) if value is None else value
    return _right(read, folder, "", pixels)


def _kind(name: str, read: str, rounds: int) -> Kind:
    """Return a kind of images, whose sorts are those of their files and what must become of them."""
    plan = [(f"{wrong.name} {sorted(wrong.expected)}", name) for name, wrong in _every(read).items()]
    return planned_kind(name, plan, partial(_make, read), rounds)


IMAGES = (_kind("environments", "environment", 3), _kind("textures", "texture", 2))
