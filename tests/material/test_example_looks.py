"""The looks that ship: they can be read in every variant, and their textures are what the script makes."""

from __future__ import annotations

import runpy
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from numpy.typing import NDArray
from pxr import Usd, UsdShade

from lookdev.brdf import PARAMETERS
from lookdev.material.look import Look, Texture
from lookdev.material.textures import sample_texture
from lookdev.material.usd import read_look

MATERIALS = Path(__file__).parents[2] / "materials"
LOOKS = sorted(MATERIALS.glob("*.usda"))


def variants_of(file: Path) -> list[dict[str, str]]:
    stage = Usd.Stage.Open(str(file))  # a prim does not keep its stage alive
    sets = stage.GetDefaultPrim().GetVariantSets()
    return [{name: choice} for name in sets.GetNames() for choice in sets.GetVariantSet(name).GetVariantNames()]


def textures_of(look: Look) -> list[Texture]:
    values = [value for layer in look.layers for value in (layer.mask, *layer.inputs.values())]
    return [value for value in values if isinstance(value, Texture)]


@pytest.mark.parametrize(
    ("file", "variants"),
    [pytest.param(file, each, id=f"{file.stem}-{each}") for file in LOOKS for each in ({}, *variants_of(file))],
)
def test_every_variant_can_be_read(
    file: Path, variants: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path))
    look = read_look(file, variants=variants)
    assert look.layers
    st = np.random.default_rng(1).uniform(-2, 2, (1000, 2))
    for layer in look.layers:
        for name, value in {"mask": layer.mask, **layer.inputs}.items():
            if isinstance(value, Texture):
                # Textures are not clamped when the look is read: they must stay within the parameter's range.
                low, high = (0.0, 1.0) if name == "mask" else PARAMETERS[layer.model][name].hard
                samples = sample_texture(value, st)
                assert low <= samples.min() < samples.max() <= high


def test_car_paint_is_layered() -> None:
    clean = read_look(MATERIALS / "car_paint.usda", variants={"wear": "clean"})
    dusty = read_look(MATERIALS / "car_paint.usda", variants={"wear": "dusty"})
    assert [layer.name for layer in clean.layers] == ["Base", "Flakes"]
    assert [layer.name for layer in dusty.layers] == ["Base", "Flakes", "Dust"]
    assert read_look(MATERIALS / "car_paint.usda").layers == clean.layers
    assert [layer.inputs["clearcoat"] for layer in dusty.layers] == [1.0, 1.0, 0.0]
    assert [texture.file.name for texture in textures_of(dusty)] == ["flakes.png", "dirt.png"]


def test_brushed_metal_is_anisotropic_with_streaks() -> None:
    metals = [read_look(MATERIALS / "brushed_metal.usda", variants={"metal": m}) for m in ("aluminium", "copper")]
    inputs = [look.layers[0].inputs for look in metals]
    assert inputs[0]["baseColor"] != inputs[1]["baseColor"]
    assert all(each["anisotropic"] > 0.5 and each["metallic"] == 1.0 for each in inputs)
    assert isinstance(inputs[0]["roughness"], Texture)


@pytest.mark.parametrize("file", LOOKS, ids=lambda file: file.stem)
def test_other_viewers_get_a_preview_surface(file: Path) -> None:
    stage = Usd.Stage.Open(str(file))
    shader, _, _ = UsdShade.Material(stage.GetDefaultPrim()).ComputeSurfaceSource()
    assert shader.GetShaderId() == "UsdPreviewSurface"


@pytest.fixture(scope="module")
def script() -> dict[str, object]:
    return runpy.run_path(str(MATERIALS / "textures" / "make_textures.py"))


def test_the_script_makes_all_textures(script: dict[str, object]) -> None:
    assert sorted(script["TEXTURES"]) == sorted(file.name for file in (MATERIALS / "textures").glob("*.png"))


@pytest.mark.parametrize("name", ["brushed.png", "dirt.png", "flakes.png"])
def test_texture_is_what_the_script_makes(script: dict[str, object], name: str) -> None:
    file = MATERIALS / "textures" / name
    assert file.stat().st_size < 150_000
    stored = np.asarray(oiio.ImageBuf(str(file)).get_pixels(oiio.UINT8)).astype(int)
    pixels: Callable[[str], NDArray[np.uint8]] = script["pixels"]
    made = pixels(name).astype(int)
    assert stored.shape == (512, 512, 1)
    # NumPy versions differ in the last bit of an FFT, which can move a value across one rounding step.
    step = 255 / script["TEXTURES"][name][1]
    difference = np.abs(stored[..., 0] - made)
    assert difference.max() <= np.ceil(step)
    assert np.count_nonzero(difference) <= 10
    # It tiles: across the edge neighbours differ no more than they do inside.
    for image in (made, made.T):
        inside = [np.abs(a - b).mean() for a, b in pairwise(image)]
        assert np.abs(image[-1] - image[0]).mean() <= max(inside)
