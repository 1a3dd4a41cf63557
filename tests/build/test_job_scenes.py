"""From a job to its scenes: the look of each part by every kind of assignment, and every fault of a job."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from usd_text import METRES, image, job_toml, material, shader, textured, variant_set

from lookdev.build import expand
from lookdev.build.scenes import JobScenes, build_scenes
from lookdev.errors import FaultsError
from lookdev.job import parse_job, schema


def overridden(name: str, line: str) -> str:
    """Return an override of a line of the layer of a material."""
    return f'over "{name}" {{\nover "Base" {{\n{line}\n}}\n}}\n'


SQUARE = """
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4, 4]
    int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 0, 1), (1, 0, 1), (2, 0, 1)]
"""
UVS = 'texCoord2f[] primvars:{name} = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)] ( interpolation = "vertex" )\n'
ROUGH = "float inputs:roughness = {}"
FINISHES = {"matt": ROUGH.format(0.5), "gloss": ROUGH.format(0.125)}
ASSET = f"""{METRES}
def Xform "Car" (
    prepend apiSchemas = ["CollectionAPI:trim", "CollectionAPI:empty"]
    prepend variantSets = "finish"
    variants = {{ string finish = "matt" }}
)
{{
    rel collection:trim:includes = [</Car/Hood>, </Car/Right/Hub>]
    def Mesh "Body" ( prepend apiSchemas = ["MaterialBindingAPI"] )
    {{
        {SQUARE}
        {UVS.format(name="st")}
        rel material:binding = </Car/Paint>
        def GeomSubset "Door" ( prepend apiSchemas = ["MaterialBindingAPI"] )
        {{
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [1]
            rel material:binding = </Car/Rubber>
        }}
    }}
    def Mesh "Hood"
    {{
        {SQUARE}
        color3f[] primvars:displayColor = [(1, 0, 0)] ( interpolation = "constant" )
    }}
    def Mesh "Bare"
    {{
        {SQUARE}
    }}
    def Xform "Left" ( instanceable = true
                       references = </Wheel> ) {{
    }}
    def Xform "Right" ( instanceable = true
                        references = </Wheel> ) {{
    }}
    {material("Paint", "float inputs:roughness", scope="/Car")}
    {material("Rubber", ROUGH.format(0.75), scope="/Car")}
    {variant_set("finish", **{name: overridden("Paint", line) for name, line in FINISHES.items()})}
}}
class Xform "Wheel"
{{
    def Mesh "Hub"
    {{
        {SQUARE}
        {UVS.format(name="map1")}
    }}
}}
"""
GOLD = 'material = "gold.usda"'
CAR = 'usd = "car.usda"'
OWN = {
    "/Car/Body": 0.5,
    "/Car/Body/Door": 0.75,
    "/Car/Hood": "displayColor",
    "/Car/Bare": "neutral",
    "/Car/Left/Hub": "neutral",
    "/Car/Right/Hub": "neutral",
}
Make = Callable[..., JobScenes]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "car.usda").write_text(ASSET)
    looks = {name: material(name.title(), ROUGH.format(value)) for name, value in {"gold": 0.25, "dirt": 1.0}.items()}
    looks |= {name: textured(name.title(), st=st) for name, st in {"checks": "st", "stripes": "map1"}.items()}
    for name, text in looks.items():
        (tmp_path / f"{name}.usda").write_text(f"#usda 1.0\n{text}")
    assert oiio.ImageBuf(np.full((2, 2, 3), 128, np.uint8)).write(str(tmp_path / "map.png"))
    return tmp_path


@pytest.fixture
def make(folder: Path) -> Make:
    """Return a function that makes the scenes of a job from the lines of its look and its asset."""

    def prepared(look: str = "", asset: str = CAR) -> JobScenes:
        text = f'{job_toml(asset=f"{{ {asset} }}")}[[look]]\nname = "one"\n{look}\n'
        return build_scenes(parse_job(text, folder / "job.toml"))

    return prepared


def look_by_part(prepared: JobScenes, name: str = "one") -> dict[str, float | str]:
    """Return the roughness of each part's look, or the name of a look without roughness."""
    scene = prepared.scenes[name, "white"]
    result: dict[str, float | str] = {}
    for instance in scene.asset.instances:
        mesh = scene.asset.meshes[instance.mesh]
        for slot in np.unique(mesh.face_slots):
            path = scene.asset.slots[slot].path
            path = instance.path + path.removeprefix(mesh.name) if instance.path else path
            look = scene.looks[slot]
            value = look.layers[0].inputs.get("roughness", look.name) if look.name != "neutral" else look.name
            assert isinstance(value, float | str)
            result[path] = value
    return result


