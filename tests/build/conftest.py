"""Lights of jobs with small tables of directions: these tests do not draw from them."""

from pathlib import Path

import pytest

from lookdev.light.dome import points


@pytest.fixture(scope="session")
def _job_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def _small_tables(_job_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw few directions of a dome, because many take seconds; a separate cache keeps them from other tests."""
    monkeypatch.setattr(points, "SIDE", 32)
    monkeypatch.setenv("LOOKDEV_CACHE", str(_job_cache))
