from itertools import groupby, pairwise
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from lookdev.output.exr import write_frame
from lookdev.output.slate import burn_in, draw_slate, write_text

HEADER = {
    "job": "/shows/a/robot.toml", "look": "gold", "ibl": "sunset", "turntable": "element, lighting",
    "samples": "128", "relmse": "0.00123", "time": "2026-03-01T23:59:59+00:00",
    "version.lookdev": "0.1.0", "version.blender": "4.5.15",
}  # fmt: skip


def frame(path: Path, **changed: str) -> Path:
    write_frame(path, np.zeros((6, 8, 3)), np.ones((6, 8)), HEADER | changed)
    return path


class Line(NamedTuple):
    """The arguments of a call of `write_text`."""

    text: str
    x: int
    baseline: int
    size: int
    room: int
    ink: int


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> list[Line]:
    """The lines of text."""
    lines: list[Line] = []

    def note(canvas: object, *line: object) -> None:
        lines.append(Line(*line))
        write_text(canvas, *line)

    monkeypatch.setattr("lookdev.output.slate.write_text", note)
    return lines


def check_rows(lines: list[Line], width: int) -> None:
    """Check that texts in a row do not overlap and fill its width, and that rows do not overlap."""
    in_order = sorted(lines, key=attrgetter("baseline", "x"))
    rows = [list(row) for _, row in groupby(in_order, key=attrgetter("baseline"))]
    for row in rows:
        assert all(line.x + line.room < after.x for line, after in pairwise(row))
        assert width - 3 * row[-1].size < row[-1].x + row[-1].room <= width
        assert all(line.x > 0 and 0 < line.ink <= 255 for line in row)
    assert all(row[0].baseline + row[0].size < after[0].baseline for row, after in pairwise(rows))


def test_a_burn_in_says_what_the_frame_is(tmp_path: Path, written: list) -> None:
    file = frame(tmp_path / "a.exr")
    codes = np.random.default_rng(1).random((480, 640, 3)).astype(np.float32)
    original = codes.copy()
    burned = burn_in(codes, file, "gold / sunset / element", "0007", "lookdev (sRGB - Display)")
    np.testing.assert_array_equal(codes, original)
    text = " ".join(line.text for line in written)
    for fact in ("robot", "gold", "sunset", "element", "0007", "2026-03-01", "lookdev 0.1.0", "Blender 4.5.15",
                 "relMSE 1.2e-03", "128 samples", "8 x 6", "lookdev (sRGB - Display)"):  # fmt: skip
        assert fact in text
    check_rows(written[:2], 640)  # of the upper band,
    check_rows(written[2:], 640)  # and of the lower one
    assert {line.size for line in written} == {16}  # readable at 480 lines: ascenders of 12 pixels
    changed = np.flatnonzero((burned != codes).any(axis=(1, 2)))
    assert changed.max() == 479
    assert len(changed) < 0.2 * 480
    np.testing.assert_array_equal(burned[40:420], codes[40:420])  # between the bands the picture is as it was
    band = burned[: 480 // 30]
    assert (band.max(), np.median(band)) > (0.85, 0.0)
    assert np.median(band) < 0.36  # text stands out


@pytest.mark.parametrize("key", ["samples", "relmse", "time", "version.lookdev", "job"])
def test_each_fact_is_seen(tmp_path: Path, key: str) -> None:
    other = {"samples": "64", "relmse": "0.5", "time": "2027-03-01T00:00:00", "version.lookdev": "9", "job": "b.toml"}
    codes = np.zeros((480, 640, 3), np.float32)
    first, second = (
        burn_in(codes, frame(tmp_path / "a.exr", **changed), "t", "1", "v") for changed in ({}, {key: other[key]})
    )
    assert (np.abs(first - second).max(axis=-1) > 0.5).sum() > 10


def test_alpha_covers_the_text(tmp_path: Path) -> None:
    burned = burn_in(np.zeros((480, 640, 4), np.float32), frame(tmp_path / "a.exr"), "t", "1", "v")
    ink = burned[..., 0] > 0.9
    assert ink.sum() > 100
    assert (burned[..., 3][ink] > 0.9).all()
    assert (burned[:8, :, 3] > 0.5).all()
    assert (burned[100:400, :, 3] == 0.0).all()


def test_a_small_frame_has_room_or_stays_as_it_is(tmp_path: Path) -> None:
    codes = np.full((6, 8, 3), 0.5, np.float32)
    np.testing.assert_array_equal(burn_in(codes, frame(tmp_path / "a.exr"), "t", "1", "v"), codes)
    assert burn_in(np.full((64, 64, 3), 0.5, np.float32), tmp_path / "a.exr", "t", "1", "v").shape == (64, 64, 3)


def test_a_slate_says_what_the_movie_is_of(tmp_path: Path, written: list) -> None:
    files = [
        frame(tmp_path / "1.exr"),
        frame(tmp_path / "2.exr", samples="256", relmse="0.02", time="2026-03-02T01:00:00"),
        frame(tmp_path / "3.exr", look="tin"),
    ]
    page = draw_slate(files, "sunset / element", "lookdev (sRGB - Display)", 23.976, (480, 640), 3)
    facts = {key.text: value.text for key, value in zip(written[::2], written[1::2], strict=True)}
    assert facts == {
        "job": "robot", "shows": "sunset / element", "look": "gold, tin", "rig": "sunset",
        "frames": "3 at 23.976 a second", "rendered": "2026-03-01 to 2026-03-02",
        "version": "lookdev 0.1.0, Blender 4.5.15", "error": "relMSE 2.0e-02 at most", "samples": "128 to 256",
        "resolution": "8 x 6", "view": "lookdev (sRGB - Display)",
    }  # fmt: skip
    assert page.shape == (480, 640, 3)
    check_rows(written, 640)
    assert {line.size for line in written} == {20}
    assert np.flatnonzero((page > 0.5).any(axis=(1, 2))).max() < 470  # every line is on the page
    assert (draw_slate(files, "t", "v", 24.0, (48, 64), 4)[..., 3] == 1.0).all()
