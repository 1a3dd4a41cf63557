"""A blurred mask between any two presets stays plausible, pair by pair; and which pairs cannot.

A BRDF is not linear in its parameters, so some pairs leave the range of their ends; `mask_edges.txt` names them.
"""

from typing import Any

import mask_edges
import numpy as np
import pytest
from mask_edges import ALLOWED, LIGHTS, MASKS, PAIRS, Pair, Preset, edges, overshoot, read_presets
from scipy.stats import qmc

from lookdev.brdf import MODELS, StackLayer, evaluate_cosine, pdf, sample
from lookdev.brdf.disney import DISNEY
from lookdev.brdf.pixar.layering import combine_partitions
from lookdev.brdf.pixar.partition import layer_partition
from lookdev.light import BUILTIN_LIGHTS, load_environment, prepare_light

# The distribution of a highlight, alpha^2 / (alpha^2 cos^2 + sin^2)^2, is nowhere above (1 + x)^2 / (4 x) times the
# larger of its ends when alpha grows by a factor x: 1 %, which `NARROW` allows, for 1.22.
_FACTOR = 1.22


@pytest.fixture(scope="module")
def presets() -> dict[str, Preset]:
    return read_presets()


def of_models(presets: dict[str, Preset], *models: str) -> list[Pair]:
    """Return the pairs whose models are these, in either order."""
    return [(a, b) for a, b in PAIRS if sorted(models) == sorted((presets[a][0], presets[b][0]))]


def some(pairs: list[Pair], count: int) -> list[Pair]:
    return [pairs[number] for number in np.random.default_rng(12).permutation(len(pairs))[:count]]


def factor(a: float, b: float) -> float:
    low, high = sorted((float(a), float(b)))
    return high / low


def unlike(a: dict[str, Any], b: dict[str, Any]) -> set[str]:
    """Return the differences of two Disney presets for which their blend leaves the range of both."""
    alpha = [max(0.001, p["roughness"] ** 2) for p in (a, b)]
    coat = [0.1 + (0.001 - 0.1) * p["clearcoatGloss"] for p in (a, b)]
    differs = {
        "metallic": a["metallic"] != b["metallic"],
        "anisotropic": a["anisotropic"] != b["anisotropic"],
        "roughness": factor(*alpha) > _FACTOR,
        "clearcoatGloss": bool(a["clearcoat"] or b["clearcoat"]) and factor(*coat) > _FACTOR,
        "subsurface": abs(a["subsurface"] - b["subsurface"]) > 0.25,
        "tint": any(p["sheen"] * p["sheenTint"] > 0.1 or p["specularTint"] > 0.1 for p in (a, b)),
    }
    return {name for name, is_different in differs.items() if is_different}


def alike(presets: dict[str, Preset]) -> list[Pair]:
    """Return the pairs of Disney's that should interpolate monotonically, whatever the light."""
    return [pair for pair in of_models(presets, "disney", "disney") if not unlike(*(presets[n][1] for n in pair))]


def test_no_parameter_leaves_its_range(presets: dict[str, Preset]) -> None:
    pairs = of_models(presets, "disney", "disney")
    numbers = {name: parameter for name, parameter in DISNEY.parameters.items() if parameter.kind != "token"}
    sides = [[presets[name][1] for name in names] for names in zip(*pairs, strict=True)]
    below, above = ({name: np.stack([p[name] for p in side])[:, None] for name in numbers} for side in sides)
    layers = [StackLayer("disney", DISNEY.tokens({}) | below), StackLayer("disney", DISNEY.tokens({}) | above, MASKS)]
    blended = DISNEY.blend(layers)
    for name, parameter in numbers.items():
        value, (low, high) = blended[name], parameter.hard
        assert value.shape[:2] == (len(pairs), len(MASKS))
        assert np.all((value >= low) & (value <= high)), name
        assert np.all(np.diff(value, axis=1) * (above[name] - below[name]) >= 0.0), name


def test_no_lobe_leaves_its_range(presets: dict[str, Preset]) -> None:
    """Weights and cones of Pixar's lobes stay between those of the two layers, seen from anywhere."""
    cos = np.array([0.05, 0.4, 0.8, 1.0])
    wo = np.stack([np.sqrt(1.0 - cos * cos), np.zeros(4), cos], axis=-1)
    for a, b in of_models(presets, "pixar", "pixar"):
        below, above = (layer_partition(presets[name][1], wo) for name in (a, b))
        for mask in MASKS:
            for name, term in combine_partitions([(below, 1.0, "over"), (above, mask, "over")]).terms.items():
                for part in ("normal", "grazing", "cone", "ior_minus_one"):
                    ends = getattr(below.terms[name], part), getattr(above.terms[name], part)
                    value = np.asarray(getattr(term, part))
                    # Averages round.
                    assert np.all(value >= np.minimum(*ends) * (1.0 - 1e-12)), (a, b, name, part)
                    assert np.all(value <= np.maximum(*ends) * (1.0 + 1e-12)), (a, b, name, part)


def assert_as_recorded(presets: dict[str, Preset], pairs: list[Pair]) -> None:
    colors = [edges(light, presets, pairs) for light in LIGHTS]
    assert all(np.isfinite(pixels).all() and (pixels >= 0.0).all() for pixels in colors)
    worst = np.max([mask_edges.excess(pixels).max(axis=(1, 2, 3)) for pixels in colors], axis=0)
    recorded = mask_edges.read_edges()
    assert [mask_edges.kind_of(value) for value in worst] == [recorded[pair] for pair in pairs]


