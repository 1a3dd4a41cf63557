from __future__ import annotations

import errno
import os
from collections.abc import Iterable
from pathlib import Path

import batch_case as case
import numpy as np
import pytest

from lookdev.batch.pictures import write_shared
from lookdev.batch.run import RunResult
from lookdev.cache import share
from lookdev.output.sheet import write_sheet


def test_files_are_shared_as_links_or_as_copies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, third = (tmp_path / name for name in ("a", "b", "deep/c"))
    write_shared([first, second, third], lambda path: path.write_text("pixels") and None)
    assert first.samefile(second)
    assert first.samefile(third)

    def refuse(source: Path, target: Path) -> None:
        raise OSError(errno.EPERM, "no hard links here")

    monkeypatch.setattr(os, "link", refuse)
    second.write_text("old")
    os.utime(first, ns=(10**18, 10**18))
    copy = tmp_path / "copy"
    share(first, copy)
    assert not first.samefile(copy)
    assert copy.read_text() == first.read_text()
    assert copy.stat().st_mtime_ns == 10**18  # as a link would have it: pictures are compared by age


@pytest.mark.parametrize("spoilt", ["", "{", "[]"])
def test_a_spoilt_ledger_makes_every_picture_again(tmp_path: Path, spoilt: str) -> None:
    case.run(tmp_path)
    ledger = tmp_path / "out" / ".lookdev" / "pictures.json"
    whole = ledger.read_text()
    ledger.write_text(spoilt)
    case.run(tmp_path)
    assert len(case.requests(tmp_path)) == 6
    assert sorted(ledger.read_text().splitlines()) == sorted(whole.splitlines())


def test_large_frames_are_averaged_for_the_sheet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[np.ndarray] = []
    monkeypatch.setattr("lookdev.output.sheet.SOURCE_SIZE", 4)

    def write_sheet(path: Path, frames: Iterable[np.ndarray], *rest: object) -> None:
        path.write_bytes(b"a sheet")
        seen.extend(frames)

    monkeypatch.setattr("lookdev.output.sheet.write_sheet", write_sheet)
    job = case.make_job(tmp_path)
    behind = np.zeros((case.HEIGHT, case.WIDTH, 3))
    behind[:, ::2] = 1.0
    case.run(tmp_path, job, behind=lambda task: behind)
    assert len(seen) == 7
    assert seen[0].shape == (3, 4, 3)
    assert (seen[0] == 128).all()  # the mean of 0.25 and 0.25 + 0.5 * 1, in the Raw view


COLORS = {"gold": (0.9, 0.6, 0.1), "tin": (0.4, 0.4, 0.4), "copper": (0.8, 0.3, 0.1)}
WANTED = "sheet = false\noverview = true\n"


@pytest.fixture
def sheets(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, list[str], list[list[int]], int | None]]:
    """Return what sheets are written: the end of the path, labels, the first pixel of each frame, and columns."""
    written: list[tuple[str, list[str], list[list[int]], int | None]] = []

    def note(
        path: Path, frames: list[np.ndarray], labels: list[str], title: str, columns: int | None = None, cell: int = 256
    ) -> None:
        write_sheet(path, frames, labels, title, columns, cell)
        written.append(("/".join(path.parts[-2:]), list(labels), [frame[0, 0].tolist() for frame in frames], columns))

    monkeypatch.setattr("lookdev.output.sheet.write_sheet", note)
    return written


def overview(folder: Path, outputs: str = WANTED, looks: tuple[str, ...] = ("tin", "copper")) -> RunResult:
    """Run a job of gold and other looks, each before its own colour."""
    more = "".join(f'[[look]]\nname = "{name}"\nmaterial = "gold.usda"\n' for name in looks)
    job = case.make_job(folder, case.TURNTABLES + more, case.RENDER + outputs)
    return case.run(folder, job, behind=lambda task: np.array(COLORS[task.labels["look"]]))


