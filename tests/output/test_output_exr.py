import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest

from lookdev.errors import OutputError
from lookdev.output.display import to_display, write_pixels
from lookdev.output.exr import read_frame, read_header, read_rec709, write_frame
from lookdev.space import to_rec709

pytestmark = pytest.mark.both_pythons

HEADER = {
    "digest": "ab" * 32, "job": "Käfer; \"x\" = 'y'", "samples": 64, "seed": 2**63 + 1, "error": 1.1e-4, "note": "",
}  # fmt: skip
Frame = tuple[np.ndarray, np.ndarray]


@pytest.fixture
def frame() -> Frame:
    rng = np.random.default_rng(1)
    beauty = (rng.normal(size=(30, 20, 3)) * 1e4).astype(np.float32)  # with negative and huge values
    return beauty, rng.random((30, 20)).astype(np.float32)


def test_round_trip_is_exact(tmp_path: Path, frame: Frame) -> None:
    path = tmp_path / "look" / "city" / "turn.0001.exr"
    write_frame(path, *frame, HEADER)
    beauty, alpha = read_frame(path)
    np.testing.assert_array_equal(beauty, frame[0])
    np.testing.assert_array_equal(alpha, frame[1])
    assert (beauty.dtype, alpha.dtype) == (np.float32, np.float32)
    assert read_header(path) == {key: str(value) for key, value in HEADER.items()} | {"resolution": "20 x 30"}
    assert float(read_header(path)["error"]) == 1.1e-4
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_a_file_is_one_part_of_floats_and_has_a_header_of_any_length(tmp_path: Path, frame: Frame) -> None:
    path, note, depth = tmp_path / "a.exr", "long " * 20000, np.arange(600.0).reshape(30, 20)
    write_frame(path, *frame, {"note": note}, planes={"depth.Z": depth[:, ::-1]}, attributes={"worldToCamera": "text"})
    with OpenEXR.File(str(path), separate_channels=True) as exr:
        assert len(exr.parts) == 1
        header, channels = exr.header(), exr.channels()
        assert (header["type"], header["lookdev:note"]) == (OpenEXR.scanlineimage, note)
        assert header["worldToCamera"] == "text"
        assert {name: channel.pixels.dtype for name, channel in channels.items()} == dict.fromkeys(
            [*"ABGR", "depth.Z"], np.dtype(np.float32)
        )
        np.testing.assert_array_equal(channels["depth.Z"].pixels, depth[:, ::-1].astype(np.float32))


def test_a_frame_of_another_space_is_shown_in_rec709(tmp_path: Path, frame: Frame) -> None:
    path = tmp_path / "a.exr"
    for space, expected in (("rec709", frame[0]), ("acescg", to_rec709(frame[0], "acescg").astype(np.float32))):
        write_frame(path, *frame, {"space": space}, space=space)
        np.testing.assert_array_equal(read_rec709(path)[0], expected)


def test_the_resolution_is_that_of_the_data_window(tmp_path: Path) -> None:
    """Other programs may move the data window."""
    spec = oiio.ImageSpec(4, 3, 4, oiio.FLOAT)
    spec.x, spec.y = 7, 5
    spec["lookdev:look"] = "paint"
    assert oiio.ImageBuf(spec).write(str(tmp_path / "a.exr"))
    assert read_header(tmp_path / "a.exr", check=False) == {"look": "paint", "resolution": "4 x 3"}


def test_foreign_exr_has_an_empty_header(tmp_path: Path) -> None:
    with OpenEXR.File({"comments": "x"}, {"Y": np.zeros((2, 2), np.float32)}) as exr:
        exr.write(str(tmp_path / "y.exr"))
    assert read_header(tmp_path / "y.exr") == {}
    with pytest.raises(OutputError, match="R, G, B, A"):
        read_frame(tmp_path / "y.exr")


@pytest.mark.parametrize("cut", [1, 400, 4000])
def test_truncated_frame_is_detected(tmp_path: Path, frame: Frame, cut: int) -> None:
    path = tmp_path / "a.exr"
    write_frame(path, *frame, HEADER)
    path.write_bytes(path.read_bytes()[:-cut])
    with pytest.raises(OutputError, match="not a whole frame"):
        read_frame(path)
    with pytest.raises(OutputError, match="pixels are cut off"):
        read_header(path)


def test_an_altered_byte_is_detected(tmp_path: Path, frame: Frame) -> None:
    path = tmp_path / "a.exr"
    write_frame(path, *frame, HEADER)
    whole = path.read_bytes()
    name_start = whole.index(b"lookdev:checksum")  # a change here renames the attribute: no checksum, right pixels
    for offset in (offset for offset in range(0, len(whole), 41) if not 0 <= offset - name_start < 20):
        path.write_bytes(whole[:offset] + bytes([whole[offset] ^ 4]) + whole[offset + 1 :])
        for read in (read_header, read_frame):
            with pytest.raises(OutputError, match=re.escape(str(path))):
                read(path)
    path.write_bytes(whole)
    read_header(path)
    read_frame(path)


def test_a_frame_of_a_version_without_checksums_is_whole(tmp_path: Path) -> None:
    channels = {name: np.full((40, 30), 0.5, np.float32) for name in "RGBA"}
    path = tmp_path / "a.exr"
    with OpenEXR.File({"lookdev:digest": "d", "compression": OpenEXR.ZIP_COMPRESSION}, channels) as exr:
        exr.write(str(path))
    assert read_header(path) == {"digest": "d", "resolution": "30 x 40"}
    assert (read_frame(path)[0] == 0.5).all()


@pytest.mark.parametrize("content", [b"", b"not an image", None, "header"])
def test_unreadable_files(tmp_path: Path, frame: Frame, content: bytes | str | None) -> None:
    path = tmp_path / "a.exr"
    if content == "header":
        write_frame(path, *frame, HEADER)
        os.truncate(path, 200)
    elif content is not None:
        path.write_bytes(content)
    with pytest.raises(OutputError, match=rf"{path}.*no readable EXR header"):
        read_header(path)
    with pytest.raises(OutputError, match="not a whole frame"):
        read_frame(path)


def test_shapes_must_belong_together(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"\(H, W, 3\)"):
        write_frame(tmp_path / "a.exr", np.zeros((4, 4, 3)), np.zeros((4, 5)), {})
    assert not list(tmp_path.iterdir())


def test_a_frame_and_a_picture_on_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, frame: Frame) -> None:
    """The libraries do not report data that is lost when they close a file."""

    @contextmanager
    def on_full(final: Path) -> Iterator[Path]:
        temporary = final.with_name("full" + final.suffix)
        temporary.symlink_to("/dev/full")
        yield temporary
        temporary.unlink()

    monkeypatch.setattr("lookdev.cache._temporary_path", on_full)
    with pytest.raises(OutputError, match=r"a\.exr: cannot write the frame: No space left on device"):
        write_frame(tmp_path / "a.exr", *frame, {})
    with pytest.raises(OutputError, match=r"a\.png: cannot write the picture: No space left on device"):
        write_pixels(tmp_path / "a.png", to_display(frame[0] * 0.0, "Raw"))
