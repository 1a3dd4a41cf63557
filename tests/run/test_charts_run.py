"""Frames of reference props in a run: the frames that are rendered, and the props in pictures, movies and pages."""

from dataclasses import replace
from pathlib import Path

import batch_case as case
import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.asset import load_asset
from lookdev.codegen.source import ShaderSource
from lookdev.material import Look
from lookdev.output.exr import read_header
from lookdev.output.review.folder import read_version
from lookdev.output.review.pixels import read_pixels
from lookdev.plan import Charts, Plan, Setup, TurntableFrames, build_plan
from lookdev.run.render import RunResult, run_plan
from lookdev.scene import Scene
from lookdev.scene.charts.props import Strip

DOUBT = "grey ball -50 %"
STRIP = Strip("bottom", 0.5, (case.WIDTH, case.HEIGHT))


@pytest.fixture(autouse=True)
def _measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the readings of props, which other tests cover: this worker renders no props."""
    monkeypatch.setattr(Strip, "size_note", lambda self: "")
    monkeypatch.setattr("lookdev.checks.charts.check_charts", lambda *_: ())
    monkeypatch.setattr("lookdev.checks.charts.charts_doubts", lambda readings: [DOUBT])
    monkeypatch.setattr("lookdev.checks.charts.charts_header", lambda readings: {"charts.doubt": DOUBT})


def plan_of(folder: Path, source: str = "props") -> Plan:
    """Return the small job's plan with a setup of props."""
    job = case.make_job(folder)
    task = case.make_plan(job).frames[0].task.scene
    props = replace(task, shaders=(ShaderSource(source, f"shader {source}() {{}}", (), (), source),))
    sampling = job.render.sampling
    scene = Scene.of_look(load_asset(builtin="plane"), Look("gold", ()), task.lights[0], task.resolution)
    look = Setup("gold", "city", scene, task, sampling, exposure=-1.0)
    charts = Setup("charts", "city", scene, props, sampling, is_rotation_invariant=True, exposure=-1.0)
    turns = TurntableFrames(job.turntable, job.output, job.camera.azimuth)
    return build_plan([look], turns, read_header, frame_suffixes=(".png",), charts=Charts((charts,), STRIP))


def run(folder: Path, source: str = "props", **options: object) -> RunResult:
    job = case.make_job(folder)
    options["worker_command"] = case.command(folder)
    return run_plan(plan_of(folder, source), job.outputs, job.render.background, **options)  # type: ignore[arg-type]


def test_props_are_rendered_once_for_each_place_of_the_light(finished: Path, tmp_path: Path) -> None:
    before = {file: file.read_bytes() for file in (tmp_path / "out/gold").glob("city/*.exr")}
    requests = len(case.requests(tmp_path))
    result = run(tmp_path)
    # The light has three positions; all frames of the element turntable share one. No frame of a look is new.
    assert result.rendered == 3
    assert len(case.requests(tmp_path)) == requests + 3
    assert {file: file.read_bytes() for file in before} == before
    props = tmp_path / "out/charts/city"
    assert (props / "element.0001.exr").samefile(props / "element.0004.exr")
    assert sorted(path.name for path in props.glob("*.exr")) == sorted(path.name for path in before)


def test_pictures_show_the_props_over_the_frame(finished: Path, tmp_path: Path) -> None:
    picture = tmp_path / "out/gold/city/element.0002.png"
    plain = oiio.ImageBuf(str(picture)).get_pixels()
    run(tmp_path)
    with_props = oiio.ImageBuf(str(picture)).get_pixels()
    # The fake renders beauty .25 after exposure and alpha .5: twice, props over frame over background.
    behind = np.array([0.5, 0.25, 0.0])
    once = 0.25 + 0.5 * behind
    np.testing.assert_allclose(plain, np.broadcast_to(once, plain.shape), atol=1 / 255)
    np.testing.assert_allclose(with_props, np.broadcast_to(0.25 + 0.5 * once, with_props.shape), atol=1 / 255)


def test_new_props_make_pictures_and_sheets_anew_and_no_frame(tmp_path: Path) -> None:
    run(tmp_path)
    frame = tmp_path / "out/gold/city/element.0001.exr"
    outputs = [frame.with_suffix(".png"), frame.with_name("element.sheet.png")]
    before, times = frame.read_bytes(), [path.stat().st_mtime_ns for path in outputs]
    requests = len(case.requests(tmp_path))
    run(tmp_path)
    assert len(case.requests(tmp_path)) == requests
    assert [path.stat().st_mtime_ns for path in outputs] == times
    run(tmp_path, "others")
    assert len(case.requests(tmp_path)) == requests + 3
    assert frame.read_bytes() == before
    assert all(path.stat().st_mtime_ns > time for path, time in zip(outputs, times, strict=True))


def test_pictures_wait_for_props_that_failed(tmp_path: Path) -> None:
    assert plan_of(tmp_path).frames[0].task.files[0].parent.parent.name == "charts"
    case.misbehave(tmp_path, element_0001=["failed", "failed", "ok"])
    assert [failure.name for failure in run(tmp_path).failures] == ["charts/city/element.0001"]
    folder = tmp_path / "out/gold/city"
    names = ("element.0001.exr", "lighting.0002.png", "element.0001.png", "element.sheet.png")
    assert [(folder / name).exists() for name in names] == [True, True, False, False]
    assert run(tmp_path).exit_code == 0
    assert all((folder / name).exists() for name in names)


def test_a_frame_that_is_chosen_brings_its_props(tmp_path: Path) -> None:
    assert run(tmp_path, only=["gold/city/lighting.0003"]).rendered == 2
    assert (tmp_path / "out/gold/city/lighting.0003.png").exists()
    assert (tmp_path / "out/charts/city/lighting.0003.exr").exists()


def test_a_review_shows_props_and_what_is_wrong_with_them(tmp_path: Path) -> None:
    run(tmp_path)
    version = read_version(tmp_path / "out", tmp_path / "page")
    reels = {reel.key: reel for reel in version.reels}
    assert {look for look, _, _ in reels} == {"charts", "gold"}
    frame = reels["gold", "city", "element"].frames[0]
    assert frame.props_file == tmp_path / "out/charts/city/element.0001.exr"
    assert reels["charts", "city", "element"].frames[0].props_file is None
    # Each picture of props is listed once, under one of its names.
    assert len(version.problems) == 3
    assert version.problems[0].endswith("charts/city/element.0001.exr: grey ball -50 %")
    pixels, alone = read_pixels(frame.file, frame.props_file), read_pixels(frame.file)
    np.testing.assert_allclose(pixels.alpha, 0.75)
    np.testing.assert_allclose(pixels.beauty, 0.25 + 0.5 * 0.25)
    assert pixels.error is not None
    assert alone.error is not None
    # The pixel has half of the frame's noise and all of the props' noise.
    np.testing.assert_allclose(pixels.error, np.sqrt(1.25) * alone.error, rtol=1e-3)
