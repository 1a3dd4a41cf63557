"""References of each test are its own."""

from pathlib import Path

import pytest
from bench_fakes import store_references


@pytest.fixture(autouse=True)
def _own_references(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store_references(tmp_path, monkeypatch)