def code_values(*looks: str) -> list[list[int]]:
    """Return what stands in a corner of each look's frames: 0.25 and half of what is behind, in the Raw view."""
    return [[int((0.25 + 0.5 * value) * 255 + 0.5) for value in COLORS[look]] for look in looks]


def test_an_overview_shows_the_first_frame_of_each_look_in_the_order_of_the_job(tmp_path: Path, sheets: list) -> None:
    assert overview(tmp_path).exit_code == 0
    looks = ["gold", "tin", "copper"]
    assert sheets == [
        (f"city/{turntable}.looks.png", looks, code_values(*looks), None) for turntable in ("element", "lighting")
    ]
    assert sorted(path.name for path in (tmp_path / "out" / "city").iterdir()) == [
        "element.looks.png",
        "lighting.looks.png",
    ]
    assert not list((tmp_path / "out").rglob("*.sheet.png"))


def test_an_overview_is_made_again_only_if_it_would_differ(tmp_path: Path, sheets: list) -> None:
    overview(tmp_path)
    sheets.clear()
    overview(tmp_path)
    assert sheets == []
    (tmp_path / "out" / "city" / "lighting.looks.png").unlink()
    overview(tmp_path)
    assert [name for name, *_ in sheets] == ["city/lighting.looks.png"]
    sheets.clear()
    overview(tmp_path, WANTED + "overview_columns = 1\n")
    assert [columns for *_, columns in sheets] == [1, 1]
    sheets.clear()
    overview(tmp_path, looks=("copper", "tin"))
    assert [labels for _, labels, *_ in sheets] == [["gold", "copper", "tin"]] * 2
    assert len(case.requests(tmp_path)) == 18


def test_an_overview_lacks_no_look(tmp_path: Path, sheets: list) -> None:
    case.misbehave(tmp_path, element_0001=["ok", "failed", "failed", "ok"])
    assert overview(tmp_path).exit_code == 1
    assert sheets == []  # the lighting turntable begins with the same pose
    assert overview(tmp_path).exit_code == 0
    assert [name for name, *_ in sheets] == ["city/element.looks.png", "city/lighting.looks.png"]


def test_overviews_are_beside_the_sheets_of_turntables_and_only_if_wanted(tmp_path: Path, sheets: list) -> None:
    overview(tmp_path, "overview = true\n", looks=("tin",))
    names = {name for name, *_ in sheets}
    assert names == {f"city/{kind}.{sheet}.png" for kind in ("element", "lighting") for sheet in ("sheet", "looks")}
    sheets.clear()
    overview(tmp_path, "", looks=("tin", "copper"))
    assert {labels[0] for _, labels, *_ in sheets} == {"0001"}


@pytest.mark.parametrize("name", ["gold/city/element.0001.png", "gold/city/element.sheet.png"])
@pytest.mark.parametrize("size", [0, 100])
def test_a_picture_that_was_cut_off_is_made_again(tmp_path: Path, name: str, size: int) -> None:
    job = case.make_job(tmp_path)
    case.run(tmp_path, job)
    picture = tmp_path / "out" / name
    whole = picture.read_bytes()
    os.truncate(picture, size)
    case.run(tmp_path, job)
    assert picture.read_bytes() == whole


def test_pictures_are_made_again_where_their_view_differs_and_frames_are_not_rendered(tmp_path: Path) -> None:
    def written(view: str) -> dict[str, bytes]:
        case.run(tmp_path, case.make_job(tmp_path, render=case.RENDER.replace('view = "Raw"', view)))
        return {each.name: each.read_bytes() for each in sorted((tmp_path / "out" / "gold" / "city").glob("*.png"))}

    raw, frames = written('view = "Raw"'), len(case.requests(tmp_path))
    other = written('view = "Raw"\nviews = { sheet = "lookdev" }')
    assert {name for name in raw if raw[name] != other[name]} == {"element.sheet.png", "lighting.sheet.png"}
    plain = written('view = "Un-tone-mapped"')
    assert all(raw[name] != plain[name] for name in raw)
    assert written('view = "Raw"') == raw
    assert len(case.requests(tmp_path)) == frames
