"""Frames of Mitsuba under every kind of light and control against the float64 reference."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from agreement import assert_scene_agreement, check_scene
from frames import POSE, scene_of
from light_rigs import RIG_LOOKS, RIGS, row_of_three
from looks import LOOKS
from mitsuba_scenes import RenderSeeds, assert_parts_agree, heads_under_lights, scene_with_look

from lookdev.asset import load_asset
from lookdev.errors import CodegenError
from lookdev.light import DiskLight, Emission, RectLight, Shaping, SphereLight
from lookdev.light.emission import Falloff
from lookdev.material import Look
from lookdev.material.change import constant_named, look_with_live_inputs
from lookdev.rendering.adaptive import Region
from lookdev.rendering.derivatives import DerivativeTask, live_inputs
from lookdev.rendering.scene import scene_task
from lookdev.scene import Pose, Sampling, Scene

pytestmark = pytest.mark.mitsuba

SIZE, SAMPLES, SEEDS = 32, 64, 4
ALIKE, TURNED = Pose(0.0, 0.0), Pose(20.0, 70.0)
OPTIONS = {"bounces": 1, "samples": 128}


def test_each_kind_of_light_and_control_agrees(render_seeds: RenderSeeds, stored_reference, tmp_path: Path) -> None:
    """Each light reaches one head alone."""
    scene = heads_under_lights(tmp_path, 16)
    frames = render_seeds(scene, ALIKE, SEEDS, samples=SAMPLES, bounces=1)
    options = {"count": 350, **OPTIONS}
    assert_parts_agree("heads under lights", frames, scene, ALIKE, SAMPLES, stored_reference, **options)


def test_a_rig_of_lamps_and_domes_agrees(render_seeds: RenderSeeds, light_of, stored_reference) -> None:
    """Lamps that turn and one that does not, a beam, a falloff, two domes with their own axes, and transmission."""
    shaped = Emission((4.0, 3.0, 2.0), shaping=Shaping(60.0, 0.5, focus=2.0), falloff=Falloff(0.2, 1.5, 2.0, 6.0))
    sphere = replace(SphereLight.example(), emission=shaped)
    still = replace(DiskLight.example(), emission=replace(DiskLight.example().emission, turns=False))
    leaning = ((1.0, 0.0, 0.0), (0.0, 0.8, 0.6), (0.0, -0.6, 0.8))
    dome = replace(light_of("slopes"), axes=leaning, emission=Emission((0.4, 0.3, 0.5)))
    white = replace(light_of("white"), emission=Emission((0.1, 0.2, 0.1)))
    scene = scene_with_look("suzanne", LOOKS["leaf"], RectLight.example(), sphere, dome, still, white)
    frames = render_seeds(scene, POSE, 6, samples=64, bounces=2)
    options = {"count": 120, "bounces": 2, "samples": 128}
    assert_scene_agreement("rig of lamps and domes", frames, scene, 64, stored_reference, **options)


@pytest.mark.proof
@pytest.mark.parametrize("look", RIG_LOOKS)
@pytest.mark.parametrize("asset", ["sphere", "suzanne"])
@pytest.mark.parametrize("rig", RIGS)
def test_rigs_agree(render_seeds: RenderSeeds, tmp_path: Path, rig: str, asset: str, look: str) -> None:
    if rig == "shadow" and look == "leaf" and asset == "suzanne":
        pytest.skip("a look that can be seen through takes plain shadows alone")
    scene = scene_with_look(asset, (RIG_LOOKS[look],), *RIGS[rig](tmp_path), size=SIZE)
    frames = render_seeds(scene, TURNED, SEEDS, samples=SAMPLES, bounces=1)
    assert_scene_agreement(f"{rig} {look}", frames, scene, SAMPLES, pose=TURNED, **OPTIONS)


def test_linked_shadows_are_cast_by_their_parts_alone(render_seeds: RenderSeeds, stored_reference) -> None:
    scene = row_of_three(SIZE)
    frames = render_seeds(scene, TURNED, SEEDS, samples=SAMPLES, bounces=1)
    options = {"pose": TURNED, **OPTIONS}
    assert_scene_agreement("linked shadows", frames, scene, SAMPLES, stored_reference, **options)
    paths, (first, *others) = [slot.path for slot in scene.asset.slots], scene.slot_groups
    shifted = replace(scene, groups=dict(zip(paths, (*others, first), strict=True)))
    assert not check_scene("shifted shadows", frames, shifted, SAMPLES, stored_reference, **options).passed


@pytest.mark.parametrize(
    "make_scene",
    [
        lambda folder: heads_under_lights(folder, SIZE, ("controls",)),
        pytest.param(lambda folder: heads_under_lights(folder, SIZE, ("disk", "images")), marks=pytest.mark.proof),
        pytest.param(lambda folder: row_of_three(SIZE), marks=pytest.mark.proof),
    ],
    ids=["controls", "images", "shadow links"],
)
def test_pictures_with_derivatives_are_lit_as_frames(
    drjit: Any, tmp_path: Path, make_scene: Callable[[Path], Scene]
) -> None:
    """Both follow the same paths, except for a few that rounding separates."""
    from lookdev.mitsuba.derivatives import DerivativeScene
    from lookdev.mitsuba.load import load_mitsuba
    from lookdev.mitsuba.render import MitsubaScene
    from lookdev.mitsuba.view import FramePart, KernelView

    mi, scene, samples = load_mitsuba("cpu"), make_scene(tmp_path), 16
    (plain,) = {id(look): look for look in scene.looks}.values()
    live = look_with_live_inputs(plain, {"0": constant_named(plain, "roughness")})
    task = scene_task(
        replace(scene, look_of_slot=dict.fromkeys(scene.look_of_slot, live)), Sampling(bounces=1), "mitsuba"
    )
    binding = live_inputs(task)["0"]
    values = {binding.parameter: constant_named(plain, "roughness").value}
    slope_task = DerivativeTask(task, ALIKE, values, binding.symbols, samples, (7, 8), "")
    halves = DerivativeScene(mi, task).render(slope_task, lambda done, planned: None)[0]
    frames = MitsubaScene(mi, task)
    width, height = task.resolution
    view = KernelView.of(mi, task.camera, ALIKE, task.resolution, frames._geometry.center)
    rectangle = FramePart.of(mi, Region(slice(0, height), slice(0, width), samples))
    numbers = (mi.UInt32(number) for number in (7, 0, samples.bit_length() - 1))
    channels = frames._estimator.render_pixels(
        view, rectangle, drjit.arange(mi.UInt32, width * height * samples), *numbers
    )
    means = [np.array(channel).reshape(height, width, samples).mean(axis=-1) for channel in channels]
    expected = np.stack(means, axis=-1)
    np.testing.assert_array_equal(halves[0, ..., 3], expected[..., 3])
    near = np.isclose(halves[0], expected, rtol=1e-3, atol=1e-5).all(axis=-1)
    assert (expected[..., :3] > 0.01).any(axis=-1).mean() > 0.1
    assert near.mean() > 0.98
    np.testing.assert_allclose(halves[0].mean(axis=(0, 1)), expected.mean(axis=(0, 1)), rtol=5e-3)
    assert np.abs(halves[1]).max() > 0.01


@pytest.mark.parametrize("rig", [pytest.param(rig, marks=[pytest.mark.proof] * (rig == "local grey")) for rig in RIGS])
def test_rigs_light_what_they_are_to_show(tmp_path: Path, rig: str) -> None:
    """A lamp that points away would agree, as all is dark."""
    for light in RIGS[rig](tmp_path):
        rng = np.random.default_rng(1)
        places = rng.uniform(-0.9, 0.9, (400, 3))
        assert light.radiance(places, light.sample(places, rng.random((400, 2)))).any(), light.kind


def test_partial_shadows_of_what_is_seen_through_are_refused_in_words(tmp_path: Path) -> None:
    net = replace(RIG_LOOKS["leaf"], inputs={**RIG_LOOKS["leaf"].inputs, "presence": 0.5})
    scene = scene_of(load_asset(builtin="suzanne"), Look("net", (net,)), RIGS["shadow"](tmp_path), 8)
    with pytest.raises(CodegenError, match="look 'net': can be seen through, so lights whose shadows"):
        scene_task(scene, Sampling(), "mitsuba")
