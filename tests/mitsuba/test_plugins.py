"""BSDFs for scenes of Mitsuba's users: values, sampling, gradients, and light that stock plug-ins carry."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from looks import quick_among

from lookdev.brdf import CONTINUOUS_MODELS, MODELS, complete_parameters, evaluate_cosine, pdf

pytestmark = pytest.mark.mitsuba

MATERIALS = Path(__file__).parents[2] / "materials"
SETTINGS: dict[str, dict[str, Any]] = {
    "disney": {"baseColor": [0.6, 0.3, 0.1], "roughness": 0.4, "metallic": 0.3, "clearcoat": 0.6, "anisotropic": 0.5},
    "pixar": {"roughness": 0.3},
    "ward": {"alphaX": 0.5, "alphaY": 0.3},
    "oren-nayar": {},
    "torrance-sparrow": {},
}
LOOKS = ("leaf", "car_paint", "lacquer_wood", "frosted_plastic")
COUNT = 500


@pytest.fixture(scope="module")
def mi(drjit: Any) -> Any:
    import mitsuba

    import lookdev.mitsuba  # noqa: F401

    mitsuba.set_variant("llvm_ad_rgb")
    return mitsuba


def plugin(mi: Any, model: str, **inputs: Any) -> Any:
    return mi.load_dict({"type": f"lookdev_{model.replace('-', '_')}", **inputs})


def interaction(mi: Any, wi: np.ndarray) -> Any:
    """Return interactions in the plane z = 0 with the world's axes as their frame, seen along directions."""
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*wi.T.astype(np.float32))
    si.sh_frame = mi.Frame3f(mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0), mi.Vector3f(0, 0, 1))
    si.n, si.dp_du, si.dp_dv = mi.Normal3f(0, 0, 1), mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0)
    si.uv = mi.Point2f(0.3, 0.6)
    return si


def random_directions() -> tuple[np.ndarray, np.ndarray]:
    directions = np.random.default_rng(3).normal(size=(2, COUNT, 3))
    directions[..., 2] = np.abs(directions[..., 2]) + 0.05
    wo, wi = (directions / np.linalg.norm(directions, axis=-1, keepdims=True)).astype(np.float32).astype(float)
    return wo, wi


def test_every_continuous_model_is_a_plugin(mi: Any) -> None:
    for model in CONTINUOUS_MODELS:
        if model != "measured":  # needs a file
            assert "LookBSDF" in str(plugin(mi, model))


