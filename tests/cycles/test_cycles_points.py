"""The generated OSL inside Cycles, in float32, against the models in float64 NumPy."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from lookdev.brdf import LOBES, PARAMETERS, evaluate, pdf
from lookdev.checks.evaluate import Batch, evaluate_cycles, evaluate_lines, evaluate_numpy

pytestmark = pytest.mark.cycles

Floats = NDArray[np.float64]

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


def random_batch(model: str, tokens: dict[str, str]) -> Batch:
    """Return cases over all of a model's parameters, a third near the mirror direction, some nearly opposite."""
    rng = np.random.default_rng(20120808)
    wo, wi = _directions(rng, COUNT), _directions(rng, COUNT)
    third, some = COUNT // 3, COUNT // 20
    wi[-third:] = wo[-third:] * [-1.0, -1.0, 1.0]
    wi[-third:] += rng.normal(size=(third, 3)) * 10.0 ** rng.uniform(-5.0, 0.0, (third, 1))
    wo[:some, 2] = wi[:some, 2] = 1e-3
    wi[:some, :2] = -wo[:some, :2] + rng.normal(size=(some, 2)) * 1e-3
    wi[:, 2] = np.abs(wi[:, 2])
    # Some lie on or below the horizon, where the answer is exactly 0.
    wi[some : 2 * some, 2] *= rng.choice([0.0, -1.0, 1.0], some)
    wo, wi = (w / np.linalg.norm(w, axis=-1, keepdims=True) for w in (wo, wi))
    parameters = {}
    for name, parameter in PARAMETERS[model].items():
        if parameter.kind != "token":
            shape = (COUNT, 3) if parameter.kind == "color" else (COUNT,)
            # A third of them at an end of what a slider offers.
            parameters[name] = _float32(np.clip(rng.uniform(-0.25, 1.25, shape), 0.0, 1.0) * parameter.soft[1])
    return Batch(model, tokens, wo, wi, parameters)


def rounded(batch: Batch) -> Batch:
    """Return the batch as Cycles gets it."""
    return replace(batch, wo=_float32(batch.wo), wi=_float32(batch.wi))


def assert_close(got: Floats, wanted: Floats) -> None:
    assert np.isfinite(got).all()
    assert (got >= 0.0).all()
    assert (got[wanted == 0.0] == 0.0).all()
    visible = wanted > VISIBLE
    assert np.count_nonzero(visible) > got.size // 4
    np.testing.assert_allclose(got[visible], wanted[visible], rtol=RELATIVE)
    np.testing.assert_allclose(got[~visible], wanted[~visible], atol=RELATIVE * VISIBLE)


@pytest.mark.parametrize("variant", ["2014", "2012"])
def test_random_cases(variant: str) -> None:
    batch = rounded(random_batch("disney", {"variant": variant}))
    (f, density), (f_wanted, density_wanted) = evaluate_cycles(batch), evaluate_numpy(batch)
    assert_close(f, f_wanted)
    assert_close(density, density_wanted)


@pytest.mark.parametrize(
    ("variant", "name"), [("2014", "diffuse"), ("2014", "specular"), ("2014", "clearcoat"), ("2012", "specular")]
)
def test_one_lobe_alone(variant: str, name: str) -> None:
    batch = rounded(random_batch("disney", {"variant": variant}))
    everywhere = {"clearcoat": np.maximum(batch.parameters["clearcoat"], 0.25)}
    everywhere["metallic"] = np.minimum(batch.parameters["metallic"], 0.75)
    everywhere["baseColor"] = np.maximum(batch.parameters["baseColor"], 0.25)
    batch = replace(batch, parameters=batch.parameters | everywhere)
    lobes = [lobe for lobe in LOBES["disney"](batch.parameters | batch.tokens) if lobe.name == name]
    f, density = evaluate_cycles(batch, [name])
    assert_close(f, evaluate(lobes, batch.wo, batch.wi))
    assert_close(density, pdf(lobes, batch.wo, batch.wi))


def test_directions_in_float64() -> None:
    # Rounding them turns the half vector by up to 2 sqrt(3) 2^-25 / |wo + wi|. A GTR2 lobe, the steeper one, changes
    # by 2 / alpha relative to that, at slope alpha: which float32 cannot give back, whatever the formula.
    batch = random_batch("disney", {"variant": "2014"})
    (f, density), (f_wanted, density_wanted) = evaluate_cycles(batch), evaluate_numpy(batch)
    roughness, anisotropic, gloss = (batch.parameters[name] for name in ("roughness", "anisotropic", "clearcoatGloss"))
    alpha = np.minimum(np.maximum(0.001, roughness**2 * np.sqrt(1.0 - 0.9 * anisotropic)), 0.1 - 0.099 * gloss)
    turn = 2.0 * np.sqrt(3.0) * 2.0**-25 / np.linalg.norm(batch.wo + batch.wi, axis=-1)
    tolerance = RELATIVE + 2.0 * turn / alpha
    # The rule holds at the first order: where a lobe changes by less than a tenth.
    tame = (2.0 * turn / alpha < 0.1) & (f_wanted.min(axis=-1) > VISIBLE)
    assert np.count_nonzero(tame) > COUNT // 2
    for got, wanted in ((f.max(axis=-1), f_wanted.max(axis=-1)), (density, density_wanted)):
        assert (np.abs(got - wanted)[tame] <= (tolerance * wanted)[tame]).all()


def test_the_oracle() -> None:
    lines = (Path(__file__).parents[1] / "oracles" / "disney.jsonl").read_text().splitlines()
    wanted = np.array([json.loads(line)["f"] for line in lines])
    got = np.array([json.loads(line)["f"] for line in evaluate_lines(lines, "cycles")])
    visible = wanted > VISIBLE
    np.testing.assert_allclose(got[visible], wanted[visible], rtol=RELATIVE)
    np.testing.assert_allclose(got[~visible], wanted[~visible], atol=RELATIVE * VISIBLE)
