"""Frames of nodes that sample the model exactly against the float64 reference: a sphere, and a mesh with bounces.

No light is sampled: where most of it comes from a small lamp, the noise of the few samples that find it is not
Student's. Hence white light and one that changes slowly from direction to direction.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from agreement import assert_agreement, check_mesh, relative_difference
from conftest import POSE, orbit_camera
from looks import LOOKS

from lookdev.asset import Asset, load_asset
from lookdev.checks.finding import Finding
from lookdev.light import Dome
from lookdev.material import Coordinates, Formula, Layer, Look
from lookdev.material.expression import parse
from lookdev.render.scene import scene_task
from lookdev.render.task import one_frame
from lookdev.render.worker import Rendered, Worker
from lookdev.scene import Sampling, Scene

pytestmark = pytest.mark.cycles

SIZE, SEEDS = 48, 8


def frames(
    worker: Worker, asset: Asset, layers: Sequence[Layer], light: Dome, *, samples: int, bounces: int
) -> list[Rendered]:
    worker.start()
    look = Look("look", tuple(layers))
    shown = Scene.of_look(asset, look, light, (SIZE, SIZE), orbit_camera(asset.center, asset.radius))
    scene = scene_task(shown, Sampling(samples, bounces=bounces), "nodes-exact")
    return [worker.render(one_frame(scene, POSE, str(seed), seed=seed), lambda progress: None) for seed in range(SEEDS)]


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


@pytest.mark.parametrize(
    ("ibl", "look", "bounces"), [pytest.param(*case, marks=() if case in QUICK else pytest.mark.slow) for case in ALL]
)
def test_a_sphere_agrees_within_its_own_noise(ibl: str, look: str, bounces: int, worker: Worker, light_of) -> None:
    light, samples = light_of(ibl), 128
    rendered = frames(worker, load_asset(builtin="sphere"), LOOKS[look], light, samples=samples, bounces=bounces)
    # The background is black and wholly transparent, though the world is there for rays of portals.
    assert not rendered[0].a[rendered[0].alpha == 0.0].any()
    assert rendered[0].alpha[SIZE // 2, SIZE // 2] == 1.0
    assert_agreement(rendered, LOOKS[look], "sphere", light, bounces=bounces)


@pytest.mark.slow
@pytest.mark.parametrize("look", ["polished", "chrome"])
def test_a_shiny_sphere_agrees(look: str, worker: Worker, light_of) -> None:
    rendered = frames(worker, load_asset(builtin="sphere"), LOOKS[look], light_of("slopes"), samples=128, bounces=0)
    difference = relative_difference(rendered, LOOKS[look], light_of("slopes"))
    # Their noise is smaller than the rounding of a direction near the map's pole to float32. On average over 300
    # pixels, each known to 2e-3, they agree to three times the error that is left.
    assert np.abs(difference.mean(axis=0)).max() < 4e-4
    assert np.abs(difference).max() < 2e-2


@pytest.mark.parametrize(("name", "bounces"), [("shaderball", 2), pytest.param("suzanne", 1, marks=pytest.mark.slow)])
def test_a_mesh_agrees_with_its_bounces(name: str, bounces: int, worker: Worker, light_of) -> None:
    light, asset = light_of("white"), load_asset(builtin=name)
    wave = parse("0.3 + 0.5 * smoothstep(8 * st[0] - floor(8 * st[0]), 0.4, 0.6)")
    stripes = Formula(wave, {"st": Coordinates("st")}, {"st": "color"})
    layers = (Layer("Striped", "disney", {"baseColor": stripes, "roughness": 0.6, "normal": (0.2, 0.3, 0.9)}),)
    rendered = frames(worker, asset, layers, light, samples=128, bounces=bounces)

    def agreement(bounces: int) -> Finding:
        return check_mesh(rendered, asset, layers, light, samples=128, bounces=bounces)

    found = agreement(bounces)
    assert found.passed, "\n".join((found.summary, *found.details))
    # Without its indirect light the frame is another.
    assert not agreement(0).passed
