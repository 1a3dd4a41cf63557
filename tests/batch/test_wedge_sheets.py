"""Sheets of wedges: what is on them and where, made when their frames are done, and again only if they would differ."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import batch_case as case
import numpy as np
import pytest

from lookdev.batch.run import RunResult, run_plan
from lookdev.job.wedges import WedgeSheet
from lookdev.output.sheet import write_sheet

LOOKS = ("tin", "copper", "iron")
SHEET = WedgeSheet(
    "roughness", "gold / city: roughness", "gold", "city", tuple((look, "city") for look in LOOKS), ("1", "2", "3"), 2
)


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> list[tuple]:
    sheets: list[tuple] = []

    def note(path: Path, frames: list[np.ndarray], labels: object, title: str, columns: int | None = None) -> None:
        write_sheet(path, frames, labels, title, columns)
        sheets.append(("/".join(path.parts[-3:]), labels, [int(frame[0, 0, 0]) for frame in frames], title, columns))

    monkeypatch.setattr("lookdev.output.sheet.write_sheet", note)
    return sheets


def run(folder: Path, sheet: WedgeSheet = SHEET, outputs: str = "sheet = false\n") -> RunResult:
    more = "".join(f'[[look]]\nname = "{name}"\nmaterial = "gold.usda"\n' for name in LOOKS)
    job = case.make_job(folder, case.TURNTABLES + more, case.RENDER + outputs)
    plan = replace(case.make_plan(job), sheets=(sheet,))
    greys = dict(zip(LOOKS, (0.2, 0.4, 0.6), strict=True))
    behind = lambda task: np.full(3, greys.get(task.labels["look"], 0.0))  # noqa: E731
    return run_plan(plan, job.outputs, job.render.background, worker_command=case.command(folder), behind=behind)


def test_a_sheet_shows_the_first_frame_of_each_cell_in_order(tmp_path: Path, written: list) -> None:
    run(tmp_path)
    values = [int((0.25 + 0.5 * grey) * 255 + 0.5) for grey in (0.2, 0.4, 0.6)]
    assert written == [
        (f"gold/city/{turntable}.roughness.wedge.png", ("1", "2", "3"), values,
         f"{turntable} / gold / city: roughness", 2)
        for turntable in ("element", "lighting")
    ]  # fmt: skip


def test_it_is_made_again_only_if_it_would_differ(tmp_path: Path, written: list) -> None:
    run(tmp_path)
    first = [path.read_bytes() for path in sorted((tmp_path / "out" / "gold" / "city").glob("*.wedge.png"))]
    assert len(first) == 2
    written.clear()
    run(tmp_path)
    assert written == []
    run(tmp_path, replace(SHEET, columns=3))
    assert [entry[-1] for entry in written] == [3, 3]
    run(tmp_path, replace(SHEET, labels=("a", "b", "c")))
    run(tmp_path)
    assert [path.read_bytes() for path in sorted((tmp_path / "out" / "gold" / "city").glob("*.wedge.png"))] == first


def test_an_interrupted_batch_ends_with_the_same_sheet(tmp_path: Path, written: list) -> None:
    for name in ("whole", "halted"):
        (tmp_path / name).mkdir()
    run(tmp_path / "whole")
    case.misbehave(tmp_path / "halted", element_0001=["ok", "failed", "failed", "ok"])
    run(tmp_path / "halted")
    assert len(written) == 2
    run(tmp_path / "halted")
    one, other = (
        {path.name: path.read_bytes() for path in (tmp_path / name / "out" / "gold" / "city").glob("*.wedge.png")}
        for name in ("whole", "halted")
    )
    assert one == other
    assert len(one) == 2


def test_none_is_made_where_none_is_wanted(tmp_path: Path, written: list) -> None:
    run(tmp_path, outputs="sheet = false\nwedges = false\n")
    assert written == []
