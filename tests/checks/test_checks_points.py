"""The point check: its cases, its findings, and faults in the text of a shader."""

import json
from pathlib import Path

import numpy as np
import pytest
from frames import replaced

from lookdev.arrays import Floats
from lookdev.checks import points
from lookdev.checks.evaluate import Batch, evaluate_lines, evaluate_numpy
from lookdev.checks.points import check_points, look_batch
from lookdev.material import Layer, Look, Primvar
from lookdev.material.usd import read_look

MATERIALS = Path(__file__).parents[2] / "materials"
COATED = Look(
    "coated",
    (
        Layer("Base", "disney", {"baseColor": (0.5, 0.2, 0.1), "roughness": Primvar("rough", 0.3)}),
        Layer("Coat", "disney", {"clearcoat": 1.0, "roughness": 0.4}, Primvar("worn", 0.5)),
    ),
)
COUNT = 4000


def test_what_is_constant_folds_and_what_varies_is_drawn_over_all_that_it_takes() -> None:
    batch = look_batch(COATED, COUNT, np.random.default_rng(0))
    assert [set(numbers) for numbers in batch.numbers] == [{"roughness"}, {"mask"}]
    assert batch.layers[0].constants["baseColor"] == [0.5, 0.2, 0.1]
    for values in (batch.numbers[0]["roughness"], batch.numbers[1]["mask"]):
        assert (values == values.astype(np.float32)).all()
        assert values.min() < 0.01
        assert values.max() > 0.99


@pytest.fixture
def exact(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace Cycles by NumPy, a millionth too bright."""

    def evaluate(batch: Batch, alter: object) -> tuple[Floats, Floats]:
        f, density = evaluate_numpy(batch)
        return f * (1.0 + 1e-6), density

    monkeypatch.setattr(points, "evaluate_cycles", evaluate)


@pytest.mark.usefixtures("exact")
def test_agreement_is_a_matter_of_the_tolerance() -> None:
    assert check_points(COATED, count=COUNT).passed
    finding = check_points(COATED, count=COUNT, tolerance=5e-7)
    assert not finding.passed
    assert finding.figures["largest_relative_error"] == pytest.approx(1e-6, rel=1e-6)
    assert finding.figures["failed"] > COUNT / 4


@pytest.mark.usefixtures("exact")
def test_the_worst_cases_replay_in_eval() -> None:
    finding = check_points(COATED, count=COUNT)
    assert len(finding.details) == 5
    for line, again in zip(finding.details, evaluate_lines(finding.details, "numpy"), strict=True):
        f, density = json.loads(again)["f"], json.loads(again)["pdf"]
        np.testing.assert_allclose([*f, density], json.loads(line)["f_and_pdf"]["numpy"], rtol=1e-12)


def test_a_value_that_is_none_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    def evaluate(batch: Batch, alter: object) -> tuple[Floats, Floats]:
        f, density = evaluate_numpy(batch)
        f[7] = np.nan
        density[9] = -1e-9
        return f, density

    monkeypatch.setattr(points, "evaluate_cycles", evaluate)
    finding = check_points(COATED, count=COUNT)
    assert not finding.passed
    assert finding.figures["failed"] == 2.0


@pytest.mark.cycles
@pytest.mark.usefixtures("warm_points")
@pytest.mark.parametrize("name", ["car_paint", "robot_paint"])
def test_a_look_with_textures_agrees(name: str) -> None:
    finding = check_points(read_look(MATERIALS / f"{name}.usda"), count=COUNT, seed=5)
    assert finding.passed, finding.summary
    assert finding.figures["visible_values"] > COUNT


@pytest.mark.cycles
@pytest.mark.usefixtures("warm_points")
@pytest.mark.parametrize(
    ("right", "wrong"), [("f += color(", "f += 1.001 * color("), ("pdf / shares", "pdf / (1.001 * shares)")]
)
def test_a_fault_in_the_text_is_found(right: str, wrong: str) -> None:
    finding = check_points(COATED, count=COUNT, alter=replaced(right, wrong))
    assert not finding.passed
    assert finding.figures["largest_relative_error"] == pytest.approx(1e-3, rel=0.05)
