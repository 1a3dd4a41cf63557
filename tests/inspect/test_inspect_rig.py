"""What `lookdev inspect` lists of a rig, and when it takes a file for one."""

import math
import re
from pathlib import Path

import pytest
from usd_text import METRES, card, translate

from lookdev.errors import RigError
from lookdev.inspect.assets import inspect_file
from lookdev.inspect.rigs import InspectedRig
from lookdev.shipped import BUILTIN_RIGS, rig_file
from lookdev.stage import Composition

RIG = f"""{METRES}
def Xform "Rig" {{
    def RectLight "Key" (prepend apiSchemas = ["ShapingAPI", "ShadowAPI"]) {{
        float inputs:width = 2
        float inputs:intensity = 7
        float inputs:specular = 0.5
        float inputs:shaping:cone:angle = 30
        float inputs:shadow:distance = 4
        bool lookdev:turns = false
        token lookdev:lightGroup = "keys"
        {translate(0, 0, 5)}
        rel collection:lightLink:excludes = </Car>
    }}
    def SphereLight "Off" {{ token visibility = "invisible"; }}
    def DistantLight "Sun" {{
        bool inputs:normalize = true
        float inputs:intensity = 3
        FALLOFF
    }}
}}
"""


def write(file: Path, text: str) -> Composition:
    file.write_text(text)
    return Composition(file)


def test_each_light_is_listed(tmp_path: Path) -> None:
    composition = write(tmp_path / "rig.usda", RIG.replace("FALLOFF", ""))
    inspection, asset = inspect_file(composition)
    assert isinstance(inspection, InspectedRig)
    assert asset is None
    key, sun = inspection.lights
    assert (key.path, key.kind, key.position, key.shines) == ("/Rig/Key", "rect", (0.0, 0.0, 5.0), (0.0, 0.0, -1.0))
    assert (key.sizes, key.value, key.unit) == ({"width": 2.0, "height": 1.0}, (7.0, 7.0, 7.0), "nits")
    assert (key.group, key.turns, key.specular) == ("keys", False, 0.5)
    assert key.light_link == (("/", "expandPrims"), ("/Car", "exclude"))
    assert (sun.position, sun.unit) == (None, "lux")
    assert sun.value == pytest.approx((3.0, 3.0, 3.0))
    assert sun.sizes["angle"] == pytest.approx(0.53)
    assert inspection.notes == (f"{composition.file}: /Rig/Off: is hidden, left out",)
    lines = inspection.text().splitlines()
    assert lines[0] == f"{composition.file}: a rig of 2 lights, in metres, z up"
    cells = ("/Rig/Key", "rect", "2 x 1", "at (0, 0, 5)", "towards (0, 0, -1)", "(7, 7, 7) nits", "group keys")
    assert tuple(re.split(" {2,}", lines[2])) == (*cells, "does not turn")
    assert lines[3:7] == [
        "    shaping: cone 30 degrees, softness 0",
        "    shadow: up to 4",
        "    specular times 0.5",
        "    shines on: / (expandPrims), /Car (exclude)",
    ]


def test_parallel_light_is_its_irradiance(tmp_path: Path) -> None:
    text = '#usda 1.0\ndef DistantLight "Sun"\n{{\n    float inputs:angle = {}\n    float inputs:intensity = 2\n}}\n'
    for angle, value in ((0, 2.0), (60, 2.0 * math.pi / 4.0)):
        inspection, _ = inspect_file(write(tmp_path / f"{angle}.usda", text.format(angle)))
        assert isinstance(inspection, InspectedRig)
        assert inspection.lights[0].value == pytest.approx((value,) * 3)


def test_a_file_with_geometry_is_an_asset_unless_its_lights_are_asked_for(tmp_path: Path) -> None:
    composition = write(tmp_path / "both.usda", RIG.replace("FALLOFF", "") + card("Card"))
    assert not isinstance(inspect_file(composition)[0], InspectedRig)
    assert isinstance(inspect_file(composition, rig=True)[0], InspectedRig)
    with pytest.raises(RigError, match="has no light that shines"):
        inspect_file(write(tmp_path / "card.usda", "#usda 1.0\n" + card("Card")), rig=True)


def test_faults_are_those_of_the_reader(tmp_path: Path) -> None:
    with pytest.raises(RigError, match=r"/Rig/Sun\.lookdev:falloff:exponent: a DistantLight has no such attribute"):
        inspect_file(write(tmp_path / "rig.usda", RIG.replace("FALLOFF", "float lookdev:falloff:exponent = 1")))


@pytest.mark.parametrize("name", BUILTIN_RIGS)
def test_built_in_rigs_are_listed_in_radii_of_the_asset(name: str) -> None:
    inspection, _ = inspect_file(Composition(rig_file(name)))
    assert "in radii of the asset's bounding sphere, about its centre" in inspection.text()
