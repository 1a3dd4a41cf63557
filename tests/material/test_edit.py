"""Edits of looks, which either leave a file without faults or change nothing; looks with another value of an input."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from look_files import BASE, LAYER1, STACK, disney, expression, look, stack, write_preset
from pxr import Usd
from variant_sets import over, selecting, variants

from lookdev.errors import LookdevError, LookError, ModelError
from lookdev.material import Coordinates, Formula, Layer, Look, Primvar, Texture, ViewCosine
from lookdev.material.change import constant_named, look_with_value, replace_constants, variable_inputs
from lookdev.material.expression import parse
from lookdev.material.library import Preset, find_preset
from lookdev.material.library.constants import check_writable, set_inputs, write_changed
from lookdev.material.library.edit import add_layer, new_look, remove_layer, set_mask, write_preview
from lookdev.material.library.masks import parse_mask
from lookdev.material.usd import read_look

pytestmark = pytest.mark.both_pythons

MATERIALS = Path(__file__).parents[2] / "materials"
Take = Callable[[str], Preset]
NEW = {"Layers", "Base", "Preview"}


@pytest.fixture
def take(tmp_path: Path) -> Take:
    """Return a function that takes presets from a small library in ``tmp_path/library``."""
    folder = tmp_path / "library"
    folder.mkdir()
    for name, inputs, *model in (
        ("gold", "color3f baseColor = (1, 0.75, 0.25)\nfloat metallic = 1"),
        ("rubber", "color3f baseColor = (0, 0.25, 0.75)"),
        ("wood", "color3f surfaceColor = (0.5, 0.25, 0.125)", "LookdevPixar"),
        ("lacquer", "color3f surfaceColor = (1, 0.5, 0.5)\nfloat clear = 1\nfloat roughness = 0.125", "LookdevPixar"),
    ):
        write_preset(folder / f"{name}.usda", inputs, *model)
    return lambda name: find_preset(name, folder)


@pytest.fixture
def paint(tmp_path: Path, take: Take, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a look of gold; the current folder has its textures."""
    shutil.copy(MATERIALS / "textures" / "dirt.png", tmp_path)
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "paint.usda"
    new_look(file, take("gold"))
    return file


def layers(file: Path, **variants: str) -> list[str]:
    return [layer.name for layer in read_look(file, variants=variants).layers]


def children(file: Path) -> set[str]:
    stage = Usd.Stage.Open(str(file))
    return {prim.GetName() for prim in stage.GetDefaultPrim().GetChildren()}


def node_of(file: Path) -> dict[str, object]:
    """Return the inputs of the expression of Rubber's mask: values, or types and sources."""
    stage = Usd.Stage.Open(str(file))
    node = stage.GetPrimAtPath("/Paint/RubberMask")
    assert node.GetAttribute("info:id").Get() == "LookdevExpression"
    inputs: dict[str, object] = {}
    for attribute in node.GetAttributes():
        if attribute.GetNamespace() == "inputs":
            sources = [str(path) for path in attribute.GetConnections()]
            source = (str(attribute.GetTypeName()), *sources)
            inputs[attribute.GetBaseName()] = source if sources else attribute.Get()
    return inputs


def refused(edit: Callable[[], object], file: Path) -> str:
    """Return the message of the error that an edit raises, and check that nothing was written."""
    before = {path: path.read_bytes() for path in file.parent.rglob("*") if path.is_file()}
    with pytest.raises(LookdevError) as caught:
        edit()
    assert {path: path.read_bytes() for path in file.parent.rglob("*") if path.is_file()} == before
    assert f".{file.stem}." not in str(caught.value), "a message names the copy that was edited"
    return str(caught.value)


def test_a_new_look_is_a_preset_by_reference(paint: Path) -> None:
    text = paint.read_text()
    assert "references = @./library/gold.usda@</Gold>" in text
    assert "baseColor" not in text, "a preset is not copied"
    (base,) = read_look(paint).layers
    assert (base.name, base.model) == ("Base", "disney")
    assert base.inputs == {"baseColor": (1.0, 0.75, 0.25), "metallic": 1.0}
    assert children(paint) == NEW


def test_a_reference_is_relative_to_the_look(tmp_path: Path, take: Take) -> None:
    file = tmp_path / "deep" / "er" / "worn_gold-2.usda"
    assert new_look(file, take("gold")) == "/WornGold2"
    assert "references = @../../library/gold.usda@</Gold>" in file.read_text()
    assert new_look(tmp_path / "x.usdc", take("gold"), "Paint") == "/Paint"
    assert layers(tmp_path / "x.usdc") == ["Base"]


