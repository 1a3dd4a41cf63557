"""Plans: which frames, which files, in which order, and why."""

import os
from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path

import pytest

from lookdev.errors import OutputError
from lookdev.job import Job
from lookdev.plan import Plan, PlannedFile, Setup, TurntableFrames, build_plan
from lookdev.plan.plan import Copy
from lookdev.rendering.task import FrameTask, SceneTask
from lookdev.scene import Pose

Scenes = dict[tuple[str, str], SceneTask]
MakeJob = Callable[..., Job]
PlanOf = Callable[..., Plan]


class Disk:
    """Frames on disk: an empty file for each, and its header in memory."""

    def __init__(self) -> None:
        self.headers: dict[Path, dict[str, str] | None] = {}

    def read_header(self, path: Path) -> dict[str, str] | None:
        if path not in self.headers:
            raise OutputError("truncated")
        return self.headers[path]

    def write(self, task: FrameTask, *files: Path, png: bool = True) -> None:
        for path in files or task.files:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()
            resolution = "{} x {}".format(*task.scene.resolution)
            self.headers[path] = task.labels | {"digest": task.digest, "resolution": resolution}
            if png:
                path.with_suffix(".png").write_bytes(b"a picture")

    def finish(self, plan: Plan) -> None:
        for task in plan.pending():
            self.write(task)


@pytest.fixture
def disk() -> Disk:
    return Disk()


@pytest.fixture
def scenes(scene: SceneTask) -> Scenes:
    def variant(look: str, ibl: str) -> SceneTask:
        shaders = (replace(scene.shaders[0], digest=look),)
        return replace(scene, shaders=shaders, lights=(replace(scene.lights[0], map_digest=ibl),))

    return {(look, ibl): variant(look, ibl) for look in ("gold", "paint") for ibl in ("city", "studio")}


@pytest.fixture
def plan_of(disk: Disk, scenes: Scenes, make_job: MakeJob, make_setups: Callable[..., list[Setup]]) -> PlanOf:
    """Return a function that plans a job, or one with text appended, of which some scenes look the same all around."""

    def plan(job_or_text: Job | str = "", around: Collection[tuple[str, str]] = ()) -> Plan:
        job = make_job(job_or_text) if isinstance(job_or_text, str) else job_or_text
        setups = make_setups(job, scenes, around)
        turns = TurntableFrames(job.turntable, job.output, job.camera.azimuth)
        return build_plan(
            setups, turns, disk.read_header, labels={"job": "a job"}, frame_suffixes=job.outputs.frame_suffixes
        )

    return plan


def planned(plan: Plan, path: Path) -> PlannedFile:
    (file,) = (file for frame in plan.frames for file in frame.files if file.path == path)
    return file


def test_a_new_job_renders_every_pose_once_look_by_look(make_job: MakeJob, plan_of: PlanOf) -> None:
    job = make_job()
    plan = plan_of(job)
    pending = plan.pending()
    # element 0, 90, 180, 270 and lighting 120, 240: pose 0 is shared, so 6 poses show 7 frames.
    assert [(task.labels["look"], task.labels["ibl"]) for task in pending] == [
        (look, ibl) for look in ("gold", "paint") for ibl in ("city", "studio") for _ in range(6)
    ]
    assert plan.counts == {"done": 0, "stale": 0, "new": 28}
    assert (plan.copies(), plan.pictures) == ((), ())
    shared = pending[0]
    folder = job.output / "gold" / "city"
    assert shared.files == (folder / "element.0001.exr", folder / "lighting.0001.exr")
    assert shared.pose == Pose(0.0, 0.0)
    assert shared.labels["turntable"] == "element, lighting"
    assert shared.labels["job"] == "a job"
    assert (shared.exposure, pending[6].exposure) == (0.5, 0.0)
    assert len({task.digest for task in pending}) == 24
    assert planned(plan, shared.files[0]) == PlannedFile(shared.files[0], "new", "no file")


