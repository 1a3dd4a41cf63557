"""Jobs and single frames by the warm workers of the run."""

from collections.abc import Iterator

import pytest
from lending import lend_workers
from stage import Stage

from lookdev.rendering.worker import Worker


@pytest.fixture
def stage(cycles_worker: Worker) -> Stage:
    """Return what renders single frames."""
    return Stage(cycles_worker)


@pytest.fixture
def warm(request: pytest.FixtureRequest) -> Iterator[None]:
    """Let jobs and checks in this process be rendered by the warm workers."""
    with pytest.MonkeyPatch.context() as patch:
        lend_workers(request, patch)
        yield
