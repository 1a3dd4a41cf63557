"""The generated OSL inside Cycles, in float32, against the models in float64 NumPy."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from looks import quick_among

from lookdev.arrays import Floats
from lookdev.brdf import MODELS, evaluate, pdf
from lookdev.checks.evaluate import Batch, evaluate_cycles, evaluate_lines, evaluate_numpy
from lookdev.codegen.points import PointLayer

pytestmark = [pytest.mark.cycles, pytest.mark.usefixtures("warm_points")]


COUNT = 10_000
# The bar everywhere; nothing needs more once both sides start from the same float32 inputs: the formulas lose at most
# some hundred units in the last place (6e-8), in the half vector of directions nearly opposite each other.
RELATIVE = 2e-4
VISIBLE = 1e-4


def _float32(values: Any) -> Floats:
    return np.asarray(values).astype(np.float32).astype(np.float64)


def _directions(rng: np.random.Generator, count: int) -> Floats:
    """Return directions of the upper hemisphere, a quarter of them at grazing angles down to 1e-4."""
    cos = rng.uniform(0.0, 1.0, count)
    cos[: count // 4] = 10.0 ** rng.uniform(-4.0, 0.0, count // 4)
    phi = rng.uniform(0.0, 2.0 * np.pi, count)
    sin = np.sqrt(1.0 - cos * cos)
    return np.stack([sin * np.cos(phi), sin * np.sin(phi), cos], axis=-1)


def random_batch(*layers: PointLayer, seed: int = 20120808) -> Batch:
    """Return cases as Cycles gets them, over all parameters of a stack, a third near the mirror image of the view.

    Where the base transmits light, half of the others have the light behind. Normals are the shading normal.
    """
    rng = np.random.default_rng(seed)
    numbers = tuple(_random_numbers(rng, layer) for layer in layers)
    wo, wi = _directions(rng, COUNT), _directions(rng, COUNT)
    third, some = COUNT // 3, COUNT // 20
    wi[-third:] = wo[-third:] * [-1.0, -1.0, 1.0]
    if layers[0].model == "pixar":
        # Below, near where the view is refracted to; and seen from behind.
        through = wo / numbers[0]["ior"][:, None] * [-1.0, -1.0, 0.0]
        through[:, 2] = -np.sqrt(1.0 - (through**2).sum(axis=-1))
        wi[-third::2] = through[-third::2]
        wi[2 * some : -third : 2, 2] *= -1.0
    wi[-third:] += rng.normal(size=(third, 3)) * 10.0 ** rng.uniform(-5.0, 0.0, (third, 1))
    wo[:some, 2] = wi[:some, 2] = 1e-3
    wi[:some, :2] = -wo[:some, :2] + rng.normal(size=(some, 2)) * 1e-3
    # Some lie on or below the horizon, where the answer of a lobe that reflects is exactly 0.
    wi[some : 2 * some, 2] *= rng.choice([0.0, -1.0, 1.0], some)
    if layers[0].model == "pixar":
        wo[3 * some : 4 * some] *= -1.0
        wi[3 * some : 4 * some] *= -1.0
    else:
        wi[2 * some :, 2] = np.abs(wi[2 * some :, 2])
    wo, wi = (w / np.linalg.norm(w, axis=-1, keepdims=True) for w in (wo, wi))
    return Batch(layers, _float32(wo), _float32(wi), numbers)


def _random_numbers(rng: np.random.Generator, layer: PointLayer) -> dict[str, Floats]:
    numbers = {"mask": _float32(np.clip(rng.uniform(-0.25, 1.25, COUNT), 0.0, 1.0))}
    for name, parameter in MODELS[layer.model].parameters.items():
        if name in layer.constants:
            continue
        if parameter.kind == "normal":
            numbers[name] = np.tile([0.0, 0.0, 1.0], (COUNT, 1))
        elif parameter.kind != "token":
            shape = (COUNT, 3) if parameter.kind == "color" else (COUNT,)
            low, high = parameter.soft
            # A third of them at an end of what a slider offers.
            numbers[name] = _float32(low + (high - low) * np.clip(rng.uniform(-0.25, 1.25, shape), 0.0, 1.0))
    return numbers


def assert_close(got: Floats, expected: Floats, tolerance: float = RELATIVE) -> None:
    assert np.isfinite(got).all()
    assert (got >= 0.0).all()
    # OSL's exp() ends at 2^-126 instead of 0.
    assert (got[expected == 0.0] < 1e-25).all()
    assert np.count_nonzero(expected > VISIBLE) > got.size // 4
    assert_values_close(got, expected, tolerance)


def assert_values_close(got: Floats, expected: Floats, tolerance: float = RELATIVE) -> None:
    visible = expected > VISIBLE
    np.testing.assert_allclose(got[visible], expected[visible], rtol=tolerance)
    np.testing.assert_allclose(got[~visible], expected[~visible], atol=tolerance * VISIBLE)


def disney(variant: str = "2014", mode: Any = "over", options: bool = False, **tokens: str) -> PointLayer:
    left_out = {} if options else MODELS["disney"].optional_defaults()
    return PointLayer("disney", {"variant": variant, **tokens}, mode, left_out)


def pixar(mode: Any = "over", energy: str = "published", **tokens: str) -> PointLayer:
    return PointLayer("pixar", {"energy": energy, **tokens}, mode)


STACKS = {
    "disney, exact metals with options": (disney(options=True, fresnel="conductor"),),
    "pixar conserving": (pixar(energy="conserving"),),
    "pixar transmitting to exact metals": (pixar(fresnel="conductor"), pixar("transmit", fresnel="conductor")),
    "disney coating pixar": (pixar(), disney(mode="coat"), disney(mode="coat")),
}
# Parts of those above, and other orders of them; the oracles below have single layers as they are published.
MORE_STACKS = {
    "disney 2014": (disney(),),
    "disney 2012": (disney("2012"),),
    "disney with options": (disney(options=True),),
    "disney, exact metals": (disney(fresnel="conductor"),),
    "disney over disney": (disney(), disney()),
    "pixar": (pixar(),),
    "pixar, exact metals": (pixar(fresnel="conductor"),),
    "pixar, exact metals, conserving": (pixar(energy="conserving", fresnel="conductor"),),
    "pixar over pixar": (pixar(), pixar()),
    "pixar transmitting to pixar": (pixar(), pixar("transmit")),
    "three pixar layers": (pixar(), pixar("transmit"), pixar("transmit")),
    "disney over pixar": (pixar(), pixar("transmit"), disney("2012")),
    "pixar over disney": (disney(), pixar()),
}


# Layers that transmit to each other average their indices of refraction: three roundings, 2^-24 each, of the refracted
# view, by product, sum and quotient. A lobe of 0.25 degrees, p = 1.2e5, changes by 2 p sin theta_h of that,
# sin^2 theta_h < 20 / p where it is seen.
AVERAGED = RELATIVE + 2.0 * np.sqrt(20.0 * 1.2e5) * 3.0 * 2.0**-24


@pytest.mark.parametrize(
    "layers",
    [
        *(pytest.param(layers, id=name) for name, layers in STACKS.items()),
        *(pytest.param(layers, id=name, marks=pytest.mark.proof) for name, layers in MORE_STACKS.items()),
    ],
)
def test_random_cases(layers: tuple[PointLayer, ...]) -> None:
    batch = random_batch(*layers)
    (f, density), (f_expected, density_expected) = evaluate_cycles(batch), evaluate_numpy(batch)
    tolerance = AVERAGED if [layer.mode for layer in layers].count("transmit") > 1 else RELATIVE
    if "filmThickness" not in layers[0].constants and layers[0].model == "disney":
        # Where a film reflects next to nothing, its terms cancel: four roundings of what a mirror reflects.
        ones = {"baseColor": np.ones((COUNT, 3)), "metallic": np.ones(COUNT), "k": np.full((COUNT, 3), 20.0)}
        mirror, _ = evaluate_numpy(replace(batch, numbers=(batch.numbers[0] | ones,)))
        f = np.where(np.abs(f - f_expected) <= 4.0 * 2.0**-24 * mirror, f_expected, f)
    assert_close(f, f_expected, tolerance)
    assert_close(density, density_expected, tolerance)


# Parameters with which no lobe is dark everywhere.
_BRIGHT = {
    "disney": {"clearcoat": (0.25, 1.0), "metallic": (0.0, 0.75), "baseColor": (0.25, 1.0)},
    "pixar": {
        "surfaceColor": (0.25, 1.0), "roughness": (0.0, 0.4), "clear": (0.25, 0.75), "back": (0.25, 0.75),
        "normalScale": (0.25, 0.75), "specularTint": (0.25, 1.0), "transmissionTint": (0.25, 1.0),
    },
}  # fmt: skip
_LOBES = [(disney("2012"), "specular"), *((disney(), name) for name in ("diffuse", "specular", "clearcoat"))] + [
    (pixar(), name)
    for name in ("diffuse", "specular", "reflection", "diffuseTransmission", "specularTransmission", "refraction")
]
# Those with terms of their own for the other lobes.
_QUICK_LOBES = [(disney(), "clearcoat"), (pixar(), "specularTransmission")]


@pytest.mark.parametrize(("layer", "name"), quick_among(_LOBES, _QUICK_LOBES))
def test_one_lobe_alone(layer: PointLayer, name: str) -> None:
    batch = random_batch(layer)
    numbers = {**batch.numbers[0]}
    for parameter, (low, high) in _BRIGHT[layer.model].items():
        numbers[parameter] = _float32(np.clip(numbers[parameter], low, high))
    numbers |= {key: np.ones(COUNT) for key in numbers if key.endswith("Scale") and key != "normalScale"}
    numbers["presence"] = np.ones(COUNT)
    batch = replace(batch, numbers=(numbers,))
    whole = batch.bsdf()
    bsdf = replace(whole, lobes=lambda wo: tuple(lobe for lobe in whole.lobes(wo) if lobe.name == name))
    f, density = evaluate_cycles(batch, [name])
    expected = evaluate(bsdf, batch.wo, batch.wi)
    # A narrow lobe is dark nearly everywhere: only a third of the cases are near its peak, on one side.
    assert np.count_nonzero(expected > VISIBLE) > expected.size // 20
    assert_values_close(f, expected)
    assert_values_close(density, pdf(bsdf, batch.wo, batch.wi))


def test_normals_of_the_lobes() -> None:
    # Into the frame of a tilted normal, a direction is rounded by up to 4 units of 2^-24, whose part across the lobe
    # turns the half vector. ln D changes by 2 p sin theta_h times that, and sin^2 theta_h < 20 / p where D can be seen.
    batch = random_batch(pixar())
    rng = np.random.default_rng(7)
    tilted = np.concatenate([rng.normal(size=(COUNT, 2, 2)) * 0.3, np.ones((COUNT, 2, 1))], axis=-1)
    normals = {"diffuseNormal": _float32(tilted[:, 0]), "highlightNormal": _float32(tilted[:, 1])}
    narrow = {name: np.ones(COUNT) for name in batch.numbers[0] if name.endswith("ConeScale")}
    batch = replace(batch, numbers=(batch.numbers[0] | normals | narrow,))
    (f, density), (f_expected, density_expected) = evaluate_cycles(batch), evaluate_numpy(batch)
    cone = np.radians(np.maximum(0.25, 10.0 * batch.numbers[0]["roughness"]))
    power = np.log(10.0) / np.sin(cone) ** 2
    turn = 4.0 * 2.0**-24 / np.linalg.norm(np.abs(batch.wo + batch.wi), axis=-1)
    tolerance = RELATIVE + 2.0 * np.sqrt(20.0 * power) * turn
    assert np.quantile(tolerance, 0.5) < 2.0 * RELATIVE
    for got, expected in ((f.max(axis=-1), f_expected.max(axis=-1)), (density, density_expected)):
        seen = (expected > VISIBLE) & (tolerance < 0.1)
        assert np.count_nonzero(seen) > COUNT // 3
        assert (np.abs(got - expected)[seen] <= (tolerance * expected)[seen]).all()


def oracle_values(name: str, is_chosen: Callable[[str], bool] = bool) -> tuple[Floats, Floats]:
    """Return the values of Cycles and of an oracle, where Cycles gets its float64 directions in float32."""
    lines = (Path(__file__).parents[1] / "oracles" / f"{name}.jsonl").read_text().splitlines()
    lines = [line for line in lines if is_chosen(line)]
    got, expected = (
        np.array([json.loads(line)["f"] for line in answers]) for answers in (evaluate_lines(lines, "cycles"), lines)
    )
    return got, expected


@pytest.mark.both_pythons
@pytest.mark.parametrize("oracle", ["disney", "pixar", pytest.param("pixar_stacks", marks=pytest.mark.proof)])
def test_the_oracle(oracle: str) -> None:
    assert_values_close(*oracle_values(oracle))


# Of 20 microfacet models, five that have each distribution, and both geometries and normalisations.
_MICROFACETS = {
    ("beckmann", "v-groove", "4"),
    ("ggx", "smith", "pi"),
    ("gtr", "v-groove", "pi"),
    ("blinn", "smith", "4"),
    ("gaussian", "v-groove", "4"),
}


@pytest.mark.parametrize(
    "microfacets", [_MICROFACETS, pytest.param(None, marks=pytest.mark.proof)], ids=["some", "all"]
)
def test_the_oracle_of_the_classics(microfacets: set[tuple[str, ...]] | None) -> None:
    def is_chosen(line: str) -> bool:
        params = json.loads(line)["params"]
        model = tuple(params.get(name) for name in ("distribution", "geometry", "normalisation"))
        return not microfacets or "geometry" not in params or model in microfacets

    got, expected = oracle_values("classic", is_chosen)
    # Directions rounded to float32 alone change the narrowest highlights by up to 2e-3.
    visible = expected > VISIBLE
    error = np.abs(got - expected)[visible] / expected[visible]
    assert np.quantile(error, 0.99) < RELATIVE
    assert error.max() < 0.05
    np.testing.assert_allclose(got[~visible], expected[~visible], atol=RELATIVE * VISIBLE)