def test_a_pose_that_one_turntable_shows_twice_is_one_frame(make_job: MakeJob, plan_of: PlanOf) -> None:
    job = make_job('[[turntable]]\nname = "twice"\nkind = "element"\nframes = 2\ndegrees = 720\n')
    plan = plan_of(job)
    stems = [path.stem for path in plan.frames[0].task.files]
    assert stems == ["element.0001", "lighting.0001", "twice.0001", "twice.0002"]
    assert plan.frames[0].task.labels["turntable"] == "element, lighting, twice"


def test_turning_what_is_the_same_all_around_is_one_frame(make_job: MakeJob, plan_of: PlanOf) -> None:
    job = make_job("[camera]\nazimuth = 30\n")
    plan = plan_of(job, {("gold", "city")})
    frames = [frame.task for frame in plan.frames]
    assert [task.labels["look"] + task.labels["ibl"] for task in frames].count("goldcity") == 3
    assert len(frames) == 3 + 3 * 6
    # The light stays where it was as seen from the camera, 30 degrees back, and turns with its own turntable.
    assert [task.pose for task in frames[:3]] == [Pose(0.0, 330.0), Pose(0.0, 90.0), Pose(0.0, 210.0)]
    elements = [f"element.000{n}.exr" for n in (1, 2, 3, 4)]
    assert [path.name for path in frames[0].files] == [*elements, "lighting.0001.exr"]
    assert (frames[0].labels["pose.element"], frames[0].labels["pose.lighting"]) == ("0.0", "330.0")
    assert frames[0].labels["turntable"] == "element, lighting"
    # Every file of a job is in its plan, once.
    rows = [(look.name, ibl.name, turntable) for look in job.look for ibl in job.ibl for turntable in job.turntable]
    files = [path for row in rows for path in TurntableFrames(job.turntable, job.output).files(*row)]
    assert sorted(path for task in frames for path in task.files) == sorted(files)


def test_turning_a_light_that_is_constant_is_one_frame(make_job: MakeJob, scenes: Scenes, plan_of: PlanOf) -> None:
    job = make_job("[camera]\nazimuth = 30\n")
    for key in (("gold", "studio"), ("paint", "studio")):
        scenes[key] = replace(scenes[key], lights=(replace(scenes[key].lights[0], constant=True),))

    def planned_poses(look: str, ibl: str) -> dict[Pose, list[str]]:
        tasks = [frame.task for frame in plan_of(job, {("gold", "studio")}).frames]
        of_scene = [task for task in tasks if (task.labels["look"], task.labels["ibl"]) == (look, ibl)]
        return {task.pose: [path.stem for path in task.files] for task in of_scene}

    lighting = [f"lighting.000{number}" for number in (1, 2, 3)]
    # The asset turns on, and the whole lighting turntable is its first frame.
    assert planned_poses("paint", "studio") == {
        Pose(330.0, 0.0): ["element.0001", *lighting],
        Pose(60.0, 0.0): ["element.0002"],
        Pose(150.0, 0.0): ["element.0003"],
        Pose(240.0, 0.0): ["element.0004"],
    }
    elements = [f"element.000{number}" for number in (1, 2, 3, 4)]
    assert planned_poses("gold", "studio") == {Pose(0.0, 0.0): elements + lighting}
    assert len(planned_poses("paint", "city")) == 6


def test_one_frame_of_many_files_resumes_as_any_other(scenes: Scenes, disk: Disk, plan_of: PlanOf) -> None:
    around = {("gold", "city")}
    task = plan_of("", around).pending()[0]
    disk.write(task, *task.files[1:3])
    plan = plan_of("", around)
    assert task not in plan.pending()
    assert plan.copies() == tuple(Copy(task.files[1], path) for path in (task.files[0], *task.files[3:]))
    disk.write(task)
    assert plan_of("", around).copies() == ()
    scenes["gold", "city"] = replace(scenes["gold", "city"], resolution=(8, 8))
    plan = plan_of("", around)
    assert plan.pending()[0].files == task.files
    assert {planned(plan, path).reason for path in task.files} == {"render changed"}


