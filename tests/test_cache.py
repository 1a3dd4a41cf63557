from __future__ import annotations

from pathlib import Path

import pytest

from lookdev.cache import atomic_path, cache_dir
from lookdev.errors import OutputError


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
