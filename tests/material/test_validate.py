"""Validation finds all faults of a look, in any file, and reports nothing in sound looks."""

import json
import sys
from pathlib import Path

import pytest
from look_files import BASE, LAYER1, ST, STACK, disney, pixar, preview, shader, shorten_path, stack
from variant_sets import over, selecting, variants

from lookdev.cli import run as run_cli
from lookdev.material.validate.examine import MAX_COMBINATIONS, MAX_FINDINGS, examine_file
from lookdev.material.validate.report import ValidationFinding, ValidationReport

ROOT = Path(__file__).parents[2]
LOOKS = [file for path in (".", "presets", "classic") for file in sorted((ROOT / "materials" / path).glob("*.usda"))]


def findings(file: Path, **options: object) -> list[tuple[str, str, str]]:
    """Return severity, place and text of the findings in a look."""
    report = examine_file(file, **options)
    places = [shorten_path(f"{finding.prim}.{finding.input}".rstrip(".")) for finding in report.findings]
    return [(finding.severity, path, finding.what) for path, finding in zip(places, report.findings, strict=True)]


@pytest.mark.parametrize("file", LOOKS, ids=lambda file: file.stem)
def test_a_shipped_look_is_clean(file: Path) -> None:
    assert examine_file(file).findings == ()


def layered_material(inputs: str, coat: str = "", base: str = "") -> str:
    return stack(BASE + LAYER1 + inputs, disney(body=base), disney("Coat", coat))


def test_displacement_is_examined(write) -> None:
    terminal = "token outputs:lookdev:displacement.connect = </M/Moved.outputs:displacement>\n"
    moved = shader("Moved", "LookdevDisplacement", "float height = 1\nfloat sacle = 2")
    ((severity, where, message),) = findings(write(terminal + disney() + moved))
    assert (severity, where, message) == ("error", "Moved.sacle", "unknown input")


UNREAD = shader("Tex", "UsdUVTexture", "asset file = @./gray.png@")
ABSENT = stack(BASE + LAYER1 + "float layer1Mask = 0.5", pixar(), pixar("Coat", "float presence = 0"))


@pytest.mark.parametrize(
    ("body", "path", "message"),
    [
        (layered_material("float layer1Mask = 0"), "Layers.layer1Mask", "the layer never shows: its mask is 0"),
        (ABSENT, "Layers.layer1", "the layer never shows: the presence of Coat is 0"),
        (layered_material("bool layer1Enabled = 0"), "Layers.layer1Enabled", "the layer is not enabled"),
        (layered_material("float layer1Mask = 0.5") + UNREAD, "/M/Tex", "UsdUVTexture that nothing reads"),
    ],
)
def test_note(write, body: str, path: str, message: str) -> None:
    file = write(body, STACK)
    assert findings(file) == [("note", path, message)]
    assert not examine_file(file).has_errors


def test_a_layer_without_a_mask_hides_those_beneath(write) -> None:
    assert findings(write(layered_material(""), STACK)) == [
        ("note", "Layers.base", "the layer never shows: Coat covers it wholly"),
        ("note", "Layers.layer1Mask", "the mask is not connected, so the layer covers all beneath"),
    ]


def test_what_lets_light_through_hides_nothing(write) -> None:
    mode = 'token layer1Mode = "transmit"'
    assert findings(write(stack(BASE + LAYER1 + mode, pixar(), pixar("Coat")), STACK)) == []
    assert findings(write(stack(BASE + LAYER1, pixar(), pixar("Coat", "float presence = 0.5")), STACK)) == []


def test_a_disabled_layer_is_examined_too(write) -> None:
    body = layered_material("bool layer1Enabled = 0", coat="float roughness = 2")
    assert findings(write(body, STACK)) == [
        ("warning", "Coat.roughness", "2 is out of range (in a layer that is not enabled)"),
        ("note", "Layers.layer1Enabled", "the layer is not enabled"),
    ]


def rough(value: float) -> str:
    return over("Base", f"float roughness = {value}")


WEAR = selecting(wear="new")


def test_every_variant_is_examined(write) -> None:
    file = write(disney() + variants("wear", dusty=rough(2), new=rough(0.5)), material=WEAR)
    report = examine_file(file)
    hint = "it must be within [0, 1]"
    fault = ValidationFinding("error", "/M/Base", "inputs:roughness", "2 is out of range", hint, ("wear=dusty",))
    assert report.findings == (fault,)
    assert (report.materials, report.combinations) == (1, 2)
    assert findings(file, variants={"wear": "new"}) == []
    [(_, path, message)] = findings(file, variants={"ware": "new"})
    assert (path, message) == ("/M", "has no variant set 'ware'")