def test_some_edges_are_as_recorded(presets: dict[str, Preset]) -> None:
    counts = {("disney", "disney"): 12, ("pixar", "pixar"): 3, ("disney", "pixar"): 3}
    pairs = [pair for models, count in counts.items() for pair in some(of_models(presets, *models), count)]
    assert_as_recorded(presets, pairs)


@pytest.mark.proof
def test_all_edges_are_as_recorded(presets: dict[str, Preset]) -> None:
    assert_as_recorded(presets, PAIRS)


@pytest.mark.parametrize(
    "light", [pytest.param(light, marks=[] if light in LIGHTS else pytest.mark.proof) for light in BUILTIN_LIGHTS]
)
def test_alike_presets_stay_in_the_range_of_both(presets: dict[str, Preset], light: str) -> None:
    pairs = alike(presets)
    assert len(pairs) > 40
    assert overshoot(light, presets, pairs).max() <= ALLOWED


@pytest.mark.parametrize(
    ("name", "pair"),
    [
        ("metallic", ("red_plastic", "silver")),
        ("anisotropic", ("brushed_aluminium", "palladium")),
        ("roughness", ("black_car_paint", "blue_rubber")),
        ("clearcoatGloss", ("black_car_paint", "satin_car_paint")),
        ("subsurface", ("wax", "white_plastic")),
        ("tint", ("mud", "red_velvet")),
    ],
)
def test_presets_that_differ_in_one_thing_leave_the_range(presets: dict[str, Preset], name: str, pair: Pair) -> None:
    satin = {**presets["black_car_paint"][1], "clearcoatGloss": np.array(0.0)}  # no two presets differ in this alone
    presets = {**presets, "satin_car_paint": ("disney", satin)}
    assert unlike(*(presets[preset][1] for preset in pair)) == {name}
    assert max(overshoot(light, presets, [pair])[0] for light in LIGHTS) > ALLOWED
    if name != "tint":
        # That one difference is the reason. Equal tints still vary as the base colour changes, as they are quotients.
        assert max(overshoot(light, presets, [pair], equal=[name])[0] for light in LIGHTS) <= ALLOWED


def test_presets_of_two_models_blend_along_a_straight_line(presets: dict[str, Preset]) -> None:
    colors = edges("studio", presets, some(of_models(presets, "disney", "pixar"), 6))
    mask = MASKS[:, None, None]
    np.testing.assert_allclose(colors, colors[:, :1] * (1.0 - mask) + colors[:, -1:] * mask, rtol=1e-12)


def test_it_does_not_matter_which_preset_is_above(presets: dict[str, Preset]) -> None:
    for models in (("disney", "disney"), ("pixar", "pixar"), ("disney", "pixar")):
        pairs = some(of_models(presets, *models), 3)
        swapped = edges("studio", presets, [(b, a) for a, b in pairs])
        np.testing.assert_allclose(edges("studio", presets, pairs), swapped[:, ::-1], rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "light"),
    [
        pytest.param(name, light, marks=[] if (number + k) % 2 else pytest.mark.proof)
        for number, name in enumerate(["chromium", "red_plastic", "silk", "green_leaf", "frosted_glass"])
        for k, light in enumerate(LIGHTS)
    ],
)
def test_pixels_are_what_sampling_estimates(presets: dict[str, Preset], name: str, light: str) -> None:
    """Cells displace light by half their width at most: 1 % of the level as rms, 3 % here with the estimate's noise."""
    model, parameters = presets[name]
    bsdf = MODELS[model].bsdf(parameters)
    dome, anywhere = prepare_light(load_environment(builtin=light), sampled=False), np.zeros(3)
    count, rng = 2**12, np.random.default_rng(5)
    u = qmc.Sobol(2, rng=rng).random(count)
    drawn = dome.sample(anywhere, qmc.Sobol(2, rng=rng).random(count))
    error = []
    for pixel in mask_edges.sphere_pixels(light):
        wo = np.broadcast_to(pixel.wo, (count, 3))
        wi = np.concatenate([sample(bsdf, wo, u), drawn @ pixel.frame.T])
        wi = wi[wi[:, 2] != 0.0]
        world = wi @ pixel.frame
        density = pdf(bsdf, pixel.wo[None], wi) + dome.pdf(anywhere, world)
        values = evaluate_cosine(bsdf, pixel.wo[None], wi) * dome.radiance(anywhere, world) / density[:, None]
        estimate = values.sum(axis=0) / count
        error.append(pixel.show(bsdf) / estimate - 1.0)
    assert np.sqrt(np.mean(np.square(error))) <= 0.03


@pytest.mark.proof
def test_the_tables_of_the_page_are_what_is_measured(presets: dict[str, Preset]) -> None:
    page = mask_edges.PAGE.read_text()
    for name, table in mask_edges.tables(presets).items():
        assert mask_edges.page_table(page, name) == table, "run: python tests/material/mask_edges.py"


def test_the_page_counts_what_is_recorded(presets: dict[str, Preset]) -> None:
    recorded = mask_edges.kinds_table(presets, mask_edges.read_edges())
    assert mask_edges.page_table(mask_edges.PAGE.read_text(), "kinds") == recorded
