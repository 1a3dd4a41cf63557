"""An exported .blend, opened where lookdev is not loaded, renders what lookdev renders."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from numpy.typing import NDArray
from scripts import run_script

from lookdev.asset import load_asset
from lookdev.batch.export import export_blend
from lookdev.batch.prepare import Prepared, prepare_job
from lookdev.plan import turntable_poses
from lookdev.render.results import Rendered
from lookdev.render.task import FrameTask
from lookdev.render.worker import Worker
from lookdev.scene import camera_rays

pytestmark = pytest.mark.cycles

SIZE, SAMPLES, SEED = 40, 32, 3
LOOKS = {
    "chips": """
    def Shader "Base" {
        uniform token info:id = "LookdevDisney"
        color3f inputs:baseColor.connect = </Look/Map.outputs:rgb>
        float inputs:roughness = 0.4
        token outputs:layer
    }
    def Shader "Map" {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @chips.png@
        float2 inputs:st.connect = </Look/St.outputs:result>
        color3f outputs:rgb
    }
    def Shader "St" {
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "st"
        float2 outputs:result
    }
""",
    "rubber": """
    def Shader "Base" {
        uniform token info:id = "LookdevDisney"
        color3f inputs:baseColor = (0.1, 0.5, 0.2)
        float inputs:roughness = 0.7
        token outputs:layer
    }
""",
}
# Looks, worlds and frames: one of each turntable.
SHOWN = [("chips", "city", 2), ("rubber", "city", 5)]
LOOK = """#usda 1.0
( defaultPrim = "Look" )
def Material "Look"
{{
    token outputs:lookdev:surface.connect = </Look/Base.outputs:layer>{nodes}}}