def test_what_a_new_look_refuses(tmp_path: Path, paint: Path, take: Take) -> None:
    gold = take("gold")
    assert "exists already" in refused(lambda: new_look(paint, gold), paint)
    assert "one of .usda, .usd, .usdc" in refused(lambda: new_look(tmp_path / "a.usdz", gold), paint)
    assert "'2a' cannot be the name" in refused(lambda: new_look(tmp_path / "2a.usda", gold), paint)
    assert "'a b' cannot be the name" in refused(lambda: new_look(tmp_path / "a.usda", gold, "a b"), paint)


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("1", 1.0),
        (".25", 0.25),
        ("dirt.png", Texture(Path("dirt.png"), "r", "raw")),
        ("dirt.png:a", Texture(Path("dirt.png"), "a", "raw")),
        ("primvar:wear", Primvar("wear", 0.0)),
    ],
)
def test_a_layer_is_added_with_any_mask(paint: Path, take: Take, typed: str, expected: object) -> None:
    assert add_layer(paint, take("rubber"), parse_mask(typed)) == (1, "Rubber")
    assert add_layer(paint, take("rubber")) == (2, "Rubber2")
    base, rubber, again = read_look(paint).layers
    assert (base.name, rubber.name, again.name) == ("Base", "Rubber", "Rubber2")
    if isinstance(expected, Texture):
        expected = Texture(paint.parent / expected.file, expected.channel, "raw")
        assert "@./dirt.png@" in paint.read_text()
    assert (rubber.mask, again.mask) == (expected, 1.0)


def test_masks_share_their_reader_of_coordinates(paint: Path, take: Take) -> None:
    add_layer(paint, take("rubber"), parse_mask("dirt.png"))
    add_layer(paint, take("gold"), parse_mask("dirt.png:g"))
    assert children(paint) == NEW | {"Rubber", "RubberMask", "Gold", "GoldMask", "St"}
    remove_layer(paint, "Rubber")
    assert children(paint) == NEW | {"Gold", "GoldMask", "St"}
    set_mask(paint, "Gold", parse_mask("1"))
    assert children(paint) == NEW | {"Gold"}


def test_a_single_layer_gets_a_stack(take: Take, shipped: Callable[[str], Path]) -> None:
    file = shipped("brushed_metal")
    (metal,) = read_look(file).layers
    add_layer(file, take("rubber"), parse_mask("0.5"))
    base, rubber = read_look(file).layers
    assert base == metal
    assert (rubber.name, rubber.mask) == ("Rubber", 0.5)


def test_a_layer_that_transmits(tmp_path: Path, take: Take, paint: Path) -> None:
    file = tmp_path / "floor.usda"
    new_look(file, take("wood"))
    add_layer(file, take("lacquer"), mode="transmit")
    assert [layer.mode for layer in read_look(file).layers] == ["over", "transmit"]
    message = refused(lambda: add_layer(paint, take("lacquer"), mode="transmit"), paint)
    assert message.startswith(f"{paint}: /Paint/Layers.inputs:layer1Mode: cannot be 'transmit'")


def test_a_layer_is_removed_from_every_variant(car: Path) -> None:
    assert layers(car, wear="dusty") == ["Base", "Flakes", "Dust"]
    assert remove_layer(car, "1") == (1, "Flakes", True)
    assert layers(car, wear="dusty") == ["Base", "Dust"]
    assert layers(car, wear="clean") == ["Base"]
    assert children(car) == {"Layers", "Base", "Dust", "DirtMask", "DirtScale", "St", "Preview"}
    assert "Car paint in three layers" in car.read_text(), "the rest of the file is kept"
    assert remove_layer(car, "Dust") == (1, "Dust", True)
    assert layers(car, wear="dusty") == ["Base"]
    assert children(car) == NEW


def test_a_node_that_an_unselected_variant_uses_stays(car: Path) -> None:
    enabled, link = "bool inputs:layer2Enabled = 1", "float inputs:layer1Mask.connect = </CarPaint/DirtMask.outputs:r>"
    car.write_text(car.read_text().replace(enabled, f"{enabled}\n{link}"))
    set_mask(car, "Dust", parse_mask("0.5"))
    assert {"DirtMask", "DirtScale"} <= children(car)
    assert read_look(car, variants={"wear": "dusty"}).layers[2].mask == 0.5


