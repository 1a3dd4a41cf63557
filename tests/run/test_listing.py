from dataclasses import asdict, replace
from pathlib import Path

import batch_case as case

from lookdev.plan.skips import Skip
from lookdev.run.listing import LINKED_REASON, FrameRange, plan_data, plan_ranges, plan_text


def test_states_and_reasons_split_a_range(finished: Path) -> None:
    for name in ("element.0002.exr", "lighting.0001.exr", "lighting.0003.png"):
        (finished / "out" / "gold" / "city" / name).unlink()
    job = case.make_job(finished)
    assert plan_text(case.make_plan(job)).splitlines() == [
        "turntable           frames     state  reason",
        "gold/city/element   0001       done",
        "gold/city/element   0002       new    no file",
        "gold/city/element   0003-0004  done",
        f"gold/city/lighting  0001       new    {LINKED_REASON}",
        "gold/city/lighting  0002-0003  done",
        "1 of 6 frames to render (files: 5 done, 0 stale, 2 new)",
        "2 pictures to make from frames that are done",
    ]


def test_consecutive_frames_in_one_state_are_one_line_and_a_changed_look_is_a_reason(finished: Path) -> None:
    job = case.make_job(finished)
    job = job.model_copy(update={"output": finished / "other"})
    assert list(plan_ranges(case.make_plan(job))) == [
        FrameRange("gold/city/element", "0001", "0004", 4, "new", "no file"),
        FrameRange("gold/city/lighting", "0001", "0003", 3, "new", "no file"),
    ]
    job = case.make_job(finished, '[[turntable]]\nkind = "element"\nframes = 4\n[camera]\nelevation = 20.0\n')
    (part,) = plan_ranges(case.make_plan(job))
    assert (part.first, part.last, part.state) == ("0001", "0004", "stale")
    assert "changed" in part.reason


def test_the_data_names_every_file(tmp_path: Path) -> None:
    job = case.make_job(tmp_path)
    case.run(tmp_path, case.make_job(tmp_path, '[[turntable]]\nkind = "element"\nframes = 4\n'))
    data = plan_data(case.make_plan(job), job.output)
    assert data["output"] == str(tmp_path / "out")
    assert data["render"] == 2
    assert data["links"] == [{"source": "gold/city/element.0001.exr", "target": "gold/city/lighting.0001.exr"}]
    assert data["pictures"] == ["gold/city/lighting.0001.png"]
    files = data["files"]
    assert isinstance(files, list)
    assert len(files) == 7
    assert files[-1]["path"] == "gold/city/lighting.0003.exr"
    assert (files[-1]["state"], files[-1]["element"], files[-1]["lighting"]) == ("new", 0.0, 240.0)


def test_skips_are_listed_scene_by_scene(tmp_path: Path) -> None:
    job = case.make_job(tmp_path)
    plan = case.make_plan(job)
    assert plan_data(plan, job.output)["skipped"] == []
    skips = (
        Skip("gold", "city", "bounces", "convex asset"),
        Skip("gold", "city", "1 texture", "reaches no pixel"),
        Skip("gold", "white", "light samples", "constant light"),
    )
    plan = replace(plan, skips=skips)
    assert plan_text(plan).splitlines()[-3:] == [
        "gold/city skipped: bounces (convex asset), 1 texture (reaches no pixel)",
        "gold/white skipped: light samples (constant light)",
        "6 of 6 frames to render (files: 0 done, 0 stale, 7 new)",
    ]
    assert plan_data(plan, job.output)["skipped"] == [asdict(skip) for skip in skips]
