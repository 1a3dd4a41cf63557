"""The folder of the review page: files that are written, kept, written again and removed; comparison of versions."""

import base64
import json
import os
import re
import shutil
import zlib
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import OpenImageIO as oiio
import pytest
import review_case as case

from lookdev.errors import OutputError
from lookdev.metrics import noise_ratio, pooled_error, standard_error
from lookdev.output.color import VIEWS, DisplayView
from lookdev.output.exr import read_frame, read_layer
from lookdev.output.review.folder import review
from lookdev.output.review.page import THUMBNAIL
from lookdev.output.review.view import view_shader

LOOK = {"looks": ["gold"], "rigs": ["city"]}


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def call_arguments(script: Path) -> list:
    """Return the two arguments of the only call in a script."""
    match = re.fullmatch(r"review\.put\((.*)\);\n", script.read_text(), re.DOTALL)
    assert match is not None
    return json.loads(f"[{match[1]}]")


def index_of(page: Path) -> dict:
    text = (page.parent / "data" / "index.js").read_text()
    return json.loads(text.removeprefix("review.start(").removesuffix(");\n"))


def test_a_page_has_every_frame_and_a_second_run_makes_nothing(tmp_path: Path) -> None:
    out = case.write_job(tmp_path / "out")
    page, written, notes = review(out)
    assert page == out / "review" / "index.html"
    assert notes == ()
    assert (written.unchanged_files, len(list((out / "review" / "data" / "frames").glob("*.js")))) == (0, 2 * 2 * 7)
    reels = {(reel["turntable"], reel["count"], reel["turns"]) for reel in index_of(page)["reels"]}
    assert reels == {("element", 4, "element"), ("lighting", 3, "lighting")}
    before = files(out)
    assert written.size == sum(path.stat().st_size for path in page.parent.rglob("*.*") if path.name != "ledger.json")
    _, again, _ = review(out)
    assert (again.new_files, again.unchanged_files) == (0, written.new_files)
    assert files(out) == before


@pytest.mark.parametrize("error", [True, False])
def test_numbers_are_the_nearest_half_floats(tmp_path: Path, error: bool) -> None:
    out = case.write_job(tmp_path, **LOOK, error=error)
    page, _, _ = review(out)
    frame = call_arguments(page.parent / index_of(page)["reels"][0]["script"])[1][2]
    file = Path(frame["file"])
    key, entry = call_arguments(page.parent / "data" / "frames" / f"{frame['key']}.js")
    assert key == frame["key"]
    planes = zlib.decompress(base64.b64decode(entry["data"]))
    halves = np.frombuffer(planes, np.uint8).reshape(entry["planes"], 2, -1).swapaxes(1, 2).copy().view(">f2")
    halves = halves.reshape(entry["planes"], entry["height"], entry["width"]).astype(np.float32)
    beauty, alpha = read_frame(file)
    expected = [*np.moveaxis(beauty, -1, 0), alpha]
    layer = read_layer(file, "error")
    assert (layer is not None) == error
    if layer is not None:
        expected.append(pooled_error(layer))
    np.testing.assert_array_equal(halves, np.stack(expected).astype(np.float16).astype(np.float32))


def test_what_is_damaged_missing_or_old_is_made_anew_to_the_same_bytes(tmp_path: Path) -> None:
    out, page = case.write_job(tmp_path / "out", **LOOK), tmp_path / "page"
    review(out, to=page)
    whole = files(page)
    for name in (n for n in whole if n != "data/ledger.json"):
        for damage in (lambda path: path.unlink(), lambda path: os.truncate(path, 3)):
            damage(page / name)
            _, written, _ = review(out, to=page)
            assert written.new_files == (2 if name.startswith("data/frames/") else 1)  # a frame has two files
            assert files(page) == whole
    (page / "data" / "ledger.json").write_text("{")
    review(out, to=page)
    assert files(page) == whole