def faults(make: Make, look: str = "", asset: str = CAR) -> list[str]:
    with pytest.raises(FaultsError) as caught:
        make(look, asset)
    return [f"{Path(fault.file).name}: {fault.where}: {fault.what} ({fault.hint})" for fault in caught.value.faults]


def assign(file: str, *prims: str) -> str:
    names = ", ".join(f'"{prim}"' for prim in prims)
    return f'\n[[look.assign]]\nprims = [{names}]\nmaterial = "{file}"\n'


ALL_GOLD = dict.fromkeys(OWN, 0.25)
GLOSS = ', variants = { finish = "gloss" }'
PARTS = ("/Car/Body/Door", "*/Hub", "/Car.collection:trim")
SOME_GOLD = dict.fromkeys(["/Car/Body/Door", "/Car/Hood", "/Car/Left/Hub", "/Car/Right/Hub"], 0.25)
DOOR, BODY = assign("gold.usda", "/Car/Body/Door"), assign("dirt.usda", "/Car/Body", "*/Left")


@pytest.mark.parametrize(
    ("look", "asset", "covered", "bare"),
    [
        ("", "", {}, "/Car/Bare and 2 more"),
        (GOLD, "", ALL_GOLD, None),
        (f"{GOLD}\nparts = {[*PARTS]}", "", SOME_GOLD, "/Car/Bare"),
        (DOOR + BODY, "", {"/Car/Body": 1.0, "/Car/Body/Door": 0.25, "/Car/Left/Hub": 1.0}, "/Car/Bare and 1 more"),
        (GOLD + assign("dirt.usda", PARTS[2]), "", ALL_GOLD | {"/Car/Hood": 1.0, "/Car/Right/Hub": 1.0}, None),
        ('variants = { finish = "gloss" }', "", {"/Car/Body": 0.125}, "/Car/Bare and 2 more"),
        ("", GLOSS, {"/Car/Body": 0.125}, "/Car/Bare and 2 more"),
        ('variants = { finish = "matt" }', GLOSS, {}, "/Car/Bare and 2 more"),
        (GOLD, GLOSS, ALL_GOLD, None),  # variants of a material do not change the asset
    ],
)
def test_each_part_has_the_first_look_that_covers_it(
    make: Make, look: str, asset: str, covered: dict[str, float], bare: str | None
) -> None:
    prepared = make(look, CAR + asset)
    assert look_by_part(prepared) == OWN | covered
    expected = [f"look 'one': nothing covers {bare}"] if bare else []
    assert [note.partition(";")[0] for note in prepared.notes] == expected


def test_a_material_that_covers_nothing_is_noted(make: Make) -> None:
    prepared = make(GOLD + assign("gold.usda", "/Car") + assign("dirt.usda", "/Car/Body"))
    said = "covers no part: others come first for all that it fits"
    assert prepared.notes == (f"look 'one': assign[1] {said}", f"look 'one': 'material' {said}")
    assert look_by_part(prepared) == ALL_GOLD


def test_a_mesh_is_split_where_looks_of_its_instances_differ_and_looks_share_what_is_equal(make: Make) -> None:
    left = assign("gold.usda", "*/Left")
    others = '[[look]]\nname = "two"\n' + left.replace("gold", "dirt") + f'[[look]]\nname = "three"\n{GOLD}'
    prepared = make(left + others)
    assert len(prepared.notes) == len(set(prepared.notes)) == 2  # of looks one and two; the asset's are there once
    one, two = (prepared.scenes[name, "white"].asset for name in ("one", "two"))
    assert one.digest == two.digest
    assert len(one.meshes) == 5
    assert one.meshes[4].points is one.meshes[3].points
    assert look_by_part(prepared) == OWN | {"/Car/Left/Hub": 0.25}
    assert look_by_part(prepared, "two") == OWN | {"/Car/Left/Hub": 1.0}
    assert prepared.scenes["three", "white"].looks[0].name == "three"


def test_an_assigned_material_has_prim_and_variants(make: Make, folder: Path) -> None:
    tin = material("Tin", "float inputs:roughness")
    tin = tin.replace('"Tin"', '"Tin" (\n prepend variantSets = "wear"\n variants = { string wear = "new" }\n)')
    roughness = {"worn": 0.875, "new": 0.3125}
    sets = variant_set("wear", **{k: f'over "Base" {{\n{ROUGH.format(v)}\n}}' for k, v in roughness.items()})
    gold = folder / "gold.usda"
    gold.write_text(f"{gold.read_text()}{tin.rstrip().removesuffix('}')}{sets}}}\n")
    tin = assign("gold.usda", "/Car") + 'prim = "/Tin"\n'
    assert set(look_by_part(make(tin)).values()) == {0.3125}
    assert set(look_by_part(make(tin + 'variants = { wear = "worn" }\n')).values()) == {0.875}


