"""Lights of UsdLux prims: units, placement, emission, and which prims are lights."""

import math
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from light_cases import make_tables_small
from pxr import UsdLux, UsdUtils
from rig_files import DIM, Y_UP_CM, Z_UP, light, rig, write_image, write_rig
from usd_text import translate

from lookdev.light import Dome, Emission, Shadow, lights_code
from lookdev.light.emission import Falloff
from lookdev.light.ies import load_profile
from lookdev.light.rig import load_rig
from lookdev.stage import Composition, StageError, compose

pytestmark = pytest.mark.both_pythons

TURNED = "float xformOp:rotateX = -90; double3 xformOp:translate = (100, 300, 50); double3 xformOp:scale = (2, 3, 4)"
ORDER = 'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX", "xformOp:scale"]'
EVEN = TURNED.replace("(2, 3, 4)", "(2, 2, 2)") + ";" + ORDER
UNEVEN = f"{TURNED}; {ORDER}"


def only(folder: Path, text: str, stage: str = Z_UP) -> Any:
    (result,) = rig(folder, text, stage).lights
    return result


SCALED = 'double3 xformOp:scale = ({}, {}, {}); uniform token[] xformOpOrder = ["xformOp:scale"]'
UPRIGHT = 'float xformOp:rotateX = 90; uniform token[] xformOpOrder = ["xformOp:rotateX"]'
LOCAL = "float lookdev:local:radius = 300; float lookdev:local:edge = 0.5"
# (x, y, z) of a stage with y up is (x, -z, y) with z up. After a turn by -90 degrees about x, -z points to -y: down.
PLACED = {"position": (1.0, -0.5, 3.0), "axes": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))}
LYING = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))


@pytest.mark.parametrize(
    ("kind", "attributes", "stage", "expected"),
    [
        ("RectLight", f"float inputs:width = 10; {UNEVEN}", Y_UP_CM, PLACED | {"width": 0.2, "height": 0.03}),
        ("DiskLight", f"float inputs:radius = 10; {UNEVEN}", Y_UP_CM, PLACED | {"radii": (0.2, 0.3)}),
        ("SphereLight", f"float inputs:radius = 10; {EVEN}", Y_UP_CM, PLACED | {"radius": 0.2}),
        ("CylinderLight", f"float inputs:radius = 10; {EVEN}", Y_UP_CM, PLACED | {"length": 0.02, "radius": 0.2}),
        ("CylinderLight", SCALED.format(3, 2, 2), Z_UP, {"length": 3.0, "radius": 1.0}),
        # A mirrored light has left-handed axes.
        ("RectLight", SCALED.format(-2, 1, 1), Z_UP, {"width": 2.0, "axes": ((-1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0))}),
        ("DistantLight", f"float inputs:angle = 2; {UPRIGHT}", Z_UP, {"angle": 2.0, "axes": LYING}),
        ("DomeLight", f"{LOCAL}; {EVEN}", Y_UP_CM, {"radius": 6.0, "edge": 0.5, "position": (1.0, -0.5, 3.0)}),
    ],
)
def test_sizes_and_places_are_in_metres_with_z_up(
    tmp_path: Path, kind: str, attributes: str, stage: str, expected: dict[str, Any]
) -> None:
    result = only(tmp_path, light(kind, attributes), stage)
    assert type(result).__name__ == kind.replace("DomeLight", "LocalDome")
    for name, value in expected.items():
        np.testing.assert_allclose(getattr(result, name), value, rtol=1e-6, atol=1e-15, err_msg=name)


WARM = "float inputs:colorTemperature = 3000"
NORMALIZED = "bool inputs:normalize = true"


