"""Frames under rigs of all kinds of lights against the float64 reference, and faults planted in their shaders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from frames import orbit_camera
from light_rigs import FACING, RIG_LOOKS, RIGS, grey, near, row_of, sent
from numpy.typing import NDArray

from lookdev.asset import load_asset
from lookdev.checks.finding import Finding
from lookdev.checks.images import check_frame, choose_pixels
from lookdev.codegen import ShaderSource
from lookdev.light import Emission, Light, RectLight
from lookdev.light.link import Link
from lookdev.material import Look
from lookdev.reference.mesh import MeshScene
from lookdev.reference.render import frame_pixels
from lookdev.render.scene import scene_task
from lookdev.render.task import one_frame
from lookdev.render.worker import Worker
from lookdev.scene import Film, Pose, Sampling, Scene
from lookdev.scene.linking import link_lights

pytestmark = pytest.mark.cycles

SIZE, SAMPLES, SEEDS = 32, 64, 4
POSE = Pose(20.0, 70.0)
QUICK = [
    *(
        ("sphere", rig, "plastic")
        for rig in ("rect", "cylinder", "local_dome", "local grey", "texture", "beam", "falloff")
    ),
    *(("suzanne", rig, "plastic") for rig in ("everything", "shadow", "response", "still", "seen", "profile")),
    ("plane", "everything", "diffuse"),
    ("suzanne", "everything", "leaf"),
]
CELLS = [(asset, rig, look) for asset in ("sphere", "plane", "suzanne") for rig in RIGS for look in RIG_LOOKS]
# A leaf is seen through: it takes plain shadows alone, and is refused by name otherwise.
CELLS = [cell for cell in CELLS if cell not in QUICK]


def agreement(
    worker: Worker, asset: str, lights: tuple[Light, ...], look: str, alter: Callable[[str], str] = lambda osl: osl
) -> Finding:
    shape = load_asset(builtin=asset)
    camera, film = orbit_camera(shape.center, shape.radius), Film((SIZE, SIZE))
    worn = Look("look", (RIG_LOOKS[look],))
    scene = Scene(shape, {slot.path: worn for slot in shape.slots}, lights, camera, film)
    task = scene_task(scene, Sampling(bounces=1, samples=SAMPLES, error=None))
    (source,) = task.shaders
    assert isinstance(source, ShaderSource)
    altered = replace(source, osl=alter(source.osl))
    task = replace(task, shaders=(altered,))
    worker.start()
    frames = [
        worker.render(one_frame(task, POSE, f"{asset} {look} {seed}", seed=seed), lambda progress: None)
        for seed in range(SEEDS)
    ]
    halves = np.stack([half for frame in frames for half in (frame.a, frame.b)])
    pixels = choose_pixels(frames[0].alpha, 100, seed=1)
    bounces = task.sampling.bounces
    # What passes through a leaf, and from there to a lamp, few samples find: with 256 a pixel's own error was wrong.
    samples = 1024 if look == "leaf" else 256
    reference = frame_pixels(
        MeshScene(shape, scene.looks), lights, camera, POSE, (SIZE, SIZE), pixels, bounces=bounces, samples=samples
    )
    return check_frame(asset, halves, frames[0].alpha, SEEDS * SAMPLES, pixels, reference)


@pytest.mark.parametrize(
    ("asset", "rig", "look"), [*QUICK, *(pytest.param(*cell, marks=pytest.mark.proof) for cell in CELLS)]
)
def test_frames_under_rigs_agree_with_the_reference(
    worker: Worker, tmp_path: Path, asset: str, rig: str, look: str
) -> None:
    found = agreement(worker, asset, RIGS[rig](tmp_path), look)
    assert found.passed, "\n".join((found.summary, *found.details))


FAULTS = {
    "a wrong Jacobian": ("    pdf = v", "    pdf = 1.2 * v"),
    "a missing weight of the BSDF": ("float own_density = brdf_samples", "float own_density = 0 * brdf_samples"),
    "a missing weight of the light": ("own_density + weighed * RIG_DRAWN(j)", "own_density + 0 * RIG_DRAWN(j)"),
    "light from behind": ("p[2] < 0.0", "p[2] != 0.0"),
    "a light that is drawn too often": ("float wanted = u1 * front_sum", "float wanted = u1 * u1 * front_sum"),
    "a lamp that nothing hides": ("(distance > RIG_OCCLUDER(at) ? 0 : 1)", "1"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_planted_faults_are_found(worker: Worker, fault: str) -> None:
    """Under a rectangle that some of the asset sees from behind, and a sphere."""
    behind = RectLight(width=1.0, height=1.0, position=(0.5, 0.0, 0.3), axes=FACING, emission=sent())
    given, planted = FAULTS[fault]
    # Of metal, directions of the light have a small part of the weight.
    look = "plastic" if "drawn" in fault else "metal"

    def alter(osl: str) -> str:
        assert given in osl
        return osl.replace(given, planted)

    assert not agreement(worker, "suzanne", (behind, near("sphere")), look, alter).passed


def test_linked_lights_light_their_parts_alone(worker: Worker) -> None:
    """Two instances of a head: one is lit by a rectangle, the other by a sphere, both by a dome."""
    left, right = (Link(((f"/{side}", "expandPrims"),)) for side in ("Left", "Right"))
    lights = (
        replace(near("rect"), emission=Emission((60.0, 40.0, 20.0), light_link=left)),
        replace(near("sphere"), emission=Emission((60.0, 40.0, 20.0), light_link=right)),
        grey(),
    )
    scene, found = linked_frames(worker, {"/Left": np.eye(4), "/Right": np.eye(4)}, lights)
    assert scene.lit == {"/Left/ball": (0, 2), "/Right/ball": (1, 2)}
    agreed = found(scene.lit_by, ())
    assert agreed.passed, "\n".join((agreed.summary, *agreed.details))
    assert not found(((0, 1, 2), (0, 1, 2)), ()).passed
    assert not found(tuple(reversed(scene.lit_by)), ()).passed


def linked_frames(
    worker: Worker, placed: dict[str, NDArray[np.float64]], lights: tuple[Light, ...]
) -> tuple[Scene, Callable[..., Finding]]:
    """Render instances of one mesh side by side under linked lights; return what compares them with the reference."""
    scene = row_of(placed, lights, SIZE)
    task = scene_task(scene, Sampling(bounces=1, samples=SAMPLES, error=None))
    worker.start()
    frames = [worker.render(one_frame(task, POSE, f"linked {n}", seed=n), lambda progress: None) for n in range(SEEDS)]
    halves = np.stack([half for frame in frames for half in (frame.a, frame.b)])
    pixels = choose_pixels(frames[0].alpha, 100, seed=1)

    def found(lit_by: tuple[tuple[int, ...], ...], groups: tuple[int, ...]) -> Finding:
        shape, size = MeshScene(scene.asset, scene.looks, lit_by, groups), scene.film.resolution
        reference = frame_pixels(shape, scene.lights, scene.camera, POSE, size, pixels, bounces=1, samples=256)
        return check_frame("row", halves, frames[0].alpha, SEEDS * SAMPLES, pixels, reference)

    return scene, found


def test_linked_shadows_are_cast_by_their_parts_alone(worker: Worker) -> None:
    """Of three heads, one is mirrored and stretched; each light spares another, and a light in their row spares two."""
    stretched = np.diag([-0.8, 1.4, 1.1, 1.0])
    casting = [
        Link((("/", "expandPrims"), *((f"/{side}", "exclude") for side in sides)))
        for sides in (("Left",), ("Middle",), ("Left", "Right"))
    ]
    bright = (300.0, 200.0, 100.0)
    beside = RectLight(
        width=1.0, height=1.0, emission=Emission(bright, shadow_link=casting[2]), position=(-3.5, 0.0, 0.5)
    )
    lights = (
        replace(near("rect"), emission=Emission(bright, shadow_link=casting[0])),
        replace(near("sphere"), emission=Emission(bright, shadow_link=casting[1])),
        replace(beside, axes=((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0))),
        grey(),
    )
    placed = {"/Left": np.eye(4), "/Middle": stretched, "/Right": np.eye(4)}
    scene, found = linked_frames(worker, placed, lights)
    assert sorted(scene.grouped) == [1, 2, 3]
    agreed = found(scene.lit_by, scene.grouped)
    assert agreed.passed, "\n".join((agreed.summary, *agreed.details))
    assert not found(scene.lit_by, ()).passed
    assert not found(scene.lit_by, (*scene.grouped[1:], scene.grouped[0])).passed


def test_a_part_without_light_reflects_that_of_others_alone(worker: Worker) -> None:
    nothing = replace(near("rect"), emission=sent(light_link=Link(())))
    asset, worn = load_asset(builtin="sphere"), Look("look", (RIG_LOOKS["plastic"],))
    wears: dict[str, Look] = {slot.path: worn for slot in asset.slots}
    linked = link_lights(asset, wears, (nothing,))
    camera = orbit_camera(asset.center, asset.radius)
    scene = Scene(linked.asset, linked.wears, linked.lights, camera, Film((8, 8)), linked.lit)
    worker.start()
    task = scene_task(scene, Sampling(samples=4, error=None))
    frame = worker.render(one_frame(task, POSE, "unlit"), lambda progress: None)
    assert frame.alpha.any()
    assert not frame.a.any()


def test_the_shader_of_a_rig_does_not_depend_on_its_numbers() -> None:
    """So rigs of the same kinds share a compiled shader."""
    moved = replace(near("rect"), position=(1.0, 2.0, 3.0), width=2.0)  # type: ignore[type-var]
    asset = load_asset(builtin="sphere")
    one, other = (
        scene_task(Scene.of_look(asset, Look("look", (RIG_LOOKS["plastic"],)), light, (8, 8)), Sampling())
        for light in (near("rect"), moved)
    )
    assert one.shaders[0].digest == other.shaders[0].digest
