"""One cache for all these tests, and one worker for those that render single frames."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))
from stage import Stage


@pytest.fixture(scope="session")
def _shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module", autouse=True)
def _cache(_shared: Path) -> Iterator[None]:
    # Set for each file: for the session, it would reach other folders' tests, which follow in the same process.
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LOOKDEV_CACHE", str(_shared))
        yield


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    """Render single frames with the real worker."""
    with Stage(tmp_path_factory.mktemp("stage")) as stage:
        yield stage
