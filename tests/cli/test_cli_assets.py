"""lookdev inspect: its text, its data, and what is wrong with its arguments."""

import json

import pytest

CARD = """#usda 1.0
def Mesh "Card" (prepend apiSchemas = ["MaterialBindingAPI"])
{
    uniform token subdivisionScheme = "none"
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 0, 1)]
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    rel material:binding = </Paint>
}
def Material "Paint"
{
    token outputs:surface.connect = </Paint/Shader.outputs:surface>
    def Shader "Shader"
    {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor.connect = </Paint/Image.outputs:rgb>
        token outputs:surface
    }
    def Shader "Image"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @./none.png@
        float3 outputs:rgb
    }
}
def "Lost" (references = @./none.usda@)
{
}
"""


@pytest.fixture
def card(tmp_path):
    file = tmp_path / "card.usda"
    file.write_text(CARD, encoding="utf-8")
    return file


def test_what_is_missing_is_listed_with_the_rest(run_cli, card):
    code, shown, errors = run_cli("inspect", str(card))
    assert (code, errors) == (0, "")
    assert "Card" in shown
    assert "none.png" in shown
    assert "none.usda" in shown


def test_the_data_is_json(run_cli, card):
    code, shown, _ = run_cli("inspect", str(card), "--json", "--prim", "/Card")
    assert code == 0
    assert [part["path"] for part in json.loads(shown)["parts"]] == ["/Card"]


def test_a_rig_is_listed_by_its_name_or_file(run_cli, tmp_path):
    code, shown, errors = run_cli("inspect", "three_point", "--json")
    assert (code, errors) == (0, "")
    assert [light["kind"] for light in json.loads(shown)["lights"]] == ["rect"] * 3
    lamp = tmp_path / "lamp.usda"
    lamp.write_text('#usda 1.0\ndef SphereLight "Lamp" {}\n', encoding="utf-8")
    assert "/Lamp  sphere  radius 0.005  at (0, 0, 0)" in run_cli("inspect", str(lamp))[1]
