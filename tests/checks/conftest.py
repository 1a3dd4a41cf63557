"""A renderer of the checks: the warm worker of each renderer."""

import pytest

from lookdev.checks.frames import RenderHalves
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import FrameTask


@pytest.fixture
def render(request: pytest.FixtureRequest) -> RenderHalves:
    def render_frame(task: FrameTask) -> WorkerFrame:
        name = "mitsuba_worker" if task.scene.backend == "mitsuba" else "cycles_worker"
        worker = request.getfixturevalue(name)
        worker.start()
        return worker.render(task, lambda progress: None)

    return render_frame
