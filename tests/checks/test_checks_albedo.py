"""The albedo check: a look agrees in three ways, and a wrong density or lobe is found."""

import json

import numpy as np
import pytest
from frames import replaced
from looks import quick_among

from lookdev.checks.albedo import check_albedo
from lookdev.checks.frames import RenderHalves
from lookdev.material import Layer, Look, Primvar
from lookdev.rendering.backends import job_backends
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import FrameTask

GLOSSY = Look("glossy", (Layer("Base", "disney", {"baseColor": (0.5, 0.2, 0.1), "roughness": 0.3}),))
LEAF = Look("leaf", (Layer("Leaf", "pixar", {"back": 0.4, "clear": 0.3, "roughness": Primvar("rough", 0.3)}),))
PAINT = {"base_color": (0.6, 0.2, 0.1), "metalness": 0.5, "coat": 0.8, "coat_roughness": 0.3}
TRANSLATED = Look("paint", (Layer("Paint", "standard_surface", PAINT),))
CELLS = [(look, backend) for look in (GLOSSY, TRANSLATED) for backend in job_backends()]
QUICK = [(look, backend) for look, backend in CELLS if (look is TRANSLATED) == (backend == "exact")]
ANGLES = (0.0, 50.0, 80.0)


def uniform_frame(value: float) -> WorkerFrame:
    image = np.full((4, 4, 3), value, np.float32)
    return WorkerFrame(image, image, np.ones((4, 4), np.float32), 2, 0.0, 0.0, blender="4.5", memory=0)


def test_another_albedo_fails() -> None:
    finding = check_albedo(GLOSSY, lambda task: uniform_frame(0.3), angles=ANGLES)
    assert not finding.passed
    assert "Cycles, reflected" in finding.summary
    worst = json.loads(finding.details[0])
    assert worst["found"] == pytest.approx(0.3)
    assert worst["layers"][0]["params"] == {"baseColor": [0.5, 0.2, 0.1], "roughness": 0.3}


def test_the_card_is_seen_from_every_angle_in_light_that_stays() -> None:
    tasks: list[FrameTask] = []

    def render(task: FrameTask) -> WorkerFrame:
        tasks.append(task)
        return uniform_frame(0.0)

    check_albedo(LEAF, render, points=2, angles=ANGLES[:2])
    assert len(tasks) == 2 * 2 * 2
    assert len({task.scene.lights[0].digest for task in tasks}) == 2
    for task in tasks:
        assert task.pose.element == task.pose.lighting
    assert tasks[0].pose.element == pytest.approx(0.0)


@pytest.mark.cycles
def test_a_look_that_transmits_agrees_on_both_sides(render: RenderHalves) -> None:
    finding = check_albedo(LEAF, render, points=1, angles=ANGLES)
    assert finding.passed, finding.summary
    assert not finding.skipped
    names = [series.name for series in finding.plots[0].series if "Cycles" in series.name]
    assert names == ["reflected, Cycles", "transmitted, Cycles"]


@pytest.mark.cycles
@pytest.mark.parametrize(
    ("look", "backend"), quick_among(CELLS, QUICK), ids=lambda value: getattr(value, "name", value)
)
def test_a_look_agrees_by_each_backend(look: Look, backend: str, render: RenderHalves) -> None:
    finding = check_albedo(look, render, angles=ANGLES, backend=backend)
    assert finding.passed, finding.summary
    # The band of the fits is no wider than what they promise.
    assert look is TRANSLATED or finding.figures["cycles_error"] < 0.01


@pytest.mark.cycles
@pytest.mark.parametrize(
    ("right", "wrong"),
    [("f += color(", "f += 1.01 * color("), ("pdf / shares", "pdf / (1.01 * shares)"), ("u1 * shares", "u1")],
)
def test_a_fault_in_the_text_is_found(right: str, wrong: str, render: RenderHalves) -> None:
    finding = check_albedo(GLOSSY, render, angles=ANGLES, alter=replaced(right, wrong))
    assert not finding.passed
    assert finding.skipped == "no light passes through: no curve of transmission"
