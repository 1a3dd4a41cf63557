"""Lights as Cycles' own: what they send is what they send in NumPy, and frames of rigs agree with the reference."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import TypeAdapter
from scripts import run_script

from lookdev.light import (
    LIGHT_KINDS,
    AnyLight,
    DistantLight,
    Emission,
    Light,
    RectLight,
    Shaping,
    make_environment,
    prepare_texture,
)  # fmt: skip

pytestmark = pytest.mark.cycles

Floats = NDArray[np.float64]

PLACE, NORMAL = np.array([0.3, -0.2, 0.5]), np.array([0.0, -0.6, 0.8])
LEFT_HANDED = ((-1.0, 0.0, 0.0), (0.0, 0.8, 0.6), (0.0, -0.6, 0.8))
BEAM = Emission((3.0, 2.0, 1.0), shaping=Shaping(70.0, 0.6, 2.0, (0.1, 0.2, 0.3)))


def pictured() -> RectLight:
    """Return a rectangle whose texture is unlike itself mirrored and turned."""
    texels = np.random.default_rng(2).uniform(0.2, 1.0, (6, 4, 3))
    texels[:2, :2] *= 6.0
    return replace(RectLight.example(), texture=prepare_texture(make_environment("picture", texels)))


CASES: dict[str, Light] = {
    **{name: kind.example() for name, kind in LIGHT_KINDS.items() if not kind.native_gap(kind.example())},
    "texture": pictured(),
    "mirrored texture": replace(pictured(), axes=LEFT_HANDED),
    "mirrored dome": replace(LIGHT_KINDS["dome"].example(), axes=LEFT_HANDED, emission=Emission((1.0, 2.0, 0.5))),
    "sun": replace(DistantLight.example(), angle=0.53),
    "parallel": replace(DistantLight.example(), angle=0.0),
    **{
        f"shaped {name}": replace(LIGHT_KINDS[name].example(), emission=BEAM) for name in ("rect", "sphere", "cylinder")
    },
}


@pytest.fixture(scope="module")
def towards() -> Mapping[str, Floats]:
    """Return a direction to each light, well above the surface."""
    u = 0.05 + 0.9 * np.random.default_rng(3).random((64, 2))
    drawn = {name: light.sample(np.broadcast_to(PLACE, (64, 3)), u) for name, light in CASES.items()}
    return {name: wi[np.argmax(wi @ NORMAL > 0.4)] for name, wi in drawn.items()}


@pytest.fixture(scope="module")
def measured(towards: Mapping[str, Floats], tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, dict[str, Any]]:
    """Return what a diffuse square and a mirror show of each light."""
    folder = tmp_path_factory.mktemp("lamps")
    adapter: TypeAdapter[Light] = TypeAdapter(AnyLight)
    request = {
        "lights": [json.loads(adapter.dump_json(light)) for light in CASES.values()],
        "towards": [towards[name].tolist() for name in CASES],
        "place": PLACE.tolist(),
        "normal": NORMAL.tolist(),
    }
    (folder / "request.json").write_text(json.dumps(request))
    run_script("lamp_probe.py", folder / "request.json", folder / "out.npz")
    with np.load(folder / "out.npz") as stored:
        return {key: dict(zip(CASES, stored[key], strict=True)) for key in stored}


def irradiance(light: Light, cells: int = 1000) -> Floats:
    """Return the irradiance at the place by the light's directions, by the midpoint rule."""
    step = (np.arange(cells) + 0.5) / cells
    u = np.stack(np.meshgrid(step, step), axis=-1).reshape(-1, 2)
    places = np.broadcast_to(PLACE, (len(u), 3))
    wi = light.sample(places, u)
    value, pdf = light.radiance(places, wi) * np.maximum(wi @ NORMAL, 0.0)[:, None], light.pdf(places, wi)
    return np.asarray(np.divide(value, pdf[:, None], out=np.zeros_like(value), where=pdf[:, None] > 0.0).mean(axis=0))


@pytest.mark.parametrize("name", CASES)
def test_a_diffuse_surface_is_lit_alike(name: str, measured: Mapping[str, dict[str, Floats]]) -> None:
    np.testing.assert_allclose(measured["diffuse"][name], irradiance(CASES[name]), rtol=5e-3)


@pytest.mark.parametrize("name", CASES)
def test_a_mirror_shows_the_light(
    name: str, measured: Mapping[str, dict[str, Floats]], towards: Mapping[str, Floats]
) -> None:
    np.testing.assert_allclose(measured["mirror"][name], CASES[name].radiance(PLACE, towards[name]), rtol=5e-3)
