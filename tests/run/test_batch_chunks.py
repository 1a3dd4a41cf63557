"""Chunks of a job in one output folder, their costs, and the status of a job that several runs render."""

import io
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import batch_case as case
import pytest

from lookdev.errors import LookdevError, OutputError
from lookdev.output.exr import read_header
from lookdev.plan.chunks import Chunk, Division, plan_of_part, split_frames
from lookdev.plan.costs import estimate_costs, measure_costs
from lookdev.run.chunks import chunk_summaries, chunks_text, plan_of_chunk, store_measured_chunks
from lookdev.run.events import Event, FrameDone, FrameFound, RunEnded
from lookdev.run.progress import JsonReport
from lookdev.run.render import RunResult
from lookdev.run.runs import Run, claim_key, read_claims
from lookdev.run.status import read_status, status_data, status_metrics, status_text

METRIC = r"^(lookdev_\w+)\{[^}]*?(?:state=\"(\w+)\")?\} (.*)"
FRAMES = ["element.0001", "element.0002", "element.0003", "element.0004", "lighting.0002", "lighting.0003"]
RenderFile = Callable[..., RunResult]


def test_the_parts_of_a_plan_are_all_of_it_whatever_is_done(tmp_path: Path) -> None:
    def parts() -> list[tuple[Path, ...]]:
        plan = case.make_plan(case.make_job(tmp_path))
        ends = split_frames([id(frame.task.scene) for frame in plan.frames], estimate_costs(plan), Division(3))
        divided = [plan_of_part(plan, ends, number) for number in (1, 2, 3)]
        assert [frame.task.files for part in divided for frame in part.frames] == [f.task.files for f in plan.frames]
        assert all(not part.reels and not part.sheets for part in divided)
        return [tuple(frame.task.files[0] for frame in part.frames) for part in divided]

    before = parts()
    case.run(tmp_path, only=("gold/city/element.0002", "gold/city/lighting.0003"))
    assert parts() == before


def test_costs_are_measured_where_frames_are(tmp_path: Path) -> None:
    job = case.make_job(tmp_path)
    case.run(tmp_path, only=("gold/city/element.0002",))
    assert measure_costs(case.make_plan(job)).frames == (0.125,) * 6  # the fake's time, for all frames of the scene
    # A frame of twice the samples is expected to take twice the time.
    finer = case.make_job(tmp_path, render=case.RENDER.replace("samples = 8", "samples = 16"))
    assert measure_costs(case.make_plan(finer)).frames == (0.25,) * 6


def test_chunks_render_their_frames_and_the_last_step_all_outputs(tmp_path: Path, render_file: RenderFile) -> None:
    results = [render_file(chunk=Chunk(number, Division(2))) for number in (2, 1)]
    assert [(entry.total, entry.done, entry.rendered) for entry in results] == [(3, 3, 3)] * 2
    assert len(case.requests(tmp_path)) == 6
    assert not list((tmp_path / "out").glob("*/*/*.sheet.png"))
    assert not (tmp_path / "out" / "manifest.json").exists()
    result = render_file(outputs_only=True)
    assert (result.exit_code, result.done, result.rendered) == (0, 6, 0)
    assert len(list((tmp_path / "out").glob("*/*/*.sheet.png"))) == 2
    assert len(json.loads((tmp_path / "out" / "manifest.json").read_text())["frames"]) == 7
    state = {path.name for path in (tmp_path / "out" / ".lookdev").iterdir()}
    assert state == {"digests.json", "pictures.json", "plan.json", "worker.log"}


def test_the_last_step_lists_frames_that_are_missing(tmp_path: Path, render_file: RenderFile) -> None:
    render_file(chunk=Chunk(1, Division(2)))
    result = render_file(outputs_only=True)
    assert (result.exit_code, result.done) == (1, 3)
    assert "3 of 6 frames are not rendered yet: gold/city/element.0004, gold/city/lighting.0002" in result.summary()
    assert (render_file().exit_code, len(case.requests(tmp_path))) == (0, 6)
    assert [render_file(chunk=Chunk(number, Division(9))).total for number in (6, 9)] == [1, 0]


def test_a_frame_that_another_run_has_rendered_meanwhile_is_found(tmp_path: Path, render_file: RenderFile) -> None:
    events: list[Event] = []

    def report(event: Event) -> None:
        if isinstance(event, FrameDone):  # its claim has ended
            claims = [key for keys in read_claims(tmp_path / "out" / ".lookdev").values() for key in keys]
            assert claim_key(event.name) not in claims
        if isinstance(event, FrameDone) and not any(isinstance(entry, FrameDone) for entry in events):
            render_file(chunk=Chunk(2, Division(2)))  # another run, during this run
        events.append(event)

    result = render_file(report=report)
    assert (result.done, result.rendered) == (6, 3)
    assert [event.name for event in events if isinstance(event, FrameFound)] == [f"gold/city/{n}" for n in FRAMES[3:]]
    assert len(case.requests(tmp_path)) == 6
    assert events[-1] == RunEnded(6, 6, 3, 0, 0, interrupted=False)


