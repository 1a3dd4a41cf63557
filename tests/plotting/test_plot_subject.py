"""The subjects that words of the command line describe."""

from pathlib import Path

import numpy as np
import pytest

from lookdev.brdf import MODELS, evaluate
from lookdev.brdf.angles import spherical_direction
from lookdev.errors import LookdevError
from lookdev.plotting import read_subject

MATERIALS = Path(__file__).parents[2] / "materials"
WO, WI = spherical_direction(np.array([0.3, 0.9])), spherical_direction(np.array([0.5, 0.2]), np.array([1.0, 2.5]))


@pytest.fixture(autouse=True)
def library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOOKDEV_LIBRARY", str(MATERIALS / "presets"))


def test_a_model_has_its_parameters() -> None:
    subject = read_subject("disney:roughness=.3,baseColor=.8/.2/.1,metallic=1")
    parameters = {"roughness": 0.3, "baseColor": (0.8, 0.2, 0.1), "metallic": 1.0}
    model = MODELS["disney"]
    assert np.array_equal(evaluate(subject.bsdf, WO, WI), evaluate(model.bsdf(model.complete(parameters)), WO, WI))
    assert subject.label == "disney:roughness=.3,baseColor=.8/.2/.1,metallic=1"


def test_a_label_names_a_subject() -> None:
    subject = read_subject("rough one=disney:roughness=.9")
    assert (subject.label, subject.parameters["roughness"]) == ("rough one", 0.9)
    assert read_subject("mine=red_plastic").label == "mine"


def test_a_preset_can_be_changed() -> None:
    plain, rough = read_subject("red_plastic"), read_subject("red_plastic:roughness=.9")
    assert plain.model == rough.model
    assert rough.parameters["roughness"] == 0.9
    assert np.array_equal(plain.parameters["baseColor"], rough.parameters["baseColor"])


def test_a_look_is_its_stack_or_one_layer() -> None:
    file = MATERIALS / "car_paint.usda"
    stack, base, upper = (read_subject(f"{file}{layer}") for layer in ("", ":0", ":1"))
    assert (stack.label, base.label) == ("car_paint", "car_paint:0")
    assert np.all(evaluate(base.bsdf, WO, WI) > 0.0)
    assert stack.parameters is None
    assert not np.array_equal(evaluate(upper.bsdf, WO, WI), evaluate(base.bsdf, WO, WI))


def test_textures_are_read_at_the_place() -> None:
    places = [read_subject(f"{MATERIALS / 'lacquer_wood.usda'}@{u},0.4") for u in (0.1, 0.37)]
    first, second = (evaluate(subject.bsdf, WO, WI) for subject in places)
    assert first.shape == WO.shape
    assert not np.array_equal(first, second)


@pytest.mark.parametrize("file", sorted(MATERIALS.glob("*.usda")), ids=lambda file: file.stem)
def test_every_example_look_has_f(file: Path) -> None:
    f = evaluate(read_subject(str(file)).bsdf, WO, WI)
    assert np.isfinite(f).all()
    assert f.max() > 0.0


REFUSED = {
    "disny:roughness=1": "did you mean 'disney'",
    "red_plastik": "did you mean 'red_plastic'",
    "qqqq": "is not a model, a preset or a file",
    "disney:rougness=1": "did you mean 'roughness'",
    "disney:roughness": "is not NAME=VALUE",
    "disney:roughness=a": "a number would be right",
    "disney:roughness=2": "its range is 0 to 1",
    "disney:baseColor=1/2": "R/G/B or one number",
    "disney:variant=2013": "one of 2014, 2012",
    "nothing.binary": "no such file",
    "nothing.usda": "nothing.usda",
    f"{MATERIALS / 'car_paint.usda'}:9": "no layer '9'",
    f"{MATERIALS / 'car_paint.usda'}@1": "is not a location",
}


@pytest.mark.parametrize(("words", "message"), REFUSED.items())
def test_what_is_nothing_is_refused(words: str, message: str) -> None:
    with pytest.raises(LookdevError, match=message):
        read_subject(words)
