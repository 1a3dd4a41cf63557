"""Wrong rigs: every fault at once, each with its file, its prim and a hint."""

from pathlib import Path

import pytest
from rig_files import DIM, Z_UP, light, rig, write_rig

from lookdev.errors import LookdevError, RigError
from lookdev.light.rig import load_rig

SHAPED = '"ShapingAPI"'
FAR = 'double3 xformOp:translate = (0, 2e9, 0); uniform token[] xformOpOrder = ["xformOp:translate"]'
UNEVEN = 'double3 xformOp:scale = (1, 2, 1); uniform token[] xformOpOrder = ["xformOp:scale"]'


def faults(folder: Path, text: str, stage: str = Z_UP) -> list[str]:
    """Return the faults of a rig without the name of its file."""
    with pytest.raises(RigError) as raised:
        rig(folder, text, stage)
    lines = str(raised.value).splitlines()
    file = str(folder / "rig.usda")
    assert all(line.startswith(f"{file}: ") for line in lines)
    return [line.removeprefix(f"{file}: ").replace(str(folder), "") for line in lines]


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (light("RectLight", "float inputs:width = 0"), "/Rig/Lamp.inputs:width: is 0 (a finite number above 0"),
        (light("DiskLight", "float inputs:radius = -1"), "/Rig/Lamp.inputs:radius: is -1 (a finite number above 0"),
        (light("SphereLight", "float inputs:intensity = -1"), "/Rig/Lamp.inputs:intensity: is -1 (a finite number of"),
        (light("SphereLight", "float inputs:exposure = nan"), "exposure: is nan (a finite number would be right)"),
        (light("SphereLight", "float inputs:exposure = 100"), "/Rig/Lamp: its largest radiance is 1.26765e+30"),
        (light("SphereLight", "color3f inputs:color = (1, -1, 1)"), "/Rig/Lamp.inputs:color: is (1, -1, 1)"),
        (light("SphereLight", "color3f inputs:color = (1, inf, 1)"), "/Rig/Lamp.inputs:color: is (1, inf, 1)"),
        (light("SphereLight", "float inputs:diffuse = -0.5"), "/Rig/Lamp.inputs:diffuse: is -0.5"),
        (light("SphereLight", "color3f inputs:color = (1, 1, 1) (colorSpace = 'red')"), "the colour space 'red'"),
        (light("SphereLight", 'string inputs:intensity = "5"'), "/Rig/Lamp.inputs:intensity: has a value of type str"),
        (
            light("SphereLight", "asset inputs:texture:file = @a.exr@"),
            "SphereLight has no texture (a RectLight",
        ),
        (light("SphereLight", "float inputs:intensty = 5"), "has no such input (did you mean 'intensity'?)"),
        (light("SphereLight", "float intensity = 5"), "/Rig/Lamp.intensity: is of UsdLux before 21.02"),
        (light("SphereLight", "float lookdev:turn = 1"), "has no such attribute (did you mean 'turns'?)"),
        (light("SphereLight", "float lookdev:turns = 1"), "/Rig/Lamp.lookdev:turns: has a value of type float (bool"),
        (light("SphereLight", "float lookdev:local:radius = 1"), "a SphereLight has no such attribute"),
        (light("SphereLight", "float inputs:shaping:focus = 5"), "ShapingAPI is not applied to the light"),
        (light("SphereLight", "float inputs:shaping:cone:angl = 5", SHAPED), "did you mean 'shaping:cone:angle'?"),
        (light("SphereLight", "float inputs:shaping:cone:angle = -5", SHAPED), "inputs:shaping:cone:angle: is -5"),
        (light("SphereLight", "float inputs:intensity.connect = </Rig/Noise.outputs:x>"), "is connected to /Rig/Noise"),
        (light("SphereLight", "rel light:filters = </Rig/Barn>"), "light filters are not supported: it has /Rig/Barn"),
        (light("SphereLight", UNEVEN), "/Rig/Lamp: is scaled by 1 along x and 2 along y"),
        (light("CylinderLight", UNEVEN), "/Rig/Lamp: is scaled by 2 along y and 1 along z"),
        (light("DomeLight_1", UNEVEN), "/Rig/Lamp: is scaled by 1 along x and 2 along y"),
        (light("RectLight", UNEVEN.replace("2", "0")), "/Rig/Lamp: the placement of a light is flat"),
        (light("RectLight", UNEVEN.replace('["x', '["xformOp:spin", "x')), "xformOpOrder: names 'xformOp:spin'"),
        (light("SphereLight", "bool treatAsPoint = true; float inputs:radius = 0"), "inputs:radius: is 0"),
        (light("SphereLight", "float inputs:radius = 1e20"), "a side or radius of it is 1e+20 m (1e-09 to 1e+09 m"),
        (light("SphereLight", "float inputs:radius = 1e-20"), "a side or radius of it is 1e-20"),
        (light("DiskLight", FAR), "/Rig/Lamp: it is 2e+09 m away (at most 1e+09 m"),
        (light("SphereLight", "color3f visibility = (1, 0, 0)"), "/Rig/Lamp.visibility: has a value of type Vec3f"),
        (light("DiskLight", "uniform int xformOpOrder = 5"), "/Rig/Lamp.xformOpOrder: has a value of type int"),
        (light("DistantLight", "float inputs:angle = -1"), "/Rig/Lamp.inputs:angle: is -1"),
        (light("DistantLight", "float lookdev:falloff:exponent = 1"), "exponent: a DistantLight has no such attribute"),
        (light("SphereLight", "float lookdev:falloff:exponent = -1"), "is -1 (a finite number of at least 0 would be"),
        (light("SphereLight", "float lookdev:falloff:start = 2; float lookdev:falloff:end = 1"), "falloff end 1: more"),
        (light("DomeLight_1", "float inputs:shaping:focus = 1", SHAPED), "has no effect: a dome light has no beam"),
        (light("DomeLight_1", 'uniform token poleAxis = "X"'), "poleAxis: is 'X' (known: scene, Y, Z)"),
        (light("DomeLight_1", "float lookdev:local:edge = 0.5"), "lookdev:local:edge: has no effect without a radius"),
        (
            light("DomeLight_1", "float lookdev:local:radius = 0"),
            "radius: is 0 (a finite number above 0",
        ),
        (light("DomeLight_1", "float lookdev:local:radius = 1; float lookdev:local:edge = 2"), "edge: is 2 (a part of"),
        (light("DomeLight_1", "asset inputs:texture:file = @no.exr@"), "texture:file: there is no file 'no.exr'"),
        (light("DomeLight_1", "asset inputs:texture:file = @bad.exr@"), "/bad.exr: cannot be read as an image"),
        (light("RectLight", "asset inputs:texture:file = @bad.exr@"), "/bad.exr: cannot be read as an image"),
        (light("SphereLight", "asset inputs:shaping:ies:file = @cut.ies@", SHAPED), "line 7: the file ends before"),
        ("custom bool lookdev:turns = false\n" + DIM, "/Rig.lookdev:turns: has no effect here (it is for lights)"),
        ("custom bool lookdev:ft = true\n" + DIM, "/Rig.lookdev:ft: has no effect here (did you mean 'fit'?)"),
        (light("Scope", "custom bool lookdev:fit = true") + DIM, "has no effect here (it is for the root of a rig"),
        (light("PortalLight", ""), "/Rig/Lamp: a light of type PortalLight is not supported"),
        (light("GeometryLight", ""), "/Rig/Lamp: a light of type GeometryLight is not supported"),
        (light("PluginLight", ""), "/Rig/Lamp: a light of type PluginLight is not supported"),
        (light("Mesh", "", '"MeshLightAPI"'), "/Rig/Lamp: a Mesh that is a light by LightAPI is not supported"),
        (light("Volume", "", '"VolumeLightAPI"'), "/Rig/Lamp: a Volume that is a light by LightAPI is not supported"),
        (light("RectLigth", ""), "/Rig/Lamp: RectLigth is not a type of USD's lights (did you mean 'RectLight'?)"),
        (light("PointInstancer", 'def SphereLight "In" {}'), "/Rig/Lamp/In: is in the PointInstancer /Rig/Lamp"),
        ("", "/Rig: has no light that shines (a light is one of RectLight"),
        (light("SphereLight", 'token visibility = "invisible"'), "no light that shines (/Rig/Lamp: is hidden"),
        (light("SphereLight", 'pathExpression collection:lightLink:membershipExpression = "/A//"'), "is not supported"),
    ],
)
def test_what_is_wrong_is_said_with_its_prim(tmp_path: Path, text: str, fault: str) -> None:
    (tmp_path / "bad.exr").write_bytes(b"\x76\x2f\x31\x01 no image")
    (tmp_path / "cut.ies").write_text("IESNA91\nTILT=NONE\n1 -1 1 3 1 1 2 0 0 0\n1 1 0\n0 45 90\n0\n4 4")
    reported = faults(tmp_path, text)
    assert len(reported) == 1
    assert fault in reported[0]


