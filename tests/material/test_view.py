"""The view as an input of expressions: values at points, sampling at a hit, and code that reads it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from lookdev.brdf import Bsdf, evaluate, evaluate_cosine, pdf, sample
from lookdev.checks.samples import constant_looks
from lookdev.material import Coordinates, Formula, Layer, Look, Primvar, View
from lookdev.material.expression import parse
from lookdev.material.points import ImagePoints
from lookdev.material.values import look_bsdf
from lookdev.reference.albedo import integrate_albedo, sample_albedo

Floats = NDArray[np.float64]

COUNT = 2**16


def of_view(text: str, **inputs: Any) -> Formula:
    kinds = {name: "color" if isinstance(each, Coordinates | tuple) else "float" for name, each in inputs.items()}
    return Formula(parse(text), {"view": View(), **inputs}, {"view": "float", **kinds})


LOOK = Look(
    "look",
    (
        Layer("Paint", "disney", {"baseColor": of_view("mix([.8, .1, .05], [.05, .2, .8], view)"), "metallic": 0.5}),
        Layer(
            "Leaf",
            "pixar",
            {"roughness": of_view("0.3 + 0.3 * view"), "back": of_view("1 - view"), "clear": of_view("view")},
            of_view("smoothstep(1 - view, 0.1, 0.9)"),
        ),
    ),
)
VIEWS = (1.0, 0.7, 0.3, 0.05)


@dataclass(frozen=True)
class Seen(ImagePoints):
    """Points seen at one cosine or at several, with one place of st and one primvar."""

    cosine: Any

    def uv(self, name: str) -> Floats:
        return np.array([0.25, 0.75])

    def primvar(self, primvar: Primvar) -> Floats:
        return np.array(0.5)

    def handedness(self) -> Floats:
        return np.ones(())

    def view(self) -> Floats:
        return np.asarray(self.cosine)


def direction(cosine: float) -> Floats:
    return np.array([np.sqrt(1.0 - cosine * cosine), 0.0, cosine])


def seen(cosine: Any) -> Bsdf:
    return look_bsdf(LOOK, Seen(cosine))


def test_values_at_points_are_those_of_each_view() -> None:
    rng = np.random.default_rng(1)
    cosines = np.array(VIEWS)
    wo = np.stack([direction(cosine) for cosine in VIEWS])
    wi = sample(seen(cosines), wo, rng.random((len(VIEWS), 2)))
    values, densities = evaluate(seen(cosines), wo, wi), pdf(seen(cosines), wo, wi)
    for k, cosine in enumerate(VIEWS):
        np.testing.assert_allclose(values[k], evaluate(seen(cosine), wo[k], wi[k]), rtol=1e-12)
        np.testing.assert_allclose(densities[k], pdf(seen(cosine), wo[k], wi[k]), rtol=1e-12)


@pytest.mark.parametrize("cosine", VIEWS)
def test_sampling_at_a_hit_agrees_with_brute_force(cosine: float) -> None:
    """Light from each side: directions of the BSDF over its pdf, quadrature, and directions uniform over the sphere."""
    rng = np.random.default_rng(2)
    bsdf, wo = seen(cosine), direction(cosine)
    z, phi = rng.uniform(-1.0, 1.0, COUNT), rng.uniform(0.0, 2.0 * np.pi, COUNT)
    r = np.sqrt(1.0 - z * z)
    wi = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1)
    view = np.broadcast_to(wo, wi.shape)
    weight = evaluate_cosine(bsdf, view, wi) * (4.0 * np.pi)
    sides = np.stack([weight * (z > 0.0)[:, None], weight * (z < 0.0)[:, None]])
    brute, error = sides.mean(axis=1), sides.std(axis=1) / np.sqrt(COUNT)
    drawn, exact = sample_albedo(bsdf, wo, 1024, 16, rng), integrate_albedo(bsdf, wo)
    # 24 comparisons over the four views: noise exceeds 4.5 standard errors once in 6,000 runs.
    assert (np.abs(brute - drawn.value) <= 4.5 * np.hypot(error, drawn.error) + exact.error).all()
    assert (np.abs(exact.value - drawn.value) <= 4.5 * drawn.error + exact.error).all()
    # Directions over the sphere are drawn with probability 1, but for those that no lobe sends.
    density = pdf(bsdf, view, wi) * (4.0 * np.pi)
    assert density.mean() < 1.0 + 4.5 * density.std() / np.sqrt(COUNT)


def test_the_albedo_of_a_view_is_that_of_the_model_with_its_numbers() -> None:
    """What a view sees is bounded by the model; the same pair of directions the other way round is another value."""
    wo, wi = direction(0.9), direction(0.2) * [-1.0, 1.0, 1.0]
    there, back = evaluate(seen(0.9), wo, wi), evaluate(seen(0.2), wi, wo)
    assert not np.allclose(there, back, rtol=0.1)
    np.testing.assert_array_equal(there, evaluate(seen(wo[2]), wo, wi))


def test_a_look_at_a_point_keeps_its_dependence_on_the_view() -> None:
    inner = of_view("view * wear", wear=Primvar("wear", 0.5))
    layer = Layer(
        "Base",
        "disney",
        {
            "roughness": of_view("a * c[0]", a=inner, c=Coordinates("st")),
            "metallic": Primvar("wear", 0.5),
            "baseColor": of_view("c * [view, 1, 1]", c=(0.3, 0.6, 0.9)),
        },
        of_view("view"),
    )
    looks = constant_looks(Look("look", (Layer("Under", "disney"), layer)), 3, np.random.default_rng(3))
    assert len(looks) == 3
    for look in looks:
        inputs = look.layers[1].inputs
        metal, rough = inputs["metallic"], inputs["roughness"]
        assert isinstance(metal, float)
        assert isinstance(rough, Formula)
        coordinate = rough.inputs["c"]
        assert isinstance(coordinate, tuple)
        bsdf, wo = look_bsdf(look, Seen(0.6)), direction(0.6)
        values = {"roughness": 0.6 * metal * coordinate[0], "metallic": metal, "baseColor": (0.18, 0.6, 0.9)}
        plain = Look("plain", (Layer("Under", "disney"), Layer("Base", "disney", values, 0.6)))
        wi = np.array([-0.5, 0.2, np.sqrt(0.71)])
        np.testing.assert_allclose(evaluate(bsdf, wo, wi), evaluate(look_bsdf(plain, Seen(1.0)), wo, wi), rtol=1e-12)
    assert len(constant_looks(LOOK, 3, np.random.default_rng(3))) == 1
