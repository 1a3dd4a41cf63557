"""Names of frames: as text, from paths, and in a folder."""

from pathlib import Path

import pytest

from lookdev.output.frame_name import FrameName, frame_files


@pytest.mark.parametrize(
    ("name", "text"),
    [
        (FrameName("gold", "city", "element", 1), "gold/city/element.0001"),
        (FrameName("gold", "city", "slow.element", 12345), "gold/city/slow.element.12345"),
    ],
)
def test_a_name_is_read_as_it_was_written(name: FrameName, text: str) -> None:
    assert str(name) == text
    assert FrameName.of(name.file(Path("/out"))) == name
    assert name.file(Path("/out")) == Path(f"/out/{text}.exr")


@pytest.mark.parametrize("file", ["gold/city/element.001.exr", "gold/city/element.0001.png", "city/element.0001.exr"])
def test_what_is_not_a_frame_is_an_error(file: str) -> None:
    with pytest.raises(ValueError, match=r"is not a frame, <look>/<rig>/<turntable>\.####\.exr"):
        FrameName.of(Path(file))


def test_frames_of_a_folder_are_found_in_order(tmp_path: Path) -> None:
    names = [FrameName("a", "city", "element", number) for number in (1, 2)] + [FrameName("b", "city", "element", 1)]
    for file in [*(name.file(tmp_path) for name in names[::-1]), tmp_path / "a/city/sheet.exr", tmp_path / "a/x.exr"]:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    (tmp_path / "a/city/.element.0003.exr").touch()  # written at this moment
    assert list(frame_files(tmp_path)) == [(name, name.file(tmp_path)) for name in names]
