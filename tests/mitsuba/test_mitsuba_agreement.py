"""Frames of Mitsuba against the float64 reference: every lobe of every model, textures, bounces, and transmission."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from agreement import SHAPES, assert_agreement, assert_mesh_agreement
from frames import POSE, RenderScene, orbit_camera
from looks import LOOKS, quick_among
from painted import embossed, painted, sparkling

from lookdev.asset import Asset, Instance, load_asset, make_asset
from lookdev.checks.images import check_frame, choose_pixels
from lookdev.light import LIGHT_KINDS, DiskLight, Emission, Falloff, Light, RectLight, Shaping, SphereLight
from lookdev.material import Layer, Look
from lookdev.reference.mesh import MeshScene
from lookdev.reference.render import frame_pixels
from lookdev.render.scene import scene_task
from lookdev.render.task import one_frame
from lookdev.render.worker import Worker
from lookdev.scene import Film, Pose, Sampling, Scene

pytestmark = pytest.mark.mitsuba

REFLECTING = ("diffuse", "cloth", "coated", "brushed", "polished", "painted", "chrome")
TRANSMITTING = ("leaf", "frosted", "tilted", "lacquered", "mixed")
# In this pose the sun of `sunset` is behind the asset.
BACKLIT = Pose(30.0, 126.0)


@pytest.mark.parametrize(
    ("light", "name"),
    quick_among(
        [*product(("studio", "city"), REFLECTING), ("white", "diffuse")],
        [("studio", "coated"), ("city", "brushed"), ("city", "painted"), ("studio", "chrome"), ("white", "diffuse")],
    ),
)
def test_spheres_agree(name: str, light: str, render: RenderScene, light_of) -> None:
    # With few samples, the noise at the edge of a mirrored lamp is two-valued, not Student's.
    samples = 128 if name in ("polished", "chrome", "coated") else 32
    frames = [render("sphere", LOOKS[name], light_of(light), samples=samples, seed=seed) for seed in range(8)]
    assert_agreement(frames, LOOKS[name], "sphere", light_of(light))


@pytest.mark.parametrize(
    ("asset", "name"), quick_among(list(product(SHAPES, TRANSMITTING)), [("plane", "tilted"), ("sphere", "leaf")])
)
def test_backlit_shapes_agree(asset: str, name: str, render: RenderScene, light_of) -> None:
    light = light_of("sunset")
    frames = [render(asset, LOOKS[name], light, samples=64, seed=seed, pose=BACKLIT, bounces=3) for seed in range(8)]
    assert_agreement(frames, LOOKS[name], asset, light, BACKLIT, bounces=3 if asset == "sphere" else 0)


@pytest.mark.parametrize(
    ("name", "look"),
    [
        ("suzanne", painted),
        pytest.param("shaderball", embossed, marks=pytest.mark.proof),
        pytest.param("suzanne", sparkling, marks=pytest.mark.proof),
    ],
)
def test_meshes_agree(name: str, look, render: RenderScene, light_of, tmp_path: Path) -> None:
    asset, light, layers = load_asset(builtin=name), light_of("city"), look(tmp_path)
    frames = [render(asset, layers, light, samples=32, seed=seed, bounces=2) for seed in range(6)]
    found = assert_mesh_agreement(frames, asset, layers, light, samples=32, bounces=2)
    assert found.figures["bias_limit"] < 0.05


def test_parts_of_several_looks_agree(worker: Worker, light_of, tmp_path: Path) -> None:
    """A card that can be seen through, and a textured ball behind it."""
    card, ball = load_asset(builtin="plane"), load_asset(builtin="sphere")
    upright = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, -1.3], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    slots = tuple(replace(slot, path=f"/{n}") for n, slot in enumerate((*card.slots, *ball.slots)))
    meshes = (*card.meshes, *(replace(each, face_slots=each.face_slots + len(card.slots)) for each in ball.meshes))
    asset = make_asset("parts", meshes, [Instance(0, upright), Instance(1, np.eye(4))], slots)
    looks = {
        "/0": Look(
            "net", (Layer("Net", "pixar", {"surfaceColor": (0.6, 0.5, 0.4), "roughness": 0.5, "presence": 0.4}),)
        ),
        "/1": Look("painted", painted(tmp_path)),
    }
    light, camera = light_of("slopes"), orbit_camera(asset.center, asset.radius)
    scene = Scene(asset, looks, (light,), camera, Film((40, 40)))
    task = scene_task(scene, Sampling(samples=64, bounces=3), "mitsuba")
    worker.start()
    frames = [worker.render(one_frame(task, POSE, f"{n}", seed=n), lambda progress: None) for n in range(6)]
    chosen = choose_pixels(frames[0].alpha, 120, seed=1)
    halves = np.stack([half for frame in frames for half in (frame.a, frame.b)])
    reference = frame_pixels(
        MeshScene(asset, scene.looks), [light], camera, POSE, (40, 40), chosen, bounces=3, samples=256
    )
    found = check_frame("parts", halves, frames[0].alpha, 6 * 64, chosen, reference)
    assert found.passed, "\n".join((found.summary, *found.details))


@pytest.mark.parametrize("model", ["mirror", "glass"])
def test_single_directions_agree(model: str, render: RenderScene, light_of) -> None:
    asset, light = load_asset(builtin="suzanne"), light_of("slopes")
    layers = (Layer("Smooth", model, {}),)
    frames = [render(asset, layers, light, samples=64, seed=seed, bounces=3) for seed in range(6)]
    assert_mesh_agreement(frames, asset, layers, light, samples=64, bounces=3)


def test_frames_are_the_same_in_any_order_and_after_other_scenes(render: RenderScene, light_of) -> None:
    first = render("suzanne", LOOKS["coated"], light_of("city"), samples=8, seed=3)
    render("sphere", LOOKS["leaf"], light_of("studio"), samples=8)
    render("suzanne", LOOKS["painted"], light_of("studio"), samples=8)
    again = render("suzanne", LOOKS["coated"], light_of("city"), samples=8, seed=3)
    other = render("suzanne", LOOKS["coated"], light_of("city"), samples=8, seed=4)
    assert np.array_equal(first.a, again.a)
    assert np.array_equal(first.b, again.b)
    assert not np.array_equal(first.a, other.a)


def test_denoised_frames_are_no_worse(render: RenderScene, light_of) -> None:
    options = {"samples": 16, "size": 64, "denoise": "measured"}
    frame = render("suzanne", LOOKS["coated"], light_of("city"), **options)
    assert frame.raw is not None
    assert frame.raw_relmse is not None
    assert frame.relmse < frame.raw_relmse


def test_a_target_is_reached(render: RenderScene, light_of) -> None:
    frame = render("suzanne", LOOKS["coated"], light_of("city"), samples=4096, error=2e-3)
    assert frame.relmse <= 2e-3
    assert frame.samples < 4096


def rig_agreement(worker: Worker, asset: Asset, look: Look, lights: Sequence[Light], **sampling: int) -> None:
    camera = orbit_camera(asset.center, asset.radius)
    scene = Scene(asset, {slot.path: look for slot in asset.slots}, tuple(lights), camera, Film((40, 40)))
    task = scene_task(scene, Sampling(samples=64, bounces=2, **sampling), "mitsuba")
    worker.start()
    frames = [worker.render(one_frame(task, POSE, f"{n}", seed=n), lambda progress: None) for n in range(6)]
    chosen = choose_pixels(frames[0].alpha, 120, seed=1)
    halves = np.stack([half for frame in frames for half in (frame.a, frame.b)])
    reference = frame_pixels(
        MeshScene(asset, scene.looks), list(lights), camera, POSE, (40, 40), chosen, bounces=2, samples=256
    )
    found = check_frame("rig", halves, frames[0].alpha, 6 * 64, chosen, reference)
    assert found.passed, "\n".join((found.summary, *found.details))


@pytest.mark.parametrize("kind", ["rect", "disk", "sphere", "cylinder", "distant"])
def test_each_kind_of_lamp_agrees(kind: str, worker: Worker) -> None:
    look = Look("coated", LOOKS["coated"])
    rig_agreement(worker, load_asset(builtin="suzanne"), look, [LIGHT_KINDS[kind].example()])


def test_a_rig_of_lamps_and_domes_agrees(worker: Worker, light_of) -> None:
    """Lamps that turn and one that stays, a beam, a falloff, two domes with axes of their own; and transmission."""
    shaped = Emission((4.0, 3.0, 2.0), shaping=Shaping(60.0, 0.5, focus=2.0), falloff=Falloff(0.2, 1.5, 2.0, 6.0))
    sphere = replace(SphereLight.example(), emission=shaped)
    still = replace(DiskLight.example(), emission=replace(DiskLight.example().emission, turns=False))
    leaning = ((1.0, 0.0, 0.0), (0.0, 0.8, 0.6), (0.0, -0.6, 0.8))
    dome = replace(light_of("slopes"), axes=leaning, emission=Emission((0.4, 0.3, 0.5)))
    white = replace(light_of("white"), emission=Emission((0.1, 0.2, 0.1)))
    look = Look("leaf", LOOKS["leaf"])
    rig_agreement(worker, load_asset(builtin="suzanne"), look, [RectLight.example(), sphere, dome, still, white])
