"""Light from behind: a thin card and a closed shell between the camera and the sun of `sunset`, against the reference.

Through the shell light comes by way of the wall that faces away, and is reflected inside; through the card directly.
"""

from __future__ import annotations

from itertools import product

import pytest
from agreement import assert_agreement
from conftest import RenderScene
from looks import LOOKS

from lookdev.reference.shapes import Plane, Shape, Sphere
from lookdev.scene import Pose

pytestmark = pytest.mark.cycles

SIZE, SEEDS, BOUNCES = 48, 8, 3
# Of the glassy look's directions one in twenty is reflected: of few samples either one or two, which is not a normal
# distribution. With less noise in the frames, that of the reference must be known better too.
SAMPLES, SCRAMBLES = {"glassy": 256}, {"glassy": 16}
# A lamp seen through a hole from inside is found by scattered directions only: of the sun they make fireflies, in the
# frames and in the reference, whose spread says nothing.
LIGHTS = {("sphere", "net"): "white"}
# The sun stands 3 degrees above the horizon, at an azimuth of -36 degrees; turned so, it is behind the asset.
POSE = Pose(30.0, 126.0)

SHAPES: dict[str, tuple[Shape, float]] = {"plane": (Plane(), 2.0**0.5), "sphere": (Sphere(), 1.0)}
QUICK = [("plane", "tilted"), ("sphere", "leaf")]
ALL = list(product(SHAPES, ("leaf", "frosted", "glassy", "net", "tilted", "lacquered", "mixed")))


@pytest.mark.parametrize(
    ("asset", "look"),
    [pytest.param(*case, marks=() if case in QUICK else pytest.mark.slow) for case in ALL],
)
def test_backlit_shapes_agree_within_their_own_noise(asset: str, look: str, render: RenderScene, light_of) -> None:
    light = light_of(LIGHTS.get((asset, look), "sunset"))
    shape, radius = SHAPES[asset]
    samples, bounces = SAMPLES.get(look, 32), BOUNCES if asset == "sphere" else 0
    frames = [
        render(asset, LOOKS[look], light, samples=samples, seed=seed, size=SIZE, pose=POSE, bounces=BOUNCES)
        for seed in range(SEEDS)
    ]
    scrambles = SCRAMBLES.get(look, 4)
    assert_agreement(frames, LOOKS[look], shape, radius, light, POSE, bounces=bounces, scrambles=scrambles)


@pytest.mark.parametrize(("asset", "ibl_samples"), [("plane", 1), pytest.param("sphere", 2, marks=pytest.mark.slow)])
def test_light_from_behind_without_directions_of_its_own(
    asset: str, ibl_samples: int, render: RenderScene, light_of
) -> None:
    """Of one direction none is for the back, of two none after a bounce: there the lobes must find light themselves."""
    light, (shape, radius) = light_of("slopes"), SHAPES[asset]
    bounces = BOUNCES if asset == "sphere" else 0
    frames = [
        render(
            asset, LOOKS["leaf"], light, samples=64, seed=seed, size=SIZE, pose=POSE, bounces=BOUNCES,
            ibl_samples=ibl_samples,
        )
        for seed in range(SEEDS)
    ]  # fmt: skip
    assert_agreement(frames, LOOKS["leaf"], shape, radius, light, POSE, bounces=bounces, scrambles=4)
