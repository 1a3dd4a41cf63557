"""An edited file keeps the layout and the comments of its author."""

import re
from pathlib import Path

import pytest
from pxr import Sdf

from lookdev.material.library.layout import restore_layout

ROOT = Path(__file__).parents[2]
FOLDERS = ("materials", "jobs", "rigs", "lookdev/shaders")
SHIPPED_FOLDERS = sorted(file for folder in FOLDERS for file in (ROOT / folder).rglob("*.usda"))
EXAMPLES = re.findall(r"```usda\n(#usda.*?)```", (ROOT / "docs" / "looks.md").read_text(), re.DOTALL)

PAINT = '''#usda 1.0
(
    # made by hand
    doc = """Two lines,
    with a # that is none"""
    defaultPrim = "Paint"
)

# Above the material.
def Material "Paint" (
    customData = { string category = "paint" }   # of the library
    prepend variantSets = "wear"
    variants = { string wear = "clean" }
) {
    color3f inputs:tint = (1, 0, 0); float inputs:unknown = 3   # two on a line
    token outputs:lookdev:surface.connect = </Paint/Base.outputs:layer>

    # Paint itself.

    # Of the base.
    def Shader "Base"
    {
        uniform token info:id = "LookdevDisney"
        float inputs:roughness = 0.5    # as measured
        float inputs:metallic = 0       # none
        float[] userProperties:many = [
            1, 2,  # inside
            3
        ]
        token outputs:layer
        # at the end
    }

    def Scope "Unknown" { custom string note = 'a "quoted" @word@'; }
    variantSet "wear" = {
        "clean" {
        }
        "dusty" (doc = "worn") {   # the second
            over "Base" { float inputs:roughness = 0.9; }
        }
    }
}
# the end
'''


def layer(text: str) -> Sdf.Layer:
    usd_layer = Sdf.Layer.CreateAnonymous(".usda")
    assert usd_layer.ImportFromString(text)
    return usd_layer


TEXTS = {
    **{file.stem: file.read_text() for file in SHIPPED_FOLDERS},
    **{f"example{number}": text for number, text in enumerate(EXAMPLES)},
    "paint": PAINT,
}


@pytest.mark.parametrize("text", TEXTS.values(), ids=list(TEXTS))
def test_what_is_not_edited_stays_to_the_letter(text: str) -> None:
    plain = layer(text).ExportToString()
    assert restore_layout(text, plain, plain) == text


def edit_text(path: str, value: object) -> tuple[str | None, str]:
    """Return the text with another value of an attribute, and what USD writes of it; None removes the prim."""
    usd_layer = layer(PAINT)
    before = usd_layer.ExportToString()
    if value is None:
        edit = Sdf.BatchNamespaceEdit()
        edit.Add(path, Sdf.Path.emptyPath)
        usd_layer.Apply(edit)
    else:
        usd_layer.GetAttributeAtPath(path).default = value
    return restore_layout(PAINT, before, usd_layer.ExportToString()), usd_layer.ExportToString()


@pytest.mark.parametrize(
    ("path", "value", "old", "new"),
    [
        ("/Paint/Base.inputs:roughness", 0.25, "roughness = 0.5    # as", "roughness = 0.25    # as"),
        ("/Paint.inputs:unknown", 4.0, "unknown = 3   # two", "unknown = 4   # two"),
        ("/Paint{wear=dusty}Base.inputs:roughness", 1.0, "roughness = 0.9;", "roughness = 1;"),
    ],
)
def test_a_value_is_changed_in_its_place(path: str, value: float, old: str, new: str) -> None:
    text, _ = edit_text(path, value)
    assert text == PAINT.replace(old, new)


def test_comments_of_what_is_removed_go_with_it_and_no_others() -> None:
    text, _ = edit_text("/Paint/Base", None)
    assert text is not None
    gone = {"# Of the base.", "# as measured", "# none", "# inside", "# at the end"}
    remaining = set(re.findall(r"# [\w ]+\.?", PAINT)) - gone
    assert all(comment in text for comment in remaining)
    assert not any(comment in text for comment in gone)


def test_what_is_added_stands_behind_its_neighbour() -> None:
    usd_layer = layer(PAINT)
    before = usd_layer.ExportToString()
    Sdf.AttributeSpec(usd_layer.GetPrimAtPath("/Paint/Base"), "inputs:sheen", Sdf.ValueTypeNames.Float).default = 0.5
    Sdf.PrimSpec(usd_layer.GetPrimAtPath("/Paint"), "Dust", Sdf.SpecifierDef, "Shader")
    text = restore_layout(PAINT, before, usd_layer.ExportToString())
    assert text is not None
    assert layer(text).ExportToString() == usd_layer.ExportToString()
    assert [comment for comment in re.findall(r"#.*", PAINT) if comment not in text] == []


def test_what_is_nested_too_deep_has_no_layout_of_its_own() -> None:
    deep = "#usda 1.0\n" + "".join(f'def "p{k}"\n{{\n' for k in range(3000)) + "}\n" * 3000
    assert restore_layout(deep, deep, deep) is None


def test_long_values_take_no_longer_than_their_length() -> None:
    numbers = ", ".join(map(str, range(200_000)))
    text = f'#usda 1.0\n\ndef "Mesh"\n{{\n    int[] faces = [{numbers}]  # many\n    float a = 1\n}}\n'
    usd_layer = layer(text)
    before = usd_layer.ExportToString()
    usd_layer.GetAttributeAtPath("/Mesh.a").default = 2.0
    assert restore_layout(text, before, usd_layer.ExportToString()) == text.replace("a = 1", "a = 2")


def test_a_prim_that_is_made_anew_at_another_place_moves_with_its_comments() -> None:
    def text(names: str) -> str:
        prims = "".join(f'    # The {name}.\n    def Scope "{name}"\n    {{\n    }}\n\n' for name in names)
        return f'#usda 1.0\n\ndef Scope "Top"\n{{\n{prims}}}\n'

    before, after = (layer(text(names)).ExportToString() for names in ("ABC", "BCA"))
    merged = restore_layout(text("ABC"), before, after)
    assert merged is not None
    assert [line for line in merged.splitlines() if line] == [line for line in text("BCA").splitlines() if line]