@pytest.fixture
def borrowed(tmp_path: Path, take: Take, car: Path) -> Path:
    """Return a look that is the car paint by reference, dusty."""
    file = tmp_path / "shot.usda"
    head = '#usda 1.0\n(\n defaultPrim = "Mine"\n)\ndef "Mine" (\n references = @./car_paint.usda@</CarPaint>\n'
    file.write_text(head + ' variants = {\n  string wear = "dusty"\n }\n)\n{\n}\n')
    return file


def test_a_stack_from_another_file_gets_overrides(borrowed: Path, car: Path, take: Take) -> None:
    before = car.read_bytes()
    set_mask(borrowed, "Dust", parse_mask("0.25"))
    assert read_look(borrowed).layers[2].mask == 0.25
    set_mask(borrowed, "Dust", parse_mask("primvar:wear"))
    assert read_look(borrowed).layers[2].mask == Primvar("wear", 0.0)
    assert add_layer(borrowed, take("rubber")) == (3, "Rubber")
    assert layers(borrowed) == ["Base", "Flakes", "Dust", "Rubber"]
    assert remove_layer(borrowed, "Flakes") == (1, "Flakes", False)
    assert layers(borrowed) == ["Base", "Dust", "Rubber"]
    assert remove_layer(borrowed, "Rubber") == (3, "Rubber", True)
    assert layers(borrowed) == ["Base", "Dust"]
    write_preview(borrowed)
    assert car.read_bytes() == before


def test_an_edit_twice_is_an_edit_once(paint: Path, take: Take) -> None:
    add_layer(paint, take("rubber"))
    for mask in ("dirt.png:g", "primvar:wear", "0.5"):
        set_mask(paint, "1", parse_mask(mask))
        once = paint.read_bytes()
        set_mask(paint, "rubber", parse_mask(mask))
        assert paint.read_bytes() == once


def test_an_expression_keeps_the_sources_of_its_names(paint: Path, take: Take, monkeypatch: pytest.MonkeyPatch) -> None:
    # This test is on the written text, so reading it is replaced.
    monkeypatch.setattr("lookdev.material.library.edit.read_look", lambda *_: None)
    inputs = ["dirt=dirt.png:g", "edge=primvar:edge", "tint=dirt.png:rgb", "amount=2"]
    add_layer(paint, take("rubber"), parse_mask("dirt * edge * amount * tint[0]", inputs))
    sources = {name: f"/Paint/RubberMask_{name}.outputs:" for name in ("dirt", "edge", "tint")}
    assert node_of(paint) == {
        "expression": "dirt * edge * amount * tint[0]",
        "dirt": ("float", sources["dirt"] + "g"),
        "edge": ("float", sources["edge"] + "result"),
        "tint": ("color3f", sources["tint"] + "rgb"),
        "amount": 2.0,
    }
    set_mask(paint, "Rubber", parse_mask("1 - dirt * amount", ["amount=3"]))
    dirt = ("float", sources["dirt"] + "g")
    assert node_of(paint) == {"expression": "1 - dirt * amount", "dirt": dirt, "amount": 3.0}
    assert children(paint) == NEW | {"Rubber", "RubberMask", "RubberMask_dirt", "St"}


def test_noise_over_the_coordinates_of_a_uv_set(paint: Path, take: Take) -> None:
    add_layer(paint, take("rubber"), parse_mask("noise(8 * p[0], 8 * p[1])", ["p=uv:st"]))
    set_mask(paint, "1", parse_mask("noise(9 * p[0], p[1]) * dirt", ["dirt=dirt.png"]))
    mask = read_look(paint).layers[1].mask
    assert mask.inputs == {"p": Coordinates("st"), "dirt": Texture(paint.parent / "dirt.png", "r", "raw")}
    assert children(paint) == NEW | {"Rubber", "RubberMask", "RubberMask_dirt", "St"}


def test_the_view_needs_no_source(paint: Path, take: Take) -> None:
    def inputs_of_mask() -> object:
        mask = read_look(paint).layers[1].mask
        return mask.inputs

    add_layer(paint, take("rubber"), parse_mask("smoothstep(1 - view, 0, 1)"))
    assert inputs_of_mask() == {"view": ViewCosine()}
    declared = "float inputs:view\n        string inputs:expression"
    paint.write_text(paint.read_text().replace("string inputs:expression", declared))
    set_mask(paint, "1", parse_mask("view ^ 2"))
    assert "inputs:view" not in paint.read_text()
    set_mask(paint, "1", parse_mask("view", ["view=0.5"]))
    set_mask(paint, "1", parse_mask("view * 2"))  # a name without a new source keeps its own
    assert inputs_of_mask() == {"view": 0.5}


