"""Rigs of a job: their keys, their lights in scenes, and one placement for all looks."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from usd_text import JOB_KEYS, METRES, job_toml, material, translate, variant_set

from lookdev.build.scenes import build_scenes
from lookdev.errors import FaultsError, JobError
from lookdev.job import Job, parse_job
from lookdev.light import Dome, RectLight, load_environment, prepare_light
from lookdev.light.placed import PlacedLight
from lookdev.plan.prepare import prepare_job
from lookdev.scene.ground import GROUND_PATH
from lookdev.shipped import BUILTIN_RIGS

LOOK = "#usda 1.0\n" + material()
SCALED = 'over "Body" {{\nfloat3 xformOp:scale = ({0}, {0}, {0})\n}}'
ASSET = f"""{METRES}
def Xform "Car" ( prepend variantSets = "size"
                  variants = {{ string size = "small" }} )
{{
    def Mesh "Body"
    {{
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-3, 0, -4), (3, 0, -4), (3, 0, 4), (-3, 0, 4)]
        float3 xformOp:translate = (10, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }}
    {variant_set("size", small=SCALED.format(1), large=SCALED.format(2))}
}}
"""
HEADER = METRES.replace("(", '( defaultPrim = "Rig"\n', 1)
RIG = f"""{HEADER}
def Xform "Rig"
{{
    custom bool lookdev:fit = false
    def RectLight "Key"
    {{
        float inputs:width = 2
        {translate(0, 0, 5)}
        rel collection:lightLink:excludes = [</Car/Body>, </Car/Bdoy>]
    }}
    def DomeLight_1 "Sky"
    {{
        float inputs:intensity = 0.5
    }}
}}
"""
KEYS = {"asset": '{ usd = "car.usda" }', "turntable": '[{ kind = "lighting", frames = 2 }]'}
IBL = f"ibl = {JOB_KEYS['ibl']}\n"
JOB = f"""{job_toml("paint = paint.usda", **KEYS).replace(IBL, "")}{IBL}
[[rig]]
name = "studio"
usd = "rig.usda"
exposure = 1
rotation = 30
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in (("paint", LOOK), ("car", ASSET), ("rig", RIG)):
        (tmp_path / f"{name}.usda").write_text(text)
    return tmp_path


def parse(text: str, folder: Path) -> Job:
    return parse_job(text, folder / "job.toml")


def test_a_job_has_its_rigs_after_its_ibls(folder: Path) -> None:
    job = parse(JOB, folder)
    assert [rig.name for rig in job.rigs] == ["white", "studio"]
    assert [job.key_of_rig(rig.name) for rig in job.rigs] == ["ibl[0]", "rig[0]"]
    rig = job.rig[0]
    assert (rig.usd, rig.builtin, rig.prim, rig.exposure, rig.rotation) == (folder / "rig.usda", None, None, 1.0, 30.0)
    built_in = parse(JOB.replace('usd = "rig.usda"', 'builtin = "three_point"'), folder).rig[0]
    assert (built_in.usd, built_in.builtin) == (None, "three_point")


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ('usd = "rig.usda"', "", "rig[0].builtin: give exactly one of 'usd' and 'builtin'"),
        ('usd = "rig.usda"', 'builtin = "tree_point"', "rig[0].builtin: unknown value 'tree_point' (did you mean 'th"),
        ('usd = "rig.usda"', 'usd = "rgi.usda"', "rig[0].usd: no readable file"),
        ('usd = "rig.usda"', 'usd = "sky.exr"', "rig[0].usd: 'sky.exr' is of no known kind (known: .usd, "),
        ('usd = "rig.usda"', 'file = "rig.usda"\nbuiltin = "three_point"', "rig[0].file: unknown key"),
        ('"rig.usda"', '"rig.usda"\nprim = "Rig"', "rig[0].prim: 'Rig' is not allowed here (an absolute prim path"),
        ("exposure = 1", "exposure = 99", "rig[0].exposure: should be less than or equal to 30, not 99"),
        ('"studio"', '"White"', "rig[0].name: 'White' is already the name of ibl[0] (give each its own name)"),
        (JOB[JOB.index("ibl = [") :], "", "rig: the job has no light (write [[ibl]] or [[rig]])"),
    ],
)
def test_what_is_wrong_with_a_key_is_said(folder: Path, old: str, new: str, fault: str) -> None:
    assert old in JOB
    with pytest.raises(JobError) as raised:
        parse(JOB.replace(old, new, 1), folder)
    assert fault in str(raised.value)
    assert len(raised.value.faults) == 1


def test_rigs_count_in_the_number_of_frames(folder: Path) -> None:
    rigs = "".join(f'[[rig]]\nname = "r{i}"\nbuiltin = "three_point"\n' for i in range(30))
    with pytest.raises(JobError, match="1 looks under 32 lights in turntables of 9999 frames make 319968 frames"):
        parse(JOB.replace("frames = 2", "frames = 9999") + rigs, folder)


def test_scenes_have_the_lights_of_their_rig(folder: Path) -> None:
    result = build_scenes(parse(JOB, folder))
    assert list(result.scenes) == [("paint", "white"), ("paint", "studio")]
    assert result.scenes["paint", "white"].lights == (prepare_light(load_environment(builtin="white")),)
    key, sky = result.scenes["paint", "studio"].lights
    assert isinstance(key, RectLight)
    assert (key.width, key.position) == (2.0, (0.0, 0.0, 5.0))
    assert sky.emission.color == (0.5, 0.5, 0.5)
    (note,) = result.notes
    assert note == "rig 'studio': /Rig/Key is linked to /Car/Bdoy, but the asset has no such part"


