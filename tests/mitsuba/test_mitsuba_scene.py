"""Arrays and constants of scenes in memory, and frames that do not depend on the speed of launches."""

import itertools
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from frames import POSE
from looks import LOOKS
from mitsuba_scenes import RenderSeeds

from lookdev.asset import load_asset
from lookdev.cache import Content
from lookdev.material import Layer, Look
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import SceneTask, frame_task
from lookdev.scene import Film, Pose, Sampling, Scene
from lookdev.space import Space, to_rec709

pytestmark = pytest.mark.mitsuba


@pytest.mark.parametrize("offset", range(4))
def test_held_numbers_are_aligned_wherever_they_came_from(drjit, offset: int) -> None:
    from lookdev.mitsuba.frozen import device_array

    numbers = np.arange(1000, dtype=np.float64)[offset:]
    for kind in (drjit.llvm.Float, drjit.llvm.UInt32):
        array = np.asarray(device_array(kind, numbers))
        np.testing.assert_array_equal(array, numbers)
        assert array.ctypes.data % 16 == 0, "Dr.Jit gathers four numbers at once, or one by one, by this"


def test_a_file_is_read_once_while_its_numbers_are_held(drjit) -> None:
    from lookdev.mitsuba.files import file_array

    read = Mock(side_effect=np.load)
    content = Content.store_written(".npy", lambda path: np.save(path, np.arange(6, dtype=np.float32).reshape(2, 3)))
    first = file_array(drjit.llvm.Float, content, read)
    assert file_array(drjit.llvm.Float, content, read) is first
    assert first.shape == (2, 3)
    assert read.call_count == 1
    del first
    again = file_array(drjit.llvm.Float, content, read)
    np.testing.assert_array_equal(np.asarray(again.array), np.arange(6))
    assert read.call_count == 2


@pytest.fixture
def task_of(llvm: str, light_of) -> Callable[..., SceneTask]:
    light, asset = light_of("city"), load_asset(builtin="suzanne")

    def task(look: Look, **sampling: object) -> SceneTask:
        return scene_task(Scene.of_look(asset, look, light, (24, 18)), Sampling(**sampling), "mitsuba")  # type: ignore[arg-type]

    return task


def test_a_scene_takes_the_constants_of_another_and_no_other_programs(task_of: Callable[..., SceneTask]) -> None:
    """Its frames equal those of a new scene, bit for bit."""
    from lookdev.mitsuba.load import load_mitsuba
    from lookdev.mitsuba.render import MitsubaScene

    def edited(**inputs: object) -> SceneTask:
        base = {"baseColor": (0.5, 0.35, 0.2), "roughness": 0.3, "metallic": 0.4, **inputs}
        return task_of(Look("edited", (Layer("base", "disney", base),)), samples=8, passes=("direct",))

    mi, first, other = load_mitsuba("cpu"), edited(), edited(roughness=0.7, baseColor=(0.1, 0.45, 0.25))

    def pictures(scene: MitsubaScene, task: SceneTask):
        frame = scene.render(frame_task(task, POSE, "frame"), lambda *progress: None)
        return np.stack([frame.a, frame.b, frame.passes["direct"]])

    scene = MitsubaScene(mi, first)
    before = pictures(scene, first)
    assert scene.update(other)
    after = pictures(scene, other)
    assert np.array_equal(after, pictures(MitsubaScene(mi, other), other))
    assert np.abs(after - before).max() > 0.01
    # A clear coat needs another program; another resolution does not.
    assert not scene.update(edited(clearcoat=1.0))
    assert np.array_equal(after, pictures(scene, other))
    small = replace(other, resolution=(12, 9))
    assert scene.matches(small)
    assert np.array_equal(pictures(scene, small), pictures(MitsubaScene(mi, small), small))


def test_a_frame_does_not_depend_on_the_speed_of_launches(task_of: Callable[..., SceneTask], monkeypatch) -> None:
    """The time of a launch determines the size of the next one."""
    from lookdev.mitsuba import render
    from lookdev.mitsuba.load import load_mitsuba

    task, mi = task_of(Look("coated", LOOKS["coated"]), samples=512, error=4e-3), load_mitsuba("cpu")
    frames, launches = [], []
    # Each launch takes a tenth of the longest, so that the next is larger, or twice the longest.
    for part in (0.1, 2.0):
        clock = itertools.count(0.0, part * render.MAX_LAUNCH_SECONDS)
        monkeypatch.setattr(render, "time", SimpleNamespace(perf_counter=clock.__next__))
        report = Mock()
        frames.append(render.MitsubaScene(mi, task).render(frame_task(task, POSE, "frame"), report))
        launches.append(report.call_count)
    fast, slow = frames
    assert launches[1] > launches[0]
    assert fast.alpha.max() == 1.0
    assert fast.samples == slow.samples
    for name in ("a", "b", "alpha"):
        assert np.array_equal(getattr(fast, name), getattr(slow, name)), name


def test_under_white_light_colours_in_acescg_agree_after_conversion(render_seeds: RenderSeeds, light_of) -> None:
    red = Look("red", (Layer("paint", "disney", {"baseColor": (0.8, 0.02, 0.02), "clearcoat": 0.5}),))
    pictures = {}
    spaces: tuple[Space, ...] = ("rec709", "acescg")
    for space in spaces:
        scene = Scene.of_look(load_asset(builtin="sphere"), red, light_of("white").in_space(space), (24, 18))
        (frame,) = render_seeds(replace(scene, film=Film((24, 18), space)), Pose(0.0, 0.0), 1, samples=16)
        pictures[space] = 0.5 * (frame.a + frame.b)
    ours = pictures["rec709"]
    # Only float32 differs: both have the same samples.
    off = np.abs(to_rec709(pictures["acescg"], "acescg") - ours)
    assert (off <= 5e-5 * (ours.max(axis=-1, keepdims=True) + 1e-3)).all()
    assert ours[..., 0].max() > 0.4