def test_an_interrupted_page_continues_to_the_same_bytes(tmp_path: Path) -> None:
    out = case.write_job(tmp_path / "out", **LOOK)
    review(out, to=tmp_path / "whole")
    whole = files(tmp_path / "whole")
    for stop in range(1, 8):
        page, report = tmp_path / f"page{stop}", Mock(side_effect=[None] * (stop - 1) + [KeyboardInterrupt])
        with pytest.raises(KeyboardInterrupt):
            review(out, to=page, report=report)
        assert report.call_args.args[0] == stop
        assert not (page / "index.html").exists()
        review(out, to=page)
        assert files(page) == whole


def test_what_left_the_job_leaves_the_page(tmp_path: Path) -> None:
    out, page = case.write_job(tmp_path / "out", **LOOK), tmp_path / "page"
    review(out, to=page)
    before = files(page)
    (page / "mine.txt").write_text("a file of the user")
    case.write_job(out, **LOOK, gain=1.5)
    review(out, to=page)
    after = files(page)
    frames = {name for name in before if name.startswith("data/frames/")}
    assert frames.isdisjoint(after)
    assert len([name for name in after if name.startswith("data/frames/")]) == len(frames)
    assert "mine.txt" in after


def test_damaged_frames_are_named_and_left_out(tmp_path: Path) -> None:
    out = case.write_job(tmp_path, **LOOK)
    damaged = out / "gold" / "city" / "element.0002.exr"
    os.truncate(damaged, damaged.stat().st_size - 10)
    page, _, (note,) = review(out)
    assert note.startswith(f"{damaged}: is left out: ")
    index = index_of(page)
    assert (index["reels"][0]["count"], index["versions"][0]["problems"]) == (3, [note])


def test_a_folder_without_frames_is_an_error_that_names_what_is_there(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="no such folder"):
        review(tmp_path / "lost")
    with pytest.raises(OutputError, match="has no frames"):
        review(tmp_path)
    case.write_job(tmp_path, **LOOK, turntables={"element": 1})
    os.truncate(tmp_path / "gold" / "city" / "element.0001.exr", 100)
    with pytest.raises(OutputError, match=r"has no frames.*element\.0001\.exr: is left out"):
        review(tmp_path)
    case.write_job(tmp_path, **LOOK)
    with pytest.raises(OutputError, match="no view of sRGB - Display called 'ACES'"):
        review(tmp_path, view="ACES")


def test_versions_are_compared_by_inputs_and_by_what_noise_explains(tmp_path: Path) -> None:
    old = case.write_job(tmp_path / "v1", ["gold", "tin", "lead"], seed=1)
    new = case.write_job(tmp_path / "v2", ["gold", "tin", "zinc"], seed=2, gain=1.02)
    page, _, _ = review(new, old, tmp_path / "page")
    index = index_of(page)
    assert [version["name"] for version in index["versions"]] == ["v2", "v1"]
    changes = index["changes"]
    by_look = {look: [change for change in changes if change["look"] == look] for look in ("gold", "tin", "lead")}
    for change in by_look["gold"]:
        assert (change["state"], change["changed"]) == ("changed", ["look", "render"])
        assert change["beyond"] > 0.05
    for change in by_look["tin"]:
        assert (change["state"], change["changed"]) == ("same picture", ["render"])
        assert change["beyond"] <= 0.003
    assert {change["state"] for change in by_look["lead"]} == {"removed"}
    assert {change["state"] for change in changes if change["look"] == "zinc"} == {"new"}
    with pytest.raises(OutputError, match="is the same folder"):
        review(new, new)


