"""Images inside usdz packages: read from the package, also as sets of tiles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from look_files import faults_of, look, rough, texture
from pxr import Sdf

from lookdev.material.look import Texture
from lookdev.material.textures import sample_texture
from lookdev.material.usd import read_look


def write_image(file: Path, value: float) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    image = oiio.ImageBuf(oiio.ImageSpec(2, 2, 1, "uint8"))
    oiio.ImageBufAlgo.fill(image, (value,))
    assert image.write(str(file)), image.geterror()


def package(folder: Path, layers: dict[str, str], images: dict[str, float], name: str = "look.usdz") -> Path:
    """Write a package of layers, the first of which is its root, and of gray images."""
    for layer, text in layers.items():
        (folder / "in" / layer).parent.mkdir(parents=True, exist_ok=True)
        (folder / "in" / layer).write_text(text)
    for image, value in images.items():
        write_image(folder / "in" / image, value)
    writer = Sdf.ZipFileWriter.CreateNew(str(folder / name))
    for inner in (*layers, *images):
        writer.AddFile(str(folder / "in" / inner), inner)
    writer.Save()
    return folder / name


def roughness(file: Path) -> Texture:
    (layer,) = read_look(file).layers
    found = layer.inputs["roughness"]
    assert isinstance(found, Texture)
    return found


def test_an_image_of_the_root_layer(tmp_path: Path) -> None:
    text = look(rough("Tex.r") + texture(file="@tex/a.png@"))
    found = roughness(package(tmp_path, {"look.usda": text}, {"tex/a.png": 0.2}))
    assert found.file.name == "a.png"
    np.testing.assert_allclose(sample_texture(found, [0.5, 0.5]), 51 / 255)


def test_an_image_relative_to_a_layer_inside(tmp_path: Path) -> None:
    text = look(rough("Tex.r") + texture(file="@./tex/a.png@"))
    root = '#usda 1.0\n(\n defaultPrim = "M"\n)\ndef "M" (\n references = @parts/mat.usda@\n)\n{\n}\n'
    file = package(tmp_path, {"root.usda": root, "parts/mat.usda": text}, {"parts/tex/a.png": 0.4})
    np.testing.assert_allclose(sample_texture(roughness(file), [0.5, 0.5]), 0.4)


def test_equal_content_is_one_file_and_a_changed_package_another(tmp_path: Path) -> None:
    text = look(rough("Tex.r") + texture(file="@a.png@"))
    first, second = (
        roughness(package(tmp_path, {"look.usda": text}, {"a.png": 0.2}, name)) for name in ("1.usdz", "2.usdz")
    )
    assert first == second
    changed = roughness(package(tmp_path, {"look.usda": text}, {"a.png": 0.8}, "3.usdz"))
    assert changed.file != first.file
    np.testing.assert_allclose(sample_texture(changed, [0.5, 0.5]), 0.8)


def test_a_file_that_left_the_cache_is_copied_again(tmp_path: Path) -> None:
    file = package(tmp_path, {"look.usda": look(rough("Tex.r") + texture(file="@a.png@"))}, {"a.png": 0.2})
    roughness(file).file.unlink()
    np.testing.assert_allclose(sample_texture(roughness(file), [0.5, 0.5]), 0.2)


def test_a_set_of_tiles(tmp_path: Path) -> None:
    text = look(rough("Tex.r") + texture(file="@tex/a.<UDIM>.png@"))
    file = package(tmp_path, {"look.usda": text}, {"tex/a.1001.png": 0.2, "tex/a.1012.png": 0.6})
    values = sample_texture(roughness(file), [[0.5, 0.5], [1.5, 1.5], [1.5, 0.5]])
    np.testing.assert_allclose(values, [0.2, 0.6, 0.0])


@pytest.mark.parametrize(
    ("file", "what"),
    [("@b.png@", "no such image file: b.png"), ("@b.<UDIM>.png@", "no tile of this set: b.<UDIM>.png")],
)
def test_a_missing_image_is_a_fault(tmp_path: Path, file: str, what: str) -> None:
    text = look(rough("Tex.r") + texture(file=file))
    ((where, said, _),) = faults_of(package(tmp_path, {"look.usda": text}, {"a.png": 0.2}))
    assert (where, said) == ("Tex.file", what)


def test_a_file_that_is_no_image_is_a_fault(tmp_path: Path) -> None:
    text = look(rough("Tex.r") + texture(file="@a.png@"))
    ((where, said, _),) = faults_of(package(tmp_path, {"look.usda": text, "a.png": "no image"}, {}))
    assert where == "Tex.file"
    assert "cannot be read as an image" in said
