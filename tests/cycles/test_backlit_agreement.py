"""Light from behind: a thin card and a closed shell between the camera and the sun of `sunset`, against the reference.

Through the shell light comes by way of the wall that faces away, and is reflected inside; through the card directly.
"""

from __future__ import annotations

from itertools import product

import pytest
from agreement import SHAPES, assert_agreement
from frames import RenderScene
from looks import LOOKS, quick_among

from lookdev.light import Dome
from lookdev.scene import Pose

pytestmark = pytest.mark.cycles

SIZE, SEEDS, BOUNCES = 48, 8, 3
# One in twenty of the glassy look's directions is reflected: one or two of few samples, which is not a normal
# distribution. With less noise in the frames, the reference needs less too.
SAMPLES, SCRAMBLES = {"glassy": 256}, {"glassy": 16}
# Only scattered directions find a lamp through a hole from inside: the sun makes fireflies, in the frames and in the
# reference, whose spread is no estimate.
LIGHTS = {("sphere", "net"): "white"}
# The sun is 3 degrees above the horizon, at an azimuth of -36 degrees; in this pose it is behind the asset.
POSE = Pose(30.0, 126.0)

QUICK = [("plane", "tilted"), ("sphere", "leaf")]
ALL = list(product(SHAPES, ("leaf", "frosted", "glassy", "net", "tilted", "lacquered", "mixed")))


@pytest.mark.parametrize(("asset", "look"), quick_among(ALL, QUICK))
def test_backlit_shapes_agree_within_their_own_noise(asset: str, look: str, render: RenderScene, light_of) -> None:
    light = light_of(LIGHTS.get((asset, look), "sunset"))
    assert_backlit(render, asset, look, light, SAMPLES.get(look, 32), SCRAMBLES.get(look, 4))


@pytest.mark.parametrize(("asset", "ibl_samples"), [("plane", 1), pytest.param("sphere", 2, marks=pytest.mark.proof)])
def test_light_from_behind_without_directions_of_its_own(
    asset: str, ibl_samples: int, render: RenderScene, light_of
) -> None:
    """Of one direction none is for the back, of two none after a bounce: transmitting lobes are not light-sampled."""
    assert_backlit(render, asset, "leaf", light_of("slopes"), 64, 4, ibl_samples=ibl_samples)


def assert_backlit(
    render: RenderScene, asset: str, look: str, light: Dome, samples: int, scrambles: int, **options: int
) -> None:
    options |= {"samples": samples, "size": SIZE, "bounces": BOUNCES}
    frames = [render(asset, LOOKS[look], light, seed=seed, pose=POSE, **options) for seed in range(SEEDS)]
    bounces = BOUNCES if asset == "sphere" else 0
    assert_agreement(frames, LOOKS[look], asset, light, POSE, bounces=bounces, scrambles=scrambles)
