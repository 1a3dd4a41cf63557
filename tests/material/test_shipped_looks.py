"""What ships: presets, looks in every variant, the textures that a script makes, and the looks of the paper's figures.

A preset is one layer that can be referenced and read, with a plausible surface.
"""

import runpy
from collections.abc import Callable
from functools import cache
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Usd, UsdShade

from lookdev.arrays import Bytes
from lookdev.brdf import MODELS, layer_shaders
from lookdev.brdf.conductor import METALS, metal_reflectance
from lookdev.job import Job, load_job
from lookdev.material import Bump, Layer, Look, Texture
from lookdev.material.library import read_preset
from lookdev.material.library.edit import preset_look
from lookdev.material.textures import sample_slopes, sample_texture
from lookdev.material.usd import expand_variants, read_look

ROOT = Path(__file__).parents[2]
MATERIALS = ROOT / "materials"
EXACT = sorted((MATERIALS / "metals").glob("*.usda"))
PRESETS = [*sorted((MATERIALS / "presets").glob("*.usda")), *EXACT]
CATEGORIES = {"metal": 10, "plastic": 4, "rubber": 2, "wood": 3, "stone": 3, "fabric": 4, "skin": 3, "ceramic": 2}
CATEGORIES |= {"car paint": 3, "glass": 3, "leaf": 2, "paper": 2, "paint": 2, "weathering": 2}
"""Each category, and the fewest presets it has."""

LOOKS = [*sorted(MATERIALS.glob("*.usda")), *sorted((MATERIALS / "classic").glob("*.usda"))]
STEPS = np.linspace(0.0, 1.0, 11)


@cache
def stage_of(file: Path) -> Usd.Stage:
    return Usd.Stage.Open(str(file))


def preset(file: Path) -> Usd.Prim:
    return stage_of(file).GetDefaultPrim()


def category(file: Path) -> str:
    return str(preset(file).GetCustomDataByKey("category"))


@cache
def layer_of(file: Path) -> Layer:
    """Return a preset as the only layer of a look, by reference."""
    return preset_look(read_preset(file), file.stem).layers[0]


@pytest.mark.parametrize("file", PRESETS, ids=lambda file: file.stem)
def test_a_preset_is_one_documented_layer_and_nothing_else(file: Path) -> None:
    prim, doc = preset(file), preset(file).GetDocumentation()
    assert prim.GetName() == file.stem.title().replace("_", "")
    assert [node.GetName() for node in stage_of(file).TraverseAll()] == [prim.GetName()]
    shader = UsdShade.Shader(prim)
    assert shader.GetShaderId() in layer_shaders()
    assert [output.GetBaseName() for output in shader.GetOutputs()] == ["layer"]
    assert file.stat().st_size < 2000
    assert doc.endswith(".")
    assert 10 <= len(doc) <= 120
    assert category(file) in CATEGORIES


def test_the_library_is_large_enough() -> None:
    categories = [category(file) for file in PRESETS]
    assert len(categories) >= 36
    assert {name: least for name, least in CATEGORIES.items() if categories.count(name) < least} == {}


@pytest.mark.parametrize("file", PRESETS, ids=lambda file: file.stem)
def test_a_preset_has_what_differs_from_the_default_within_what_a_slider_offers(file: Path) -> None:
    layer = layer_of(file)
    assert {shader_input.GetBaseName() for shader_input in UsdShade.Shader(preset(file)).GetInputs()} == set(
        layer.inputs
    )
    for name, value in layer.inputs.items():
        parameter = MODELS[layer.model].parameters[name]
        if isinstance(value, str):
            assert value != parameter.default
            continue
        low, high = parameter.soft
        assert np.all((np.array(value) >= low) & (np.array(value) <= high)), name
        # USD holds float32.
        assert not np.allclose(value, parameter.default, rtol=1e-6, atol=1e-6), name


@pytest.mark.parametrize("file", [file for file in PRESETS if file not in EXACT], ids=lambda file: file.stem)
def test_a_surface_is_as_bright_as_real_ones(file: Path) -> None:
    layer = layer_of(file)
    color = layer.inputs["surfaceColor" if layer.model == "pixar" else "baseColor"]
    if layer.inputs.get("metallic") == 1.0:
        assert category(file) == "metal"
    elif layer.inputs.get("clear") == 1.0:
        assert min(color) >= 0.02  # glass; it may let all light through
    else:
        # Between coal and fresh snow; float32 may round below.
        assert min(color) > 0.02 - 1e-6
        assert max(color) <= 0.9


@pytest.mark.parametrize("metal", METALS)
def test_a_metal_has_the_colour_of_its_measured_index_and_an_exact_preset(metal: str) -> None:
    metal_files = [file for file in PRESETS if file.stem.endswith(metal) and file not in EXACT]
    (exact,) = (file for file in EXACT if file.stem == f"exact_{metal}")
    assert metal_files
    for file in metal_files:
        # Three digits are written.
        np.testing.assert_allclose(layer_of(file).inputs["baseColor"], metal_reflectance(metal), rtol=0, atol=5.1e-4)
    assert layer_of(exact).inputs["metal"] == metal
    for file in (*metal_files, exact):
        assert layer_of(file).inputs["metallic"] == 1.0
        assert METALS[metal].split()[0] in preset(file).GetCustomDataByKey("source")


def test_every_metal_is_a_measured_one() -> None:
    metals = [file.stem for file in PRESETS if category(file) == "metal"]
    assert [name for name in metals if not name.endswith(tuple(METALS))] == []


