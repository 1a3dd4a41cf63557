"""The models in NumPy against values of an independent implementation."""

import json
from pathlib import Path

import numpy as np
import pytest

from lookdev.brdf import CONTINUOUS_MODELS
from lookdev.checks.evaluate import evaluate_lines

# Cases of `test_fresnel` have no directions.
ORACLES = [path for path in sorted((Path(__file__).parents[1] / "oracles").glob("*.jsonl")) if path.stem != "fresnel"]


@pytest.mark.parametrize("oracle", ORACLES, ids=lambda path: path.stem)
def test_f_agrees_with_the_oracle(oracle: Path) -> None:
    lines = oracle.read_text().splitlines()
    assert lines
    expected = np.array([json.loads(line)["f"] for line in lines])
    answers = [json.loads(line) for line in evaluate_lines(lines, "numpy")]
    np.testing.assert_allclose([answer["f"] for answer in answers], expected, rtol=1e-9, atol=1e-12)


def test_every_model_has_an_oracle() -> None:
    models = {json.loads(line)["model"] for path in ORACLES for line in path.read_text().splitlines()}
    assert set(CONTINUOUS_MODELS) <= models
