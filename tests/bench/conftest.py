"""References of these tests are kept in a cache of their own."""

from __future__ import annotations

import pytest

from lookdev.bench.backends import bench_light


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    bench_light.cache_clear()  # its files are in the cache of another test