STUDIO = """<materialx version="1.38">
  <standard_surface name="S" type="surfaceshader">
    <input name="subsurface" type="float" value="0.5"/>
  </standard_surface>
  <surfacematerial name="Studio" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="S"/>
  </surfacematerial>
</materialx>"""


def test_a_material_of_another_model_covers_parts_and_its_losses_are_noted(make: Make, folder: Path) -> None:
    folder.joinpath("studio.mtlx").write_text(STUDIO)
    prepared = make(GOLD + assign("studio.mtlx", "/Car/Hood") + '[[look]]\nname = "two"\nmaterial = "studio.mtlx"')
    assert look_by_part(prepared) == ALL_GOLD | {"/Car/Hood": "Studio"}
    assert look_by_part(prepared, "two") == dict.fromkeys(OWN, "two")
    assert {look.layers[0].model for look in prepared.scenes["two", "white"].looks} == {"standard_surface"}
    (note,) = prepared.notes
    assert note.startswith(f"{folder / 'studio.mtlx'}: /MaterialX/Materials/Studio/S.inputs:subsurface: ")
    folder.joinpath("lama.mtlx").write_text(STUDIO.replace("standard_surface", "lama_surface"))
    messages = faults(make, 'material = "lama.mtlx"')
    assert "lama.mtlx: /MaterialX/Materials/Studio: has no surface shader that can be read ()" in messages


def test_built_in_assets_have_looks_by_part_uvs_for_any_look_and_no_collections(make: Make) -> None:
    built_in = 'builtin = "shaderball"'
    prepared = make(assign("dirt.usda", "*/base"), built_in)
    assert look_by_part(prepared) == {"/shaderball/body": "neutral", "/shaderball/base": 1.0}
    assert prepared.notes == ("look 'one': nothing covers /shaderball/body; it is rendered neutral grey",)
    prepared = make('material = "stripes.usda"', built_in)
    assert all("map1" in mesh.uvs for mesh in prepared.scenes["one", "white"].asset.meshes)
    (note,) = prepared.notes
    assert "no UV set 'map1', which looks ask for: 'st' is read" in note
    (fault,) = faults(make, f'{GOLD}\nparts = ["/x.collection:y"]', built_in)
    assert fault == "job.toml: look[0].parts: '/x.collection:y': a built-in asset has no collections ()"


def bound(prim: str, material: str, lines: str = "") -> str:
    schema = 'prepend apiSchemas = ["MaterialBindingAPI"]'
    return f"{prim} ( {schema} )\n{{\n{lines}\nrel material:binding = <{material}>\n}}\n"


OVERS = bound('over "Body"', "/Car/Rubber") + bound('over "Left"', "/Gold")
LAYER = f'#usda 1.0\nover "Car"\n{{\n{OVERS}}}\ndef "Gold" ( references = @./gold.usda@</Gold> ) {{\n}}\n'


def test_a_layer_is_composed_over_the_asset(make: Make, folder: Path) -> None:
    folder.joinpath("looks.usda").write_text(LAYER)
    second = '\n[[look]]\nname = "two"\n[[look]]\nname = "three"\nlayer = "looks.usda"\n'
    prepared = make('layer = "looks.usda"' + second + assign("dirt.usda", "/Car/Body"))
    layered = OWN | {"/Car/Body": 0.75, "/Car/Left/Hub": 0.25}
    assert look_by_part(prepared) == layered
    assert look_by_part(prepared, "two") == OWN
    assert look_by_part(prepared, "three") == layered | {"/Car/Body": 1.0, "/Car/Body/Door": 1.0}
    one, two, three = (prepared.scenes[name, "white"].asset for name in ("one", "two", "three"))
    assert one is three
    assert one.digest != two.digest


def test_a_layer_that_overrides_nothing_is_noted(make: Make, folder: Path) -> None:
    folder.joinpath("looks.usda").write_text(LAYER.replace('over "Left"', 'over "Lfet"'))
    assert any("/Car/Lfet: overrides a prim that is not there" in note for note in make('layer = "looks.usda"').notes)


