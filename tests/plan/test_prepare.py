"""What a job names, read and planned: every fault at once, and the look of each part."""

import gc
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from usd_text import card, material, textured, variant_set

from lookdev.codegen.setting import SourceSetting
from lookdev.codegen.source import GeneratedSource, ShaderSource
from lookdev.errors import FaultsError
from lookdev.job import load_job
from lookdev.light.dome import points
from lookdev.light.dome.maps import DomeMap, load_dome
from lookdev.material import Look
from lookdev.plan.prepare import plan_job, prepare_job
from lookdev.rendering.backends import BACKENDS, job_backends
from lookdev.rendering.task import SceneTask

JOB = """
output = "out"
asset = { usd = "asset.usda" }
turntable = [{ kind = "element", frames = 3 }]
look = [{ name = "good", material = "good.usda" }, { name = "other", material = "other.usda" }]
[[ibl]]
name = "white"
builtin = "white"
[render]
resolution = [8, 8]
"""


def look_text(roughness: float) -> str:
    return "#usda 1.0\n" + material("Paint", f"float inputs:roughness = {roughness}")


@pytest.fixture
def job(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a job without a fault."""
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    for name in ("good", "other"):
        (tmp_path / f"{name}.usda").write_text(look_text(0.5))
    cards = card("Left") + card("Right")
    (tmp_path / "asset.usda").write_text(f'#usda 1.0\n( upAxis = "Z" )\n{cards}')
    path = tmp_path / "job.toml"
    path.write_text(JOB)
    return path


@pytest.mark.parametrize(("backend", "tables"), [("exact", 1), ("nodes", 0), ("nodes-exact", 0)])
def test_maps_have_tables_where_directions_are_drawn_from_them(
    job: Path, backend: str, tables: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(points, "SIDE", 32)
    job.write_text(job.read_text().replace('builtin = "white"', 'builtin = "city"'))
    digests = [frame.task.digest for frame in prepare_job(job, backend).plan.frames]
    assert len(list((job.parent / "cache" / "ibl").glob("*.tables.json"))) == tables
    # The tables are there now, for whatever reason: no digest is another.
    prepare_job(job, "exact")
    assert [frame.task.digest for frame in prepare_job(job, backend).plan.frames] == digests


def faults_of(job: Path, **options: str) -> list[str]:
    with pytest.raises(FaultsError) as caught:
        prepare_job(job, **options)
    return [str(fault) for fault in caught.value.faults]


def with_good(keys: str) -> str:
    """Return the text of the job with further keys of its look "good"."""
    return JOB.replace('"good.usda"', f'"good.usda", {keys}')


@pytest.mark.both_pythons
def test_a_scene_with_the_shader_of_frames_is_known_before_the_asset_is_read(job: Path) -> None:
    scenes: list[SceneTask] = []
    prepared = plan_job(load_job(job), scenes.append)
    (scene,) = scenes
    frame = prepared.plan.frames[0].task.scene
    assert scene.shaders[0] in frame.shaders
    assert (scene.lights, scene.resolution, scene.sampling) == (frame.lights, frame.resolution, frame.sampling)
    (job.parent / "asset.usda").write_text("no USD")
    gc.collect()  # USD keeps a layer as it was read while a stage of it is left
    with pytest.raises(FaultsError, match=r"asset\.usda"):
        plan_job(load_job(job), scenes.append)
    assert scenes == [scene, scene]
    (job.parent / "other.usda").write_text("no USD either")
    with pytest.raises(FaultsError):
        plan_job(load_job(job), scenes.append)
    assert len(scenes) == 2


def test_faults_of_asset_looks_and_lights_are_reported_at_once_with_their_places(job: Path) -> None:
    job.write_text(job.read_text() + '[[ibl]]\nname = "file"\nfile = "light.hdr"\n')
    (job.parent / "light.hdr").write_text("dark")
    (job.parent / "asset.usda").write_text("no USD")
    (job.parent / "good.usda").write_text("no USD either")
    (job.parent / "other.usda").write_text(look_text(7))
    light, good, other, asset = faults_of(job)
    assert asset.startswith(f"{job.parent}/asset.usda: USD cannot open it: ")
    assert "pxrInternal" not in asset
    assert light.startswith(f"{job}: ibl[1]: {job.parent}/light.hdr: cannot be read as an image")
    assert good.startswith(f"{job.parent}/good.usda: USD cannot open it")
    assert other.startswith(f"{job.parent}/other.usda: /Paint/Base.inputs:roughness: 7")
    assert not (job.parent / "out").exists()


def test_a_part_that_no_look_covers_is_noted(job: Path) -> None:
    job.write_text(with_good('parts = ["/Left"]'))
    assert prepare_job(job).notes == ("look 'good': nothing covers /Right; it is rendered neutral grey",)


@pytest.mark.parametrize(
    ("asset", "files", "frames"),
    [('usd = "asset.usda"', [1, 1, 1], []), ('builtin = "sphere"', [3], ["2 of 3 frames"])],
)
def test_turning_a_sphere_of_a_plain_look_is_one_frame(
    job: Path, asset: str, files: list[int], frames: list[str]
) -> None:
    job.write_text(job.read_text().replace('usd = "asset.usda"', asset))
    plan = prepare_job(job).plan
    assert [len(frame.task.files) for frame in plan.frames] == files * 2
    skipped = {look: [skip.what for skip in plan.skips if skip.look == look] for look in ("good", "other")}
    convex = ["bounces", "shadow rays"] if frames else []
    assert skipped["good"] == skipped["other"] == [*convex, "light from behind", "light samples", "1 lobe", *frames]


@pytest.mark.parametrize("backend", [name for name in job_backends() if name != "exact"])
def test_a_backend_of_the_job_or_another_makes_the_sources(job: Path, backend: str) -> None:
    by_shaders, of_argument = prepare_job(job), prepare_job(job, backend=backend)
    assert (of_argument.job.render.backend, of_argument.job.file) == (backend, job)
    device = BACKENDS[backend].devices[-1]
    job.write_text(f'{job.read_text()}backend = "{backend}"\ndevice = "{device}"\n')
    of_job = prepare_job(job)
    source = BACKENDS[backend].source
    expected = ("exact", "cpu", ShaderSource), (backend, "cpu", source), (backend, device, source)
    for prepared, (name, on, kind) in zip((by_shaders, of_argument, of_job), expected, strict=True):
        scenes = [frame.task.scene for frame in prepared.plan.frames]
        assert {(scene.backend, scene.device) for scene in scenes} == {(name, on)}
        assert {type(source) for scene in scenes for source in scene.shaders} == {kind}
    digests = [{frame.task.digest for frame in prepared.plan.frames} for prepared in (by_shaders, of_job)]
    assert not digests[0] & digests[1]


def test_a_look_is_generated_once_for_all_lights_of_one_size(job: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    generated = []
    generate = BACKENDS["exact"].generate

    def counted(look: Look, setting: SourceSetting) -> GeneratedSource:
        generated.append((look.name, setting.lights[0].constant))
        return generate(look, setting)

    monkeypatch.setitem(BACKENDS, "exact", replace(BACKENDS["exact"], generate=counted))

    def varied(file: Path | None, builtin: str, *, sampled: bool) -> DomeMap:
        """Return a map that varies, but for white; its tables of directions are any file: nothing reads them here."""
        white = load_dome(builtin="white")
        if builtin == "white":
            return white
        tables = dict.fromkeys(("points_file", "slots_file", "bins_file"), white.dome.radiance_file)
        return replace(white, dome=replace(white.dome, constant=False, map_digest=builtin, **tables))

    monkeypatch.setattr("lookdev.build.lights.load_dome", varied)
    lights = [f'[[ibl]]\nname = "{name}"\nbuiltin = "{name}"\n' for name in ("city", "forest")]
    job.write_text(job.read_text() + "".join(lights))
    setups = prepare_job(job).setups
    assert sorted(generated) == [(look, constant) for look in ("good", "other") for constant in (False, True)]
    for look in ("good", "other"):
        sources = {setup.ibl: setup.task.shaders[0] for setup in setups if setup.look == look}
        assert sources["city"] == sources["forest"] != sources["white"]
    assert len({setup.task.lights[0].digest for setup in setups}) == 3


def test_a_look_that_a_backend_cannot_show_is_a_fault_with_its_place(job: Path) -> None:
    see_through = look_text(0.5).replace("LookdevDisney", "LookdevPixar")
    (job.parent / "other.usda").write_text(see_through.replace("float inputs:roughness", "float inputs:presence"))
    assert prepare_job(job, backend="nodes").plan.frames
    (fault,) = faults_of(job, backend="nodes-exact")
    assert fault.startswith(f"{job}: look[1]: ")
    assert "nodes-exact" in fault


RIG = """#usda 1.0
( defaultPrim = "Rig" )
def Xform "Rig" {
    def SphereLight "Left" { float inputs:diffuse = 0.5; string lookdev:lightGroup = "sides"; }
    def SphereLight "Right" { float lookdev:falloff:exponent = 1; }
}
"""


def test_lights_that_a_backend_cannot_show_are_faults_with_their_prims(job: Path) -> None:
    rig = job.parent / "rig.usda"
    rig.write_text(RIG)
    job.write_text(job.read_text() + '[[rig]]\nname = "sides"\nusd = "rig.usda"\n')
    assert [fault.partition(", which")[0] for fault in faults_of(job, backend="nodes")] == [
        f"{job}: rig[0]: {rig}: light /Rig/Left (sphere): it has a diffuse multiplier",
        f"{job}: rig[0]: {rig}: light /Rig/Right (sphere): it has a falloff of its own",
    ]


# A set of two; another of two, where one variant brings a set of its own.
BASE = [f"float inputs:{name}.connect = </Paint.inputs:{name}>" for name in ("roughness", "specular", "sheen")]
DIRT = variant_set("dirt", dry="float inputs:sheen = 0.3", wet="float inputs:sheen = 0.4")
WORN = f"""( prepend variantSets = "dirt"; variants = {{ string dirt = "dry" }} ) {{
    float inputs:specular = 0.1
    {DIRT}
}}
"""
VARIED = f"""#usda 1.0
def Material "Paint" (
    prepend variantSets = ["wear", "gloss"]
    variants = {{ string wear = "new"; string gloss = "matt" }}
) {{
    float inputs:roughness
    float inputs:specular
    float inputs:sheen
    {material("Paint", *BASE).partition("{")[2].rstrip().removesuffix("}")}
    variantSet "wear" = {{
        "worn" {WORN}
        "new" {{ float inputs:specular = 0.2; float inputs:sheen = 0; }}
    }}
    {variant_set("gloss", matt="float inputs:roughness = 0.75", bright="float inputs:roughness = 0.25")}
}}
"""


def write_varied(job: Path, variants: str, other: str = "other") -> Path:
    """Write a job whose look "good" is of the material with variant sets, and chooses them so."""
    text = with_good(f"variants = {{ {variants} }}").replace('name = "other"', f'name = "{other}"')
    job.write_text(text.replace("frames = 3", "frames = 1"))
    (job.parent / "good.usda").write_text(VARIED)
    return job


@pytest.mark.both_pythons
@pytest.mark.parametrize(
    ("variants", "names"),
    [
        ('wear = "*", gloss = "bright"', ["good_new", "good_worn"]),
        ('gloss = "*", wear = "*"', ["good_bright_new", "good_bright_worn", "good_matt_new", "good_matt_worn"]),
        ('wear = "worn", dirt = "*"', ["good_dry", "good_wet"]),  # of a set inside a variant
    ],
)
def test_stars_make_a_look_of_each_combination_of_variants(job: Path, variants: str, names: list[str]) -> None:
    prepared = prepare_job(write_varied(job, variants))
    shaders = {frame.task.labels["look"]: frame.task.scene.shaders[0] for frame in prepared.plan.frames}
    assert [look.name for look in prepared.job.look] == list(shaders) == [*names, "other"]
    assert [shader.name for shader in shaders.values()] == list(shaders)
    assert len({shader.digest for shader in shaders.values()}) == len(shaders)
    assert [frame.task.files for frame in prepared.plan.frames] == [
        (job.parent / "out" / look / "white" / "element.0001.exr",) for look in shaders
    ]


@pytest.mark.parametrize(
    ("variants", "other", "fault"),
    [
        ('wear = "new", dirt = "*"', "other", "good.usda: /Paint: has no variant set 'dirt' (known: gloss, wear)"),
        # Folders may ignore case.
        ('wear = "*"', "Good_WORN", "job.toml: look[1]: two looks of the job are called 'Good_WORN' (give each its ow"),
    ],
)
def test_a_fault_of_variants_is_reported_with_all_others(job: Path, variants: str, other: str, fault: str) -> None:
    if other == "other":
        (job.parent / "other.usda").write_text("no USD")
    message, *others = faults_of(write_varied(job, variants, other))
    assert message.startswith(f"{job.parent}/{fault}")
    assert [text.partition(": ")[0] for text in others] == [f"{job.parent}/other.usda"] * (other == "other")


TEXTURED = "#usda 1.0\n" + textured(
    "Checks",
    "color3f inputs:baseColor.connect = </Checks/Map.outputs:rgb>",
    "float inputs:clearcoat.connect = </Checks/Map.outputs:r>",
)
UVS = "texCoord2f[] primvars:{name} = [(0, 0), (1, 0), (1, 1), (0, 1)]"


@pytest.fixture
def textured_job(job: Path) -> Path:
    """Return the job with a textured look."""
    assert oiio.ImageBuf(np.full((2, 2, 3), 128, np.uint8)).write(str(job.parent / "map.png"))
    (job.parent / "good.usda").write_text(TEXTURED)
    return job


@pytest.mark.parametrize(
    ("sets", "fault"), [(("map1", "map2"), "it has: map1, map2; the look can name one"), ((), "it has none at all")]
)
def test_a_mesh_lacks_a_uv_set_that_can_be_meant(textured_job: Path, sets: tuple[str, ...], fault: str) -> None:
    uvs = "".join(f'{UVS.format(name=name)} ( interpolation = "vertex" )\n' for name in sets)
    asset = textured_job.parent / "asset.usda"
    asset.write_text(asset.read_text().replace("point3f", f"{uvs}point3f"))
    assert faults_of(textured_job) == [f"asset: /Left and 1 more, look 'good': no UV set 'st' ({fault})"]


def test_a_look_whose_textures_reach_no_pixel_needs_no_uvs(textured_job: Path) -> None:
    # Without a clearcoat, its gloss is read by nothing.
    text = TEXTURED.replace("color3f inputs:baseColor.connect = </Checks/Map.outputs:rgb>", "")
    text = text.replace("inputs:clearcoat.connect", "inputs:clearcoatGloss.connect")
    (textured_job.parent / "good.usda").write_text(text)
    assert prepare_job(textured_job).plan.frames