@pytest.mark.parametrize(
    ("mask", "inputs", "message"),
    [
        ("2", [], "mask: 2 is out of range (it must be within [0, 1])"),
        ("-1", [], "mask: -1 is out of range"),
        ("nowhere.png", [], "mask: no such image file: nowhere.png"),
        ("dirt.png:rgb", [], "mask: unknown channel 'rgb'"),
        ("dirt.png:", [], "mask: unknown channel ''"),
        ("uv:st", [], "mask: is not a number"),
        ("dirt", ["dirt=uv:"], "--input dirt: '' cannot be the name of a primvar"),
        ("primvar:a b", [], "mask: 'a b' cannot be the name of a primvar"),
        ("dirt *", [], "\n    dirt *\n          ^"),
        ("dirt.pgn", [], "mask: is not a number from 0 to 1, an image (.bmp"),
        ("dirt * 2", [], "'dirt' in the expression has no source (add --input dirt=IMAGE"),
        ("dirt * 2", ["drit=1"], "--input: drit=1: 'drit' is not a name in the expression (did you mean 'dirt'?)"),
        ("dirt * 2", ["dirt"], "--input: dirt: '' is not a number, an image, a primvar or a UV set"),
        ("1", ["dirt=1"], "--input: dirt=1: only an expression has inputs"),
        ("dirt", ["dirt=dirt.png:rgb"], "the result is a color (a float is needed: use luminance())"),
        ("dirt[0]", ["dirt=dirt.png:r"], "only colors have channels"),
    ],
)
def test_what_is_no_mask(paint: Path, take: Take, mask: str, inputs: list[str], message: str) -> None:
    add_layer(paint, take("rubber"))
    assert message in refused(lambda: set_mask(paint, "1", parse_mask(mask, inputs)), paint)


def test_a_layer_that_is_not_there(paint: Path, take: Take, shipped: Callable[[str], Path]) -> None:
    add_layer(paint, take("rubber"))
    message = f"{paint}: /Paint/Layers: no layer 'Ruber' (did you mean 'Rubber'?)"
    assert refused(lambda: remove_layer(paint, "Ruber"), paint) == message
    assert "no layer '2'" in refused(lambda: remove_layer(paint, "2"), paint)
    for base in ("0", "Base"):
        assert f"'{base}' is the base" in refused(lambda base=base: remove_layer(paint, base), paint)
    metal = shipped("brushed_metal")
    assert ": /BrushedMetal: has a single layer, no stack" in refused(lambda: set_mask(metal, "1", 0.5), metal)


def test_a_layer_that_is_there_twice_goes_by_its_number(paint: Path, take: Take) -> None:
    add_layer(paint, take("rubber"))
    text = paint.read_text()
    twice = "token inputs:layer2.connect = </Paint/Rubber.outputs:layer>\n        token outputs:surface\n"
    paint.write_text(text.replace("token outputs:surface\n", twice, 1))
    assert "layers 1, 2 are all 'Rubber'" in refused(lambda: remove_layer(paint, "Rubber"), paint)
    remove_layer(paint, "1")
    assert layers(paint) == ["Base", "Rubber"], "the other layer still uses it"


@pytest.mark.parametrize(
    ("text", "prim", "summary"),
    [
        (None, None, "no such file"),
        ('def Material "M" {}\n', None, "is not connected to layers"),
        ('def Material "M" {}\n', "/N", "no such prim (known: /M)"),
        ("", None, "holds no material"),
        ("def {", None, "USD cannot open it"),
    ],
)
def test_what_is_no_look_to_edit(tmp_path: Path, take: Take, text: str | None, prim: str | None, summary: str) -> None:
    file = tmp_path / "bare.usda"
    if text is not None:
        file.write_text(f"#usda 1.0\n{text}")
    assert summary in refused(lambda: add_layer(file, take("gold"), prim=prim), file)


def test_a_link_is_not_edited(tmp_path: Path, paint: Path, take: Take) -> None:
    link = tmp_path / "link.usda"
    link.symlink_to(paint)
    assert f"edit {paint} itself" in refused(lambda: add_layer(link, take("gold")), link)