def test_an_asset_without_a_surface_is_a_fault_of_its_layer_or_of_itself(make: Make, folder: Path) -> None:
    folder.joinpath("looks.usda").write_text('#usda 1.0\nover "Car" ( active = false ) {\n}\n')
    (fault,) = faults(make, 'layer = "looks.usda"')
    assert fault.startswith("job.toml: look[0].layer: ")
    (fault,) = faults(make, asset=f'{CAR}, prim = "/Car/Paint"')
    assert fault.startswith("job.toml: asset: ")


def test_a_fault_of_a_material_that_the_asset_binds_is_that_of_its_file(make: Make, folder: Path) -> None:
    (folder / "car.usda").write_text(ASSET.replace(ROUGH.format(0.75), ROUGH.format(2.0)))
    (fault,) = faults(make)
    assert fault.startswith("car.usda: /Car/Rubber/Base.inputs:roughness: ")


def test_a_star_makes_a_look_of_each_variant_of_the_asset(make: Make) -> None:
    every = make('variants = { finish = "*" }')
    assert [look.name for look in every.job.look] == ["one_gloss", "one_matt"]
    assert look_by_part(every, "one_gloss") == OWN | {"/Car/Body": 0.125}
    assert look_by_part(every, "one_matt") == OWN


def test_a_set_without_variants_and_one_with_too_many_are_faults(
    make: Make, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    none = ASSET.replace('"finish"\n', '["finish", "none"]\n').replace(
        "variantSet ", 'variantSet "none" = {}\nvariantSet '
    )
    (folder / "car.usda").write_text(none)
    asset = f'{CAR}, prim = "/Car"'
    assert faults(make, 'variants = { none = "*" }', asset) == ["car.usda: /Car: variant set 'none' has no variants ()"]
    monkeypatch.setattr("lookdev.material.variants.MAX_COMBINATIONS", 1)
    (message,) = faults(make, 'variants = { finish = "*" }', asset)
    assert message.startswith("car.usda: /Car: '*' expands to 2 combinations of variants, at most 1")


def test_the_looks_and_the_frames_of_all_stars_are_bounded(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    star = 'variants = { finish = "*" }\n'
    two = star + '[[look]]\nname = "two"\n' + star
    monkeypatch.setattr(expand, "MAX_COMBINATIONS", 4)
    monkeypatch.setattr(schema, "MAX_FRAMES", 8)
    assert len(make(two).job.look) == 4
    monkeypatch.setattr(schema, "MAX_FRAMES", 7)
    with pytest.raises(FaultsError, match=r"turntable: 4 looks under 1 lights .* make 8 frames"):
        make(two)
    monkeypatch.setattr(expand, "MAX_COMBINATIONS", 3)
    with pytest.raises(FaultsError, match=r"look: '\*' expands to variants that make 4 looks, at most 3"):
        make(two)


def test_another_uv_set_stands_for_the_one_asked_for(make: Make) -> None:
    prepared = make(assign("checks.usda", "*/Hub") + assign("stripes.usda", "*/Body"))
    assert prepared.notes[1:] == (
        "/Car/Body has no UV set 'map1', which looks ask for: 'st' is read",
        "/Car/Left/Hub has no UV set 'st', which looks ask for: 'map1' is read",
    )


SECOND = assign("gold.usda", "/Car") + assign("gold.usda", "/Car/Body", "/Car/Rihgt")
NO_VARIANT = "car.usda: : variant set 'finish' has no variant 'glos' (did you mean 'gloss'?)"
NO_SET = "car.usda: : has no variant set 'finihs' (did you mean 'finish'?)"
KNOWN = "known: /Car/Bare, /Car/Body, /Car/Hood, /Car/Left, /Car/Right"
PATTERNS = {
    "/Cra": "fits no part (did you mean '/Car'?)",
    "/Car.collection:empty": "fits no part (it includes none that is rendered)",
    "/Car.collection:trin": "is not a collection of the asset: /Car has no 'trin' (did you mean 'trim'?) ()",
    "/Car/Paint": "fits no part (the asset has this prim, but renders nothing of it)",
    "/Car/Wheel*": f"fits no part ({KNOWN})",
}


@pytest.mark.parametrize(
    ("look", "asset", "fault"),
    [
        *(
            (f'{GOLD}\nparts = ["/Car/Body", "{pattern}"]', "", f"job.toml: look[0].parts: '{pattern}' {said}")
            for pattern, said in PATTERNS.items()
        ),
        (SECOND, "", "job.toml: look[0].assign[1].prims: '/Car/Rihgt' fits no part (did you mean '/Car/Right'?)"),
        ('variants = { finihs = "gloss" }', "", NO_SET),
        ('variants = { finihs = "*" }', "", NO_SET),
        ('variants = { finish = "glos" }', "", NO_VARIANT),
        ("", GLOSS.replace("gloss", "glos"), NO_VARIANT),
        ("", ', prim = "/Cat"', "car.usda: /Cat: there is no such prim"),
    ],
)
def test_what_the_asset_does_not_have_is_a_fault(make: Make, look: str, asset: str, fault: str) -> None:
    (messages,) = faults(make, look, CAR + asset)
    assert messages.startswith(fault)


def test_every_pattern_that_fits_nothing_is_reported(make: Make) -> None:
    patterns = ["/Car.collection:trin", "/Car/Rihgt", "/Nothing"]
    assert [fault.split("'")[1] for fault in faults(make, assign("gold.usda", *patterns))] == patterns


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("no USD", "USD cannot open it"),
        ('#usda 1.0\n(\n subLayers = [@gone.usda@]\n)\nover "Car" {\n}', "gone.usda"),
        ('#usda 1.0\ndef "X" ( references = @gone.usda@ ) {\n}', "gone.usda"),
        ('#usda 1.0\ndef "X" ( references = </X/Y> ) {\n}', "/X"),
    ],
)
def test_a_layer_that_breaks_is_a_fault(make: Make, folder: Path, text: str, said: str) -> None:
    folder.joinpath("looks.usda").write_text(text)
    messages = faults(make, 'layer = "looks.usda"')
    assert len(messages) == 1
    assert said in messages[0]


