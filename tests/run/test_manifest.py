"""The manifest: its content after a run, and its verification."""

import json
import os
import shlex
from pathlib import Path

import batch_case as case
import numpy as np
import OpenImageIO as oiio
import pytest
from usd_text import mtlx

from lookdev.cache import file_digest
from lookdev.errors import LookdevError, OutputError
from lookdev.job import load_job, parse_job
from lookdev.output.exr import read_header
from lookdev.output.manifest import read_manifest
from lookdev.run.manifest import input_files, record_run, verify_manifest
from lookdev.shipped import shipped_folder


def record(folder: Path, **options: object) -> Path:
    """Run the small job, write its manifest, and return its output."""
    job = case.make_job(folder)
    case.run(folder, job, **options)
    record_run(job, case.make_plan(job))
    return job.output


@pytest.fixture
def out(finished: Path) -> Path:
    """Return the output of the finished job with its manifest."""
    return record(finished)


def test_a_manifest_lists_inputs_frames_and_pictures_by_hash(out: Path, tmp_path: Path) -> None:
    manifest = read_manifest(out)
    assert manifest["planned"] == len(manifest["frames"]) == 7
    assert json.loads((out / "manifest.json").read_text())["format"] == 1
    for kind, base in (("frames", out), ("pictures", out), ("inputs", Path("/"))):
        for entry in manifest[kind]:
            assert entry["sha256"] == file_digest(base / entry["file"])
    assert {Path(entry["file"]).name for entry in manifest["inputs"]} == {"job.toml", "gold.usda"}
    on_disk = {path.relative_to(out).as_posix() for path in out.rglob("*.png")}
    assert {entry["file"] for entry in manifest["pictures"]} == on_disk
    frame = manifest["frames"][1]
    assert frame["header"] == read_header(out / frame["file"])
    assert set(frame["header"]) >= {"digest", "samples", "seconds", "relmse", "time", "version.blender"}
    words = shlex.split(frame["command"])
    assert words == ["lookdev", "render", str(tmp_path / "job.toml"), "--force", "--frame", "gold/city/element.0002"]
    assert manifest["settings"]["outputs"]["view"] == "Raw"


def test_the_shipped_jobs_name_all_their_files() -> None:
    files = {path.name for path in input_files(load_job(shipped_folder() / "jobs" / "parts.toml"))}
    assert {"parts.toml", "toy_car.usda"} <= files
    assert any(name.endswith(".png") for name in files)


def test_a_run_that_changes_nothing_leaves_the_manifest_and_reads_no_file(
    out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = case.make_job(tmp_path)
    plan = case.make_plan(job)
    record_run(job, plan)
    before = (out / "manifest.json").stat().st_mtime_ns
    monkeypatch.setattr("lookdev.run.manifest.file_digest", lambda file: pytest.fail(f"{file} is read"))
    record_run(job, plan)
    assert (out / "manifest.json").stat().st_mtime_ns == before
    monkeypatch.undo()
    whole = (out / "manifest.json").read_bytes()
    (out / ".lookdev" / "digests.json").write_text("{")  # damaged: made again
    record_run(job, plan)
    assert (out / "manifest.json").read_bytes() == whole


def test_a_run_that_was_interrupted_lists_what_is_there(tmp_path: Path) -> None:
    (tmp_path / "job.toml").touch()
    case.misbehave(tmp_path, lighting_0002=["failed"])
    manifest = read_manifest(record(tmp_path))
    assert (manifest["planned"], len(manifest["frames"])) == (7, 6)
    case.misbehave(tmp_path)
    assert len(read_manifest(record(tmp_path))["frames"]) == 7


def test_verification_names_what_is_missing_changed_and_not_listed(out: Path, tmp_path: Path) -> None:
    assert verify_manifest(out)[1] == ()
    frame, picture = out / "gold" / "city" / "element.0001.exr", out / "gold" / "city" / "element.0002.png"
    frame.rename(frame.with_name("other.0001.exr"))
    os.truncate(picture, 20)
    (tmp_path / "gold.usda").write_text("# another look")
    assert {(inputs.state, inputs.kind, inputs.file.name, inputs.is_failure) for inputs in verify_manifest(out)[1]} == {
        ("missing", "frame", "element.0001.exr", True),
        ("changed", "picture", "element.0002.png", True),
        ("changed", "input", "gold.usda", True),
        ("unlisted", "frame", "other.0001.exr", False),
    }


@pytest.mark.parametrize("text", [None, "", "{", "[]", '{"format": 2}', '{"format": 1, "frames": [{}]}'])
def test_a_manifest_that_is_missing_or_spoilt_is_an_error(out: Path, text: str | None) -> None:
    file = out / "manifest.json"
    file.unlink()
    if text is not None:
        file.write_text(text)
    with pytest.raises(OutputError, match=r"lookdev render"):
        verify_manifest(out)


def test_the_command_of_a_frame_renders_it_alone(out: Path, tmp_path: Path) -> None:
    before = {path.name: path.stat().st_mtime_ns for path in out.rglob("[!.]*.exr")}
    requests = len(case.requests(tmp_path))
    record(tmp_path, force=True, only=["gold/city/lighting.0002"])
    assert case.requests(tmp_path)[requests:] == ["lighting.0002.exr"]
    after = {path.name: path.stat().st_mtime_ns for path in out.rglob("[!.]*.exr")}
    assert {name for name in after if after[name] != before[name]} == {"lighting.0002.exr"}
    assert verify_manifest(out)[1] == ()
    for name in ("element.0003", "lighting.0003"):
        (out / "gold" / "city" / f"{name}.exr").unlink()
    case.run(tmp_path, only=["gold/city/lighting.0003"])
    assert case.requests(tmp_path)[requests + 1 :] == ["lighting.0003.exr"]
    with pytest.raises(LookdevError, match=r"no frame 'gold/city/lighting.9' .did you mean"):
        case.run(tmp_path, only=["gold/city/lighting.9"])


@pytest.mark.parametrize("through", ["x.mtlx", "look.usda"])
def test_what_a_materialx_document_reads_is_an_input(through: str, tmp_path: Path) -> None:
    (tmp_path / "maps").mkdir()
    for tile in (1001, 1002):
        oiio.ImageBuf(np.full((2, 2, 3), 0.5, np.float32)).write(str(tmp_path / "maps" / f"color.{tile}.png"))
    (tmp_path / "x.mtlx").write_text(mtlx("maps/color.&lt;UDIM&gt;.png"))
    (tmp_path / "look.usda").write_text('#usda 1.0\ndef "M" (references = @x.mtlx@</MaterialX/Materials/Paint>) {}\n')
    text = case.JOB.replace("gold.usda", through) + case.TURNTABLES + case.RENDER
    inputs = {file.relative_to(tmp_path).as_posix() for file in input_files(parse_job(text, tmp_path / "job.toml"))}
    assert inputs == {"job.toml", "x.mtlx", "maps/color.1001.png", "maps/color.1002.png"} | {through}
