"""Frames of simple scenes from the warm worker of Cycles."""

import pytest
from frames import RenderScene, frames_of

from lookdev.rendering.worker import Worker


@pytest.fixture(scope="session")
def worker(cycles_worker: Worker) -> Worker:
    return cycles_worker


@pytest.fixture(scope="session")
def render(cycles_worker: Worker) -> RenderScene:
    return frames_of(cycles_worker)
