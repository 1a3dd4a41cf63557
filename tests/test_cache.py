import json
import os
import resource
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from lookdev.cache import (
    Content,
    atomic_path,
    cache_dir,
    cached_files,
    load_cached,
    memory_file,
    store_cached,
    take_notes,
)
from lookdev.errors import ContentError, OutputError


@pytest.mark.parametrize("name", ['a"b', "a\nb", "a\\b", "a\x1bb", "a\udcffb"])
def test_a_cache_that_shaders_cannot_be_loaded_from_is_refused(tmp_path, monkeypatch, name):
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / name))
    with pytest.raises(OutputError, match="quotation mark") as caught:
        cache_dir("osl")
    assert str(caught.value).isprintable()
    assert not list(tmp_path.iterdir())


def test_a_file_is_written_whole_or_not_at_all(tmp_path):
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
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    return cache_dir()


def test_a_file_is_known_by_its_content(cache, tmp_path):
    files = [tmp_path / name for name in ("a.exr", "b.exr", "c.exr")]
    for file, text in zip(files, ("same", "same", "other"), strict=True):
        file.write_text(text)
    first, same, other = map(Content.store_copy, files)
    assert first == same != other
    assert first.path == cache / "content" / f"{first.digest}.exr"
    assert first.path.read_text() == "same"
    assert Content.store_copy(first.path) == first
    files[0].unlink()
    assert first.path.read_text() == "same"


def test_another_content_under_the_same_name_is_noticed(cache):
    file = cache / "a.exr"
    for text in ("one", "other"):
        with atomic_path(file) as temporary:
            temporary.write_text(text)
        assert Content.store_copy(file).path.read_text() == text


def test_content_that_the_store_lacks_is_named(cache):
    with pytest.raises(ContentError, match=rf"{cache}/content lacks the file 0123\.exr"):
        _ = Content("0123", ".exr").path


def _flipped(file: Path) -> None:
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)


def _folder(file: Path) -> None:
    file.unlink()
    (file / "more").mkdir(parents=True)


DAMAGE: dict[str, Callable[[Path], object]] = {
    "flipped": _flipped,
    "cut": lambda file: os.truncate(file, file.stat().st_size // 2),
    "empty": lambda file: os.truncate(file, 0),
    "longer": lambda file: file.write_bytes(file.read_bytes() + b"x"),
    "folder": _folder,
    "pipe": lambda file: (file.unlink(), os.mkfifo(file)),
    "loop": lambda file: (file.unlink(), file.symlink_to(file)),
}


@pytest.mark.parametrize("room", ["content", "stuff"])
@pytest.mark.parametrize("damage", DAMAGE)
def test_what_is_damaged_is_made_again_with_a_note(cache, damage, room):
    calls: list[int] = []

    def make() -> tuple[Content, ...]:
        calls.append(1)
        return tuple(Content.store_bytes(data, ".txt") for data in (b"one", b"other"))

    files = cached_files("stuff", "key", make)
    assert cached_files("stuff", "key", make) == files
    assert len(calls) == 1
    (damaged,) = [file for file in (cache / room).iterdir() if room == "stuff" or file == files[1].path]
    DAMAGE[damage](damaged)
    assert cached_files("stuff", "key", make) == files
    assert [file.path.read_bytes() for file in files] == [b"one", b"other"]
    assert len(calls) == 2
    assert take_notes() == (f"{damaged}: was damaged, and is made again",)
    assert cached_files("stuff", "key", make) == files
    assert len(calls) == 2
    assert take_notes() == ()


def test_what_is_gone_is_made_again_without_a_note(cache):
    (file,) = cached_files("stuff", "key", lambda: (Content.store_bytes(b"one", ".txt"),))
    file.path.unlink()
    assert cached_files("stuff", "key", lambda: (Content.store_bytes(b"one", ".txt"),)) == (file,)
    assert file.path.is_file()
    assert take_notes() == ()


def test_a_value_of_another_key_is_damaged(cache):
    store_cached("stuff", "a", [1])
    store_cached("stuff", "b", [2])
    (cache / "stuff" / "a.json").write_bytes((cache / "stuff" / "b.json").read_bytes())
    assert load_cached("stuff", "a") is None
    assert load_cached("stuff", "b") == [2]
    assert json.loads((cache / "stuff" / "b.json").read_text())["value"] == [2]
    assert take_notes() == (f"{cache}/stuff/a.json: was damaged, and is made again",)


def test_a_cache_that_is_no_folder_is_named(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.raises(OutputError, match=rf"the cache cannot be written: {tmp_path}/file/cache/osl: Not a directory"):
        cache_dir("osl")


def test_what_a_library_loses_on_a_full_disk_is_an_error(tmp_path):
    (tmp_path / "full").symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left"), memory_file(tmp_path / "full") as memory:
        Path(memory).write_bytes(b"a few bytes")
    with memory_file(tmp_path / "room") as memory:
        Path(memory).write_bytes(b"a few bytes")
    assert (tmp_path / "room").read_bytes() == b"a few bytes"


@pytest.mark.parametrize("folder", [Path(), Path("/"), Path("..")])
def test_a_folder_is_no_file_to_write(folder):
    with pytest.raises(IsADirectoryError, match="is a folder"), atomic_path(folder):
        pass


def _write_twice(file: Path) -> None:
    with atomic_path(file) as temporary, temporary.open("wb", 0) as stream:
        assert stream.write(bytes(2000)) == 1000
        stream.write(bytes(2000))


def test_a_full_disk_is_named(cache, tmp_path):
    """A limit of the size of files makes a write fail as on a full disk."""
    before, ignored = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(OutputError, match=f"the cache cannot be written: {cache}"):
            Content.store_bytes(bytes(2000), ".txt")
        with pytest.raises(OutputError, match=f"the cache cannot be written: {cache}/stuff/key.json"):
            store_cached("stuff", "key", "long" * 1000)
        with pytest.raises(OSError, match=f"'{tmp_path}/frame.png'"):
            _write_twice(tmp_path / "frame.png")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ignored)
    assert list((cache / "content").iterdir()) == list((cache / "stuff").iterdir()) == []
