"""The times of frames on disk predict those of others; digests of finished frames stay the same."""

from dataclasses import replace
from pathlib import Path

import pytest

from lookdev.plan.chunks import plan_of_part
from lookdev.plan.costs import SCENE_SECONDS, START_SECONDS, estimate, estimate_costs, measure_costs
from lookdev.plan.digest import PARTS, part_digests
from lookdev.plan.plan import Plan, PlannedFrame, Reel
from lookdev.rendering import backends
from lookdev.rendering.task import FrameTask, SceneTask
from lookdev.scene import Pose

FILE = Path("/out/a.0001.exr")
WRITTEN = {"digest": "old", "resolution": "32 x 12", "samples": "16", "seconds": "3.0"}


def frame(scene: SceneTask, **header: str) -> PlannedFrame:
    task = FrameTask(scene, Pose(0.0, 0.0), 0.0, "new", (FILE,), {f"digest.{part}": part for part in PARTS})
    return PlannedFrame(task, lambda path: WRITTEN | header)


def test_the_time_of_another_version_counts_by_its_pixels_and_samples(scene: SceneTask) -> None:
    scene = replace(scene, sampling=replace(scene.sampling, samples=64, error=None))
    assert frame(scene).seconds == pytest.approx(3.0 * (64 * 48) / (32 * 12) * 64 / 16)
    assert frame(replace(scene, sampling=replace(scene.sampling, error=1e-3))).seconds == 3.0
    assert frame(scene, digest="new", resolution="64 x 48").seconds == 3.0


@pytest.mark.parametrize(
    "header",
    [{"seconds": value} for value in ("-1", "nan", "inf", "soon")]
    + [{"samples": "0"}, {"samples": "many"}, {"resolution": "0 x 12"}, {"resolution": "large"}],
)
def test_a_bad_time_in_a_header_is_unknown(scene: SceneTask, header: dict[str, str]) -> None:
    assert frame(scene, **header).seconds is None


def test_costs_are_those_measured_else_estimated_with_a_scene_and_a_start(scene: SceneTask) -> None:
    other = replace(scene, resolution=(128, 96))
    plan = Plan((frame(scene, digest="new", resolution="64 x 48"), frame(other, seconds="")), (), Path("/out"))
    costs = measure_costs(plan)
    assert (costs.scene, costs.start) == (SCENE_SECONDS, START_SECONDS)
    assert costs.frames == pytest.approx((3.0, 3.0 * estimate(other) / estimate(scene)))
    costs = estimate_costs(plan)
    assert (costs.scene, costs.start) == (SCENE_SECONDS, START_SECONDS)
    assert costs.frames == (estimate(scene), estimate(other))


def test_parts_have_the_frames_between_their_ends_and_nothing_that_is_made_of_several(scene: SceneTask) -> None:
    frames = tuple(frame(scene) for _ in range(6))
    plan = Plan(frames, (Reel("gold", "city", "turn", (FILE,)),), Path("/out"), (".png",))
    parts = [plan_of_part(plan, (1, 3, 3, 6), number) for number in (1, 2, 3, 4)]
    assert [part.frames for part in parts] == [frames[:1], frames[1:3], (), frames[3:]]
    assert all((part.reels, part.sheets, part.skips, part.frame_suffixes) == ((), (), (), (".png",)) for part in parts)


def test_digests_of_finished_frames_stay(scene: SceneTask, monkeypatch: pytest.MonkeyPatch) -> None:
    """A change here renders every frame of every user again: then `RENDER_VERSION` says so."""
    monkeypatch.setattr(backends, "blender_version", lambda: "4.5.15")
    monkeypatch.setattr(backends, "RENDER_VERSION", 1)
    digests = part_digests(scene, Pose(30.0, 60.0), 0.5)
    assert {part: digest[:12] for part, digest in digests.items()} == {
        "asset": "a55e7",
        "look": "f47b30972b82",
        "ibl": "683f9f1fdeea",
        "camera": "d6ee32b1f374",
        "pose": "29c2e262b913",
        "render": "ff5fb91202c0",
    }
    wide = part_digests(replace(scene, space="acescg"), Pose(30.0, 60.0), 0.5)
    assert wide["render"][:12] == "01280d90360e"
    with_pass = replace(scene, sampling=replace(scene.sampling, passes=("depth",)), prims=("/a",))
    assert part_digests(with_pass, Pose(30.0, 60.0), 0.5)["render"][:12] == "d685e6503f1c"