def test_a_fitted_rig_stands_around_the_largest_look(folder: Path) -> None:
    (folder / "rig.usda").write_text(RIG.replace("lookdev:fit = false", "lookdev:fit = true"))
    text = JOB.replace('"paint", material = "paint.usda"', '"each", variants = { size = "*" }')
    body = 'def Mesh "Body"'
    bound = ASSET.replace(body, f'{body} (prepend apiSchemas = ["MaterialBindingAPI"])')
    bound = bound.replace("uniform token sub", "rel material:binding = </Car/Paint>\n        uniform token sub")
    (folder / "car.usda").write_text(bound.replace(body, f"{material(scope='/Car')}{body}"))
    result = build_scenes(parse(text, folder))
    small, large = (result.scenes[f"each_{size}", "studio"] for size in ("small", "large"))
    assert (small.asset.radius, large.asset.radius) == pytest.approx((5.0, 10.0))
    assert small.lights == large.lights
    key = small.lights[0]
    assert isinstance(key, RectLight)
    assert key.width == pytest.approx(20.0)
    assert key.position == pytest.approx((10.0, 0.0, 50.0), abs=1e-5)


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("RectLight", "RectLigth", "{rig}: /Rig/Key: RectLigth is not a type of USD's lights"),
        ("width = 2", "width = -2", "{rig}: /Rig/Key.inputs:width: is -2"),
        ("intensity = 0.5", "intensity = 9e17", "{rig}: /Rig/Sky: its largest radiance times 2^1 is 1.8e+18"),
        ("#usda 1.0", "#usda", "{rig}: USD cannot open it"),
    ],
)
def test_faults_of_a_rig_are_those_of_its_file(folder: Path, old: str, new: str, fault: str) -> None:
    assert old in RIG
    (folder / "rig.usda").write_text(RIG.replace(old, new))
    with pytest.raises(FaultsError) as raised:
        build_scenes(parse(JOB, folder))
    assert str(raised.value).startswith(fault.format(rig=folder / "rig.usda"))


def test_faults_of_a_light_have_its_place(folder: Path) -> None:
    (folder / "sky.exr").write_text("no EXR")
    with pytest.raises(FaultsError) as raised:
        build_scenes(parse(JOB.replace('builtin = "white"', 'file = "sky.exr"'), folder))
    (fault,) = raised.value.faults
    assert (fault.file, fault.where) == (str(folder / "job.toml"), "ibl[0]")
    assert str(folder / "sky.exr") in fault.what


def test_a_light_may_be_linked_to_the_ground(folder: Path) -> None:
    (folder / "rig.usda").write_text(RIG.replace("/Car/Bdoy", GROUND_PATH))
    (note,) = build_scenes(parse(JOB, folder)).notes
    assert note == f"rig 'studio': /Rig/Key is linked to {GROUND_PATH}, but the asset has no such part"
    assert build_scenes(parse(f"{JOB}[ground]\n", folder)).notes == ()


def test_a_prim_that_is_not_there_is_a_fault_with_what_there_is(folder: Path) -> None:
    with pytest.raises(FaultsError, match=r"/Rig/Kye: there is no such prim \(below /Rig there are: /Rig/Key"):
        build_scenes(parse(JOB.replace('"rig.usda"', '"rig.usda"\nprim = "/Rig/Kye"'), folder))
    only = build_scenes(parse(JOB.replace('"rig.usda"', '"rig.usda"\nprim = "/Rig/Sky"'), folder))
    assert len(only.scenes["paint", "studio"].lights) == 1


@pytest.mark.parametrize("name", BUILTIN_RIGS)
def test_a_built_in_rig_stands_around_any_asset(folder: Path, name: str) -> None:
    text = JOB.replace('usd = "rig.usda"', f'builtin = "{name}"').replace('usd = "car.usda"', 'builtin = "sphere"')
    scene = build_scenes(parse(text, folder)).scenes["paint", "studio"]
    places = [light.position for light in scene.lights if isinstance(light, PlacedLight)]
    away = np.linalg.norm(np.array(places).reshape(-1, 3) - np.array(scene.asset.center), axis=1)
    assert (away > 3.0 * scene.asset.radius).all()


def test_a_rig_in_place_of_a_look_or_a_job_is_pointed_out(folder: Path) -> None:
    (folder / "job.toml").write_text(JOB.replace("paint.usda", "rig.usda"))
    with pytest.raises(FaultsError, match=r"rig\.usda: holds no material \(it has lights: 'lookdev inspect'"):
        prepare_job(folder / "job.toml")
    with pytest.raises(FaultsError, match=r"not TOML.*'lookdev inspect' lists what a USD file has"):
        prepare_job(folder / "rig.usda")


def test_a_dome_of_a_rig_is_the_light_of_an_ibl(folder: Path) -> None:
    turned = 'float xformOp:rotateZ = 90\nuniform token[] xformOpOrder = ["xformOp:rotateZ"]'
    (folder / "sky.usda").write_text(f'{HEADER}def DomeLight_1 "Rig"\n{{\n{turned}\n}}\n')
    (folder / "job.toml").write_text(JOB.replace('"rig.usda"', '"sky.usda"').replace("rotation = 30", "rotation = 0"))
    prepared = prepare_job(folder / "job.toml")
    files = [reel.files[0].relative_to(folder / "out") for reel in prepared.plan.reels]
    assert files == [Path("paint/white/lighting.0001.exr"), Path("paint/studio/lighting.0001.exr")]
    assert [(setup.ibl, setup.exposure) for setup in prepared.setups] == [("white", 0.0), ("studio", 1.0)]
    (of_ibl,), (of_rig,) = (setup.scene.lights for setup in prepared.setups)
    assert isinstance(of_rig, Dome)
    assert of_rig.emission.group == "Rig"
    assert replace(of_rig, emission=of_rig.emission.without_names) == of_ibl
