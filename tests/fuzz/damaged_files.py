"""Files of the cache, and finished frames, that are damaged: the result is the same, with a note of the file.

Every product of the cache is made in a cache of its own; one of its files is damaged in one of `WAYS`, and all is asked
for again.
"""

import os
import random
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from unittest.mock import patch

import numpy as np
from cases import Case, Kind, Reading
from damage import Damage, append_noise, flip_bits, truncate
from image_files import NOTED, REFUSED, RGB, SOUND, exr, image
from pxr import Sdf, UsdUtils
from usd_text import textured

from lookdev.asset import Instance, Slot, load_asset, read_asset
from lookdev.asset.mesh import Subdivision
from lookdev.asset.store import asset_digest, make_asset, save_asset
from lookdev.bench.subjects import cloudy_mask
from lookdev.build.refine import Refiner
from lookdev.cache import take_notes
from lookdev.errors import OutputError, TextureError
from lookdev.images import open_image, whole_image
from lookdev.light import make_environment, prepare_light
from lookdev.light.dome import bins, points, slots
from lookdev.material import Texture
from lookdev.material.textures import linear_texture, slope_texture
from lookdev.material.usd.bound import read_any_look
from lookdev.mtlx.shade import document_layer
from lookdev.output.exr import read_frame, read_header, write_frame
from lookdev.scene import Camera

Result = dict[str, object]
_RNG = random.Random(0)


def _pixels(file: Path) -> bytes:
    with open_image(file, TextureError) as opened:
        return whole_image(opened, file, range(3), TextureError).tobytes()


def _textures(folder: Path) -> Result:
    file = folder / "map.exr"
    exr(RGB)(file, _RNG)
    texture = Texture(file, "r", "raw", "clamp", "clamp")
    return {"linear": _pixels(linear_texture(texture)), "slopes": _pixels(slope_texture(texture))}


def _light(folder: Path) -> Result:
    with patch.object(slots, "SLOTS", 64), patch.object(points, "SIDE", 32), patch.object(bins, "COUNT", 4):
        light = prepare_light(make_environment("map", RGB))
        files = ("radiance_file", "points_file", "slots_file", "bins_file")
        return {name: getattr(light, name).path.read_bytes() for name in files}


def _asset(folder: Path) -> Result:
    return {"asset": asset_digest(read_asset(save_asset(load_asset(builtin="sphere"), [0])))}


def _refined(folder: Path) -> Result:
    cage = replace(load_asset(builtin="suzanne").meshes[0], subdivision=Subdivision("catmullClark"), default_uv="st")
    asset = make_asset("a", [cage], [Instance(0, np.eye(4), "/a")], [Slot("/a")])
    refined, notes = Refiner("auto", 300).refine(asset, Camera(40.0, 10.0, (0.0, 0.0, 0.0), 8.0))
    return {"asset": asset_digest(refined), "notes": notes}


def _document(folder: Path) -> Result:
    file = folder / "look.mtlx"
    file.write_text(
        '<?xml version="1.0"?><materialx version="1.39">'
        '<standard_surface name="s" type="surfaceshader"><input name="base" type="float" value="0.5"/>'
        "</standard_surface>"
        '<surfacematerial name="m" type="material"><input name="surfaceshader" type="surfaceshader" nodename="s"/>'
        "</surfacematerial></materialx>"
    )
    return {"layer": document_layer(str(file)).read_text()}


def _package(folder: Path) -> Result:
    package = folder / "look.usdz"
    if not package.exists():
        image(kind="uint8")(folder / "map.png", _RNG)
        (folder / "look.usda").write_text('#usda 1.0\n( defaultPrim = "Look" )\n' + textured("Look"))
        UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(folder / "look.usda")), str(package))
    look = read_any_look(package).look
    (texture,) = [each for layer in look.layers for each in layer.inputs.values() if isinstance(each, Texture)]
    return {"image": texture.file.read_bytes()}


def _bench(folder: Path) -> Result:
    return {"mask": _pixels(cloudy_mask(0).file)}


PRODUCTS: dict[str, Callable[[Path], Result]] = {
    "textures": _textures,
    "light": _light,
    "asset": _asset,
    "refined": _refined,
    "document": _document,
    "package": _package,
    "bench": _bench,
}


def _bytes(damage: Damage) -> Callable[[Path, random.Random], object]:
    return lambda file, rng: file.write_bytes(damage(file.read_bytes(), rng))


