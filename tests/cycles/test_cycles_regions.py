"""A rectangle of a frame is bit for bit that part of the whole frame; rectangles bring a frame to its target."""

from collections.abc import Callable

import numpy as np
import pytest
from frames import POSE, RenderScene, orbit_camera
from looks import quick_among
from warm_blender import BlenderProcess

from lookdev.asset import load_asset
from lookdev.light import Dome
from lookdev.material import Layer, Look
from lookdev.metrics import relmse
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import frame_task
from lookdev.scene import Sampling, Scene

pytestmark = pytest.mark.cycles

COPPER = Layer("copper", "disney", {"metallic": 1.0, "roughness": 0.35})
PLASTIC = Layer("plastic", "disney", {"baseColor": (0.1, 0.2, 0.5), "roughness": 0.3})

WIDTH, HEIGHT = 67, 45
BOXES = [(0, 0, 4, 4), (WIDTH - 4, HEIGHT - 4, WIDTH, HEIGHT), (21, 16, 46, 32), (0, 16, WIDTH, 31)]


@pytest.mark.parametrize("backend", quick_among([("exact",), ("nodes-exact",), ("nodes",)], [("exact",)]))
def test_a_rectangle_is_that_part_of_the_frame(backend: str, blender: BlenderProcess, light_of) -> None:
    asset = load_asset(builtin="shaderball")
    look = Look("copper", (COPPER,))
    camera = orbit_camera(asset.center, asset.radius)
    scene = Scene.of_look(asset, look, light_of("studio"), (WIDTH, HEIGHT), camera)
    task = frame_task(scene_task(scene, Sampling(), backend), POSE, "regions")
    pictures = blender.call("probes.render_regions", task, BOXES, 4)
    for number, (left, bottom, right, top) in enumerate(BOXES):
        part = pictures[f"part{number}"]
        assert part.shape == (top - bottom, right - left, 4)
        for other in ("before", "again", "after"):
            np.testing.assert_array_equal(part, pictures[f"{other}{number}"], err_msg=f"box {number}, {other}")
    assert any(pictures[f"part{number}"][..., :3].any() for number in (0, 2)), "the boxes show nothing"


TARGET = 6e-3


def test_rectangles_bring_a_frame_to_its_target(render: RenderScene, light_of: Callable[[str], Dome]) -> None:
    def frame(**options):
        return render("shaderball", [PLASTIC], light_of("studio"), size=32, **options)

    adaptive = frame(samples=4096, error=TARGET, seed=3)
    # What else is rendered in between does not matter.
    converged = frame(samples=256, seed=1000)
    again = frame(samples=4096, error=TARGET, seed=3)
    # Rounds over the whole frame alone would end at a power of two.
    assert adaptive.samples & (adaptive.samples - 1), f"nothing was adaptive at {adaptive.samples} samples"
    for name in ("a", "b", "alpha"):
        np.testing.assert_array_equal(getattr(adaptive, name), getattr(again, name))
    assert adaptive.relmse <= TARGET
    true = relmse(0.5 * (adaptive.a + adaptive.b), 0.5 * (converged.a + converged.b), converged.alpha)
    assert 0.5 < adaptive.relmse / true < 2.0, (adaptive.relmse, true, adaptive.samples)
    # At a silhouette alpha is a mean as the colours are.
    assert np.abs(adaptive.alpha - converged.alpha)[converged.alpha > 0.0].mean() < 0.03
