from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.errors import OutputError
from lookdev.output.sheet import PAGE_GREY, write_sheet


def frames(count: int, shape: tuple[int, int] = (60, 80)) -> list[np.ndarray]:
    return [np.full((*shape, 3), (200, 10 * i, 20), np.uint8) for i in range(count)]


def sheet(path: Path, *arguments: object, **options: object) -> np.ndarray:
    write_sheet(path, *arguments, **options)
    return oiio.ImageBuf(str(path)).get_pixels(oiio.UINT8)


def cells(page: np.ndarray, frame: np.ndarray) -> int:
    """Count the pixels of a frame's own colour; resizing a flat frame may round by one."""
    return int((np.abs(page.astype(int) - frame[0, 0]).max(axis=-1) <= 1).sum())


def test_every_frame_is_shown_whole(tmp_path: Path) -> None:
    page = sheet(tmp_path / "s.png", frames(7), [f"{i:04d}" for i in range(7)], "title", cell=40)
    assert [cells(page, frame) for frame in frames(7)] == [40 * 30] * 7
    assert [(edge == PAGE_GREY).all() for edge in (page[0], page[:, -1])] == [True, True]
    assert [file.name for file in tmp_path.iterdir()] == ["s.png"]


def test_frames_run_row_by_row(tmp_path: Path) -> None:
    squares = frames(4, (40, 40))
    page = sheet(tmp_path / "s.png", squares, [""] * 4, "", columns=3, cell=40)
    corners = [np.argwhere(np.abs(page.astype(int) - f[0, 0]).max(axis=-1) <= 1)[0] for f in squares]
    assert corners[0][0] == corners[1][0] == corners[2][0] < corners[3][0]
    assert corners[0][1] == corners[3][1] < corners[1][1] < corners[2][1]


@pytest.mark.parametrize(("count", "columns"), [(1, 1), (2, 2), (7, 4), (24, 6), (36, 9)])
def test_page_is_filled_evenly(tmp_path: Path, count: int, columns: int) -> None:
    white = np.full((64, 64, 3), 255, np.uint8)
    page = sheet(tmp_path / "s.png", [white] * count, [""] * count, "", cell=64)
    in_row = np.flatnonzero((page == 255).all(axis=-1).any(axis=1))[0]
    assert (page[in_row] == 255).all(axis=-1).sum() == columns * 64


def test_labels_and_title_are_written_and_fit(tmp_path: Path) -> None:
    blank = [np.full((80, 80, 3), PAGE_GREY, np.uint8)] * 2
    bare = sheet(tmp_path / "a.png", blank, ["", ""], "", cell=80, columns=2)
    assert (bare == PAGE_GREY).all()
    for labels, title in ((["0001", ""], ""), (["", ""], "A title"), (["W" * 300, "é °"], "W" * 300)):
        page = sheet(tmp_path / "b.png", blank, labels, title, cell=80, columns=2)
        ink = np.argwhere((page != PAGE_GREY).any(axis=-1))
        assert len(ink) > 20
        assert page.shape == bare.shape
        assert ink[:, 1].min() >= 4  # inside the margins
        assert ink[:, 1].max() < page.shape[1] - 4
        assert (np.ptp(page, axis=-1) == 0).all()  # neutral ink


@pytest.mark.parametrize("labels", ["clearcoatGloss_000 clearcoatGloss_100", "first_of_many_looks last_of_many_looks"])
def test_names_too_long_differ_where_they_differ(tmp_path: Path, labels: str) -> None:
    blank = [np.full((48, 48, 3), PAGE_GREY, np.uint8)]
    first, second = (sheet(tmp_path / "s.png", blank, [label], "", cell=48) for label in labels.split())
    assert first.shape == second.shape  # no wider than a frame
    assert (first != second).any()


def test_resizing_averages_light(tmp_path: Path) -> None:
    stripes = np.zeros((64, 64, 3), np.uint8)
    stripes[:, ::2] = 255
    page = sheet(tmp_path / "s.png", [stripes], [""], "", cell=8)
    # Half of the light is sRGB code 188 by the exact curve, 186 by a gamma of 2.2; half the code is 128.
    centre = page[(page != PAGE_GREY).any(axis=-1)]
    assert abs(float(np.median(centre)) - 187) <= 4


def test_what_makes_no_sheet(tmp_path: Path) -> None:
    for pictures, labels, message in (
        ([], [], "at least one frame"),
        (frames(2), ["one"], "2 frames and 1 labels"),
        ([*frames(1), *frames(1, (10, 10))], ["", ""], "of one size"),
    ):
        with pytest.raises(OutputError, match=message):
            write_sheet(tmp_path / "s.png", pictures, labels, "t")
    assert not list(tmp_path.iterdir())
