"""Arranging layers: order, names, switches, modes, variants; copies as USD text; and sources of their parameters."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lookdev.errors import LookdevError, LookError
from lookdev.material import Formula, Primvar
from lookdev.material.library.arrange import enable_layer, move_layer, rename_layer, select_variant, set_mode
from lookdev.material.library.constants import set_inputs
from lookdev.material.library.edit import set_mask
from lookdev.material.library.fragments import copy_layer, duplicate_layer, paste_layer
from lookdev.material.library.masks import parse_mask
from lookdev.material.library.parameters import set_source, unset_parameter
from lookdev.material.library.stack import read_outline
from lookdev.material.usd import read_look

MATERIALS = Path(__file__).parents[2] / "materials"
DUSTY = {"wear": "dusty"}


def names(file: Path, **variants: str) -> list[str]:
    return [entry.name for entry in read_outline(file, variants=variants).entries]


def test_an_outline_has_all_layers_and_variants(car: Path) -> None:
    clean, dusty = read_outline(car), read_outline(car, variants=DUSTY)
    assert [(e.number, e.name, e.enabled) for e in clean.entries] == [(0, "Base", 1), (1, "Flakes", 1), (2, "Dust", 0)]
    assert all(entry.enabled for entry in dusty.entries)
    assert clean.variants == {"wear": (("clean", "dusty"), "clean")}


def test_layers_are_moved_with_all_that_they_have_in_every_variant(car: Path) -> None:
    before = read_look(car, variants=DUSTY)
    move_layer(car, "Dust", 1)
    assert read_look(car, variants=DUSTY).layers == (before.layers[0], before.layers[2], before.layers[1])
    assert names(car) == ["Base", "Dust", "Flakes"]
    assert [layer.name for layer in read_look(car).layers] == ["Base", "Flakes"]
    move_layer(car, "1", 2)
    assert read_look(car, variants=DUSTY) == before


def test_a_layer_is_renamed_and_nothing_else(car: Path) -> None:
    before, text = read_look(car, variants=DUSTY), car.read_text()
    rename_layer(car, "dust", "Grime")
    assert [e.name for e in read_look(car, variants=DUSTY).layers] == ["Base", "Flakes", "Grime"]
    assert [e.inputs for e in read_look(car, variants=DUSTY).layers] == [e.inputs for e in before.layers]
    old, new = text.replace("/Dust.", "/Grime.").replace('Shader "Dust"', 'Shader "Grime"'), car.read_text()
    assert new == old
    rename_layer(car, "0", "Paint")
    assert names(car)[0] == "Paint"


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda file: move_layer(file, "Dust", 0), "cannot be layer 0"),
        (lambda file: move_layer(file, "Base", 1), "is the base"),
        (lambda file: rename_layer(file, "Dust", "a b"), "cannot be the name"),
        (lambda file: rename_layer(file, "Dust", "Flakes"), "is there already"),
        (lambda file: enable_layer(file, "Base", False), "is the base"),
        (lambda file: set_mode(file, "Dust", "transmit"), "cannot be 'transmit'"),
        (lambda file: select_variant(file, "wear", "dirty"), "did you mean 'dusty'"),
        (lambda file: paste_layer(file, "#usda 1.0\n"), "has no layer of a look"),
        (lambda file: paste_layer(file, "roughness"), "has no layer of a look"),
        (lambda file: duplicate_layer(file, "Dirt"), "no layer 'Dirt'"),
    ],
)
def test_what_cannot_be_is_refused(edit: Callable[[Path], object], message: str, car: Path) -> None:
    text = car.read_text()
    with pytest.raises(LookError, match=message):
        edit(car)
    assert car.read_text() == text


def test_a_switch_is_set_in_the_variant_that_has_it(car: Path) -> None:
    enable_layer(car, "Dust", True, variants={"wear": "clean"})
    assert len(read_look(car).layers) == 3
    enable_layer(car, "Dust", False, variants=DUSTY)
    assert [len(read_look(car, variants={"wear": choice}).layers) for choice in ("clean", "dusty")] == [3, 2]
    enable_layer(car, "Flakes", False)
    assert [len(read_look(car, variants={"wear": choice}).layers) for choice in ("clean", "dusty")] == [2, 1]


def test_the_file_s_own_variant_is_chosen(car: Path) -> None:
    text = car.read_text()
    select_variant(car, "wear", "dusty")
    assert read_look(car) == read_look(car, variants=DUSTY)
    assert car.read_text() == text.replace('wear = "clean"', 'wear = "dusty"')


def test_a_copy_is_the_same_layer_in_another_look_and_folder(car: Path, tmp_path: Path) -> None:
    other = tmp_path / "other" / "frosted.usda"
    other.parent.mkdir()
    shutil.copy(MATERIALS / "frosted_plastic.usda", other)
    text = copy_layer(car, "Dust", variants=DUSTY)
    dust = read_look(car, variants=DUSTY).layers[2]
    assert paste_layer(other, text) == 1
    pasted = read_look(other).layers[1]
    assert (pasted.inputs, pasted.mask, pasted.name) == (dust.inputs, dust.mask, "Dust")
    assert "@../textures/dirt.png@" in other.read_text()


def test_a_copy_of_a_base_has_the_values_of_the_interface(car: Path) -> None:
    base = read_look(car).layers[0]
    number = paste_layer(car, copy_layer(car, "Base"))
    pasted = read_look(car).layers[-1]
    assert (number, pasted.name, pasted.inputs) == (3, "Base2", base.inputs)
    assert "paintColor" not in copy_layer(car, "Base")


def test_a_duplicate_is_connected_to_the_same_interface(car: Path) -> None:
    assert duplicate_layer(car, "Base") == 3
    car.write_text(re.sub(r"inputs:paintColor = [^)]*\)", "inputs:paintColor = (0.125, 0.25, 0.5)", car.read_text()))
    base, *_, copy = read_look(car).layers
    assert base.inputs["baseColor"] == copy.inputs["baseColor"] == (0.125, 0.25, 0.5)


def test_numbers_of_an_expression_are_set(car: Path) -> None:
    mask = parse_mask("dirt * amount", ["dirt=textures/dirt.png", "amount=0.5"], car.parent)
    set_mask(car, "Dust", mask, variants=DUSTY)
    set_inputs(car, {(2, "mask.amount"): 0.75}, variants=DUSTY)
    assert read_look(car, variants=DUSTY).layers[2].mask.inputs["amount"] == 0.75
    with pytest.raises(LookError, match="did you mean 'amount'"):
        set_inputs(car, {(2, "mask.amuont"): 0.75}, variants=DUSTY)


def test_every_edit_keeps_the_comments_of_what_stays(car: Path) -> None:
    set_inputs(car, {(0, "roughness"): 0.25, (0, "sheen"): 0.5})
    move_layer(car, "Dust", 1)
    rename_layer(car, "Flakes", "Glitter")
    duplicate_layer(car, "Base")
    enable_layer(car, "Dust", True)
    assert all(f"# This is {name}.\n" in car.read_text() for name in ("Base", "Flakes", "Dust"))


def base(file: Path) -> dict[str, Any]:
    return dict(read_look(file).layers[0].inputs)


def test_a_number_takes_an_image_a_primvar_and_an_expression_and_is_taken_back(car: Path) -> None:
    text, before = car.read_text(), base(car)
    set_source(car, "0", "sheen", parse_mask("textures/dirt.png:g", folder=car.parent, name="sheen"))
    image = base(car)["sheen"]
    assert (image.file.name, image.channel, image.colorspace) == ("dirt.png", "g", "raw")
    set_source(car, "0", "sheen", parse_mask("primvar:wear", name="sheen"))
    assert base(car)["sheen"] == Primvar("wear", 0.0)
    words = parse_mask("dirt * amount", ["dirt=textures/dirt.png", "amount=.5"], car.parent, "sheen")
    set_source(car, "0", "sheen", words)
    assert base(car)["sheen"].inputs["amount"] == 0.5
    set_inputs(car, {(0, "sheen.amount"): 0.75})
    # A name without a new source keeps the one that it has.
    set_source(car, "0", "sheen", parse_mask("1 - dirt * amount", name="sheen"))
    assert base(car)["sheen"].inputs["amount"] == 0.75
    unset_parameter(car, "0", "sheen")
    assert base(car) == before
    assert car.read_text() == text


def test_a_colour_takes_all_channels_and_an_expression_of_a_colour(car: Path) -> None:
    def color(words: str, *inputs: str) -> object:
        set_source(car, "Base", "baseColor", parse_mask(words, inputs, car.parent, "baseColor", "color"))
        return base(car)["baseColor"]

    count = car.read_text().count("sourceColorSpace")
    assert color("textures/dirt.png").channel == "rgb"
    assert car.read_text().count("sourceColorSpace") == count  # by the image, as USD does
    assert color("primvar:displayColor") == Primvar("displayColor", (0.0, 0.0, 0.0))
    assert isinstance(color("mix([1, 0, 0], c, 0.5)", "c=textures/dirt.png:rgb"), Formula)
    with pytest.raises(LookdevError, match="luminance"):
        set_source(car, "0", "roughness", parse_mask("[1, 0, 0]", name="roughness"))
    with pytest.raises(LookdevError, match="unknown channel 'r'"):
        color("textures/dirt.png:r")


def test_a_stated_constant_is_taken_back_in_every_variant(car: Path) -> None:
    text = car.read_text()
    assert "roughness" in base(car)
    unset_parameter(car, "0", "roughness")
    assert "roughness" not in base(car)
    assert len(car.read_text().splitlines()) == len(text.splitlines()) - 1
    with pytest.raises(LookdevError, match="does not state 'roughness'"):
        unset_parameter(car, "0", "roughness")
    with pytest.raises(LookdevError, match="did you mean 'roughness'"):
        unset_parameter(car, "0", "rougness")


def test_what_another_file_states_is_blocked(car: Path) -> None:
    other = car.with_name("other.usda")
    head = '#usda 1.0\n(\n defaultPrim = "Mine"\n)\n'
    other.write_text(head + 'def "Mine" (\n references = @./car_paint.usda@</CarPaint>\n)\n{\n}\n')
    before = car.read_bytes()
    set_source(other, "0", "roughness", parse_mask("primvar:wear", name="roughness"))
    assert base(other)["roughness"] == Primvar("wear", 0.0)
    unset_parameter(other, "0", "roughness")
    assert "roughness" not in base(other)
    set_inputs(other, {(0, "roughness"): 0.5})
    assert base(other)["roughness"] == 0.5
    assert car.read_bytes() == before


def test_a_token_takes_no_source(car: Path) -> None:
    with pytest.raises(LookdevError, match="only numbers and colours"):
        set_source(car, "0", "variant", parse_mask("primvar:wear", name="variant"))
