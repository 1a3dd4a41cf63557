"""Frames of Mitsuba against the float64 reference: every lobe of every model, textures, bounces, and transmission."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import pytest
from agreement import SHAPES, assert_agreement, assert_mesh_agreement
from frames import RenderScene
from looks import LOOKS, quick_among
from painted import embossed, painted, sparkling

from lookdev.asset import load_asset
from lookdev.scene import Pose

pytestmark = pytest.mark.mitsuba

REFLECTING = ("diffuse", "cloth", "coated", "brushed", "polished", "painted", "chrome")
TRANSMITTING = ("leaf", "frosted", "tilted", "lacquered", "mixed")
# In this pose the sun of `sunset` is behind the asset.
BACKLIT = Pose(30.0, 126.0)


@pytest.mark.parametrize(
    ("light", "name"),
    quick_among(
        [*product(("studio", "city"), REFLECTING), ("white", "diffuse")],
        [("studio", "coated"), ("city", "brushed"), ("city", "painted"), ("studio", "chrome"), ("white", "diffuse")],
    ),
)
def test_spheres_agree(name: str, light: str, render: RenderScene, light_of) -> None:
    # With few samples, the noise at the edge of a mirrored lamp is two-valued, not Student's.
    samples = 128 if name in ("polished", "chrome", "coated") else 32
    frames = [render("sphere", LOOKS[name], light_of(light), samples=samples, seed=seed) for seed in range(8)]
    assert_agreement(frames, LOOKS[name], "sphere", light_of(light))


@pytest.mark.parametrize(
    ("asset", "name"), quick_among(list(product(SHAPES, TRANSMITTING)), [("plane", "tilted"), ("sphere", "leaf")])
)
def test_backlit_shapes_agree(asset: str, name: str, render: RenderScene, light_of) -> None:
    light = light_of("sunset")
    frames = [render(asset, LOOKS[name], light, samples=64, seed=seed, pose=BACKLIT, bounces=3) for seed in range(8)]
    assert_agreement(frames, LOOKS[name], asset, light, BACKLIT, bounces=3 if asset == "sphere" else 0)


@pytest.mark.parametrize(
    ("name", "look"),
    [
        ("suzanne", painted),
        pytest.param("shaderball", embossed, marks=pytest.mark.slow),
        pytest.param("suzanne", sparkling, marks=pytest.mark.slow),
    ],
)
def test_meshes_agree(name: str, look, render: RenderScene, light_of, tmp_path: Path) -> None:
    asset, light, layers = load_asset(builtin=name), light_of("city"), look(tmp_path)
    frames = [render(asset, layers, light, samples=32, seed=seed, bounces=2) for seed in range(6)]
    found = assert_mesh_agreement(frames, asset, layers, light, samples=32, bounces=2)
    assert found.figures["bias_limit"] < 0.05
