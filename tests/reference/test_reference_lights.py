"""The reference renderer under several lights, of finite size, and with shadows that are not physical."""

from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import diffuse_scenes
import numpy as np
import pytest
from diffuse_scenes import SIGMAS, dome, lambert
from shapes import CAMERA, INSIDE, SIZE, Plane, Sphere

from lookdev.light import DistantLight, Emission, RectLight, Shadow, SphereLight
from lookdev.light.mapping import rotate_z
from lookdev.scene import Pose, camera_rays

POSE = Pose(0.0, 0.0)
GREY = lambert(0.5)
FACING = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))  # emits along +y
estimate = partial(diffuse_scenes.estimate, pose=POSE)


@dataclass(frozen=True)
class Roofed(Plane):
    """A card with a larger, invisible card in front of it, at y = -1, that occludes it."""

    def trace_onward(self, hits, direction):
        before = direction[:, 1] < 0.0
        distance = -1.0 / np.where(before, direction[:, 1], -1.0)
        points = hits + distance[:, None] * direction
        return before & (np.abs(points[:, [0, 2]]) < 3.0).all(axis=-1), points


def assert_agree(got, expected) -> None:
    error = np.hypot(got.error, expected.error)
    assert (np.abs(got.value - expected.value) <= SIGMAS * error).all()
    assert (error < 0.01 * expected.value.max()).all()


def small_light(y: float, **emission) -> SphereLight:
    return SphereLight(radius=0.2, position=(0.1, y, 0.2), emission=Emission((3.0, 2.0, 1.0), **emission))


def test_a_card_under_a_rectangle_has_its_irradiance() -> None:
    light = RectLight(width=1.0, height=0.5, position=(0.4, -1.5, 0.3), axes=FACING)
    got = estimate(GREY, Plane(), light, samples=1024)
    for pixel, value, error in zip(INSIDE, got.value, got.error, strict=True):
        steps = (np.arange(3) + 0.5) / 3.0
        x, y = (values.ravel() for values in np.meshgrid(*(pixel[:, None] + steps)))
        _, point = Plane().intersect(*camera_rays(CAMERA, POSE, SIZE, x, y, np.empty((9, 0))))
        # Over the area of the light, whose normal is the card's: cosine^2 / distance^2.
        across, up = np.meshgrid((np.arange(200) + 0.5) / 200 - 0.5, (np.arange(100) + 0.5) / 200 - 0.25)
        surface = np.stack([0.4 + across, np.full_like(across, -1.5), 0.3 + up], axis=-1).reshape(-1, 3)
        squared = ((surface - point[:, None]) ** 2).sum(axis=-1)
        expected = 0.5 / np.pi * (1.5**2 / squared**2).mean() * light.size_factor
        assert (np.abs(value - expected) < SIGMAS * error + 1e-3 * expected).all()


@pytest.mark.parametrize(("shape", "bounces"), [(Sphere(), 2), (Roofed(), 0)])
def test_several_lights_are_the_sum_of_each(shape, bounces: int) -> None:
    rng = np.random.default_rng(5)
    lights = [
        dome(rng.uniform(size=(8, 16, 3)) ** 4),
        small_light(-1.6),
        RectLight(width=2.0, height=1.0, position=(0.5, -2.5, 1.0), axes=FACING, emission=Emission((1.0, 2.0, 5.0))),
    ]
    render = partial(estimate, lambert(0.4, 0.4), shape, pose=Pose(30.0, 75.0), bounces=bounces)
    together, alone = render(*lights), [render(light, seed=1 + number) for number, light in enumerate(lights)]
    error = np.sqrt(together.error**2 + sum(single.error**2 for single in alone))
    assert (np.abs(together.value - sum(single.value for single in alone)) < SIGMAS * error).all()
    assert (error < 0.03 * together.value).all()


