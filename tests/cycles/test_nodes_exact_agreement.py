"""Frames of nodes that sample the model exactly against the float64 reference: a sphere, and a mesh with bounces.

No light is sampled: where most of it comes from a small lamp, the noise of the few samples that find it is not
Student's. Hence white light and one that changes slowly from direction to direction.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from agreement import assert_agreement, assert_mesh_agreement, relative_difference
from frames import RenderScene
from looks import LOOKS, quick_among

from lookdev.asset import load_asset
from lookdev.light import Dome
from lookdev.material import Coordinates, Formula, Layer
from lookdev.material.expression import parse
from lookdev.render.results import Rendered

pytestmark = pytest.mark.cycles

SIZE, SEEDS = 48, 8


def frames(
    render: RenderScene, which: str, layers: Sequence[Layer], light: Dome, samples: int, bounces: int
) -> list[Rendered]:
    options = {"backend": "nodes-exact", "samples": samples, "size": SIZE, "bounces": bounces}
    return [render(which, layers, light, seed=seed, **options) for seed in range(SEEDS)]


QUICK = [("slopes", "coated", 0)]
ALL = [
    *QUICK,
    ("white", "leaf", 2),
    ("white", "cloth", 0),
    ("white", "painted", 0),
    ("white", "tilted", 2),
    ("white", "frosted", 2),
    ("slopes", "diffuse", 0),
    ("white", "diffuse", 0),
    ("slopes", "brushed", 0),
    ("slopes", "frosted", 2),
    ("slopes", "lacquered", 2),
    ("slopes", "mixed", 2),
]


@pytest.mark.parametrize(("ibl", "look", "bounces"), quick_among(ALL, QUICK))
def test_a_sphere_agrees_within_its_own_noise(ibl: str, look: str, bounces: int, render: RenderScene, light_of) -> None:
    light = light_of(ibl)
    rendered = frames(render, "sphere", LOOKS[look], light, 128, bounces)
    # The background is black and transparent, though rays of portals see the world.
    assert not rendered[0].a[rendered[0].alpha == 0.0].any()
    assert rendered[0].alpha[SIZE // 2, SIZE // 2] == 1.0
    assert_agreement(rendered, LOOKS[look], "sphere", light, bounces=bounces)


@pytest.mark.proof
@pytest.mark.parametrize("look", ["polished", "chrome"])
def test_a_shiny_sphere_agrees(look: str, render: RenderScene, light_of) -> None:
    rendered = frames(render, "sphere", LOOKS[look], light_of("slopes"), 128, 0)
    difference = relative_difference(rendered, LOOKS[look], light_of("slopes"))
    # Their noise is smaller than the rounding of a direction near the map's pole to float32. On average over 300
    # pixels, each known to 2e-3, they agree to three times the error that is left.
    assert np.abs(difference.mean(axis=0)).max() < 4e-4
    assert np.abs(difference).max() < 2e-2


@pytest.mark.parametrize(("name", "bounces"), [("shaderball", 2), pytest.param("suzanne", 1, marks=pytest.mark.proof)])
def test_a_mesh_agrees_with_its_bounces(name: str, bounces: int, render: RenderScene, light_of) -> None:
    light, asset = light_of("white"), load_asset(builtin=name)
    wave = parse("0.3 + 0.5 * smoothstep(8 * st[0] - floor(8 * st[0]), 0.4, 0.6)")
    stripes = Formula(wave, {"st": Coordinates("st")}, {"st": "color"})
    layers = (Layer("Striped", "disney", {"baseColor": stripes, "roughness": 0.6, "normal": (0.2, 0.3, 0.9)}),)
    rendered = frames(render, name, layers, light, 128, bounces)
    assert_mesh_agreement(rendered, asset, layers, light, samples=128, bounces=bounces)
