from __future__ import annotations

from pathlib import Path

import pytest

from lookdev.cache import Content, atomic_path, cache_dir
from lookdev.errors import ContentError, OutputError


def test_a_cache_that_shaders_cannot_be_loaded_from_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / 'a"b'))
    with pytest.raises(OutputError, match="quotation mark"):
        cache_dir("osl")


def test_a_file_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    final = tmp_path / "frame.exr"

    def fail_half_way() -> None:
        with atomic_path(final) as path:
            path.write_bytes(b"half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail_half_way()
    assert list(tmp_path.iterdir()) == []
    with atomic_path(final) as path:
        path.write_bytes(b"whole")
        assert path.suffix == ".exr"
        assert not final.exists()
    assert final.read_bytes() == b"whole"
    assert list(tmp_path.iterdir()) == [final]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    return cache_dir()


@pytest.mark.parametrize("inside", [True, False])
def test_a_file_is_known_by_its_content(cache: Path, tmp_path: Path, inside: bool) -> None:
    files = [(cache if inside else tmp_path) / name for name in ("a.exr", "b.exr", "c.exr")]
    for file, text in zip(files, ("same", "same", "other"), strict=True):
        file.write_text(text)
    one, same, other = map(Content.of, files)
    assert one == same != other
    assert one.path == cache / "content" / f"{one.digest}.exr"
    assert one.path.read_text() == "same"
    # Files of the cache are never edited in place: they need no copy.
    assert one.path.samefile(files[0]) is inside
    files[0].unlink()
    assert one.path.read_text() == "same"


def test_another_content_under_the_same_name_is_noticed(cache: Path) -> None:
    file = cache / "a.exr"
    for text in ("one", "other"):
        with atomic_path(file) as temporary:
            temporary.write_text(text)
        assert Content.of(file).path.read_text() == text


def test_content_that_the_store_lacks_is_named(cache: Path) -> None:
    with pytest.raises(ContentError, match=rf"{cache}/content lacks the file 0123\.exr"):
        _ = Content("0123", ".exr").path