@pytest.mark.parametrize(
    ("kind", "attributes", "color"),
    [
        ("SphereLight", "float inputs:intensity = 3; float inputs:exposure = 2", 12.0),
        ("SphereLight", "color3f inputs:color = (0.5, 0.25, 0)", (0.5, 0.25, 0.0)),
        ("SphereLight", WARM, 1.0),
        ("SphereLight", f"{WARM}; bool inputs:enableColorTemperature = true", UsdLux.BlackbodyTemperatureAsRgb(3000.0)),
        ("SphereLight", "color3f inputs:color = (0.214041, 1, 0.5) (colorSpace = 'raw')", (0.214041, 1.0, 0.5)),
        ("SphereLight", "color3f inputs:color = (0.5, 1, 1) (colorSpace = 'srgb_texture')", (0.214041, 1.0, 1.0)),
        ("SphereLight", "double inputs:intensity = 2", 2.0),
        ("SphereLight", "float inputs:intensity.timeSamples = { 3: 5, 7: 9 }", 5.0),
        ("DistantLight", "", 50000.0),
        # Power is divided by the area in units of the stage.
        ("RectLight", f"float inputs:width = 4; float inputs:height = 2; {NORMALIZED}", 0.125),
        ("DiskLight", f"float inputs:radius = 2; {NORMALIZED}", 0.25 / math.pi),
        ("SphereLight", f"float inputs:radius = 2; {NORMALIZED}", 0.0625 / math.pi),
        ("CylinderLight", f"float inputs:radius = 2; float inputs:length = 3; {NORMALIZED}", 1.0 / (12.0 * math.pi)),
        ("DistantLight", f"float inputs:angle = 60; float inputs:intensity = 1; {NORMALIZED}", 4.0 / math.pi),
        ("DistantLight", f"float inputs:angle = 0; float inputs:intensity = 1; {NORMALIZED}", 1.0),
        ("DomeLight_1", NORMALIZED, 1.0),
    ],
)
@pytest.mark.parametrize("stage", [Z_UP, Y_UP_CM])
def test_colour_is_that_of_the_light_api(tmp_path: Path, kind: str, attributes: str, color: Any, stage: str) -> None:
    result = only(tmp_path, light(kind, attributes), stage)
    assert result.emission.color == pytest.approx(tuple(np.broadcast_to(color, 3)), rel=1e-6)


def test_what_is_not_said_is_the_default_of_usdlux(tmp_path: Path) -> None:
    assert only(tmp_path, DIM).emission == Emission(group="Dim", path="/Rig/Dim")


def test_every_control_of_a_light_is_read(tmp_path: Path) -> None:
    attributes = """float inputs:diffuse = 0.5; float inputs:specular = 2; bool lookdev:turns = false
        bool lookdev:camera = true; token lookdev:lightGroup = "keys"
        float inputs:shaping:cone:angle = 30; float inputs:shaping:cone:softness = 0.2; float inputs:shaping:focus = 3
        color3f inputs:shaping:focusTint = (1, 0, 0)
        bool inputs:shadow:enable = true; color3f inputs:shadow:color = (0, 0, 1); float inputs:shadow:distance = 200
        float inputs:shadow:falloff = 50; float inputs:shadow:falloffGamma = 2
        float lookdev:falloff:virtualDistance = 100; float lookdev:falloff:exponent = 1
        double lookdev:falloff:start = 200; float lookdev:falloff:end = 300
        rel collection:shadowLink:excludes = </Car>"""
    emission = only(tmp_path, light("SphereLight", attributes, '"ShapingAPI", "ShadowAPI"'), Y_UP_CM).emission
    assert (emission.diffuse, emission.specular, emission.group) == (0.5, 2.0, "keys")
    assert (emission.turns, emission.camera) == (False, True)
    shaping = emission.shaping
    assert (shaping.cone_angle, shaping.focus, shaping.focus_tint) == (30.0, 3.0, (1.0, 0.0, 0.0))
    assert shaping.cone_softness == pytest.approx(0.2)
    assert emission.shadow == Shadow(True, (0.0, 0.0, 1.0), 2.0, 0.5, 2.0)
    assert emission.falloff == Falloff(1.0, 1.0, 2.0, 3.0)
    assert emission.light_link is None
    assert not emission.shadow_link.includes("/Car/Body")
    assert emission.shadow_link.includes("/Stand")


def test_a_schema_that_is_applied_has_its_defaults(tmp_path: Path) -> None:
    shaped = light("SphereLight", "float inputs:shaping:focus = 0", '"ShapingAPI"')
    assert only(tmp_path, shaped).emission.shaping.cone_angle == 90.0
    unused = light("DomeLight", "", '"ShapingAPI"')
    assert only(tmp_path, unused, Y_UP_CM).emission.shaping is None


@pytest.mark.parametrize(
    ("kind", "stage", "middle", "left", "top"),
    [
        # UsdLuxDomeLight: longitude 0 is +z, pi / 2 is +x, the pole +y, of the stage: (x, y, z) is (x, -z, y) here.
        ("DomeLight", Y_UP_CM, (0, -1, 0), (1, 0, 0), (0, 0, 1)),
        ("DomeLight", Z_UP, (0, 0, 1), (1, 0, 0), (0, 1, 0)),
        ("DomeLight_1", Y_UP_CM, (0, -1, 0), (1, 0, 0), (0, 0, 1)),
        # UsdLuxDomeLight_1: with the pole +z, longitude 0 is -y.
        ("DomeLight_1", Z_UP, (0, -1, 0), (1, 0, 0), (0, 0, 1)),
    ],
)
def test_a_dome_is_oriented_as_usdlux_says(
    tmp_path: Path, kind: str, stage: str, middle: tuple[int, ...], left: tuple[int, ...], top: tuple[int, ...]
) -> None:
    pixels = np.full((16, 32, 3), 0.01, np.float32)
    pixels[7:9, 15:17] = (1, 0, 0)
    pixels[7:9, 7:9] = (0, 1, 0)
    pixels[0] = (0, 0, 1)
    write_image(tmp_path / "sky.exr", pixels)
    result = only(tmp_path, light(kind, "asset inputs:texture:file = @./sky.exr@"), stage)
    seen = result.radiance(np.zeros(3), np.array([middle, left, top], np.float64))
    assert seen == pytest.approx(np.eye(3), abs=0.02)


