"""The preset library: every file is one layer that can be referenced and read, with a plausible surface."""

from __future__ import annotations

from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdShade

from lookdev.brdf import MODELS, layer_shaders
from lookdev.brdf.conductor import METALS, metal_reflectance
from lookdev.material.library import read_preset
from lookdev.material.library.edit import preset_look
from lookdev.material.look import Layer

MATERIALS = Path(__file__).parents[2] / "materials"
EXACT = sorted((MATERIALS / "metals").glob("*.usda"))
PRESETS = [*sorted((MATERIALS / "presets").glob("*.usda")), *EXACT]
CATEGORIES = {
    "metal": 10,
    "plastic": 4,
    "rubber": 2,
    "wood": 3,
    "stone": 3,
    "fabric": 4,
    "skin": 3,
    "ceramic": 2,
    "car paint": 3,
    "glass": 3,
    "leaf": 2,
    "paper": 2,
    "paint": 2,
    "weathering": 2,
}
"""Each category, and the fewest presets it has."""

each_preset = pytest.mark.parametrize("file", PRESETS, ids=lambda file: file.stem)


def prim_name(file: Path) -> str:
    return file.stem.title().replace("_", "")


@cache
def stage_of(file: Path) -> Usd.Stage:
    return Usd.Stage.Open(str(file))


def preset(file: Path) -> Usd.Prim:
    return stage_of(file).GetDefaultPrim()


def category(file: Path) -> str:
    return str(preset(file).GetCustomDataByKey("category"))


@pytest.fixture(scope="module")
def layers() -> dict[Path, Layer]:
    """Return every preset as the only layer of a look, by reference."""
    return {file: preset_look(read_preset(file), file.stem).layers[0] for file in PRESETS}


@each_preset
def test_a_preset_is_one_layer_and_nothing_else(file: Path) -> None:
    prim = preset(file)
    assert prim.GetName() == prim_name(file)
    assert [each.GetName() for each in stage_of(file).TraverseAll()] == [prim.GetName()]
    shader = UsdShade.Shader(prim)
    assert shader.GetShaderId() in layer_shaders()
    assert [output.GetBaseName() for output in shader.GetOutputs()] == ["layer"]
    assert file.stat().st_size < 2000


@each_preset
def test_a_preset_is_documented(file: Path) -> None:
    doc = preset(file).GetDocumentation()
    assert doc.endswith(".")
    assert 10 <= len(doc) <= 120
    assert category(file) in CATEGORIES


def test_the_library_is_large_enough() -> None:
    found = [category(file) for file in PRESETS]
    assert len(found) >= 36
    assert {name: least for name, least in CATEGORIES.items() if found.count(name) < least} == {}


@each_preset
def test_values_are_within_what_a_slider_offers(file: Path, layers: dict[Path, Layer]) -> None:
    layer = layers[file]
    for name, value in layer.inputs.items():
        parameter = MODELS[layer.model].parameters[name]
        low, high = parameter.soft
        assert isinstance(value, str) or np.all((np.array(value) >= low) & (np.array(value) <= high)), name


@each_preset
def test_only_what_differs_from_the_default_is_authored(file: Path, layers: dict[Path, Layer]) -> None:
    layer = layers[file]
    authored = {each.GetBaseName() for each in UsdShade.Shader(preset(file)).GetInputs()}
    assert authored == set(layer.inputs)
    for name, value in layer.inputs.items():
        # USD holds float32.
        default = MODELS[layer.model].parameters[name].default
        assert value != default if isinstance(value, str) else not np.allclose(value, default, rtol=1e-6, atol=1e-6), (
            name
        )


@pytest.mark.parametrize("file", [file for file in PRESETS if file not in EXACT], ids=lambda file: file.stem)
def test_a_surface_is_as_bright_as_real_ones(file: Path, layers: dict[Path, Layer]) -> None:
    inputs = layers[file].inputs
    color = inputs["surfaceColor" if layers[file].model == "pixar" else "baseColor"]
    if inputs.get("metallic") == 1.0:
        assert category(file) == "metal"
    elif inputs.get("clear") == 1.0:
        assert min(color) >= 0.02  # glass; it may let all light through
    else:
        # Between coal and fresh snow; float32 may round below.
        assert min(color) > 0.02 - 1e-6
        assert max(color) <= 0.9


@pytest.mark.parametrize("metal", METALS)
def test_a_metal_has_the_colour_of_its_measured_index(metal: str, layers: dict[Path, Layer]) -> None:
    named = {file: layer for file, layer in layers.items() if file.stem.endswith(metal) and file not in EXACT}
    assert named
    for file, layer in named.items():
        # Three digits are written.
        np.testing.assert_allclose(layer.inputs["baseColor"], metal_reflectance(metal), rtol=0, atol=5.1e-4)
        assert layer.inputs["metallic"] == 1.0
        author = METALS[metal].split()[0]
        assert author in preset(file).GetCustomDataByKey("source")


@pytest.mark.parametrize("metal", METALS)
def test_a_metal_has_an_exact_preset(metal: str, layers: dict[Path, Layer]) -> None:
    (file,) = (file for file in EXACT if file.stem == f"exact_{metal}")
    assert layers[file].inputs["metal"] == metal
    assert layers[file].inputs["metallic"] == 1.0
    assert METALS[metal].split()[0] in preset(file).GetCustomDataByKey("source")


def test_every_metal_is_a_measured_one() -> None:
    metals = [file.stem for file in PRESETS if category(file) == "metal"]
    assert [name for name in metals if not name.endswith(tuple(METALS))] == []


def test_no_two_presets_are_the_same(layers: dict[Path, Layer]) -> None:
    for (one, a), (other, b) in combinations(layers.items(), 2):
        assert (a.model, a.inputs) != (b.model, b.inputs), f"{one.stem} is {other.stem}"
        assert preset(one).GetDocumentation() != preset(other).GetDocumentation()


def test_categories_show_what_they_are_known_for(layers: dict[Path, Layer]) -> None:
    """Fabric, skin, car paint, glass and leaves each have a parameter that makes them look like one."""
    marks = {"fabric": "sheen", "skin": "subsurface", "car paint": "clearcoat", "glass": "clear", "leaf": "back"}
    for file, layer in layers.items():
        if mark := marks.get(category(file)):
            assert layer.inputs[mark] >= 0.35, f"{file.stem}.{mark}"
