"""Rigs in an exported .blend: opened without lookdev, they give the light of lookdev's frames."""

import functools
import json
from dataclasses import replace
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from frames import scene_of
from scripts import run_script

from lookdev.asset import load_asset
from lookdev.export.blend import EXPORT_COMMAND, _run_exporter
from lookdev.light import LIGHT_KINDS, Emission, Light, native_images
from lookdev.light.mapping import rotate_z
from lookdev.material import Layer, Look
from lookdev.rendering.blend import BlendImage, BlendRig, BlendTask, BlendTurntable
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import SceneTask, frame_task
from lookdev.rendering.worker import Worker
from lookdev.scene import Camera, Pose, Sampling

pytestmark = pytest.mark.cycles

SIZE, SAMPLES, SEED = 24, 32, 3
PIVOT = 0.2, 0.1
POSES = (Pose(0.0, 20.0), Pose(0.0, 110.0))
COLORS = {"red": (0.8, 0.1, 0.1), "green": (0.1, 0.8, 0.1)}
LAMPS: tuple[Light, ...] = (
    replace(LIGHT_KINDS["rect"].example(), emission=Emission((6.0, 5.0, 4.0), group="key")),
    replace(LIGHT_KINDS["sphere"].example(), position=(1.4, -1.4, 0.7), emission=Emission((4.0,) * 3, turns=False)),
)


@functools.cache  # a dome takes seconds to prepare
def rigs() -> dict[str, tuple[Light, ...]]:
    group = replace(LIGHT_KINDS["disk"].example(), emission=Emission(group="fill"))
    return {"studio": LAMPS, "sky": (LIGHT_KINDS["dome"].example(), group)}


def task_of(look: str, rig: str) -> SceneTask:
    asset, layers = load_asset(builtin="suzanne"), (Layer("Layer", "disney", {"baseColor": COLORS[look]}),)
    camera = Camera(30.0, 20.0, (*PIVOT, 0.0), 4.5 * asset.radius)
    scene = replace(scene_of(asset, Look(look, layers), rigs()[rig], SIZE), camera=camera)
    return scene_task(scene, Sampling(samples=SAMPLES, seed=SEED, bounces=1), "nodes")


@pytest.fixture(scope="module")
def reopened(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Any]:
    """Return facts of an exported file, and the second frame of its second scene."""
    folder = tmp_path_factory.mktemp("rigs")
    task = BlendTask(
        file=folder / "look.blend",
        scenes={look: replace(task_of(look, "studio"), device="cuda") for look in COLORS},
        rigs=tuple(BlendRig(name, lights, 2.0, 0.0) for name, lights in rigs().items()),
        turntables=(BlendTurntable("sun", POSES),),
        images=tuple(BlendImage(image, "maps/sky.exr") for image in native_images(rigs()["sky"])),
        pack=True,
        view="Un-tone-mapped",
        show_light=False,
    )
    _run_exporter(task, EXPORT_COMMAND, 300.0)
    assert [*folder.iterdir()] == [task.file]
    # Without a GPU, Blender renders on the CPU.
    picture, facts = folder / "out.exr", folder / "facts.json"
    run_script("reopen_blend.py", task.file, facts, "green", "studio", 2, 64 * SEED, SAMPLES // 2, picture)
    return json.loads(facts.read_text()), np.asarray(oiio.ImageBuf(str(picture)).get_pixels(oiio.FLOAT))


def test_each_rig_is_a_collection_and_a_world(reopened: tuple[dict[str, Any], Any]) -> None:
    facts, _ = reopened
    assert set(facts["worlds"]) == set(rigs())
    assert facts["images"] == {"//maps/sky.exr": True}
    for scene in facts["scenes"].values():
        assert (scene["world"], scene["device"]) == ("studio", "GPU")
        assert scene["rigs"] == {"rig studio": [True, ["key", "sphere 2"]], "rig sky": [False, ["fill"]]}


def test_a_light_that_does_not_turn_has_keys(reopened: tuple[dict[str, Any], Any]) -> None:
    facts, _ = reopened
    center, axis = np.array(load_asset(builtin="suzanne").center), np.array((*PIVOT, 0.0))
    for scene in facts["scenes"].values():
        # Frames 1 and 2, of steps of a half.
        for placement, pose in zip(scene["half_frames"][::2], POSES, strict=False):
            key, still = (np.array(light.position) for light in LAMPS)
            # The scene is rotated against the rig: so the rig stands still, and this light does not.
            rotated = rotate_z(still - axis, -pose.lighting) + axis
            np.testing.assert_allclose(placement["lights"]["key"], key - center, atol=1e-6)
            np.testing.assert_allclose(placement["lights"]["sphere 2"], rotated - center, atol=1e-6)


def test_the_reopened_rig_renders_the_same_picture(reopened: tuple[dict[str, Any], Any], worker: Worker) -> None:
    _, theirs = reopened
    worker.start()
    ours = worker.render(frame_task(task_of("green", "studio"), POSES[1], "green"), lambda progress: None)
    assert ours.a[ours.alpha == 1.0].mean() > 0.02
    np.testing.assert_allclose(theirs[..., :3], 2.0 * ours.a, rtol=1e-5, atol=1e-6)
