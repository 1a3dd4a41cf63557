"""`evaluate_lines`: lines that are not cases, refused with their numbers; numbers that depend on the view."""

import json
from pathlib import Path

import numpy as np
import pytest

from lookdev.checks.evaluate import Evaluator, evaluate_lines
from lookdev.errors import ModelError

_CASE = {"model": "disney", "params": {}, "wo": [0, 0, 1], "wi": [0, 0, 1]}
_FRESNEL = {"model": "fresnel", "params": {"eta": 1.5}, "cosTheta": 1}


def _fresnel(**changes: object) -> str:
    return json.dumps(_FRESNEL | changes)


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
        (_line(params={"roughness": "view + dirt"}), "'view + dirt', which is not an expression of the view: unknown"),
        (_line(params={"roughness": "[view, 0, 0]"}), "the result is a color ('roughness' is a float)"),
        (_line(params={"roughness": "0.5"}), "does not depend on the view (a number would be right)"),
        (_line(params={"normal": "view"}), "the result is a float ('normal' is a normal)"),
        (_line(params={"variant": "view"}), "disney.variant is 'view'; one of 2014, 2012"),
        (_line(params={"mask": "view"}), "unknown parameter 'mask'"),
        (_line(model="stack", layers=[{"model": "pixar", "mask": "vew"}]), "layer 0: pixar.mask is 'vew'"),
        (_line(params={"metal": "gold", "k": "[view, 1, 1]"}), "k is '[view, 1, 1]', but metal 'gold' stands for"),
        (_line(model="fresnel"), "cosTheta missing; model, params, cosTheta are needed"),
        (_line(model="fresnle"), "did you mean 'fresnel'"),
        (_fresnel(cosTheta=1.5), "cosTheta is 1.5; a number from 0 to 1 would be right"),
        (_fresnel(cosTheta=[1, 1, 1]), "cosTheta is [1, 1, 1]; a number from 0 to 1"),
        (_fresnel(cosTheta=float("nan")), "cosTheta is nan; a number"),
        (_fresnel(cosTheta=True), "cosTheta is True; a number"),
        (_fresnel(params=[]), "params must be an object"),
        (_fresnel(params={"n": 1.5}), "fresnel: unknown parameter 'n'"),
        (_fresnel(params={"eta": 0.0}), "fresnel.eta is 0.0; its range is 0.05 to 10"),
        (_fresnel(params={"eta": [1, 1, 1]}), "fresnel.eta is [1, 1, 1]; a number would be right"),
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


# Each of the second has the numbers that the first has at the view, whose cosine is 0.8.
_VIEWED = {"roughness": "mix(.6, .1, 1 - view)", "baseColor": "[view, .5, .2]", "metallic": "9 * view"}
_SEEN = (
    [{"model": "disney", "params": _VIEWED}],
    [{"model": "disney", "params": {"roughness": 0.5, "baseColor": [0.8, 0.5, 0.2], "metallic": 1.0}}],
)
_CLEAR = {"clear": "1 - view", "specularConeScale": "view", "diffuseNormal": "[0, view, 1]"}
_STACKED = (
    [{"model": "pixar", "params": _CLEAR}, {"model": "disney", "params": {"baseColor": "view"}, "mask": "view * view"}],
    [
        {"model": "pixar", "params": {"clear": 0.2, "specularConeScale": 0.8, "diffuseNormal": [0.0, 0.8, 1.0]}},
        {"model": "disney", "params": {"baseColor": [0.8, 0.8, 0.8]}, "mask": 0.64},
    ],
)


@pytest.mark.both_pythons
@pytest.mark.cycles
def test_cycles_answers_from_a_process_of_its_own() -> None:
    """Other tests share one that is warm."""
    (numpy, cycles) = (json.loads(*evaluate_lines([_line()], backend)) for backend in ("numpy", "cycles"))
    np.testing.assert_allclose([*cycles["f"], cycles["pdf"]], [*numpy["f"], numpy["pdf"]], rtol=1e-6)


@pytest.mark.usefixtures("warm_points")
@pytest.mark.parametrize("backend", ["numpy", pytest.param("cycles", marks=pytest.mark.cycles)])
def test_numbers_may_be_expressions_of_the_view(backend: Evaluator) -> None:
    front, behind = {"wo": [0.6, 0, 0.8], "wi": [-0.6, 0, 0.8]}, {"wo": [0.6, 0, -0.8], "wi": [0, 0.6, -0.8]}
    cases = [*((layers, front) for layers in (*_SEEN, *_STACKED)), *((layers, behind) for layers in _STACKED)]
    lines = [json.dumps({"model": "stack", "layers": layers, **seen}) for layers, seen in cases]
    answers = [json.loads(line) for line in evaluate_lines(lines, backend)]
    f, density = (np.array([answer[name] for answer in answers]) for name in ("f", "pdf"))
    assert (f > 0.0).all()
    np.testing.assert_allclose(f[0::2], f[1::2], rtol=2e-6 if backend == "cycles" else 1e-12)
    np.testing.assert_allclose(density[0::2], density[1::2], rtol=2e-6 if backend == "cycles" else 1e-12)


def test_fresnel_answers_with_the_reflectance() -> None:
    lines = (Path(__file__).parents[1] / "oracles" / "fresnel.jsonl").read_text().splitlines()
    cases = [json.loads(line) for line in lines]
    expected = [case.pop("F") for case in cases]
    # Among other lines, with keys of its own.
    questions = [_line(), *(json.dumps(case | {"mine": number}) for number, case in enumerate(cases)), "", _fresnel()]
    disney, *answers, blank, glass = evaluate_lines(questions, "numpy")
    assert "f" in json.loads(disney)
    assert blank == ""
    assert json.loads(glass) == _FRESNEL | {"F": pytest.approx(0.04, rel=1e-12)}
    results = [json.loads(answer) for answer in answers]
    assert [answer | {"F": 0} for answer in results] == [case | {"mine": i, "F": 0} for i, case in enumerate(cases)]
    np.testing.assert_allclose([answer["F"] for answer in results], expected, rtol=1e-9, atol=1e-12)


def test_fresnel_is_not_for_cycles() -> None:
    with pytest.raises(ModelError, match=r"line 1: 'fresnel' is not a surface, .*; --backend numpy would be right"):
        list(evaluate_lines([_fresnel()], "cycles"))
