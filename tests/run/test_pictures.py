"""Pictures and sheets: shared by links, made when frames are done, and made again only where they would differ."""

import errno
import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import batch_case as case
import numpy as np
import pytest

from lookdev.build.wedges import WedgeSheet
from lookdev.cache import link_or_copy
from lookdev.output.sheet import write_sheet
from lookdev.run.pictures import link_to_first
from lookdev.run.render import RunResult, run_plan

COLORS = {"gold": (0.9, 0.6, 0.1), "tin": (0.4, 0.4, 0.4), "copper": (0.8, 0.3, 0.1)}
TURNTABLES = case.TURNTABLES.replace("frames = 4", "frames = 2").replace("frames = 3", "frames = 2")
KINDS = ("element", "lighting")
OVERVIEW = "sheet = false\noverview = true\n"
LOOKS = ("tin", "copper", "gold")  # not in the order of the job
WEDGE = WedgeSheet(
    "roughness", "gold / city: roughness", "gold", "city", tuple((look, "city") for look in LOOKS), ("1", "2", "3"), 2
)
Written = list[tuple[str, list[str], list[list[int]], str, int | None]]


def test_files_are_shared_as_links_or_as_copies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, third = (tmp_path / name for name in ("a", "b", "deep/c"))
    first.write_text("pixels")
    link_to_first([first, second, third])
    assert first.samefile(second)
    assert first.samefile(third)

    def refuse(source: Path, target: Path) -> None:
        raise OSError(errno.EPERM, "no hard links here")

    monkeypatch.setattr(os, "link", refuse)
    second.write_text("old")
    os.utime(first, ns=(10**18, 10**18))
    copy = tmp_path / "copy"
    link_or_copy(first, copy)
    assert not first.samefile(copy)
    assert copy.read_text() == first.read_text()
    assert copy.stat().st_mtime_ns == 10**18  # as of a link: the age of pictures is compared


@pytest.mark.parametrize("spoilt", ["", "{", "[]"])
def test_a_spoilt_ledger_makes_every_picture_again(finished: Path, spoilt: str) -> None:
    ledger = finished / "out" / ".lookdev" / "pictures.json"
    whole = ledger.read_text()
    ledger.write_text(spoilt)
    case.run(finished)
    assert len(case.requests(finished)) == 6
    assert sorted(ledger.read_text().splitlines()) == sorted(whole.splitlines())