def test_faults_of_assigned_materials_and_of_patterns_are_reported_at_once(make: Make, folder: Path) -> None:
    folder.joinpath("dirt.usda").write_text("no USD")
    wrong, gold = assign("dirt.usda", "/Wrong"), assign("gold.usda", "/Car")
    messages = faults(make, f'{wrong}prim = "/X"\n{gold}prim = "/X"\n')
    assert len(messages) == 3
    assert messages[0].startswith("dirt.usda: : USD cannot open it")
    assert messages[1].startswith("gold.usda: /X: no such prim")
    assert messages[2].startswith("job.toml: look[0].assign[0].prims: '/Wrong' fits no part")


def preview(name: str) -> str:
    """Return a material with a UsdPreviewSurface that emits light and reads an image."""
    surface = shader(
        "Surface",
        "UsdPreviewSurface",
        "color3f inputs:emissiveColor = (1, 1, 1)",
        f"color3f inputs:diffuseColor.connect = </{name}/Map.outputs:rgb>",
        "token outputs:surface",
    )
    output = f"token outputs:surface.connect = </{name}/Surface.outputs:surface>"
    return f'def Material "{name}"\n{{\n{output}\n{surface}{image(name)}}}\n'


def test_translated_materials_are_read_at_zero_without_uvs_and_losses_are_told_once(make: Make, folder: Path) -> None:
    meshes = [("A", "Red"), ("B", "Blue"), ("C", "Red")]
    parts = [bound(f'def Mesh "{name}"', f"/{material}", SQUARE) for name, material in meshes]
    (folder / "car.usda").write_text("".join(["#usda 1.0\n", *parts, preview("Red"), preview("Blue")]))
    prepared = make('\n[[look]]\nname = "two"\n')
    assert [look.name for look in prepared.scenes["one", "white"].looks] == ["Red", "Blue", "Red"]
    (lost, uvs) = prepared.notes
    assert "/Red/Surface.inputs:emissiveColor and 1 more: " in lost
    assert uvs == "/A and 2 more have no UV set 'st', which looks ask for: nor another; textures are read at (0, 0)"
    assert look_by_part(prepared, "two") == look_by_part(prepared)


@pytest.mark.parametrize(
    ("opacity", "color", "presence"),
    [
        ("[1, 1]", "displayColor", None),
        ("[0.5, 1]", "displayColor", "displayOpacity"),
        ("[0.5, 1]", "unread", "displayOpacity"),  # of a grey
    ],
)
def test_a_display_opacity_counts_where_it_is_below_one(
    make: Make, folder: Path, opacity: str, color: str, presence: str | None
) -> None:
    primvar = f'float[] primvars:displayOpacity = {opacity} ( interpolation = "uniform" )\n color3f[] primvars:{color}'
    (folder / "car.usda").write_text(ASSET.replace("color3f[] primvars:displayColor", primvar))
    (look,) = {look.name: look for look in make().scenes["one", "white"].looks if look.name == "displayColor"}.values()
    assert getattr(look.layers[0].inputs.get("opacity"), "name", None) == presence