def _instead(make: Callable[[Path, random.Random], object]) -> Callable[[Path, random.Random], object]:
    def replaced(file: Path, rng: random.Random) -> None:
        file.unlink()
        make(file, rng)

    return replaced


WAYS: dict[str, Callable[[Path, random.Random], object]] = {
    "first byte": _bytes(lambda data, rng: bytes([data[0] ^ 1]) + data[1:]),
    "last byte": _bytes(lambda data, rng: data[:-1] + bytes([data[-1] ^ 1])),
    "any bytes": _bytes(flip_bits()),
    "all bytes": _bytes(lambda data, rng: rng.randbytes(len(data))),
    "empty": _bytes(lambda data, rng: b""),
    "one byte": _bytes(lambda data, rng: data[:1]),
    "any part": _bytes(truncate),
    "all but one": _bytes(lambda data, rng: data[:-1]),
    "without start": _bytes(lambda data, rng: data[1:]),
    "longer": _bytes(append_noise),
    "nulls": _bytes(lambda data, rng: bytes(len(data))),
    "text": _bytes(lambda data, rng: b"[]\n"),
    "a folder": _instead(lambda file, rng: (file / "more").mkdir(parents=True)),
    "a pipe": _instead(lambda file, rng: os.mkfifo(file)),
    "a device": _instead(lambda file, rng: file.symlink_to("/dev/zero")),
    "a loop": _instead(lambda file, rng: file.symlink_to(file)),
}


@contextmanager
def _cached(folder: Path) -> Iterator[Path]:
    with patch.dict(os.environ, LOOKDEV_CACHE=str(folder / "cache")):
        yield folder / "cache"


@cache
def _made(product: str) -> tuple[tempfile.TemporaryDirectory[str], Result]:
    """Return a folder with a product's files, its cache among them, and the product."""
    folder = tempfile.TemporaryDirectory()
    with _cached(Path(folder.name)):
        return folder, PRODUCTS[product](Path(folder.name))


@cache
def _targets() -> tuple[tuple[str, Path], ...]:
    """Return each product with each file of its cache."""
    return tuple(
        (product, file.relative_to(folder))
        for product in PRODUCTS
        for folder in [Path(_made(product)[0].name)]
        for file in sorted((folder / "cache").rglob("*"))
        if file.is_file()
    )


def _make_cache_case(rng: random.Random, number: int, folder: Path) -> Case:
    product, name = _targets()[number // len(WAYS) % len(_targets())]
    way = list(WAYS)[number % len(WAYS)]
    made, result = _made(product)
    place = folder / "product"
    shutil.copytree(made.name, place)
    file = place / name
    WAYS[way](file, rng)

    def read() -> Reading:
        take_notes()
        with _cached(place):
            again = PRODUCTS[product](place)
            # A note excuses no other result.
            return Reading(again, take_notes() if again == result else ())

    # What was refined is found without the record of its arrays.
    unread = product == "refined" and name.parent.name == "assets"
    return Case(
        f"{product}: {name.parent.name}/{name.suffix}: {way}",
        SOUND | NOTED if unread else NOTED,
        read,
        lambda: Reading(result),
        note_names=(str(file),),
    )


_BEAUTY = np.full((40, 30, 3), 0.5, np.float32)
_BEAUTY[10:20] = 2.0


def _make_frame_case(rng: random.Random, number: int, folder: Path) -> Case:
    file = folder / "frame.0001.exr"
    write_frame(file, _BEAUTY, _BEAUTY[..., 0], {"digest": "ab" * 32, "look": "gold"})
    way = list(WAYS)[number % len(WAYS)]
    WAYS[way](file, rng)

    def read() -> Reading:
        """Read a frame as a plan does, then as what is made of it."""
        header = read_header(file)
        if (header.get("digest"), header.get("resolution")) != ("ab" * 32, "30 x 40"):
            raise OutputError(f"{file}: is stale")
        beauty, alpha = read_frame(file)
        return Reading({"beauty": beauty.tobytes(), "alpha": alpha.tobytes()})

    sound = Reading({"beauty": _BEAUTY.tobytes(), "alpha": _BEAUTY[..., 0].tobytes()})
    return Case(f"frame: {way}", REFUSED | SOUND, read, lambda: sound, (str(file),))


DAMAGED = (
    Kind("damaged cache", _make_cache_case, 20 * len(WAYS), tuple(WAYS)),
    Kind("damaged frames", _make_frame_case, 5 * len(WAYS), tuple(WAYS)),
)