def test_large_frames_are_averaged_for_the_sheet(finished: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[np.ndarray] = []
    monkeypatch.setattr("lookdev.output.sheet.SOURCE_SIZE", 4)

    def note_frames(path: Path, frames: Iterable[np.ndarray], *rest: object) -> None:
        path.write_bytes(b"a sheet")
        seen.extend(frames)

    monkeypatch.setattr("lookdev.output.sheet.write_sheet", note_frames)
    behind = np.zeros((case.HEIGHT, case.WIDTH, 3))
    behind[:, ::2] = 1.0
    case.run(finished, render_background=lambda task: behind, force=True)
    assert len(seen) == 7
    assert seen[0].shape == (3, 4, 3)
    assert (seen[0] == 128).all()  # the mean of 0.25 and 0.25 + 0.5 * 1, in the Raw view


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> Written:
    """Return the sheets that are written: end of path, labels, first pixel of each frame, title and columns."""
    sheets: Written = []

    def note(
        path: Path, frames: list[np.ndarray], labels: list[str], title: str, columns: int | None = None, cell: int = 256
    ) -> None:
        write_sheet(path, frames, labels, title, columns, cell)
        end, codes = path.relative_to(path.parents[2]).as_posix(), [frame[0, 0].tolist() for frame in frames]
        sheets.append((end, list(labels), codes, title, columns))

    monkeypatch.setattr("lookdev.output.sheet.write_sheet", note)
    return sheets


def run(
    folder: Path, outputs: str, looks: tuple[str, ...] = ("tin", "copper"), wedges: tuple[WedgeSheet, ...] = ()
) -> RunResult:
    """Run a job of gold and other looks, each in front of a colour of its own, with sheets of wedges."""
    folder.mkdir(exist_ok=True)
    more = "".join(f'[[look]]\nname = "{name}"\nmaterial = "gold.usda"\n' for name in looks)
    job = case.make_job(folder, TURNTABLES + more, case.RENDER + outputs)
    plan = replace(case.make_plan(job), sheets=wedges)
    return run_plan(
        plan,
        job.outputs,
        job.render.background,
        worker_command=case.command(folder),
        render_background=lambda task: np.array(COLORS[task.labels["look"]]),
    )


def code_values(*looks: str) -> list[list[int]]:
    """Return the corner pixel of each look's frames: 0.25 plus half of the background, in the Raw view."""
    return [[int((0.25 + 0.5 * value) * 255 + 0.5) for value in COLORS[look]] for look in looks]


def test_an_overview_shows_first_frames_and_is_made_again_only_if_it_would_differ(
    tmp_path: Path, written: Written
) -> None:
    assert run(tmp_path, OVERVIEW).exit_code == 0
    looks = ["gold", "tin", "copper"]
    assert [(end, labels, codes, columns) for end, labels, codes, _, columns in written] == [
        (f"out/city/{kind}.looks.png", looks, code_values(*looks), None) for kind in KINDS
    ]
    assert sorted(path.name for path in (tmp_path / "out" / "city").iterdir()) == [
        f"{kind}.looks.png" for kind in KINDS
    ]
    assert not list((tmp_path / "out").rglob("*.sheet.png"))

    def written_again(*arguments: object) -> Written:
        written.clear()
        run(tmp_path, *arguments)  # type: ignore[arg-type]
        return written

    assert written_again(OVERVIEW) == []
    (tmp_path / "out" / "city" / "lighting.looks.png").unlink()
    assert [end for end, *_ in written_again(OVERVIEW)] == ["out/city/lighting.looks.png"]
    assert [columns for *_, columns in written_again(OVERVIEW + "overview_columns = 1\n")] == [1, 1]
    assert [labels for _, labels, *_ in written_again(OVERVIEW, ("copper", "tin"))] == [["gold", "copper", "tin"]] * 2
    assert len(case.requests(tmp_path)) == 9
    beside = {Path(end).name for end, *_ in written_again("overview = true\n", ("tin",))}
    assert beside == {f"{kind}.{sheet}.png" for kind in KINDS for sheet in ("sheet", "looks")}
    assert {labels[0] for _, labels, *_ in written_again("")} == {"0001"}  # without overviews


def wedge_files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (folder / "out" / "gold" / "city").glob("*.wedge.png")}


def test_a_wedge_shows_the_first_frame_of_each_cell_and_is_made_again_only_if_it_would_differ(
    tmp_path: Path, written: Written
) -> None:
    def run_wedge(outputs: str = "sheet = false\n", **changes: object) -> Written:
        written.clear()
        run(tmp_path, outputs, wedges=(replace(WEDGE, **changes),))  # type: ignore[arg-type]
        return written

    assert run_wedge("sheet = false\nwedges = false\n") == []
    assert run_wedge() == [
        (f"gold/city/{kind}.roughness.wedge.png", ["1", "2", "3"], code_values(*LOOKS), f"{kind} / {WEDGE.title}", 2)
        for kind in KINDS
    ]
    first = wedge_files(tmp_path)
    assert len(first) == 2
    assert run_wedge() == []
    assert [columns for *_, columns in run_wedge(columns=3)] == [3, 3]
    run_wedge(labels=("a", "b", "c"))
    run_wedge()
    assert wedge_files(tmp_path) == first


def test_an_interrupted_batch_ends_with_the_same_wedge_and_an_overview_lacks_no_look(
    tmp_path: Path, written: Written
) -> None:
    whole, halted = tmp_path / "whole", tmp_path / "halted"
    run(whole, "sheet = false\n", wedges=(WEDGE,))
    written.clear()
    halted.mkdir()
    case.misbehave(halted, element_0001=["ok", "failed", "failed", "ok"])
    assert run(halted, OVERVIEW, wedges=(WEDGE,)).exit_code == 1
    assert written == []  # the lighting turntable begins with the same pose
    assert run(halted, OVERVIEW, wedges=(WEDGE,)).exit_code == 0
    assert {Path(end).name for end, *_ in written} >= {f"{kind}.looks.png" for kind in KINDS}
    assert len(wedge_files(whole)) == 2
    assert wedge_files(halted) == wedge_files(whole)
