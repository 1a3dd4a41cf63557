import pytest
from usd_file import File


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def file(tmp_path) -> File:
    return File(tmp_path / "thing.usda")