def test_a_pole_that_is_stated_is_one_of_the_stage(tmp_path: Path) -> None:
    result = rig(tmp_path, light("DomeLight_1", 'uniform token poleAxis = "Z"'), Y_UP_CM)
    assert isinstance(result.lights[0], Dome)
    assert isinstance(only(tmp_path, light("DomeLight_1", "float lookdev:local:radius")), Dome), "it has no value"
    assert result.lights[0].axes[2] == (0.0, -1.0, 0.0)
    assert not rig(tmp_path, light("DomeLight", "")).notes, "it is the same all around"
    write_image(tmp_path / "sky.exr", np.ones((8, 16, 3), np.float32))
    (note,) = rig(tmp_path, light("DomeLight", "asset inputs:texture:file = @sky.exr@")).notes
    assert "the pole of a DomeLight is +y, and horizontal here" in note


def test_a_local_dome_without_a_picture_is_sampled_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_tables_small(monkeypatch)
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    file = write_rig(tmp_path / "rig.usda", light("DomeLight_1", "float lookdev:local:radius = 3"))
    code = lights_code(load_rig(file).lights, sampled=True)
    assert {"dome0_slots", "dome0_bins"} <= code.arrays.keys()


@pytest.mark.parametrize("kind", ["RectLight", "DomeLight_1"])
@pytest.mark.parametrize("channels", [1, 2, 3])
def test_a_picture_is_srgb_unless_its_colour_space_is_stated(tmp_path: Path, kind: str, channels: int) -> None:
    import OpenImageIO as oiio

    image = oiio.ImageBuf(oiio.ImageSpec(4, 2, channels, oiio.UINT8))
    oiio.ImageBufAlgo.fill(image, (0.5, 1.0, 0.25) if channels == 3 else (0.5, 1.0)[:channels])
    image.write(str(tmp_path / "box.png"))
    for space, value in (("", (0.2140, 1.0, 0.0513)), (" (colorSpace = 'raw')", (0.5, 1.0, 0.25))):
        textured = only(tmp_path, light(kind, f"asset inputs:texture:file = @box.png@{space}"))
        texels = textured.picture if kind == "RectLight" else textured.radiance(np.zeros(3), np.eye(3))
        expected = value if channels == 3 else value[:1] * 3
        assert texels == pytest.approx(np.broadcast_to(expected, texels.shape), abs=0.003)


def test_texture_and_profile_come_from_a_package(tmp_path: Path) -> None:
    write_image(tmp_path / "box.exr", np.full((4, 4, 3), 0.5, np.float32))
    (tmp_path / "lamp.ies").write_text("IESNA91\nTILT=NONE\n1 -1 1 2 1 1 2 0 0 0\n1 1 0\n0 90\n0\n4 4\n")
    shaped = "asset inputs:texture:file = @box.exr@; asset inputs:shaping:ies:file = @lamp.ies@"
    file = write_rig(tmp_path / "rig.usda", light("RectLight", shaped, '"ShapingAPI"'))
    assert UsdUtils.CreateNewUsdzPackage(str(file), str(tmp_path / "rig.usdz"))
    assert {"box.exr", "lamp.ies"} <= {Path(name).name for name in zipfile.ZipFile(tmp_path / "rig.usdz").namelist()}
    zipped, plain = load_rig(tmp_path / "rig.usdz").lights, load_rig(file).lights
    assert zipped == plain
    assert zipped[0].emission.shaping.profile == load_profile(tmp_path / "lamp.ies")
    assert zipped[0].emission.shaping.profile.factor(np.array(30.0), np.array(0.0)) == pytest.approx(4.0)