def test_a_look_that_was_faulty_and_stays_so_is_not_written(paint: Path, take: Take) -> None:
    add_layer(paint, take("rubber"), parse_mask("dirt.png"))
    (paint.parent / "dirt.png").unlink()
    message = refused(lambda: add_layer(paint, take("gold")), paint)
    assert message.startswith(f"{paint}: /Paint/RubberMask.inputs:file: no such image file: ./dirt.png")
    remove_layer(paint, "Rubber")  # the edit that removes the fault
    assert layers(paint) == ["Base"]


def test_a_fault_in_another_variant_counts(car: Path, take: Take) -> None:
    # With 'clean' selected, the copy would have no fault, as it has no dust.
    fault = '"dusty" {\n over "Dust" {\n float inputs:shine = 1\n }\n'
    car.write_text(car.read_text().replace('"dusty" {\n', fault))
    assert f"{car}: /CarPaint/Dust.inputs:shine: unknown input" in refused(lambda: add_layer(car, take("gold")), car)


def test_constants_of_layers_are_set_where_the_file_has_them(paint: Path, take: Take) -> None:
    add_layer(paint, take("rubber"), 0.5)
    before = read_look(paint)
    set_inputs(paint, {(0, "roughness"): 0.25, (1, "mask"): 0.75, (1, "baseColor"): (0.1, 0.2, 0.3)})
    after = read_look(paint)
    assert after.layers[0].inputs == {**before.layers[0].inputs, "roughness": pytest.approx(0.25)}
    assert after.layers[1].mask == pytest.approx(0.75)
    assert after.layers[1].inputs["baseColor"] == pytest.approx((0.1, 0.2, 0.3))


def test_a_constant_of_a_variant_is_set_in_the_variant(shipped: Callable[[str], Path]) -> None:
    file = shipped("brushed_metal")
    others = read_look(file, None, {"metal": "aluminium"})
    set_inputs(file, {(0, "baseColor"): (0.1, 0.2, 0.3)}, None, {"metal": "copper"})
    assert read_look(file, None, {"metal": "copper"}).layers[0].inputs["baseColor"] == pytest.approx((0.1, 0.2, 0.3))
    assert read_look(file, None, {"metal": "aluminium"}).layers == others.layers


def test_an_input_with_a_source_is_no_constant(shipped: Callable[[str], Path]) -> None:
    file = shipped("brushed_metal")
    text = file.read_text()
    with pytest.raises(LookdevError, match="is connected"):
        set_inputs(file, {(0, "roughness"): 0.5})
    assert file.read_text() == text


WEAR = {"old": 0.2, "new": 0.9}
SHARED = look(
    'float inputs:rough = 0.4 ( doc = "Of both." )\nfloat inputs:shine = 0.8 ( doc = "Of the coat alone." )\n'
    + stack(
        BASE + LAYER1 + "float layer1Mask <- Fade.result",
        disney(body="float roughness <- .rough"),
        disney("Coat", "float roughness <- .rough\nfloat clearcoatGloss <- .shine"),
        expression("amount * view", "float amount = 0.5", "Fade"),
    )
    + variants("wear", **{name: over("Base", f"color3f baseColor = ({red}, 0.1, 0.1)") for name, red in WEAR.items()}),
    STACK,
    selecting(wear="old"),
)
NAMES = {
    "Coat.clearcoatGloss": (0.3,),
    "Base.roughness": (0.7,),
    "Coat.mask.amount": (0.25,),
    "Base.baseColor": (0.5, 0.6, 0.7),
    "Coat.metallic": (0.9,),
}


def test_constants_are_set_where_they_are(tmp_path: Path) -> None:
    file = tmp_path / "paint.usda"
    file.write_text(SHARED)
    before = read_look(file)
    for names in ([n for n in NAMES if n != "Base.roughness"], list(NAMES)):
        out = tmp_path / f"found{len(names)}.usda"
        changed = [replace(constant_named(before, name), value=NAMES[name]) for name in names]
        write_changed(file, out, changed)
        written_look = read_look(out)
        for constant in changed:
            assert constant_named(written_look, constant.name).value == pytest.approx(constant.value)
        assert len(written_look.layers) == len(before.layers)
        stage = Usd.Stage.Open(str(out))
        # An interface input of one layer gets the constant. One that two layers read stays with the other layer.
        shared = "Base.roughness" in names
        assert stage.GetPrimAtPath("/M").GetAttribute("inputs:rough").Get() == pytest.approx(0.4)
        if not shared:
            assert stage.GetPrimAtPath("/M").GetAttribute("inputs:shine").Get() == pytest.approx(0.3)
            assert stage.GetPrimAtPath("/M/Coat").GetAttribute("inputs:clearcoatGloss").HasAuthoredConnections()
        assert constant_named(written_look, "Coat.roughness").value == pytest.approx((0.4,))
        # Only the selected variant changes.
        new = read_look(out, None, {"wear": "new"})
        assert constant_named(new, "Base.baseColor").value == pytest.approx((0.9, 0.1, 0.1))
    assert read_look(file) == before


