"""Looks with another value of one input."""

from __future__ import annotations

import pytest

from lookdev.errors import ModelError
from lookdev.material import Formula, Layer, Look, Primvar, View
from lookdev.material.change import changed_look, varied_names
from lookdev.material.expression import parse

AMOUNT = Formula(
    parse("smoothstep(wear, low, 1) * amount"),
    {"wear": Primvar("wear", 0.0), "low": 0.2, "amount": 0.5},
    dict.fromkeys(("wear", "low", "amount"), "float"),
)
STEEL = Layer("Steel", "disney", {"roughness": 0.3, "metallic": 1.0})
DUST = Layer("Dust", "disney", {"baseColor": (0.5, 0.4, 0.3)}, mask=0.25)
PAINT = Look("paint", (STEEL, Layer("Paint", "disney", {"roughness": 0.5}, mask=AMOUNT), DUST))


def layer(look: Look, name: str) -> Layer:
    return next(each for each in look.layers if each.name == name)


@pytest.mark.parametrize(
    ("parameter", "value", "name", "expected"),
    [
        ("Paint.roughness", 0.9, "roughness", 0.9),
        ("Paint.metallic", 1, "metallic", 1.0),  # of a default
        ("Dust.baseColor", (0.1, 0.2, 0.3), "baseColor", (0.1, 0.2, 0.3)),
        ("Dust.baseColor", 0.5, "baseColor", (0.5, 0.5, 0.5)),
    ],
)
def test_an_input_of_one_layer(parameter: str, value: object, name: str, expected: object) -> None:
    changed = changed_look(PAINT, parameter, value)
    own = parameter.partition(".")[0]
    assert layer(changed, own).inputs == {**layer(PAINT, own).inputs, name: expected}
    assert [each for each in changed.layers if each.name != own] == [each for each in PAINT.layers if each.name != own]


def test_masks_and_inputs_of_their_expressions() -> None:
    assert layer(changed_look(PAINT, "Dust.mask", 0.75), "Dust").mask == 0.75
    mask = layer(changed_look(PAINT, "Paint.mask.amount", 0.9), "Paint").mask
    assert mask == Formula(AMOUNT.expression, {**AMOUNT.inputs, "amount": 0.9}, AMOUNT.kinds)
    assert layer(changed_look(PAINT, "mask.amount", 0.9), "Paint").mask == mask  # one layer alone has it
    other = layer(changed_look(PAINT, "Paint.mask", "wear * wear * view"), "Paint").mask
    kinds = {"wear": "float", "view": "float"}
    assert other == Formula(parse("wear * wear * view"), {"wear": Primvar("wear", 0.0), "view": View()}, kinds)
    rough = layer(changed_look(PAINT, "Steel.roughness", "0.2 + 0.5 * (1 - view)"), "Steel").inputs["roughness"]
    assert rough.inputs == {"view": View()}


def test_of_a_single_layer_the_name_of_the_input_is_enough() -> None:
    single = Look("steel", PAINT.layers[:1])
    assert changed_look(single, "roughness", 0.1).layers[0].inputs["roughness"] == 0.1
    assert changed_look(single, "variant", "2012").layers[0].inputs["variant"] == "2012"


@pytest.mark.parametrize(
    ("parameter", "value", "message"),
    [
        ("rougness", 0.5, "no 'rougness' .did you mean 'roughness'"),
        ("Pant.roughness", 0.5, "did you mean 'Paint.roughness'"),
        ("roughness", 0.5, "several layers .*one of Steel.roughness, Paint.roughness, Dust.roughness would be right"),
        ("Paint.roughness", 1.5, "its range is 0 to 1"),
        ("Paint.roughness", (0.1, 0.2, 0.3), "a number would be right"),
        ("Paint.roughness", float("nan"), "its range is"),
        ("Dust.mask", -1.0, "its range is 0 to 1"),
        ("Paint.mask.amont", 0.5, "did you mean '.*mask.amount'"),
        ("Paint.mask", "waer * 2", "unknown name 'waer' .did you mean 'wear'"),
        ("Paint.mask", "wear *", "."),
        ("Paint.mask", "[1, 0, 0]", "a float would be right"),
        ("Steel.mask", 0.5, "did you mean"),  # a base has none
        ("Paint.variant", "2012", "choice that layers share"),
    ],
)
def test_what_cannot_vary_and_what_would_be_right(parameter: str, value: object, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        changed_look(PAINT, parameter, value)


def test_every_name_can_be_used() -> None:
    names = dict(varied_names(PAINT))
    assert {"Steel.roughness", "Paint.mask", "Paint.mask.wear", "Dust.mask"} <= names.keys()
    assert "Steel.mask" not in names