def test_lights_are_those_below_the_prim_that_shine(tmp_path: Path) -> None:
    text = f"""
def SphereLight "On" {{}}
def SphereLight "Off" (active = false) {{}}
{light("Scope", 'token visibility = "invisible"; def SphereLight "In" {}', name="Hidden")}
{light("SphereLight", 'uniform token purpose = "guide"', name="Guide")}
{light("SphereLight", "float inputs:intensity = 0", name="Dark")}
class SphereLight "Class" {{}}
def Xform "Copy" ( instanceable = true
                   references = </Lamp> )
{{
    {translate(1, 0, 0)}
}}
def LightFilter "Unused" {{}}
"""
    file = write_rig(tmp_path / "rig.usda", text)
    more = 'def Xform "Lamp"\n{\n    def SphereLight "Bulb" {}\n}\ndef SphereLight "Outside" {}\n'
    file.write_text(file.read_text() + more)
    result = load_rig(file)
    assert [rig_light.path for rig_light in result.rig_lights] == ["/Rig/Copy/Bulb", "/Rig/On"]
    assert result.lights[0].position == (1.0, 0.0, 0.0)
    assert [note.removeprefix(f"{file}: ") for note in result.notes] == [
        "/Rig/Guide: is of purpose guide, left out",
        "/Rig/Hidden/In: is hidden by /Rig/Hidden, left out",
        "/Rig/Dark: sends no light, left out",
    ]
    assert [rig_light.path for rig_light in load_rig(file, "/Rig/On").rig_lights] == ["/Rig/On"]
    assert [rig_light.path for rig_light in load_rig(file, "/Rig/Hidden/In").rig_lights] == ["/Rig/Hidden/In"]
    with pytest.raises(StageError, match="there is no such prim"):
        compose(Composition(file, prim="/Rig/Onn"))


def test_without_a_default_prim_all_lights_are_the_rig(tmp_path: Path) -> None:
    file = tmp_path / "rig.usda"
    file.write_text('#usda 1.0\ndef SphereLight "A" {}\ndef Scope "More"\n{\n    def DiskLight "B" {}\n}\n')
    assert [rig_light.path for rig_light in load_rig(file).rig_lights] == ["/A", "/More/B"]


def test_a_light_list_that_a_model_has_is_obeyed(tmp_path: Path) -> None:
    text = """
def SphereLight "Listed" {}
def SphereLight "Missed" {}
def Xform "Set" (kind = "component")
{
    rel lightList = </Rig/Listed>
    token lightList:cacheBehavior = "consumeAndHalt"
}
"""
    result = rig(tmp_path, text.replace("consumeAndHalt", "ignore"))
    assert [rig_light.path for rig_light in result.rig_lights] == ["/Rig/Listed", "/Rig/Missed"]
    file = write_rig(tmp_path / "rig.usda", text)
    file.write_text(file.read_text().replace('def Xform "Rig"', 'def Xform "Rig" (kind = "group")'))
    result = load_rig(file)
    assert [rig_light.path for rig_light in result.rig_lights] == ["/Rig/Listed"]
    assert result.notes[0].endswith(": /Rig/Missed: is in no light list of its models, left out")
    assert len(result.notes) == 1


def test_what_is_animated_is_taken_at_the_start(tmp_path: Path) -> None:
    moves = """double3 xformOp:translate.timeSamples = { 1: (0, 0, 1), 10: (0, 0, 4) }
        uniform token[] xformOpOrder = ["xformOp:translate"]"""
    first = rig(tmp_path, light("SphereLight", moves))
    assert first.lights[0].position == (0.0, 0.0, 1.0)  # type: ignore[attr-defined]
    assert first.notes[0].endswith("/Rig/Lamp: its transform is animated, and taken at its first sample")
    start = rig(tmp_path, light("SphereLight", moves), f"{Z_UP}\nstartTimeCode = 4")
    assert start.lights[0].position == pytest.approx((0.0, 0.0, 2.0))  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("kind", "text", "note"),
    [
        ("SphereLight", "float inputs:ri:light:bounces = 3", "bounces: is of another renderer, and has no effect"),
        ("SphereLight", "bool treatAsPoint = true", "treatAsPoint: is disregarded: the light is a sphere"),
        ("CylinderLight", "bool treatAsLine = true", "treatAsLine: is disregarded: the light is a cylinder"),
        ("SphereLight", f"{WARM}0; bool inputs:enableColorTemperature = true", "is 30000, taken as 10000"),
        ("SphereLight", "color3f inputs:color = (0, 1, 0) (colorSpace = 'acescg')", "lies outside of Rec.709 by 0.62"),
        ("SphereLight", "float inputs:intensity.timeSamples = { 1: 1, 2: 3 }", "inputs:intensity: is animated"),
    ],
)
def test_what_is_done_about_it_is_noted(tmp_path: Path, kind: str, text: str, note: str) -> None:
    (result,) = rig(tmp_path, light(kind, text)).notes
    assert note in result


def test_a_rig_that_fits_has_no_metres(tmp_path: Path) -> None:
    text = f"custom bool lookdev:fit = true\n{light('SphereLight', translate(0, 3, 0))}"
    result = rig(tmp_path, text, Y_UP_CM)
    assert result.fit
    assert result.lights[0].position == (0.0, 0.0, 3.0)  # type: ignore[attr-defined]
    assert load_rig(tmp_path / "rig.usda", "/Rig/Lamp").fit
    assert not rig(tmp_path, text.replace("true", "false", 1), Y_UP_CM).fit
