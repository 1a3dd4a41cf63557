"""`lookdev export blend` without Blender: the exporter's task, the files that it writes, and files after a failure."""

import gc
import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from usd_text import textured

from lookdev.cache import Content
from lookdev.errors import FaultsError, LookdevError, OutputError, RenderError, WorkerError
from lookdev.export import ExportResult
from lookdev.export.blend import blend_task, export_blend, image_names
from lookdev.light import Emission
from lookdev.plan.prepare import JobSetups, read_setups
from lookdev.rendering.blend import BLEND_TASK, BlendImage
from lookdev.scene import Pose

LOOK = '#usda 1.0\n( defaultPrim = "Look" )\n' + textured("Look", file="paint chips.png")
JOB = """output = "out"
asset = { builtin = "plane" }
look = [{ name = "chips", material = "chips.usda" }]
ibl = [
    { name = "tent", builtin = "white", exposure = 1.0, rotation = 30.0 },
    { name = "bright", builtin = "white", exposure = -2.0, rotation = 75.0 },
]
turntable = [{ kind = "element", frames = 4 }, { kind = "lighting", name = "sun", frames = 2, degrees = 90 }]
camera = { azimuth = 10 }
render = { resolution = [16, 16], samples = 4, brdf_samples = 2, background = "ibl" }
outputs = { view = "Raw" }
"""

# An exporter, to which tests append the rest of its program; its last argument is the task.
EXPORTER = """
import json, pathlib, sys, time
task = json.loads(pathlib.Path(sys.argv[-1]).read_text())
def save():
    pathlib.Path(task["file"]).write_bytes(b"BLENDER" + json.dumps(task).encode())
    pathlib.Path(task["file"] + "@").write_bytes(b"as Blender does while it writes")
"""
SAVE = 'save(); print(json.dumps({"notes": ["a note"]}))'
HANG = "import os; pathlib.Path('{}', 'pid').write_text(str(os.getpid())); save(); time.sleep(60)"


