"""`evaluate_lines`: lines that are no case, each refused with its number."""

from __future__ import annotations

import json

import pytest

from lookdev.checks.evaluate import evaluate_lines
from lookdev.errors import ModelError

_CASE = {"model": "disney", "params": {}, "wo": [0, 0, 1], "wi": [0, 0, 1]}


def _line(**changes: object) -> str:
    return json.dumps(_CASE | changes)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (_line(model=["disney"]), "unknown model '['disney']'"),
        (_line(model="stack", layers=[{"model": {"a": 1}}]), "layer 0: unknown model"),
        (_line(wo=["0", "0", "1"]), "wo is ['0', '0', '1']; a unit vector of three numbers"),
        (_line(wi=[False, False, True]), "wi is [False, False, True]; a unit vector"),
        (_line(wi=[10**400, 0, 1]), "a unit vector of three numbers"),
        (_line(params={"roughness": True}), "disney.roughness is True; a number"),
        (_line(params={"baseColor": [True, 0.5, 0.5]}), "disney.baseColor is [True, 0.5, 0.5]; three numbers"),
        (_line(params={"baseColor": ["0", "0", "1"]}), "three numbers would be right"),
        (_line(params={"roughness": 10**400}), "a number would be right"),
        (_line(params={"roughness": "x" * 300_000}), "disney.roughness is 'xxx"),
        ("[" * 100_000, "deep"),
        ("9" * 5000, "not JSON: Exceeds the limit"),
        ('{"model" 1}', "column 10: not JSON"),
    ],
)
def test_a_line_that_is_no_case_is_refused_with_its_number(line, message):
    with pytest.raises(ModelError) as caught:
        list(evaluate_lines(["", line], "numpy"))
    assert str(caught.value).startswith("line 2: ")
    assert message in str(caught.value)
    assert len(str(caught.value)) < 2000
