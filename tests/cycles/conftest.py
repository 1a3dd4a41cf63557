"""A warm render worker, and frames of simple scenes from it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from frames import RenderScene, frames_of

from lookdev.render.backends import WORKER_COMMAND
from lookdev.render.worker import Worker


@pytest.fixture(scope="session")
def worker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Worker]:
    folder = tmp_path_factory.mktemp("worker")
    with Worker(WORKER_COMMAND, folder / "worker.log", folder, 300.0) as process:
        yield process


@pytest.fixture(scope="session")
def render(worker: Worker) -> RenderScene:
    return frames_of(worker)