def test_all_faults_of_a_rig_are_reported_together(tmp_path: Path) -> None:
    wrong = "float inputs:radius = -1; float inputs:exposure = inf; float inputs:foo = 1; asset inputs:bar = @a@"
    text = light("SphereLight", wrong) + light("PortalLight", "", name="Portal") + light("RectLight", UNEVEN, name="C")
    places = {line.partition(": ")[0] for line in faults(tmp_path, text)}
    assert places == {"/Rig/Portal", *(f"/Rig/Lamp.inputs:{name}" for name in ("bar", "exposure", "foo", "radius"))}


@pytest.mark.parametrize(
    ("stage", "fault"),
    [('upAxis = "X"', "upAxis is 'X'"), ('upAxis = "Z"\nmetersPerUnit = -1', "metersPerUnit is -1")],
)
def test_a_stage_has_units_and_an_axis(tmp_path: Path, stage: str, fault: str) -> None:
    assert fault in faults(tmp_path, DIM, stage)[0]


def test_an_empty_rig_names_lights_elsewhere(tmp_path: Path) -> None:
    file = write_rig(tmp_path / "rig.usda", "")
    file.write_text(file.read_text() + DIM)
    with pytest.raises(RigError, match=r"has no light that shines \(there are lights at /Dim\)"):
        load_rig(file)