@pytest.mark.parametrize("model", SETTINGS)
def test_a_plugin_agrees_with_its_model(model: str, mi: Any) -> None:
    wo, wi = random_directions()
    arrays = {name: np.asarray(value, float) for name, value in SETTINGS[model].items()}
    bsdf = MODELS[model].bsdf(complete_parameters(model, arrays))
    values, density = plugin(mi, model, **SETTINGS[model]).eval_pdf(
        mi.BSDFContext(), interaction(mi, wo), mi.Vector3f(*wi.T.astype(np.float32)), True
    )
    expected = evaluate_cosine(bsdf, wo, wi)
    scale = np.maximum(np.abs(expected), 1e-3)
    assert np.quantile(np.abs(np.array(values).T - expected) / scale, 0.99) < 2e-4
    np.testing.assert_allclose(np.array(density), pdf(bsdf, wo, wi), rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("model", SETTINGS)
def test_samples_follow_their_pdf(model: str, mi: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # where a failing test writes its histogram
    from mitsuba.chi2 import BSDFAdapter, ChiSquareTest, SphericalDomain

    inputs = "".join(
        f'<rgb name="{name}" value="{" ".join(map(str, value))}"/>'
        if isinstance(value, list)
        else f'<float name="{name}" value="{value}"/>'
        for name, value in SETTINGS[model].items()
    )
    name = f"lookdev_{model.replace('-', '_')}"
    sample, density = BSDFAdapter(name, inputs, wi=[0.5, 0.2, 0.84])
    test = ChiSquareTest(SphericalDomain(), sample, density, sample_dim=3, sample_count=200_000, res=60, ires=8)
    assert test.run(0.01, len(SETTINGS)), test.messages


@pytest.mark.parametrize("name", quick_among([(name,) for name in LOOKS], [("leaf",)]))
def test_a_look_of_a_file_weighs_its_samples_rightly(name: str, mi: Any) -> None:
    """Weights are value over pdf, on both sides; light through a leaf's holes is unchanged."""
    import drjit as dr

    bsdf = mi.load_dict({"type": "lookdev_look", "file": str(MATERIALS / f"{name}.usda")})
    wo, _ = random_directions()
    wo[::3, 2] *= -1.0
    si = interaction(mi, wo)
    rng = np.random.default_rng(1)
    u = [mi.Float(numbers) for numbers in rng.random((3, COUNT)).astype(np.float32)]
    sample, weight = bsdf.sample(mi.BSDFContext(), si, u[0], mi.Point2f(u[1], u[2]), True)
    value, density = bsdf.eval_pdf(mi.BSDFContext(), si, sample.wo, True)
    passed = np.array(sample.sampled_type) == int(+mi.BSDFFlags.Null)
    evaluated = ~passed & (np.array(density) > 0.0)
    assert evaluated.sum() > COUNT // 4
    expected = np.array(value / dr.maximum(density, 1e-20)).T
    np.testing.assert_allclose(np.array(weight).T[evaluated], expected[evaluated], rtol=1e-3, atol=1e-5)
    np.testing.assert_allclose(np.array(sample.pdf)[evaluated], np.array(density)[evaluated], rtol=1e-3)
    assert (np.array(sample.wo).T[passed] == -wo[passed].astype(np.float32)).all()
    np.testing.assert_allclose(np.array(weight).T[passed], 1.0, rtol=1e-6)


def test_gradients_are_those_of_differences(mi: Any) -> None:
    import drjit as dr

    bsdf = plugin(mi, "disney", **SETTINGS["disney"])
    parameters = mi.traverse(bsdf)
    wo, wi = random_directions()

    def total(value: float) -> Any:
        parameters["roughness"] = mi.Float(value)
        dr.enable_grad(parameters["roughness"])
        parameters.update()
        values = bsdf.eval(mi.BSDFContext(), interaction(mi, wo), mi.Vector3f(*wi.T.astype(np.float32)), True)
        return dr.mean(dr.mean(values))

    loss = total(0.4)
    dr.backward(loss)
    slope = float(np.array(dr.grad(parameters["roughness"]))[0])
    high, low = (float(np.array(dr.detach(total(0.4 + h)))[0]) for h in (0.003, -0.003))
    assert slope == pytest.approx((high - low) / 0.006, rel=2e-3)


def test_what_is_wrong_is_said(mi: Any) -> None:
    with pytest.raises(RuntimeError, match="no parameter 'roughnes'; it has: baseColor"):
        plugin(mi, "disney", roughnes=0.3)
    with pytest.raises(RuntimeError, match=r"roughness is 3\.0; its range is 0 to 1"):
        plugin(mi, "disney", roughness=3.0)
    with pytest.raises(RuntimeError, match="no 'file'"):
        mi.load_dict({"type": "lookdev_look"})
    with pytest.raises(RuntimeError, match="scatters along single directions"):
        mi.load_dict({"type": "lookdev_look", "file": str(MATERIALS / "classic" / "mirror.usda")})


def test_a_texture_of_mitsuba_feeds_a_parameter(mi: Any) -> None:
    texture = {"type": "checkerboard", "color0": 0.2, "color1": 0.7}
    bsdf = plugin(mi, "disney", roughness=texture)
    wo, wi = random_directions()
    direction = mi.Vector3f(*wi.T.astype(np.float32))
    values = np.array(bsdf.eval(mi.BSDFContext(), interaction(mi, wo), direction, True))
    plain = [plugin(mi, "disney", roughness=value) for value in (0.2, 0.7)]
    either = [np.array(bsdf.eval(mi.BSDFContext(), interaction(mi, wo), direction, True)) for bsdf in plain]
    assert any(np.allclose(values, expected, rtol=1e-4, atol=1e-7) for expected in either)
    assert not np.allclose(*either)