def test_relative_paths_stay_right_in_another_folder(tmp_path: Path) -> None:
    file = MATERIALS / "robot_paint.usda"
    look = read_look(file)
    target = replace(constant_named(look, "Paint.roughness"), value=(0.5,))
    write_changed(file, tmp_path / "found.usdc", [target])
    assert read_look(tmp_path / "found.usdc").layers == replace_constants(look, [target]).layers


def test_what_is_no_look_of_layers_is_refused(tmp_path: Path) -> None:
    file, out = tmp_path / "plain.usda", tmp_path / "out.usda"
    file.write_text('#usda 1.0\n(\n    defaultPrim = "M"\n)\ndef Material "M"\n{\n}\n')
    with pytest.raises(LookError, match="is not connected to layers"):
        check_writable(file)
    file.write_text(SHARED)
    look = read_look(file)
    with pytest.raises(LookError, match=r"found\.txt: is not a file to write a look in"):
        write_changed(file, tmp_path / "found.txt", [constant_named(look, "Base.metallic")])
    with pytest.raises(LookError, match=r"out\.usda: .*out of range"):
        write_changed(file, out, [replace(constant_named(look, "Base.metallic"), value=(3.0,))])
    assert not out.exists()


AMOUNT = Formula(
    parse("smoothstep(wear, low, 1) * amount"),
    {"wear": Primvar("wear", 0.0), "low": 0.2, "amount": 0.5},
    dict.fromkeys(("wear", "low", "amount"), "float"),
)
STEEL = Layer("Steel", "disney", {"roughness": 0.3, "metallic": 1.0})
DUST = Layer("Dust", "disney", {"baseColor": (0.5, 0.4, 0.3)}, mask=0.25)
PAINT = Look("paint", (STEEL, Layer("Paint", "disney", {"roughness": 0.5}, mask=AMOUNT), DUST))


def layer_named(look: Look, name: str) -> Layer:
    return next(layer for layer in look.layers if layer.name == name)


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
    layer_name = parameter.partition(".")[0]
    assert look_with_value(PAINT, parameter, value).layers == tuple(
        replace(layer, inputs={**layer.inputs, name: expected}) if layer.name == layer_name else layer
        for layer in PAINT.layers
    )


def test_masks_and_inputs_of_their_expressions() -> None:
    assert layer_named(look_with_value(PAINT, "Dust.mask", 0.75), "Dust").mask == 0.75
    mask = layer_named(look_with_value(PAINT, "Paint.mask.amount", 0.9), "Paint").mask
    assert mask == Formula(AMOUNT.expression, {**AMOUNT.inputs, "amount": 0.9}, AMOUNT.kinds)
    assert layer_named(look_with_value(PAINT, "mask.amount", 0.9), "Paint").mask == mask  # one layer alone has it
    other = layer_named(look_with_value(PAINT, "Paint.mask", "wear * wear * view"), "Paint").mask
    kinds = {"wear": "float", "view": "float"}
    assert other == Formula(parse("wear * wear * view"), {"wear": Primvar("wear", 0.0), "view": ViewCosine()}, kinds)
    rough = layer_named(look_with_value(PAINT, "Steel.roughness", "0.2 + 0.5 * (1 - view)"), "Steel").inputs[
        "roughness"
    ]
    assert rough.inputs == {"view": ViewCosine()}


def test_of_a_single_layer_the_name_of_the_input_is_enough() -> None:
    single = Look("steel", PAINT.layers[:1])
    assert look_with_value(single, "roughness", 0.1).layers[0].inputs["roughness"] == 0.1
    assert look_with_value(single, "variant", "2012").layers[0].inputs["variant"] == "2012"


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
        look_with_value(PAINT, parameter, value)


def test_every_name_can_be_used() -> None:
    names = dict(variable_inputs(PAINT))
    assert {"Steel.roughness", "Paint.mask", "Paint.mask.wear", "Dust.mask"} <= names.keys()
    assert "Steel.mask" not in names