def test_a_rig_is_exposed_within_what_float32_has(tmp_path: Path) -> None:
    bright = rig(tmp_path, light("SphereLight", "float inputs:exposure = 55"))
    bright.check_exposed(4.0)
    with pytest.raises(RigError, match=r"/Rig/Lamp: its largest radiance times 2\^6 is 2\.3"):
        bright.check_exposed(6.0)


def test_what_is_no_usd_is_said(tmp_path: Path) -> None:
    file = tmp_path / "rig.usda"
    file.write_text("#usda 1.0\ndef SphereLight {")
    with pytest.raises(LookdevError, match="USD cannot open it"):
        load_rig(file)
    with pytest.raises(LookdevError, match="no such file"):
        load_rig(tmp_path / "none.usda")


def test_a_profile_without_light_is_noted(tmp_path: Path) -> None:
    counts = "1 1000 1 2 1 1 2 0.1 0.2 0\n1 1 50\n0 90\n0\n0 0\n"
    (tmp_path / "dark.ies").write_text(f"IESNA:LM-63-2002\nTILT=NONE\n{counts}")
    dark = light("SphereLight", "asset inputs:shaping:ies:file = @dark.ies@", SHAPED)
    with pytest.raises(RigError, match=r"has no light that shines \(/Rig/Lamp: sends no light, left out\)"):
        rig(tmp_path, dark)
