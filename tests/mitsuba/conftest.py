"""Frames of simple scenes from the warm worker of Mitsuba."""

from __future__ import annotations

import pytest
from frames import RenderScene, frames_of

from lookdev.render.worker import Worker


@pytest.fixture(scope="session")
def worker(mitsuba_worker: Worker) -> Worker:
    return mitsuba_worker


@pytest.fixture(scope="session")
def render(mitsuba_worker: Worker) -> RenderScene:
    return frames_of(mitsuba_worker, "mitsuba")
