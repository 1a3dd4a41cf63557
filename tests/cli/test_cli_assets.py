"""lookdev inspect: its text, and its data."""

import json

from usd_text import METRES, card, image, shader

COLOR = "color3f inputs:diffuseColor.connect = </Paint/Map.outputs:rgb>"
PAINT = f"""def Material "Paint" {{
token outputs:surface.connect = </Paint/Surface.outputs:surface>
{shader("Surface", "UsdPreviewSurface", COLOR, "token outputs:surface")}{image("Paint", "none.png")}}}
"""
LOST = 'def "Lost" (references = @./none.usda@) {}\n'


def test_what_is_missing_is_listed_with_the_rest(run_cli, tmp_path):
    file = tmp_path / "card.usda"
    file.write_text(METRES + card("Card", "rel material:binding = </Paint>") + card("Other") + PAINT + LOST)
    code, output, errors = run_cli("inspect", file)
    assert (code, errors) == (0, "")
    assert [name for name in ("Card", "none.png", "none.usda") if name not in output] == []
    code, output, _ = run_cli("inspect", file, "--json", "--prim", "/Card")
    assert code == 0
    assert [part["path"] for part in json.loads(output)["parts"]] == ["/Card"]


def test_a_rig_is_listed_by_its_name_or_file(run_cli, tmp_path):
    code, output, errors = run_cli("inspect", "three_point", "--json")
    assert (code, errors) == (0, "")
    assert [light["kind"] for light in json.loads(output)["lights"]] == ["rect"] * 3
    lamp = tmp_path / "lamp.usda"
    lamp.write_text('#usda 1.0\ndef SphereLight "Lamp" {}\n')
    assert "/Lamp  sphere  radius 0.005  at (0, 0, 0)" in run_cli("inspect", str(lamp))[1]