def test_frames_once_rendered_pose_by_pose_are_not_rendered_again(disk: Disk, plan_of: PlanOf) -> None:
    """For instance of a look that has lost its texture, and is now the same all around."""
    disk.finish(plan_of())
    plan = plan_of("", {("gold", "city")})
    assert plan.pending() == ()
    first, *others = (path for path in plan.frames[0].task.files if path.stem.startswith("element"))
    assert plan.copies() == tuple(Copy(first, path) for path in others)
    assert planned(plan, others[0]).reason == "pose changed"


def test_a_finished_job_has_nothing_to_do_a_changed_look_is_stale(scenes: Scenes, disk: Disk, plan_of: PlanOf) -> None:
    disk.finish(plan_of())
    again = plan_of()
    assert again.counts == {"done": 28, "stale": 0, "new": 0}
    assert (again.pending(), again.copies(), again.pictures) == ((), (), ())
    for key in (("paint", "city"), ("paint", "studio")):
        scenes[key] = replace(scenes[key], shaders=(replace(scenes[key].shaders[0], digest="new"),))
    plan = plan_of()
    assert {task.labels["look"] for task in plan.pending()} == {"paint"}
    assert plan.counts == {"done": 14, "stale": 14, "new": 0}
    assert {file.reason for frame in plan.frames for file in frame.files} == {"", "look changed"}


def test_several_changes_are_all_named(scenes: Scenes, disk: Disk, plan_of: PlanOf) -> None:
    task = plan_of().pending()[0]
    disk.write(task)
    scene = scenes["gold", "city"]
    scenes["gold", "city"] = replace(scene, resolution=(8, 8), lights=(replace(scene.lights[0], map_digest="new"),))
    plan = plan_of("[camera]\nazimuth = 1\n")
    assert planned(plan, task.files[0]).reason == "light, pose, render changed"


@pytest.mark.parametrize(
    ("header", "reason"),
    [
        (lambda written: {}, "not written by lookdev"),
        (lambda written: None, "not written by lookdev"),
        (None, "damaged"),
        (lambda written: written | {"resolution": "1 x 1"}, "pixels of another size"),
    ],
)
def test_files_that_are_not_frames_of_the_plan_are_stale(
    disk: Disk, plan_of: PlanOf, header: Callable[[dict[str, str]], dict[str, str] | None] | None, reason: str
) -> None:
    task = plan_of().pending()[0]
    disk.write(task)
    for path in task.files:
        written = disk.headers.pop(path)
        if header is not None:
            disk.headers[path] = header(written)
    plan = plan_of()
    assert planned(plan, task.files[0]) == PlannedFile(task.files[0], "stale", reason)
    assert plan.counts["stale"] == len(task.files)
    assert plan.pending()[0] == task


def test_a_frame_done_under_another_name_is_copied(disk: Disk, plan_of: PlanOf) -> None:
    task = plan_of().pending()[0]
    first, second = task.files
    disk.write(task, first)
    plan = plan_of()
    assert task not in plan.pending()
    assert plan.copies() == (Copy(first, second),)
    assert plan.pictures == (second.with_suffix(".png"),)


def test_pictures_that_are_missing_older_or_none_are_due(disk: Disk, plan_of: PlanOf) -> None:
    tasks = plan_of().pending()[1:6]
    for task in tasks:
        disk.write(task, png=task is not tasks[1])
    _, (missing,), (older,), (empty,), (folder,) = (task.files for task in tasks)
    os.utime(older.with_suffix(".png"), (0, 0))
    written = tasks[0].files[0].stat()
    os.utime(
        tasks[0].files[0].with_suffix(".png"), ns=(written.st_atime_ns, written.st_mtime_ns)
    )  # as old is not older
    empty.with_suffix(".png").write_bytes(b"")
    folder.with_suffix(".png").unlink()
    folder.with_suffix(".png").mkdir()
    plan = plan_of()
    assert plan.counts["done"] == 5
    assert plan.pictures == tuple(path.with_suffix(".png") for path in (missing, older, empty, folder))
    assert plan_of("[outputs]\npng = false\n").pictures == ()


def test_the_background_renders_nothing_again(plan_of: PlanOf) -> None:
    assert plan_of().pending()[0] == plan_of("[render]\nbackground = [0.1, 0.2, 1]\n").pending()[0]
