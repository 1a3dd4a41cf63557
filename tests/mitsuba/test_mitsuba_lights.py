"""Frames of Mitsuba under every kind of light and control against the float64 reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from frames import orbit_camera
from light_rigs import FACING, RIG_LOOKS, RIGS, grey, near, row_of, row_of_three

from lookdev.asset import load_asset
from lookdev.checks.finding import Finding
from lookdev.checks.images import check_frame, choose_pixels
from lookdev.errors import CodegenError
from lookdev.light import Emission, Light
from lookdev.light.link import Link
from lookdev.material import Look
from lookdev.material.change import constant_of, live_look
from lookdev.reference.mesh import MeshScene
from lookdev.reference.render import frame_pixels
from lookdev.render.adaptive import Region
from lookdev.render.scene import scene_task
from lookdev.render.slopes import SlopeTask, live_inputs
from lookdev.render.task import one_frame
from lookdev.render.worker import Worker
from lookdev.scene import Film, Pose, Sampling, Scene

pytestmark = pytest.mark.mitsuba

SIZE, SAMPLES, SEEDS = 32, 64, 4
POSE = Pose(20.0, 70.0)
QUICK = {"images": ("texture", "profile", "local_dome"), "controls": ("shadow", "response", "seen", "still")}


def compared(
    worker: Worker, scene: Scene, lit_by: tuple[tuple[int, ...], ...] | None = None, groups: tuple[int, ...] = ()
) -> tuple[Finding, Callable[..., Finding]]:
    """Render a scene, and compare it with the reference; return what compares it with that of other links, too."""
    task = scene_task(scene, Sampling(bounces=1, samples=SAMPLES), "mitsuba")
    worker.start()
    frames = [worker.render(one_frame(task, POSE, f"{n}", seed=n), lambda progress: None) for n in range(SEEDS)]
    halves = np.stack([half for frame in frames for half in (frame.a, frame.b)])
    pixels = choose_pixels(frames[0].alpha, 100, seed=1)

    def found(lit_by: tuple[tuple[int, ...], ...] | None = None, groups: tuple[int, ...] = ()) -> Finding:
        shape = MeshScene(scene.asset, scene.looks, lit_by, groups)
        size, bounces = scene.film.resolution, task.sampling.bounces
        reference = frame_pixels(shape, scene.lights, scene.camera, POSE, size, pixels, bounces=bounces, samples=256)
        return check_frame("rig", halves, frames[0].alpha, SEEDS * SAMPLES, pixels, reference)

    return found(lit_by, groups), found


def agreement(worker: Worker, asset: str, lights: tuple[Light, ...], look: str) -> Finding:
    shape = load_asset(builtin=asset)
    camera = orbit_camera(shape.center, shape.radius)
    worn = Look("look", (RIG_LOOKS[look],))
    scene = Scene(shape, {slot.path: worn for slot in shape.slots}, lights, camera, Film((SIZE, SIZE)))
    return compared(worker, scene)[0]


def assert_passed(found: Finding) -> None:
    assert found.passed, "\n".join((found.summary, *found.details))


@pytest.mark.parametrize("rigs", QUICK)
def test_every_control_of_lights_agrees(worker: Worker, tmp_path: Path, rigs: str) -> None:
    lights = tuple(light for rig in QUICK[rigs] for light in RIGS[rig](tmp_path))
    assert_passed(agreement(worker, "suzanne", lights, "plastic"))


@pytest.mark.proof
@pytest.mark.parametrize("look", RIG_LOOKS)
@pytest.mark.parametrize("asset", ["sphere", "suzanne"])
@pytest.mark.parametrize("rig", RIGS)
def test_rigs_agree(worker: Worker, tmp_path: Path, rig: str, asset: str, look: str) -> None:
    if rig == "shadow" and look == "leaf" and asset == "suzanne":
        pytest.skip("a look that can be seen through takes plain shadows alone")
    assert_passed(agreement(worker, asset, RIGS[rig](tmp_path), look))


def test_linked_lights_light_their_parts_alone(worker: Worker) -> None:
    left, right = (Link(((f"/{side}", "expandPrims"),)) for side in ("Left", "Right"))
    lights = (
        replace(near("rect"), emission=Emission((60.0, 40.0, 20.0), light_link=left)),
        replace(near("sphere"), emission=Emission((60.0, 40.0, 20.0), light_link=right)),
        grey(),
    )
    scene = row_of({"/Left": np.eye(4), "/Right": np.eye(4)}, lights, SIZE)
    agreed, found = compared(worker, scene, scene.lit_by)
    assert_passed(agreed)
    assert not found(tuple(reversed(scene.lit_by))).passed


def test_linked_shadows_are_cast_by_their_parts_alone(worker: Worker) -> None:
    scene = row_of_three(SIZE)
    agreed, found = compared(worker, scene, scene.lit_by, scene.grouped)
    assert_passed(agreed)
    assert not found(scene.lit_by, (*scene.grouped[1:], scene.grouped[0])).passed


def split_row(folder: Path) -> Scene:
    """Return linked heads under lights of controls of all kinds."""
    left = Link((("/Left", "expandPrims"),))
    controlled = [light for rig in QUICK["controls"] for light in RIGS[rig](folder)]
    lights = (*controlled, replace(near("disk"), emission=Emission((60.0, 40.0, 20.0), light_link=left)))
    return row_of({"/Left": np.eye(4), "/Right": np.eye(4)}, lights, SIZE)


def images(folder: Path) -> Scene:
    ball = load_asset(builtin="suzanne")
    lights = tuple(light for rig in QUICK["images"] for light in RIGS[rig](folder))
    looks = {slot.path: Look("look", (RIG_LOOKS["leaf"],)) for slot in ball.slots}
    return Scene(ball, looks, lights, orbit_camera(ball.center, ball.radius), Film((SIZE, SIZE)))


@pytest.mark.parametrize(
    "made", [images, split_row, lambda folder: row_of_three(SIZE)], ids=["images", "split", "linked"]
)
def test_pictures_with_derivatives_are_lit_as_frames(drjit: Any, tmp_path: Path, made: Callable[[Path], Scene]) -> None:
    """Both follow the same paths, but for the rounding by which few of them part."""
    from lookdev.mitsuba.load import load_mitsuba
    from lookdev.mitsuba.render import MitsubaScene
    from lookdev.mitsuba.slopes import SlopeScene
    from lookdev.mitsuba.view import Rectangle, View

    mi, scene, samples = load_mitsuba("cpu"), made(tmp_path), 16
    (plain,) = {id(look): look for look in scene.looks}.values()
    live = live_look(plain, {"0": constant_of(plain, "roughness")})
    task = scene_task(replace(scene, wears=dict.fromkeys(scene.wears, live)), Sampling(bounces=1), "mitsuba")
    binding = live_inputs(task)["0"]
    values = {binding.parameter: constant_of(plain, "roughness").value}
    asked = SlopeTask(task, POSE, values, binding.symbols, samples, (7, 8), "")
    found = SlopeScene(mi, task).render(asked, lambda done, of: None)[0]
    frames = MitsubaScene(mi, task)
    view = View.of(mi, task.camera, POSE, task.resolution, frames._geometry.center)
    place = Rectangle.of(mi, Region(slice(0, SIZE), slice(0, SIZE), samples))
    numbers = (mi.UInt32(each) for each in (7, 0, samples.bit_length() - 1))
    channels = frames._estimator.pixels(view, place, drjit.arange(mi.UInt32, SIZE * SIZE * samples), *numbers)
    expected = np.stack([np.array(each).reshape(SIZE, SIZE, samples).mean(axis=-1) for each in channels], axis=-1)
    np.testing.assert_array_equal(found[0, ..., 3], expected[..., 3])
    near = np.isclose(found[0], expected, rtol=1e-3, atol=1e-5).all(axis=-1)
    assert (expected[..., :3] > 0.01).any(axis=-1).mean() > 0.1
    assert near.mean() > 0.98
    np.testing.assert_allclose(found[0].mean(axis=(0, 1)), expected.mean(axis=(0, 1)), rtol=5e-3)
    assert np.abs(found[1]).max() > 0.01


def test_rigs_light_what_they_are_to_show(tmp_path: Path) -> None:
    """A lamp that is turned away would agree in darkness."""
    for rig, lights in ((name, make(tmp_path)) for name, make in RIGS.items()):
        for light in lights:
            rng = np.random.default_rng(1)
            places = rng.uniform(-0.9, 0.9, (400, 3))
            assert light.radiance(places, light.sample(places, rng.random((400, 2)))).any(), (rig, light.kind)
    assert FACING[2] == (0.0, -1.0, 0.0)


def test_partial_shadows_of_what_is_seen_through_are_refused_in_words(tmp_path: Path) -> None:
    asset = load_asset(builtin="suzanne")
    net = replace(RIG_LOOKS["leaf"], inputs={**RIG_LOOKS["leaf"].inputs, "presence": 0.5})
    looks = {slot.path: Look("net", (net,)) for slot in asset.slots}
    scene = Scene(asset, looks, RIGS["shadow"](tmp_path), orbit_camera(asset.center, asset.radius), Film((8, 8)))
    with pytest.raises(CodegenError, match="look 'net': can be seen through, so lights whose shadows"):
        scene_task(scene, Sampling(), "mitsuba")