def test_equal_frames_and_frames_of_other_sizes_or_numbers(tmp_path: Path) -> None:
    old = case.write_job(tmp_path / "old", **LOOK, turntables={"element": 2})
    states = {}
    for name, count, options in (
        ("same", 2, {}),
        ("sized", 2, {"size": (32, 24)}),
        ("blind", 2, {"error": False, "seed": 1}),
        ("first", 1, {}),
    ):
        if name == "first":
            (old / "gold" / "city" / "element.0001.exr").unlink()
        new = case.write_job(tmp_path / name, **LOOK, turntables={"element": count}, **options)
        (change,) = index_of(review(new, old, tmp_path / f"{name}_page")[0])["changes"]
        states[name] = change["state"]
    assert states == {"same": "same", "sized": "changed", "blind": "changed", "first": "other frames"}


def test_the_frame_of_a_change_is_the_worst(tmp_path: Path) -> None:
    old, new, brighter = (
        case.write_job(tmp_path / str(gain), **LOOK, turntables={"element": 3}, error=False, gain=gain)
        for gain in (1.0, 1.1, 1.5)
    )
    shutil.copy(brighter / "gold" / "city" / "element.0002.exr", new / "gold" / "city")
    (change,) = index_of(review(new, old, tmp_path / "page")[0])["changes"]
    assert (change["beyond"], change["frame"]) == (None, 2)


def test_small_pictures_have_the_shape_of_the_frames_and_a_cell_each(tmp_path: Path) -> None:
    out = case.write_job(tmp_path, **LOOK, turntables={"element": 4}, size=(2 * THUMBNAIL, THUMBNAIL))
    page, _, _ = review(out)
    (reel,) = index_of(page)["reels"]
    sprite = oiio.ImageBuf(str(page.parent / reel["sprite"])).get_pixels(oiio.UINT8)
    assert (reel["columns"], *sprite.shape[1::-1]) == (2, 2 * THUMBNAIL, THUMBNAIL)
    cells = sprite.reshape(2, THUMBNAIL // 2, 2, THUMBNAIL, 3).swapaxes(1, 2).reshape(4, -1)
    assert len({cell.tobytes() for cell in cells}) == 4
    assert (cells.max(axis=1) > 2).all()


@pytest.mark.parametrize("size", [1, 3, 7])
def test_noise_alone_is_rarely_beyond_3(size: int) -> None:
    """z is above 3 in at most 0.27 % of pixels plus 4 deviations of that count, and not at a spike in one half."""
    rng = np.random.default_rng(5)
    shape, spread = (256, 256, 3), 0.1
    level = 1.0 + (np.arange(256)[:, None, None] > 128)  # an edge, with noise in proportion
    halves = [level * (1.0 + spread * rng.standard_normal(shape)) for _ in range(4)]
    halves[0][20, 20] += 100.0
    a, b = (halves[0] + halves[1]) / 2, (halves[2] + halves[3]) / 2
    errors = [pooled_error(standard_error(*pair)) for pair in (halves[:2], halves[2:])]
    z = noise_ratio(a, b, *errors, size)
    # Pixels in one square of size^2 exceed 3 together.
    assert (z > 3.0).mean() <= 0.0027 + 4.0 * np.sqrt(0.0027 / z.size) * size
    assert z[20, 20] <= 3.0 * (1.0 + 5.0 * spread / 50.0)  # the spike is 50 in a mean, noise five deviations
    assert np.median(noise_ratio(a + 0.1 * level, b, *errors, size)) > 0.8 * size


def test_the_standard_error_is_that_of_the_mean_in_ten_bits() -> None:
    a, b = np.random.default_rng(6).uniform(0.0, 1e6, (2, 50, 50, 3)).astype(np.float32)
    error = standard_error(a, b)
    np.testing.assert_allclose(error, np.abs(a - b) / 2, rtol=2.0**-10)
    assert not (error.view(np.uint32) & 0x1FFF).any()


@pytest.mark.parametrize("view", VIEWS)
def test_every_view_is_a_shader(view: str) -> None:
    shader = view_shader(DisplayView(view))
    assert "vec4 view(vec4" in shader["glsl"]
    for texture in shader["textures"]:
        texels = np.frombuffer(base64.b64decode(texture["texels"]), "<f4")
        assert texels.size == np.prod(texture["size"]) * texture["components"]
