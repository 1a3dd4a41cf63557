"""Frames of a sphere and a card against the float64 reference: in front of a light, and between it and the camera.

Through a closed shell light comes by way of the wall that faces away, and is reflected inside; through a card directly.
"""

from itertools import product
from typing import Any

import numpy as np
import pytest
from agreement import SHAPES, assert_agreement, relative_difference
from frames import POSE, RenderScene
from looks import LOOKS, quick_among
from stored_references import StoredReference

from lookdev.scene import Pose

pytestmark = pytest.mark.cycles

SIZE, SEEDS, BOUNCES = 32, 8, 3
REFLECTING = ("diffuse", "cloth", "coated", "brushed", "polished", "painted", "chrome")
TRANSMITTING = ("leaf", "frosted", "glassy", "net", "tilted", "lacquered", "mixed")
# White light is not sampled, and directions of a shiny surface weigh alike but for the few below its horizon: the noise
# is two-valued, and the estimated error of a pixel without any of these is too small.
TWO_VALUED = ("coated", "polished", "chrome")
LIGHTS = ("white", "studio", "city")
FRONT = [(ibl, look) for ibl in LIGHTS for look in REFLECTING if not (ibl == "white" and look in TWO_VALUED)]
# The sun is 3 degrees above the horizon, at an azimuth of -36 degrees; in this pose it is behind the asset.
BACKLIT = Pose(30.0, 126.0)


def rendered(render: RenderScene, shape: str, look: str, light: Any, seeds: int = SEEDS, **options: Any) -> list[Any]:
    return [render(shape, LOOKS[look], light, seed=seed, size=SIZE, **options) for seed in range(seeds)]


@pytest.mark.parametrize(("ibl", "look"), quick_among(FRONT, [("studio", "coated")]))
def test_a_sphere_agrees_within_its_own_noise(
    ibl: str, look: str, render: RenderScene, light_of, stored_reference: StoredReference
) -> None:
    # With few samples, the noise at the edge of a mirrored lamp is two-valued, not Student's.
    samples = 128 if (ibl, look) == ("studio", "polished") else 32
    frames = rendered(render, "sphere", look, light_of(ibl), samples=samples)
    assert_agreement(frames, LOOKS[look], "sphere", light_of(ibl), stored=stored_reference)


@pytest.mark.proof
@pytest.mark.parametrize("look", TWO_VALUED)
def test_a_shiny_sphere_agrees_in_white_light(look: str, render: RenderScene, light_of) -> None:
    frames = rendered(render, "sphere", look, light_of("white"), 16, samples=128)
    difference = relative_difference(frames, LOOKS[look], light_of("white"))
    assert abs(difference.mean()) < 2e-4
    assert np.abs(difference).max() < 1.5e-2


@pytest.mark.proof  # by a veil on a mesh, a leaf under a rectangle, and a card without directions of its own
@pytest.mark.parametrize(("asset", "look"), list(product(SHAPES, TRANSMITTING)))
def test_backlit_shapes_agree_within_their_own_noise(asset: str, look: str, render: RenderScene, light_of) -> None:
    # Only scattered directions find a lamp through a hole from inside: the sun makes fireflies, in the frames and in
    # the reference, whose spread is no estimate.
    light = light_of("white" if (asset, look) == ("sphere", "net") else "sunset")
    # One in twenty of the glassy look's directions is reflected: one or two of few samples, which is not a normal
    # distribution. With less noise in the frames, the reference needs less too.
    samples, scrambles = (256, 16) if look == "glassy" else (32, 4)
    frames = rendered(render, asset, look, light, pose=BACKLIT, bounces=BOUNCES, samples=samples)
    options = {"bounces": BOUNCES if asset == "sphere" else 0, "scrambles": scrambles}
    assert_agreement(frames, LOOKS[look], asset, light, BACKLIT, **options)


@pytest.mark.parametrize(("asset", "ibl_samples"), [("plane", 1), pytest.param("sphere", 2, marks=pytest.mark.proof)])
def test_light_from_behind_without_directions_of_its_own(
    asset: str, ibl_samples: int, render: RenderScene, light_of, stored_reference: StoredReference
) -> None:
    """Of one direction none is for the back, of two none after a bounce: transmitting lobes are not light-sampled."""
    light, options = light_of("slopes"), {"samples": 64, "ibl_samples": ibl_samples}
    frames = rendered(render, asset, "leaf", light, pose=BACKLIT, bounces=BOUNCES, **options)
    bounces = BOUNCES if asset == "sphere" else 0
    assert_agreement(frames, LOOKS["leaf"], asset, light, BACKLIT, bounces=bounces, stored=stored_reference)


# No light is sampled by nodes that are exact: where most of it comes from a small lamp, the noise of the few samples
# that find it is not Student's. Hence white light, and one that changes slowly from direction to direction.
BY_NODES = [
    *(("white", look, 2) for look in ("leaf", "tilted", "frosted")),
    *(("white", look, 0) for look in ("cloth", "painted", "diffuse")),
    *(("slopes", look, 0) for look in ("coated", "diffuse", "brushed")),
    *(("slopes", look, 2) for look in ("frosted", "lacquered", "mixed")),
]


@pytest.mark.proof  # by the view of exact nodes on a mesh
@pytest.mark.parametrize(("ibl", "look", "bounces"), BY_NODES)
def test_a_sphere_by_exact_nodes_agrees_within_its_own_noise(
    ibl: str, look: str, bounces: int, render: RenderScene, light_of
) -> None:
    light = light_of(ibl)
    frames = rendered(render, "sphere", look, light, backend="nodes-exact", samples=128, bounces=bounces)
    # The background is black and transparent, though rays of portals see the world.
    assert not frames[0].a[frames[0].alpha == 0.0].any()
    assert frames[0].alpha[SIZE // 2, SIZE // 2] == 1.0
    assert_agreement(frames, LOOKS[look], "sphere", light, POSE, bounces=bounces)


@pytest.mark.proof
@pytest.mark.parametrize("look", ["polished", "chrome"])
def test_a_shiny_sphere_by_exact_nodes_agrees(look: str, render: RenderScene, light_of) -> None:
    light = light_of("slopes")
    frames = rendered(render, "sphere", look, light, backend="nodes-exact", samples=128, bounces=0)
    difference = relative_difference(frames, LOOKS[look], light)
    # Their noise is smaller than the rounding of a direction near the map's pole to float32. On average over 300
    # pixels, each known to 2e-3, they agree to three times the error that is left.
    assert np.abs(difference.mean(axis=0)).max() < 4e-4
    assert np.abs(difference).max() < 2e-2