def test_a_light_is_occluded_only_by_what_lies_before_it() -> None:
    before, behind = small_light(-0.6), small_light(-2.0)
    roofed, uncovered = (estimate(GREY, shape, before).value for shape in (Roofed(), Plane()))
    np.testing.assert_allclose(roofed, uncovered, rtol=1e-12)
    assert (uncovered > 1e-3).all()
    for light in (behind, DistantLight(angle=5.0, axes=FACING)):
        assert (estimate(GREY, Roofed(), light).value == 0.0).all()
        assert (estimate(GREY, Plane(), light).value > 1e-4).all()


@pytest.mark.parametrize(
    ("shadow", "share"),
    [
        (Shadow(enable=False), (1.0, 1.0, 1.0)),
        (Shadow(color=(0.5, 0.25, 0.0)), (0.5, 0.25, 0.0)),
        (Shadow(distance=0.9), (1.0, 1.0, 1.0)),
        (Shadow(distance=9.0, falloff=1.0), (0.0, 0.0, 0.0)),
    ],
)
def test_a_shadow_is_as_dark_as_the_light_wants(shadow: Shadow, share: tuple[float, ...]) -> None:
    unshadowed = estimate(GREY, Plane(), small_light(-2.0))
    shadowed = estimate(GREY, Roofed(), small_light(-2.0, shadow=shadow))
    np.testing.assert_allclose(shadowed.value, unshadowed.value * np.array(share), rtol=1e-12)


@pytest.mark.parametrize("presence", [0.3, 1.0])
def test_light_that_casts_no_shadow_is_counted_once_behind_holes(presence: float) -> None:
    """In a furnace, a shaded point receives all light directly, so no more may reach it through a hole.

    A path from the camera continues inside by half of the presence, and to the wall behind by the absent share.
    """
    unshadowed = replace(dome(np.ones((1, 1, 3))), emission=Emission(shadow=Shadow(enable=False)))
    for bounces, expected in ((0, presence), (1, presence + 0.5 * presence**2 + (1.0 - presence) * presence)):
        got = estimate(lambert(0.5, 0.5, presence), Sphere(), unshadowed, bounces=bounces)
        assert (np.abs(got.value - expected) < SIGMAS * got.error + 1e-9).all()
        assert (got.error < 0.02).all()


@pytest.mark.parametrize("turns", [True, False])
def test_the_rig_turns_but_for_what_stays(turns: bool) -> None:
    light = small_light(-1.6, turns=turns)
    position = rotate_z(light.position, 40.0 if turns else 0.0)
    render = partial(estimate, GREY, Sphere())
    assert_agree(render(light, pose=Pose(0.0, 40.0)), render(replace(light, position=tuple(position.tolist()))))
    # A sphere turns under both without effect.
    assert_agree(render(light, pose=Pose(25.0, 0.0)), render(light))


def test_multipliers_scale_their_response_alone() -> None:
    """The test surface is diffuse: one multiplier is a factor of the picture, the other changes nothing."""
    plain = estimate(GREY, Plane(), small_light(-2.0))
    assert (plain.value > 0.0).any()
    for diffuse, specular in ((0.25, 1.0), (1.0, 0.0), (0.0, 3.0)):
        got = estimate(GREY, Plane(), small_light(-2.0, diffuse=diffuse, specular=specular))
        np.testing.assert_allclose(got.value, diffuse * plain.value, rtol=1e-12)


def test_shadows_of_all_lights_are_independent() -> None:
    """Every choice of two lights before and behind a roof, with and without shadows."""
    lights = small_light(-0.6), small_light(-2.0)
    alone = [estimate(GREY, Plane(), light, samples=128) for light in lights]
    for (i, j), shadow in product(np.ndindex(2, 2), (Shadow(), Shadow(enable=False))):
        second = replace(lights[j], emission=replace(lights[j].emission, shadow=shadow))
        got = estimate(GREY, Roofed(), lights[i], second, samples=128)
        total = (i == 0) * alone[i].value + (j == 0 or not shadow.enable) * alone[j].value
        error = np.sqrt(got.error**2 + alone[i].error ** 2 + alone[j].error ** 2)
        assert (np.abs(got.value - total) <= SIGMAS * error + 1e-12).all(), (i, j, shadow)