def test_no_two_presets_are_the_same() -> None:
    for first, other in combinations(PRESETS, 2):
        a, b = layer_of(first), layer_of(other)
        assert (a.model, a.inputs) != (b.model, b.inputs), f"{first.stem} is {other.stem}"
        assert preset(first).GetDocumentation() != preset(other).GetDocumentation()


def test_categories_show_what_they_are_known_for() -> None:
    """Fabric, skin, car paint, glass and leaves each have a parameter that makes them look like one."""
    marks = {"fabric": "sheen", "skin": "subsurface", "car paint": "clearcoat", "glass": "clear", "leaf": "back"}
    for file in PRESETS:
        if mark := marks.get(category(file)):
            assert layer_of(file).inputs[mark] >= 0.35, f"{file.stem}.{mark}"


def variants_of(file: Path) -> list[dict[str, str]]:
    stage = Usd.Stage.Open(str(file))  # a prim does not keep its stage alive
    sets = stage.GetDefaultPrim().GetVariantSets()
    return [{name: choice} for name in sets.GetNames() for choice in sets.GetVariantSet(name).GetVariantNames()]


def read_shipped(name: str, **variants: str) -> Look:
    return read_look(MATERIALS / f"{name}.usda", variants=variants)


@pytest.mark.parametrize(
    ("file", "variants"),
    [
        pytest.param(file, variants, id=f"{file.stem}-{variants}")
        for file in LOOKS
        for variants in ({}, *variants_of(file))
    ],
)
def test_every_variant_can_be_read(file: Path, variants: dict[str, str]) -> None:
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


def test_robot_paint_shows_metal_where_it_is_worn() -> None:
    new, worn_look = (read_shipped("robot_paint", wear=wear) for wear in ("new", "worn"))
    assert [layer.name for layer in new.layers] == ["Metal", "Paint"]
    assert [layer.name for layer in worn_look.layers] == ["Metal", "Paint", "Dirt"]
    assert {layer.model for layer in worn_look.layers} == {"pixar"}
    assert new.layers[1].mask == 1.0
    mask = worn_look.layers[1].mask
    assert isinstance(mask, Texture)
    samples = sample_texture(mask, np.random.default_rng(2).uniform(0, 1, (10000, 2)))
    assert 0.02 < (samples < 0.5).mean() < 0.2  # worn, but painted still
    assert all(isinstance(layer.inputs["highlightNormal"], Bump) for layer in worn_look.layers[:2])


def test_leaf_is_thin_and_cut_out() -> None:
    blade, veins = read_shipped("leaf").layers
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
    pixels: Callable[[str], Bytes] = script["pixels"]
    texels = pixels(name).astype(int)
    assert stored.shape == (512, 512, 1)
    # NumPy versions differ in the last bit of an FFT, which can move a value across one rounding step.
    step = 255 / script["TEXTURES"][name][1]
    difference = np.abs(stored[..., 0] - texels)
    assert difference.max() <= np.ceil(step)
    assert np.count_nonzero(difference) <= 10
    # It tiles: across the edge neighbours differ no more than they do inside.
    for image in (texels, texels.T):
        inside = [np.abs(a - b).mean() for a, b in pairwise(image)]
        assert np.abs(image[-1] - image[0]).mean() <= max(inside)


def test_every_model_but_those_of_production_has_a_classic_look() -> None:
    looks = {file.stem: read_look(file) for file in (MATERIALS / "classic").glob("*.usda")}
    models = {name: [layer.model for layer in look.layers] for name, look in looks.items()}
    assert models == {name.replace("-", "_"): [name] for name in MODELS if name not in ("disney", "pixar", "measured")}


def rows(name: str) -> tuple[Job, dict[str, list[tuple[Layer, ...]]]]:
    """Return the job of a figure, and for each of its looks the layers of each variant."""
    job = load_job(ROOT / "jobs" / f"{name}.toml")
    return job, {
        look.name: [
            read_look(look.material, look.prim, selection).layers
            for selection in expand_variants(look.material, look.prim, look.variants)
        ]
        for look in job.look
    }


def test_figure_16_varies_one_parameter_a_row_from_0_to_1() -> None:
    job, figure = rows("figure_16")
    parameters = MODELS["disney"].parameters
    published = [parameter for name, parameter in parameters.items() if name != "presence" and not parameter.optional]
    scalars = [parameter.name for parameter in published if parameter.kind == "float"]
    assert list(figure) == scalars  # every one, in the order of the paper's list
    for parameter, looks in figure.items():
        layers = [layer for (layer,) in looks]
        assert [layer.inputs[parameter] for layer in layers] == pytest.approx(STEPS)
        others = [{name: value for name, value in layer.inputs.items() if name != parameter} for layer in layers]
        assert others == others[:1] * len(STEPS)
    assert job.outputs.overview_columns == len(STEPS)


def test_figure_19_turns_one_preset_to_another_in_even_steps() -> None:
    job, figure = rows("figure_19")
    presets = [layer_of(MATERIALS / "presets" / f"{name}.usda").inputs for name in ("gold", "blue_rubber")]
    (looks,) = figure.values()
    assert [rubber.mask for _, rubber in looks] == pytest.approx(STEPS)
    for look in looks:
        assert [layer.inputs for layer in look] == presets
    assert job.outputs.overview_columns == len(STEPS)
