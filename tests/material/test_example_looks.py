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

from lookdev.brdf import MODELS
from lookdev.material.look import Bump, Look, Texture
from lookdev.material.textures import sample_slopes, sample_texture
from lookdev.material.usd import read_look

MATERIALS = Path(__file__).parents[2] / "materials"
LOOKS = [*sorted(MATERIALS.glob("*.usda")), *sorted((MATERIALS / "classic").glob("*.usda"))]


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
                low, high = (0.0, 1.0) if name == "mask" else MODELS[layer.model].parameters[name].hard
                samples = sample_texture(value, st)
                assert low <= samples.min() < samples.max() <= high
            elif isinstance(value, Bump):
                assert np.any(sample_slopes(value.height, st))


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


def test_robot_paint_shows_metal_where_it_is_worn() -> None:
    new, worn = (read_look(MATERIALS / "robot_paint.usda", variants={"wear": wear}) for wear in ("new", "worn"))
    assert [layer.name for layer in new.layers] == ["Metal", "Paint"]
    assert [layer.name for layer in worn.layers] == ["Metal", "Paint", "Dirt"]
    assert {layer.model for layer in worn.layers} == {"pixar"}
    assert new.layers[1].mask == 1.0
    mask = worn.layers[1].mask
    assert isinstance(mask, Texture)
    kept = sample_texture(mask, np.random.default_rng(2).uniform(0, 1, (10000, 2)))
    assert 0.02 < (kept < 0.5).mean() < 0.2  # worn, but painted still
    assert all(isinstance(layer.inputs["highlightNormal"], Bump) for layer in worn.layers[:2])


def test_leaf_is_thin_and_cut_out() -> None:
    blade, veins = read_look(MATERIALS / "leaf.usda").layers
    assert 0.4 <= blade.inputs["back"] <= 0.7
    assert 0.0 < blade.inputs["clear"] < 0.5
    presence = blade.inputs["presence"]
    assert isinstance(presence, Texture)
    assert isinstance(veins.mask, Texture)
    # The border of the card is empty, its middle is blade and the middle of its lower part is stalk.
    border = np.array([[s, t] for s in np.linspace(0, 1, 101) for t in (0.0, 1.0)])
    border = np.concatenate([border, border[:, ::-1]])
    for texture in (presence, veins.mask):
        assert not sample_texture(texture, border).any()
    assert sample_texture(presence, [0.5, 0.5]) == 1.0
    stalk = np.stack([np.linspace(0.4, 0.6, 200), np.full(200, 0.1)], axis=-1)
    assert not sample_texture(presence, stalk).any()
    assert sample_texture(veins.mask, stalk).max() > 0.9


def test_leaf_has_seasons() -> None:
    colours = {
        season: read_look(MATERIALS / "leaf.usda", variants={"season": season}).layers[0].inputs["surfaceColor"]
        for season in ("summer", "autumn")
    }
    assert np.argmax(colours["summer"]) == 1
    assert np.argmax(colours["autumn"]) == 0


def test_frosted_plastic_lets_most_light_through() -> None:
    (wall,) = read_look(MATERIALS / "frosted_plastic.usda").layers
    assert wall.inputs["clear"] == pytest.approx(0.8)  # USD holds float32
    # Where roughness is above 1/2 no light is refracted sharply, near 1 none is transmitted but diffusely.
    assert 0.2 <= wall.inputs["roughness"] <= 0.5


def test_lacquer_lies_on_wood_in_mode_transmit() -> None:
    lacquered, bare = (
        read_look(MATERIALS / "lacquer_wood.usda", variants={"finish": finish}) for finish in ("lacquered", "bare")
    )
    assert [layer.mode for layer in lacquered.layers] == ["over", "over", "transmit"]
    assert bare.layers == lacquered.layers[:2]
    assert lacquered.layers[2].inputs["clear"] == 1.0


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


@pytest.mark.parametrize("name", sorted(file.name for file in (MATERIALS / "textures").glob("*.png")))
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


def test_every_model_but_those_of_production_has_a_classic_look() -> None:
    looks = {file.stem: read_look(file) for file in (MATERIALS / "classic").glob("*.usda")}
    models = {name: [layer.model for layer in look.layers] for name, look in looks.items()}
    assert models == {name.replace("-", "_"): [name] for name in MODELS if name not in ("disney", "pixar", "measured")}