def test_what_every_variant_shares_is_reported_once_and_what_one_leaves_unused_not(write) -> None:
    off, on = (over("Layers", f"bool layer1Enabled = {value}") for value in (0, 1))
    body = layered_material("float layer1Mask = 0.5", base="float sheen = 7")
    file = write(body + variants("wear", dusty=off, new=on), STACK, WEAR)
    hint = "it must be within [0, 1]"
    assert examine_file(file).findings == (
        ValidationFinding("error", "/M/Base", "inputs:sheen", "7 is out of range", hint),
    )


READ_AS = ("note", "/M", "is read as Standard Surface as Disney")


def test_a_material_of_another_model_is_named_and_what_it_loses_noted(write) -> None:
    body = preview("float subsurface = 1", identifier="ND_standard_surface_surfaceshader")
    first, second = findings(file := write(body, ""))
    assert first == READ_AS
    assert second[:2] == ("note", "S.subsurface")
    assert not examine_file(file).has_errors


def test_what_usd_objects_to_in_another_model_is_a_warning(write) -> None:
    ((severity, path, message), _) = findings(write(preview("float3 diffuseColor = (1, 0, 0)"), ""))
    assert (severity, path) == ("warning", "S.diffuseColor")
    assert "Expected 'color3f'" in message


def test_what_one_variant_of_another_model_loses_is_noted(write) -> None:
    lossy, plain = (over("S", f"float subsurface = {value}") for value in (1, 0))
    body = preview("", identifier="ND_standard_surface_surfaceshader") + variants("wear", dusty=lossy, new=plain)
    first, second = examine_file(write(body, "", WEAR)).findings
    assert (first.severity, first.prim, first.what) == READ_AS
    assert (second.input, second.variants) == ("inputs:subsurface", ("wear=dusty",))


def test_a_material_of_another_model_that_cannot_be_read_is_an_error(write) -> None:
    reported = findings(write(preview("", identifier="ND_lama_surface"), ""))
    assert reported[0] == ("error", "/M", "has no surface shader that can be read")
    assert {severity for severity, _, _ in reported} == {"error"}


def test_a_variant_inside_a_variant_is_examined(write) -> None:
    dirt = f'"dusty" (\nprepend variantSets = "dirt"\n) {{\n{variants("dirt", mud=rough(3), none="")}}}\n'
    sets = variants("wear", new="").removesuffix("}\n") + dirt + "}\n"
    report = examine_file(write(disney() + sets, material=WEAR))
    assert [finding.variants for finding in report.findings] == [("wear=dusty, dirt=mud",)]
    # With mud, without, with neither chosen as the file has it; and new.
    assert report.combinations == 4


def test_too_many_combinations_are_tried_one_by_one(write) -> None:
    assert MAX_COMBINATIONS < 2**7
    sets = "".join(variants(f"s{i}", a="", b=rough(2) if i == 6 else "") for i in range(7))
    report = examine_file(write(disney() + sets, material=selecting(**{f"s{i}": "a" for i in range(7)})))
    error, note = report.findings
    assert (error.input, error.variants) == ("inputs:roughness", ("s6=b",))
    assert note.what == f"has more than {MAX_COMBINATIONS} combinations of variants; not all were examined"
    assert report.combinations == 14


def p(kind: str, inputs: str = "") -> str:
    return shader("P", kind, inputs + "token outputs:surface\n")


GONE = shader("P", "UsdPreviewSurface", "color3f diffuseColor <- Tex.rgb")
GONE += shader("Tex", "UsdUVTexture", "asset file = @./gone.png@; float3 outputs:rgb")


@pytest.mark.both_pythons
@pytest.mark.parametrize(
    ("body", "severity", "path", "message"),
    [
        (p("UsdPreviewSurface", "double roughness = 1; "), "error", "P.roughness", "Incorrect type"),
        (p("PxrSurface"), "warning", "/M/P.info:id", "not found in sdrRegistry"),
        (GONE, "error", "", "unresolvable external dependency"),
        (p("UsdPreviewSurface") + 'def Xform "X" {\n}\n', "error", "/M", "not a valid descendant of Material"),
    ],
)
def test_usd_finds(write, body: str, severity: str, path: str, message: str) -> None:
    [(*location, text)] = findings(write("token outputs:surface.connect = </M/P.outputs:surface>\n" + disney() + body))
    assert location == [severity, path]
    assert message in text


