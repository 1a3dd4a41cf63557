"""An exported .blend, opened without lookdev, renders the same pictures as lookdev."""

import json
import math
from dataclasses import dataclass
from typing import Any

import batches
import numpy as np
import OpenImageIO as oiio
import pytest
from scripts import run_script
from usd_text import textured

from lookdev.arrays import Floats32
from lookdev.asset import load_asset
from lookdev.export.blend import export_blend
from lookdev.plan import turntable_poses
from lookdev.plan.prepare import PlannedJob, prepare_job
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import FrameTask
from lookdev.rendering.worker import Worker
from lookdev.scene import camera_rays

pytestmark = pytest.mark.cycles

SIZE, SAMPLES, SEED = 40, 32, 3
LOOKS = {
    "chips": '#usda 1.0\n( defaultPrim = "Look" )\n' + textured("Look", file="chips.png", space="sRGB"),
    "rubber": batches.look_text("Disney", baseColor=(0.1, 0.5, 0.2), roughness=0.7),
}
# Looks, worlds and frames: one of each turntable.
FRAMES = [("chips", "city", 2), ("rubber", "city", 5)]
JOB = {
    "look": '[{ name = "chips", material = "chips.usda" }, { name = "rubber", material = "rubber.usda" }]',
    "ibl": '[{ name = "city", builtin = "city", exposure = 1.0, rotation = 20.0 }, '
    '{ name = "studio", builtin = "studio", rotation = 140.0 }]',
    "turntable": '[{ kind = "element", frames = 3, start = 300 }, { kind = "lighting", name = "sun", frames = 4 }]',
    "render": f"{{ resolution = [{SIZE}, {SIZE}], samples = {SAMPLES}, seed = {SEED}, bounces = 1 }}",
    "outputs": '{ view = "Un-tone-mapped" }',
}