"""
JOB = f"""output = "out"
[asset]
builtin = "suzanne"
[[look]]
name = "chips"
material = "chips.usda"
[[look]]
name = "rubber"
material = "rubber.usda"
[[ibl]]
name = "city"
builtin = "city"
exposure = 1.0
rotation = 20.0
[[ibl]]
name = "studio"
builtin = "studio"
rotation = 140.0
[[turntable]]
kind = "element"
frames = 3
start = 300
[[turntable]]
kind = "lighting"
name = "sun"
frames = 4
[render]
resolution = [{SIZE}, {SIZE}]
samples = {SAMPLES}
seed = {SEED}
bounces = 1
[outputs]
view = "Un-tone-mapped"
"""


@dataclass(frozen=True)
class Case:
    """A job, facts of its .blend, and renders (SIZE, SIZE, 4) of it by look, world and frame."""

    prepared: Prepared
    facts: dict[str, Any]
    pictures: dict[tuple[str, str, int], NDArray[np.float32]]

    def task(self, look: str, ibl: str, frame: int) -> FrameTask:
        """Return the task of a frame of the timeline."""
        job = self.prepared.job
        rotation = next(each.rotation for each in job.ibl if each.name == ibl)
        poses = [pose for each in job.turntable for pose in turntable_poses(each, rotation)]
        (task,) = (
            planned.task
            for planned in self.prepared.plan.frames
            if (planned.task.labels["look"], planned.task.labels["ibl"]) == (look, ibl)
            and planned.task.pose == poses[frame - 1]
        )
        return task


def reopen(
    file: Path, folder: Path, frames: list[tuple[str, str, int]]
) -> tuple[dict[str, Any], dict[tuple[str, str, int], NDArray[np.float32]]]:
    """Open a .blend in a new process; return facts of its content, and renders with the seed of a first half."""
    facts = folder / "facts.json"
    files = [folder / f"{number}.exr" for number in range(len(frames))]
    renders = [
        word
        for (look, world, frame), out in zip(frames, files, strict=True)
        for word in (look, world, frame, 64 * SEED, SAMPLES // 2, out)
    ]
    run_script("reopen_blend.py", file, facts, *renders)
    pictures = [np.asarray(oiio.ImageBuf(str(out)).get_pixels(oiio.FLOAT), np.float32) for out in files]
    return json.loads(facts.read_text()), dict(zip(frames, pictures, strict=True))


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("job")
    for name, nodes in LOOKS.items():
        (folder / f"{name}.usda").write_text(LOOK.format(nodes=nodes))
    pixels = np.random.default_rng(7).integers(40, 255, (16, 16, 3)).astype(np.uint8)
    assert oiio.ImageBuf(pixels).write(str(folder / "chips.png"))
    (folder / "job.toml").write_text(JOB)
    return folder / "job.toml"


@pytest.fixture(scope="module")
def case(job: Path, tmp_path_factory: pytest.TempPathFactory) -> Case:
    written, elsewhere = tmp_path_factory.mktemp("written"), tmp_path_factory.mktemp("moved")
    export_blend(job, written / "look.blend")
    moved = written.rename(elsewhere / "to another place")
    facts, pictures = reopen(moved / "look.blend", elsewhere, [*SHOWN, ("rubber", "studio", 5)])
    return Case(prepare_job(job, backend="nodes"), facts, pictures)


def direct(worker: Worker, task: FrameTask) -> Rendered:
    worker.start()
    return worker.render(task, lambda progress: None)


@pytest.mark.both_pythons
@pytest.mark.parametrize("shown", SHOWN, ids=["element", "lighting"])
def test_the_reopened_file_renders_the_same_picture(shown: tuple[str, str, int], case: Case, worker: Worker) -> None:
    task = case.task(*shown)
    ours = direct(worker, task)
    theirs = case.pictures[shown]
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


def test_the_timeline_has_both_turntables(case: Case) -> None:
    for scene in case.facts["scenes"].values():
        assert scene["range"] == [1, 7]
        assert scene["markers"] == {"element": 1, "sun": 4}


def test_every_frame_stands_at_its_pose(case: Case) -> None:
    camera, center = case.prepared.plan.frames[0].task.scene.camera, load_asset(builtin="suzanne").center
    for look, scene in case.facts["scenes"].items():
        for frame in range(1, 8):
            pose = case.task(look, "city", frame).pose
            found = scene["half_frames"][2 * (frame - 1)]
            assert math.remainder(math.degrees(found["turn"]) - pose.element + pose.lighting, 360.0) == pytest.approx(
                0.0, abs=1e-3
            )
            # Seen from the asset, whose origin is its centre, the camera has gone round by -element.
            start, _ = camera_rays(camera, pose, (SIZE, SIZE), 0.5, 0.5)
            x, y, z = np.subtract(found["camera"], found["asset"])
            back = -found["turn"]
            seen = (x * math.cos(back) - y * math.sin(back), x * math.sin(back) + y * math.cos(back), z)
            np.testing.assert_allclose(seen, start - center, atol=1e-5 * camera.distance)


def test_between_frames_nothing_turns_back(case: Case) -> None:
    for scene in case.facts["scenes"].values():
        steps = np.degrees(np.diff([each["turn"] for each in scene["half_frames"]]))
        steps = np.where(np.abs(steps) > 180.0, steps - np.copysign(360.0, steps), steps)
        # 120 degrees a frame; then 90 of the light, the other way. Where a turn is whole, a key lies 1/64 before.
        np.testing.assert_allclose(steps[0:4], 60.0, atol=120.0 / 64.0)
        np.testing.assert_allclose(steps[6:12], -45.0, atol=90.0 / 64.0)
        # Two turntables have nothing between them.
        assert steps[4] == 0.0


@pytest.mark.proof  # a packed rig is in test_export_rigs.py, and what the command line exports in tests/cli
def test_a_packed_file_stands_alone(job: Path, case: Case, worker: Worker, tmp_path: Path) -> None:
    turned = JOB.index("[[turntable]]"), JOB.index("[render]")
    short = JOB[: turned[0]] + '[[turntable]]\nkind = "element"\nframes = 2\nstart = 300\n' + JOB[turned[1] :]
    file = job.with_name("short.toml")
    file.write_text(short.replace("[render]", '[render]\nbackend = "nodes"\ndevice = "cuda"'))
    exported = export_blend(file, tmp_path / "written" / "look.blend", pack=True)
    assert [path.name for path in exported.file.parent.iterdir()] == ["look.blend"]
    moved = exported.file.rename(tmp_path / "alone.blend")
    facts, pictures = reopen(moved, tmp_path, [("rubber", "city", 1)])
    assert len(facts["images"]) == 3
    assert all(facts["images"].values())
    assert all(path.startswith("//look_files/") for path in facts["images"])
    assert {scene["device"] for scene in facts["scenes"].values()} == {"GPU"}
    # It is the first frame of the other file's timeline; without a GPU, Blender renders it on the CPU.
    task = case.task("rubber", "city", 1)
    same = direct(worker, task).a * 2.0**task.exposure
    np.testing.assert_allclose(pictures["rubber", "city", 1][..., :3], same, rtol=1e-5, atol=1e-6)


def test_another_world_shows_the_jobs_other_light(case: Case, worker: Worker) -> None:
    ours = direct(worker, case.task("rubber", "studio", 5))
    theirs = case.pictures["rubber", "studio", 5][..., :3]
    # Its map is turned, so its samples are others: as far from either half as these are from each other.
    noise = np.mean((ours.a - ours.b) ** 2)
    assert np.mean((theirs - ours.b) ** 2) < 2.0 * noise
    # Not turned, the picture is another one.
    unturned = direct(worker, case.task("rubber", "studio", 6)).a
    assert np.mean((theirs - unturned) ** 2) > 4.0 * noise