def test_what_usd_finds_too_is_reported_once(write) -> None:
    textured = disney(body="float roughness <- Tex.r\ndouble sheen = 1") + ST
    image = "asset file = @./gone.png@\nfloat2 st <- St.result"
    gone = 'def "Gone" (\nreferences = @./gone.usda@\n) {\n}\n'
    reported = findings(write(textured + shader("Tex", "UsdUVTexture", image) + gone))
    assert [path for _, path, _ in reported] == ["/M/Gone", "Tex.file", "Base.sheen"]


def test_only_the_material_named_is_examined(write) -> None:
    other = 'def Material "N" {\ntoken outputs:lookdev:surface.connect = </N/Base.outputs:layer>\n%s}\n'
    file = write(disney(), before=other % disney(body="float sheen = 7"))
    assert [path for _, path, _ in findings(file)] == ["/N/Base.inputs:sheen"]
    assert findings(file, prim="/M") == []
    assert examine_file(file).materials == 2
    [(_, path, message)] = findings(file, prim="/O")
    assert (path, message) == ("/O", "no such prim")


def test_a_preset_is_a_layer_of_its_own(tmp_path: Path) -> None:
    file = tmp_path / "preset.usda"
    file.write_text('#usda 1.0\n(\ndefaultPrim = "Base"\n)\n' + disney(body="float sheen = 7"))
    assert findings(file) == [("error", "/Base.inputs:sheen", "7 is out of range")]


def test_a_rig_is_pointed_to_what_lists_it(tmp_path: Path) -> None:
    file = tmp_path / "rig.usda"
    file.write_text('#usda 1.0\ndef SphereLight "Key" {}\n')
    finding = examine_file(file).findings[0]
    assert (finding.what, finding.hint.split(":")[0]) == ("holds no material and no layer", "it has lights")


def test_findings_are_bounded_and_stderr_is_silent(write, capfd: pytest.CaptureFixture[str]) -> None:
    unread = "".join(shader(f"B{i}", "LookdevDisney") for i in range(MAX_FINDINGS + 10))
    report = examine_file(write(disney() + unread + 'def "X" (\nreferences = @./gone.usda@\n) {\n}\n'))
    assert len(report.findings) == MAX_FINDINGS + 1
    assert (report.findings[0].severity, report.findings[-1].what) == ("error", "11 more findings")
    assert capfd.readouterr() == ("", "")


def test_the_text_shows_an_expression_with_its_caret() -> None:
    message = "an operator should stand here, not 'b'\n    a b\n      ^"
    fault = ValidationFinding(
        "error", "/M/X", "inputs:expression", message, "see the manual", tuple(f"s=v{i}" for i in range(6))
    )
    assert ValidationReport(
        "look.usda", (fault, ValidationFinding("note", "/M", "", "odd")), 1, 6
    ).text().splitlines() == [
        "look.usda: 1 error, 1 note (1 material, 6 combinations of variants)",
        "",
        "/M",
        "  note     odd",
        "",
        "/M/X",
        "  error    inputs:expression: an operator should stand here, not 'b'",
        "               a b",
        "                 ^",
        "           hint: see the manual",
        "           in: s=v0 | s=v1 | s=v2 | s=v3 and 2 more",
    ]


def test_the_verb(write, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def run(*options: str) -> tuple[object, str]:
        monkeypatch.setattr(sys, "argv", ["lookdev", "validate", str(file), *options])
        with pytest.raises(SystemExit) as left:
            run_cli()
        return left.value.code, capsys.readouterr().out

    file = write(disney())
    assert run() == (0, f"{file}: nothing wrong (1 material, 1 combination of variants)\n")
    file = write(disney() + variants("wear", dusty=rough(2), new=""), material=WEAR)
    code, output = run("--prim", "/M", "--variants", "wear=dusty", "--json")
    assert code == 1
    assert output == json.dumps(examine_file(file, "/M", {"wear": "dusty"}).data(), indent=2) + "\n"
    assert [run("--variants", wear)[0] for wear in ("wear=new", "wear")] == [0, 2]