@dataclass(frozen=True)
class Case:
    """A job, facts of its .blend, and renders (SIZE, SIZE, 4) of it by look, world and frame."""

    prepared: PlannedJob
    facts: dict[str, Any]
    pictures: dict[tuple[str, str, int], Floats32]

    def task(self, look: str, ibl: str, frame: int) -> FrameTask:
        """Return the task of a frame of the timeline."""
        job = self.prepared.job
        rotation = next(light.rotation for light in job.ibl if light.name == ibl)
        poses = [pose for turntable in job.turntable for pose in turntable_poses(turntable, rotation)]
        key = look, ibl, poses[frame - 1]
        tasks = [planned.task for planned in self.prepared.plan.frames]
        (task,) = (task for task in tasks if (task.labels["look"], task.labels["ibl"], task.pose) == key)
        return task


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """Return a job, facts that a new process reads from its .blend, and renders with the seed of a first half."""
    folder, written, elsewhere = (tmp_path_factory.mktemp(name) for name in ("job", "written", "moved"))
    for name, text in LOOKS.items():
        (folder / f"{name}.usda").write_text(text)
    pixels = np.random.default_rng(7).integers(40, 255, (16, 16, 3)).astype(np.uint8)
    assert oiio.ImageBuf(pixels).write(str(folder / "chips.png"))
    job = batches.write_job(folder, **JOB)
    export_blend(job, written / "look.blend")
    moved, facts = written.rename(elsewhere / "to another place"), elsewhere / "facts.json"
    files = {frame: elsewhere / f"{i}.exr" for i, frame in enumerate([*FRAMES, ("rubber", "studio", 5)])}
    renders = [word for frame, out in files.items() for word in (*frame, 64 * SEED, SAMPLES // 2, out)]
    run_script("reopen_blend.py", moved / "look.blend", facts, *renders)
    pictures = {frame: oiio.ImageBuf(str(out)).get_pixels(oiio.FLOAT) for frame, out in files.items()}
    return Case(prepare_job(job, backend="nodes"), json.loads(facts.read_text()), pictures)


def render_direct(worker: Worker, task: FrameTask) -> WorkerFrame:
    worker.start()
    return worker.render(task, lambda progress: None)


@pytest.mark.both_pythons
@pytest.mark.parametrize("frame", FRAMES, ids=["element", "lighting"])
def test_the_reopened_file_renders_the_same_picture(frame: tuple[str, str, int], case: Case, worker: Worker) -> None:
    task = case.task(*frame)
    ours = render_direct(worker, task)
    theirs = case.pictures[frame]
    assert ours.alpha.max() == 1.0
    assert ours.a[ours.alpha == 1.0].mean() > 0.02
    # The same samples of the same scene, of which nothing is rounded on its way through the file.
    np.testing.assert_allclose(theirs[..., :3], ours.a * 2.0**task.exposure, rtol=1e-5, atol=1e-6)


def test_scenes_are_looks_and_worlds_are_lights(case: Case) -> None:
    facts = case.facts
    assert facts["opens"] == "chips"
    assert list(facts["scenes"]) == ["chips", "rubber"]
    assert facts["worlds"] == {"city": True, "studio": True}
    for look, scene in facts["scenes"].items():
        assert scene["world"] == "city"
        assert scene["materials"] == [look]


def test_scenes_have_the_settings_of_the_job(case: Case) -> None:
    for scene in case.facts["scenes"].values():
        assert scene["engine"] == "CYCLES"
        assert scene["view"] == "Standard"
        assert scene["size"] == [SIZE, SIZE, 100]
        assert scene["samples"] == [SAMPLES, False, SEED]
        assert scene["transparent"]
        assert scene["device"] == "CPU"
        assert scene["range"] == [1, 7]
        assert scene["markers"] == {"element": 1, "sun": 4}


def test_nothing_but_blender_is_needed(case: Case) -> None:
    facts = case.facts
    assert facts["modules"] == facts["texts"] == facts["libraries"] == []
    assert "ShaderNodeScript" not in facts["nodes"]
    assert all(node.startswith(("ShaderNode", "NodeGroup", "NodeFrame", "NodeReroute")) for node in facts["nodes"])
    assert len(facts["images"]) == 3
    for path, packed in facts["images"].items():
        assert path.startswith("//look_files/")
        assert not packed
    assert "lookdev_normal" in facts["attributes"]


def test_every_frame_stands_at_its_pose(case: Case) -> None:
    camera, center = case.prepared.plan.frames[0].task.scene.camera, load_asset(builtin="suzanne").center
    for look, scene in case.facts["scenes"].items():
        for frame in range(1, 8):
            pose = case.task(look, "city", frame).pose
            placement = scene["half_frames"][2 * (frame - 1)]
            difference = math.remainder(math.degrees(placement["turn"]) - pose.element + pose.lighting, 360.0)
            assert difference == pytest.approx(0.0, abs=1e-3)
            # Seen from the asset, whose origin is its centre, the camera has gone round by -element.
            start, _ = camera_rays(camera, pose, (SIZE, SIZE), 0.5, 0.5)
            x, y, z = np.subtract(placement["camera"], placement["asset"])
            back = -placement["turn"]
            from_asset = (x * math.cos(back) - y * math.sin(back), x * math.sin(back) + y * math.cos(back), z)
            np.testing.assert_allclose(from_asset, start - center, atol=1e-5 * camera.distance)


def test_between_frames_nothing_turns_back(case: Case) -> None:
    for scene in case.facts["scenes"].values():
        steps = np.degrees(np.diff([placement["turn"] for placement in scene["half_frames"]]))
        steps = np.where(np.abs(steps) > 180.0, steps - np.copysign(360.0, steps), steps)
        # 120 degrees a frame; then 90 of the light, the other way. Where a turn is whole, a key lies 1/64 before.
        np.testing.assert_allclose(steps[0:4], 60.0, atol=120.0 / 64.0)
        np.testing.assert_allclose(steps[6:12], -45.0, atol=90.0 / 64.0)
        # Two turntables have nothing between them.
        assert steps[4] == 0.0


def test_another_world_shows_the_jobs_other_light(case: Case, worker: Worker) -> None:
    ours = render_direct(worker, case.task("rubber", "studio", 5))
    theirs = case.pictures["rubber", "studio", 5][..., :3]
    # Its map is turned, so its samples are others: as far from either half as these are from each other.
    noise = np.mean((ours.a - ours.b) ** 2)
    assert np.mean((theirs - ours.b) ** 2) < 2.0 * noise
    # Not turned, the picture is another one.
    unturned = render_direct(worker, case.task("rubber", "studio", 6)).a
    assert np.mean((theirs - unturned) ** 2) > 4.0 * noise