def test_measured_chunks_are_kept_until_all_is_done(tmp_path: Path, render_file: RenderFile) -> None:
    plan = case.make_plan(case.make_job(tmp_path))
    with pytest.raises(LookdevError, match="no frame of the job is rendered, so no time of a frame is known"):
        store_measured_chunks(plan, Division(2))
    render_file(only=("gold/city/element.0001",))
    assert read_header(tmp_path / "out/gold/city/element.0001.exr")["seconds"] == "0.125"
    # As if the first frame took as long as all others.
    slow = replace(plan.frames[0])
    slow.__dict__["files"] = (replace(plan.frames[0].files[0], seconds=1.0),)
    uneven = replace(plan, frames=(slow, *plan.frames[1:]))
    for frame in uneven.frames[1:]:
        frame.__dict__["files"] = (replace(frame.files[0], seconds=0.2),)
    store_measured_chunks(uneven, Division(2))
    again = case.make_plan(case.make_job(tmp_path))
    assert [len(plan_of_chunk(again, Chunk(number, Division(2))).frames) for number in (1, 2)] == [1, 5]
    assert [entry.frames for entry in chunk_summaries(again, Division(2))] == [1, 5]
    assert "gold/city/lighting.0003" in chunks_text(again, Division(2)).splitlines()[2]
    with Run(tmp_path / "out", "1/2"), pytest.raises(OutputError, match="renders chunk 1/2 of the division"):
        store_measured_chunks(again, Division(2))
    assert [render_file(chunk=Chunk(number, Division(2))).total for number in (1, 2)] == [1, 5]
    render_file()
    assert [len(plan_of_chunk(again, Chunk(number, Division(2))).frames) for number in (1, 2)] == [3, 3]


def test_the_status_of_a_job_that_runs_render(tmp_path: Path, render_file: RenderFile) -> None:
    with pytest.raises(OutputError, match="no run of 'lookdev render' has recorded a plan there"):
        read_status(tmp_path / "out")
    case.misbehave(tmp_path, element_0002=["failed"])
    render_file(chunk=Chunk(1, Division(2)))
    status = read_status(tmp_path / "out")
    assert (status.total, status.done, status.rendering, status.waiting, status.seconds) == (6, 2, 0, 3, None)
    assert [(e.name, e.reason) for e in status.failed] == [("gold/city/element.0002", "no such attribute 'st2'")]
    claimed = {"gold/city/element.0004", "gold/city/element.0002"}
    with Run(tmp_path / "out", "2/2") as run:
        assert all(map(run.claim, claimed))
        status = read_status(tmp_path / "out")
    assert (status.done, status.rendering, status.waiting, status.failed) == (2, 2, 2, ())
    (active,) = status.runs
    assert (active.run.part, active.state, set(active.frames)) == ("2/2", "working", claimed)
    assert status.seconds == pytest.approx(4 * 0.125 / 2)
    assert status.frame_seconds == pytest.approx(0.125)
    metrics = {
        (name, label): float(value) for name, label, value in re.findall(METRIC, status_metrics(status), re.MULTILINE)
    }
    states = {"frames": {"done": 2.0, "rendering": 2.0, "waiting": 2.0, "failed": 0.0}}
    states["runs"] = {"working": 1.0, "stalled": 0.0, "dead": 0.0}
    counts = {(f"lookdev_{kind}", state): value for kind in states for state, value in states[kind].items()}
    assert metrics == counts | {("lookdev_frame_seconds", ""): 0.125, ("lookdev_left_seconds", ""): 0.25}
    assert "2 of 6 frames are done (33.3 %), 2 are rendered now, 2 wait, 0 failed" in status_text(status)
    assert json.loads(json.dumps(status_data(status)))["runs"][0]["run"]["process"] == active.run.process
    (tmp_path / "behaviour.json").unlink()
    render_file()
    status = read_status(tmp_path / "out")
    assert (status.done, status.failed, status.runs) == (6, (), ())


@pytest.mark.both_pythons
def test_the_status_names_what_is_dead(tmp_path: Path, render_file: RenderFile) -> None:
    render_file(chunk=Chunk(1, Division(3)))
    with case.hold_frame(tmp_path / "out", "gold/city/element.0003") as other:
        other.kill()
    status = read_status(tmp_path / "out")
    assert [(entry.state, entry.frames) for entry in status.runs] == [("dead", ("gold/city/element.0003",))]
    assert (status.rendering, status.waiting) == (0, 4)
    assert "no run is at work; 'lookdev render" in status_text(status)


def test_events_are_lines_of_json_with_the_id_of_the_frame(tmp_path: Path, render_file: RenderFile) -> None:
    stream = io.StringIO()
    case.misbehave(tmp_path, element_0002=["die", "ok"], element_0003=["failed"])
    render_file(chunk=Chunk(1, Division(2)), report=JsonReport(stream))
    lines = [json.loads(line) for line in stream.getvalue().splitlines()]
    kinds = [line["event"] for line in lines]
    assert (kinds[0], kinds[1], kinds[-1]) == ("run_joined", "run_started", "run_ended")
    assert all({"time", "level", "host", "process", "run", "chunk"} <= line.keys() for line in lines)
    done = {line["frame"]: line for line in lines if line["event"] == "frame_done"}
    assert done.keys() == {"gold/city/element.0001", "gold/city/element.0002"}
    for name, line in done.items():
        assert line["id"] == read_header(tmp_path / "out" / f"{name}.exr")["digest"]
        assert line["id"] in (tmp_path / "out/.lookdev/worker.1-2.log").read_text()
    levels = {line["event"]: line["level"] for line in lines}
    assert (levels["frame_retried"], levels["frame_failed"], levels["frame_done"]) == ("warning", "error", "info")