@pytest.fixture
def job(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    pixels = np.linspace(0, 255, 4 * 4 * 3).reshape(4, 4, 3).astype(np.uint8)
    oiio.ImageBuf(pixels).write(str(tmp_path / "paint chips.png"))
    (tmp_path / "chips.usda").write_text(LOOK)
    (tmp_path / "job.toml").write_text(JOB)
    return tmp_path / "job.toml"


@pytest.fixture
def prepared(job: Path) -> JobSetups:
    return read_setups(job, backend="nodes")


Export = Callable[..., ExportResult]


@pytest.fixture
def export(job: Path, tmp_path: Path) -> Export:
    """Return a function that exports to ``show/look.blend`` by an exporter with the program `does`."""

    def run(does: str = SAVE, out: str = "show/look.blend", **options: object) -> ExportResult:
        command = (sys.executable, "-c", EXPORTER + does)
        return export_blend(job, tmp_path / out, command=command, **options)  # type: ignore[arg-type]

    return run


def names(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def test_the_task_has_every_pose_of_the_first_light_and_scenes_of_nodes(prepared: JobSetups, tmp_path: Path) -> None:
    images = [BlendImage(Content("a", ".exr"), "files/a.exr")]
    task = blend_task(prepared, tmp_path / "look.blend", images, pack=False)
    assert [(turntable.name, turntable.poses) for turntable in task.turntables] == [
        ("element", tuple(Pose(angle, 20.0) for angle in (350.0, 80.0, 170.0, 260.0))),
        ("sun", (Pose(350.0, 20.0), Pose(350.0, 65.0))),
    ]
    rigs = [(rig.name, rig.strength, rig.turn) for rig in task.rigs]
    assert rigs == [("tent", 2.0, 0.0), ("bright", 0.25, 45.0)]  # turned beyond the first
    assert list(task.scenes) == ["chips"]
    (source,) = task.scenes["chips"].shaders
    assert type(source).__name__ == "NodeSource"
    assert (task.view, task.show_light, task.pack) == ("Raw", True, False)
    packed = replace(task, pack=True)
    assert BLEND_TASK.validate_json(BLEND_TASK.dump_json(packed)) == packed


def test_domes_that_turn_and_others_that_do_not_have_no_common_timeline(prepared: JobSetups, tmp_path: Path) -> None:
    varied = replace(prepared.setups[0].task.lights[0], constant=False)
    lights = [(replace(varied, emission=Emission(turns=turns)),) for turns in (True, False)]
    tasks = [replace(setup.task, lights=pair) for setup, pair in zip(prepared.setups, lights, strict=True)]
    setups = [replace(setup, task=task) for setup, task in zip(prepared.setups, tasks, strict=True)]
    with pytest.raises(RenderError, match="one of the rigs 'tent' and 'bright' turn"):
        blend_task(replace(prepared, setups=setups), tmp_path / "look.blend", [], pack=False)


def test_images_are_named_after_their_originals_tiles_one_by_one(job: Path) -> None:
    def names_of(look: str) -> list[str]:
        job.with_name("chips.usda").write_text(look)
        gc.collect()  # USD keeps a layer as it was read while a stage of it is left
        called = image_names(read_setups(job, backend="nodes"))
        assert all(image.path.is_file() for image in called)
        assert len(set(called.values())) == len(called)
        return sorted(name.rpartition("-")[0] for name in called.values())

    # Both lights are the same image: its name is the first one's.
    assert names_of(LOOK) == ["paint_chips", "tent"]
    for number in (1001, 1012):
        tile = np.full((4, 4, 3), number % 100, np.uint8)
        oiio.ImageBuf(tile).write(str(job.with_name(f"rust.{number}.png")))
    assert names_of(LOOK.replace("paint chips.png", "rust.<UDIM>.png")) == ["rust.1001", "rust.1012", "tent"]


def test_images_are_placed_beside_the_file_which_a_second_export_replaces(export: Export, tmp_path: Path) -> None:
    folder = tmp_path / "show"
    assert export(pack=True).files == (folder / "look.blend",)
    assert names(folder) == ["look.blend"]
    exported = export()
    assert exported.files[0] == folder / "look.blend"
    assert exported.notes == ("a note",)
    assert set(exported.files) == {folder / name for name in names(folder)}
    task = json.loads(exported.files[0].read_bytes().removeprefix(b"BLENDER"))
    for image in task["images"]:
        assert (folder / image["path"]).read_bytes() == Content(**image["content"]).path.read_bytes()
        assert image["path"].startswith("look_files/")
    for part in (str(folder / "look.blend"), "MB", "chips", "tent", "bright", "'nodes'", "look_files"):
        assert part in exported.text
    before = names(folder)
    with pytest.raises(RenderError):
        export('print(json.dumps({"error": "no"}))')
    assert names(folder) == before
    export("pathlib.Path(task['file']).write_bytes(b'BLENDER 2'); print('{}')")
    assert (folder / "look.blend").read_bytes() == b"BLENDER 2"
    assert names(folder) == before


@pytest.mark.parametrize(
    ("does", "error", "message"),
    [
        ('print(json.dumps({"error": "look \'chips\' cannot be built"}))', RenderError, "look 'chips' cannot be built"),
        ('save(); print(json.dumps({"error": "late"}))', RenderError, "late"),
        ("sys.exit('Blender is not here')", WorkerError, "exit code 1: Blender is not here"),
        ("print('{}')", WorkerError, "without an error, and without"),
        ("print('Info: saved')", WorkerError, "exit code 0"),
    ],
)
def test_a_failure_leaves_what_was_there(
    does: str, error: type[Exception], message: str, export: Export, tmp_path: Path
) -> None:
    file = tmp_path / "show" / "look.blend"
    file.parent.mkdir()
    file.write_bytes(b"BLENDER before")
    with pytest.raises(error, match=message):
        export(does)
    assert list(file.parent.iterdir()) == [file]
    assert file.read_bytes() == b"BLENDER before"


@pytest.mark.both_pythons
def test_an_exporter_that_hangs_is_killed(export: Export, tmp_path: Path) -> None:
    started = time.monotonic()
    with pytest.raises(WorkerError, match="silent for 1 s"):
        export(HANG.format(tmp_path), timeout=1.0)
    assert time.monotonic() - started < 20.0
    assert not Path("/proc", (tmp_path / "pid").read_text()).exists()
    assert names(tmp_path / "show") == []


def test_ctrl_c_ends_the_exporter_and_leaves_nothing(
    export: Export, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> tuple[bytes, bytes]:
        while not list((tmp_path / "show").glob(".look*/look.blend@")):
            time.sleep(0.01)
        raise KeyboardInterrupt

    monkeypatch.setattr("subprocess.Popen.communicate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        export(HANG.format(tmp_path))
    assert not Path("/proc", (tmp_path / "pid").read_text()).exists()
    assert names(tmp_path / "show") == []


@pytest.mark.parametrize(
    ("out", "error", "message"),
    [
        ("look.usd", LookdevError, "look.blend would be right"),
        ("look", LookdevError, "look.blend would be right"),
        ("folder.blend", OutputError, "is a folder"),
        ("job.toml/look.blend", OutputError, "job.toml"),
    ],
)
def test_a_file_that_cannot_be_written(
    out: str, error: type[Exception], message: str, export: Export, tmp_path: Path
) -> None:
    (tmp_path / "folder.blend").mkdir()
    with pytest.raises(error, match=message):
        export(out=out)


def test_all_faults_of_a_job_are_reported(tmp_path: Path, job: Path, export: Export) -> None:
    job.write_text(JOB.replace('builtin = "plane"', 'builtin = "plain"').replace("frames = 4", "frame = 4"))
    with pytest.raises(FaultsError, match=r"(?s)did you mean 'plane'.*did you mean 'frames'"):
        export()
    assert not (tmp_path / "show").exists()


def test_a_program_that_is_not_there(job: Path, tmp_path: Path) -> None:
    with pytest.raises(WorkerError, match="cannot be started"):
        export_blend(job, tmp_path / "look.blend", command=(str(tmp_path / "none"),))
    assert not (tmp_path / "look_files").exists()
