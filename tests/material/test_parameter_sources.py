"""What gives a parameter its value, set and taken back in a look's file."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from lookdev.errors import LookdevError
from lookdev.material.library.constants import set_inputs
from lookdev.material.library.masks import parse_mask
from lookdev.material.library.parameters import set_source, unset_parameter
from lookdev.material.look import Formula, Primvar, Texture
from lookdev.material.usd import read_look

ROOT = Path(__file__).parents[2]


@pytest.fixture
def car(tmp_path: Path) -> Path:
    shutil.copytree(ROOT / "materials" / "textures", tmp_path / "textures")
    return Path(shutil.copy(ROOT / "materials" / "car_paint.usda", tmp_path))


def base(file: Path) -> dict[str, object]:
    return dict(read_look(file).layers[0].inputs)


def test_a_number_takes_an_image_a_primvar_and_an_expression_and_is_taken_back(car: Path) -> None:
    text, before = car.read_text(), base(car)
    set_source(car, "0", "sheen", parse_mask("textures/dirt.png:g", folder=car.parent, what="sheen"))
    image = base(car)["sheen"]
    assert isinstance(image, Texture)
    assert (image.file.name, image.channel, image.colorspace) == ("dirt.png", "g", "raw")
    set_source(car, "0", "sheen", parse_mask("primvar:wear", what="sheen"))
    assert base(car)["sheen"] == Primvar("wear", 0.0)
    words = parse_mask("dirt * amount", ["dirt=textures/dirt.png", "amount=.5"], car.parent, "sheen")
    set_source(car, "0", "sheen", words)
    formula = base(car)["sheen"]
    assert isinstance(formula, Formula)
    assert formula.inputs["amount"] == 0.5
    set_inputs(car, {(0, "sheen.amount"): 0.75})
    # A name without a new source keeps the one that it has.
    set_source(car, "0", "sheen", parse_mask("1 - dirt * amount", what="sheen"))
    formula = base(car)["sheen"]
    assert isinstance(formula, Formula)
    assert formula.inputs["amount"] == 0.75
    unset_parameter(car, "0", "sheen")
    assert base(car) == before
    assert car.read_text() == text


def test_a_colour_takes_all_channels_and_an_expression_of_a_colour(car: Path) -> None:
    text = car.read_text()
    set_source(car, "base", "baseColor", parse_mask("textures/dirt.png", (), car.parent, "baseColor", "color"))
    image = base(car)["baseColor"]
    assert isinstance(image, Texture)
    assert image.channel == "rgb"
    assert car.read_text().count("sourceColorSpace") == text.count("sourceColorSpace")  # by the image, as USD does
    set_source(car, "Base", "baseColor", parse_mask("primvar:displayColor", (), car.parent, "baseColor", "color"))
    assert base(car)["baseColor"] == Primvar("displayColor", (0.0, 0.0, 0.0))
    words = parse_mask("mix([1, 0, 0], c, 0.5)", ["c=textures/dirt.png:rgb"], car.parent, "baseColor", "color")
    set_source(car, "Base", "baseColor", words)
    assert isinstance(base(car)["baseColor"], Formula)
    with pytest.raises(LookdevError, match="luminance"):
        set_source(car, "0", "roughness", parse_mask("[1, 0, 0]", what="roughness"))
    with pytest.raises(LookdevError, match="unknown channel 'r'"):
        parse_mask("textures/dirt.png:r", (), car.parent, "baseColor", "color")


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
    other.write_text(
        '#usda 1.0\n(\n defaultPrim = "Mine"\n)\ndef "Mine" (\n references = @./car_paint.usda@</CarPaint>\n)\n{\n}\n'
    )
    before = car.read_bytes()
    set_source(other, "0", "roughness", parse_mask("primvar:wear", what="roughness"))
    assert base(other)["roughness"] == Primvar("wear", 0.0)
    unset_parameter(other, "0", "roughness")
    assert "roughness" not in base(other)
    set_inputs(other, {(0, "roughness"): 0.5})
    assert base(other)["roughness"] == 0.5
    assert car.read_bytes() == before


def test_a_token_takes_no_source(car: Path) -> None:
    with pytest.raises(LookdevError, match="only numbers and colours"):
        set_source(car, "0", "variant", parse_mask("primvar:wear", what="variant"))
