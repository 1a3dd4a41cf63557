"""Composing USD files: layers over them, variants, what is missing, and MaterialX files."""

import os

import pytest
from pxr import Sdf, UsdGeom, UsdShade, UsdUtils

from lookdev.errors import LookError, OutputError, StageError
from lookdev.stage import Composition, compose
from lookdev.stage.files import DEFAULT_BYTES

pytestmark = pytest.mark.both_pythons

CAR = """#usda 1.0
( defaultPrim = "Car"
  upAxis = "Z"
  metersPerUnit = 1 )
def Xform "Car" (variants = { string model = "plain" }; prepend variantSets = "model") {
    variantSet "model" = {
        "plain" {
            def Sphere "Plain" {}
        }
        "sport" (variants = { string trim = "none" }; prepend variantSets = "trim") {
            def Sphere "Sport" {}
            variantSet "trim" = {
                "none" {}
                "wing" {
                    def Cube "Wing" {}
                }
            }
        }
    }
    def Xform "Wheel" (references = @wheel.usda@; instanceable = true) {}
}
def Xform "Van" (references = @core.usda@</Car>) {}
"""
WHEEL = """#usda 1.0
( defaultPrim = "Wheel" )
def Xform "Wheel" {
    def Xform "Tire" (variants = { string tread = "slick" }; prepend variantSets = "tread") {
        variantSet "tread" = {
            "slick" {
                def Sphere "Slick" {}
            }
            "rain" {
                def Sphere "Rain" {}
            }
        }
    }
}
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "car.usda").write_text(CAR)
    (tmp_path / "core.usda").write_text(CAR.partition('def Xform "Van"')[0])
    (tmp_path / "wheel.usda").write_text(WHEEL)
    return tmp_path


def compose_car(folder, **options):
    return compose(Composition(folder / "car.usda", **options))


def prims_exist(stage, *paths):
    return [bool(stage.GetPrimAtPath(path)) for path in paths]


def test_a_file_as_it_is(folder):
    result = compose_car(folder)
    assert prims_exist(result.stage, "/Car/Plain", "/Van/Plain", "/Car/Sport") == [True, True, False]
    assert result.notes == ()
    assert result.stage.GetDefaultPrim().GetPath() == "/Car"
    assert UsdGeom.GetStageUpAxis(result.stage) == "Z"


def test_variants_are_selected_wherever_a_prim_has_the_set_those_inside_variants_too(folder):
    stage = compose_car(folder, variants=(("trim", "wing"), ("model", "sport"))).stage
    assert prims_exist(stage, "/Car/Plain", "/Car/Wing", "/Van/Wing") == [False, True, True]


def test_variants_are_those_of_prims_above_and_below_the_chosen_one(folder):
    stage = compose_car(folder, prim="/Car/Sport", variants=(("model", "sport"),)).stage
    assert prims_exist(stage, "/Car/Sport", "/Van/Sport") == [True, False]


def test_variants_inside_an_instance_are_selected_in_that_instance(folder):
    stage = compose_car(folder, prim="/Car/Wheel", variants=(("tread", "rain"),)).stage
    assert prims_exist(stage, "/Car/Wheel/Tire/Rain", "/Car/Wheel/Tire/Slick") == [True, False]
    assert prims_exist(stage, "/Van/Wheel/Tire/Rain", "/Van/Wheel/Tire/Slick") == [False, True]


def test_a_prim_whose_set_lacks_the_variant_keeps_its_own_with_a_note(folder):
    (folder / "car.usda").write_text(CAR.partition('def Xform "Van"')[0] + VAN)
    result = compose_car(folder, variants=(("model", "sport"),))
    assert prims_exist(result.stage, "/Car/Sport", "/Van/Long") == [True, True]
    note = f"{folder}/car.usda: /Van: variant set 'model' has no variant 'sport'; 'long' stays selected"
    assert result.notes == (note,)


VAN = """def Xform "Van" (variants = { string model = "long" }; prepend variantSets = "model") {
    variantSet "model" = {
        "long" {
            def Sphere "Long" {}
        }
    }
}
"""


@pytest.mark.parametrize(
    ("variants", "message"),
    [
        ((("modle", "sport"),), r"car\.usda: has no variant set 'modle' \(did you mean 'model'\?\)"),
        ((("xyz", "sport"),), r"has no variant set 'xyz' \(known: model, tread\)"),
        ((("model", "sprot"),), r"variant set 'model' has no variant 'sprot' \(did you mean 'sport'\?\)"),
        ((("trim", "wing"),), r"has no variant set 'trim'"),  # it is inside a variant that is not selected
    ],
)
def test_unknown_variants_are_faults_that_list_the_known_ones(folder, variants, message):
    with pytest.raises(StageError, match=message):
        compose_car(folder, variants=variants)


def test_a_layer_is_stronger_than_the_file_and_relative_to_its_own_folder(folder):
    other = folder / "looks"
    other.mkdir()
    (other / "more.usda").write_text('#usda 1.0\ndef Xform "More" {\ndef Cone "Cone" {}\n}')
    (other / "looks.usda").write_text("""#usda 1.0
over "Car" {
    over "Plain" { double radius = 7; }
    def "Added" (references = @more.usda@</More>) {}
}
over "Cra" {
    over "Plain" {}
}
""")
    result = compose_car(folder, layer=other / "looks.usda")
    assert UsdGeom.Sphere(result.stage.GetPrimAtPath("/Car/Plain")).GetRadiusAttr().Get() == 7.0
    assert prims_exist(result.stage, "/Car/Added/Cone") == [True]
    assert result.notes == (f"{other}/looks.usda: /Cra: overrides a prim that is not there, and has no effect",)
    # The layers on disk and in memory are as before.
    assert UsdGeom.Sphere(compose_car(folder).stage.GetPrimAtPath("/Car/Plain")).GetRadiusAttr().Get() == 1.0


def test_of_many_prims_the_nearest_is_named(tmp_path):
    prims = "".join(f'def Sphere "L{number:03}" {{}}\n' for number in range(100))
    file = tmp_path / "many.usda"
    file.write_text(f"#usda 1.0\n{prims}")
    with pytest.raises(StageError, match=r"/L10: there is no such prim \(did you mean '/L010'\?\)"):
        compose(Composition(file, prim="/L10"))
    with pytest.raises(StageError, match=r"\(below / there are: /L000, .*, /L015 and 84 more\)"):
        compose(Composition(file, prim="/Key"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"prim": ""}, r"'' is not the path of a prim"),
        ({"prim": "Car"}, r"'Car' is not the path of a prim \(one looks like '/World/Car'\)"),
        ({"prim": "/Car.radius"}, "is not the path of a prim"),
        ({"prim": "/Car/Weel"}, r"/Car/Weel: there is no such prim \(below /Car there are: /Car/Plain, /Car/Wheel\)"),
        ({"layer": "none.usda"}, r"none\.usda: no such file"),
        ({"layer": "bad.usda"}, r"bad\.usda: USD cannot open it"),
    ],
)
def test_faults_of_the_options(folder, options, message):
    (folder / "bad.usda").write_text("#usda 1.0\ndef Mesh {")
    if "layer" in options:
        options = {"layer": folder / options["layer"]}
    with pytest.raises(StageError, match=message):
        compose_car(folder, **options)


BROKEN = {
    "reference": ("references = @none.usda@</X>", "/A: Could not open asset @none.usda@ for reference"),
    "payload": ("payload = @none.usda@</X>", "/A: Could not open asset @none.usda@ for payload"),
    "not USD": ("references = @junk.usda@</X>", "/A: Could not open asset @.*junk.usda@ .* is not a valid usda layer"),
    "no target": ("references = @wheel.usda@</Weel>", "/A: Unresolved reference prim path @.*wheel.usda@</Weel>"),
    "cycle": ("references = </A/B>", "/A: Cycle detected: .* CANNOT reference"),
    "missing MaterialX": ("references = @none.mtlx@</MaterialX>", "/A: Could not open asset @none.mtlx@"),
}


@pytest.mark.parametrize(("arc", "message"), BROKEN.values(), ids=BROKEN)
def test_what_cannot_be_composed_is_a_fault_at_its_prim_or_a_note(folder, arc, message, capfd):
    (folder / "junk.usda").write_text("junk")
    inside = 'def Xform "B" (references = </A>) {}\n' if "</A" in arc else ""
    (folder / "car.usda").write_text(f'{CAR}def Xform "A" ({arc}) {{\n{inside}}}\n')
    with pytest.raises(StageError, match=r"(?s)car\.usda: " + message) as caught:
        compose_car(folder)
    assert isinstance(caught.value, LookError)  # a look's file is a USD file, too
    result = compose_car(folder, missing="warn")
    assert result.notes == tuple(map(str, caught.value.faults))
    assert prims_exist(result.stage, "/A", "/Car/Plain") == [True, True]
    assert capfd.readouterr().err == ""


def test_a_missing_sublayer_is_a_fault_of_the_file(folder):
    (folder / "car.usda").write_text(CAR.replace("( defaultPrim", "( subLayers = [@none.usda@]\n  defaultPrim"))
    with pytest.raises(StageError, match=r"car\.usda: Could not load sublayer @none.usda@"):
        compose_car(folder)
    assert len(compose_car(folder, missing="warn").notes) == 1


def test_one_missing_file_of_many_prims_is_one_fault(folder):
    prims = "".join(f'def Xform "X{i}" (references = </Y>) {{}}\n' for i in range(5))
    text = f'#usda 1.0\nclass Xform "Y" (references = @none.usda@</X>) {{}}\n{prims}'
    (folder / "car.usda").write_text(text)
    with pytest.raises(StageError) as caught:
        compose_car(folder)
    assert len(caught.value.faults) == 1
    assert str(caught.value).endswith("(and 5 more prims)")


def test_materials_of_materialx_files_are_bound_in_instances_too(folder):
    (folder / "m.mtlx").write_text(
        '<materialx version="1.38"><standard_surface name="S" type="surfaceshader"/><surfacematerial name="Gold" '
        'type="material"><input name="surfaceshader" type="surfaceshader" nodename="S"/></surfacematerial></materialx>'
    )
    (folder / "part.usda").write_text(
        '#usda 1.0\ndef "Part" {\n    def "Looks" (references = @m.mtlx@</MaterialX/Materials>) {}\n'
        '    def Sphere "Ball" { rel material:binding = </Part/Looks/Gold>; }\n}\n'
    )
    (folder / "car.usda").write_text(
        '#usda 1.0\ndef "A" (references = @part.usda@</Part>) {}\n'
        'def "B" (references = @part.usda@</Part>; instanceable = true) {}\n'
    )
    result = compose_car(folder)
    assert result.notes == ()
    for name in "AB":
        ball = UsdShade.MaterialBindingAPI(result.stage.GetPrimAtPath(f"/{name}/Ball"))
        assert ball.ComputeBoundMaterial()[0].GetPath() == f"/{name}/Looks/Gold"


def test_payloads_are_loaded(folder):
    (folder / "car.usda").write_text('#usda 1.0\ndef "A" (payload = @wheel.usda@) {}\n')
    assert prims_exist(compose_car(folder).stage, "/A/Tire/Slick") == [True]


CLIPPED = """#usda 1.0
def "Root" (references = @still.usda@</Root>
    clips = {
        dictionary default = {
            asset[] assetPaths = [@clip.usda@]
            asset manifestAssetPath = @manifest.usda@
            string primPath = "/Root"
            double2[] active = [(0, 0)]
            double2[] times = [(0, 0), (9, 9)]
        }
    }) {}
"""


@pytest.fixture
def clips_folder(tmp_path):
    (tmp_path / "asset.usda").write_text(CLIPPED)
    (tmp_path / "still.usda").write_text('#usda 1.0\ndef Sphere "Root" { double radius = 1; }')
    (tmp_path / "manifest.usda").write_text('#usda 1.0\nover "Root" { double radius; }')
    (tmp_path / "clip.usda").write_text('#usda 1.0\nover "Root" { double radius.timeSamples = { 0: 2, 9: 11 }; }')
    return tmp_path


def test_values_of_clips(clips_folder):
    stage = compose(Composition(clips_folder / "asset.usda")).stage
    assert UsdGeom.Sphere(stage.GetPrimAtPath("/Root")).GetRadiusAttr().Get(3.0) == 5.0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[@clip.usda@]", "[@gone.usda@]", "gone.usda is not there"),
        ("[@clip.usda@]", "[]", "names no file that is there"),
        ("@manifest.usda@", "@gone.usda@", "gone.usda is not there"),
        ("[@clip.usda@]", "[@bad.usda@]", "bad.usda cannot be read: USD cannot open it"),
        ('primPath = "/Root"', 'primPath = "/Other"', "clip.usda has no prim '/Other', which primPath names"),
        ("[(0, 0)]", "[(0, 1)]", "active names a clip that does not exist: there are 1, counted from 0"),
        ("(9, 9)", "(9, inf)", "active and times must be finite"),
        ("double2[] active = [(0, 0)]", 'string active = "a"', "active is not of type double2[]"),
    ],
)
def test_clips_that_usd_passes_over_are_faults_or_notes(clips_folder, old, new, message, capfd):
    (clips_folder / "bad.usda").write_text("#usda 1.0\ndef {")
    assert old in CLIPPED
    (clips_folder / "asset.usda").write_text(CLIPPED.replace(old, new))
    with pytest.raises(StageError) as caught:
        compose(Composition(clips_folder / "asset.usda"))
    assert any(fault.where == "/Root.clips[default]" and message in fault.what for fault in caught.value.faults)
    result = compose(Composition(clips_folder / "asset.usda", missing="warn"))
    assert any(message in note for note in result.notes)
    assert capfd.readouterr().err == ""


def _cut_crate(data):
    """Return a binary layer whose first section is longer than the file."""
    table = int.from_bytes(data[16:24], "little")
    return data[: table + 32] + (1 << 40).to_bytes(8, "little") + data[table + 40 :]


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("a.usdc", _cut_crate, "is damaged: a section of it is cut off"),
        ("a.usdc", lambda data: data[:40], "is damaged: a section of it is cut off"),
        ("a.usdz", lambda data: data[:64] + _cut_crate(data[64:]), "member a.usdc, which is damaged: a section"),
        ("a.usdz", lambda data: data[:-22], "is not a package that can be read: File is not a zip file"),
        ("a.usda", lambda data: data.replace(b"Ball", b"Ba\0l"), "holds a character 0, which no text has"),
        ("a.usda", lambda data: data.replace(b"Ball", b"B\xe4ll"), "holds text that is not UTF-8"),
    ],
)
def test_damaged_files_are_faults_and_do_not_reach_usd(tmp_path, name, change, message, capfd):
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString('#usda 1.0\ndef Sphere "Ball" {}')
    layer.Export(str(tmp_path / "a.usdc"))
    layer.Export(str(tmp_path / "a.usda"))
    UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(tmp_path / "a.usdc")), str(tmp_path / "a.usdz"))
    file = tmp_path / name
    assert compose(Composition(file)).stage.GetPrimAtPath("/Ball")
    copy = tmp_path / f"copy{file.suffix}"  # USD holds what it has opened
    copy.write_bytes(change(file.read_bytes()))
    with pytest.raises(StageError, match=message):
        compose(Composition(copy))
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("start", [b"#usda 1.0\n", b"#sdf 1.4.32\n"])
def test_a_huge_text_layer_is_a_fault_before_it_is_read(tmp_path, start):
    file = tmp_path / "huge.usda"
    file.write_bytes(start)
    os.truncate(file, DEFAULT_BYTES + 1)  # sparse
    message = f"has {DEFAULT_BYTES + 1} bytes; at most LOOKDEV_LAYER_BYTES = {DEFAULT_BYTES}"
    with pytest.raises(StageError, match=message):
        compose(Composition(file))


def test_text_in_a_package_is_bounded_as_a_file_is(tmp_path, monkeypatch):
    text = '#usda 1.0\ndef Sphere "Ball"\n{\n    string[] names = [' + '"a", ' * 500 + '"b"]\n}\n'
    (tmp_path / "a.usda").write_text(text)
    package = tmp_path / "a.usdz"
    UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(tmp_path / "a.usda")), str(package))
    monkeypatch.setenv("LOOKDEV_LAYER_BYTES", "1000")
    with pytest.raises(StageError, match=r"member a\.usda, which has \d{4} bytes; at most LOOKDEV_LAYER_BYTES = 1000"):
        compose(Composition(package))
    monkeypatch.setenv("LOOKDEV_LAYER_BYTES", "10000")
    assert compose(Composition(package)).stage.GetPrimAtPath("/Ball")
    (tmp_path / "deep.usdz").write_bytes(package.read_bytes().replace(b'"a", ' * 400, b"[" * 2000))
    with pytest.raises(StageError, match=r"member a\.usda, which is nested 2002 brackets deep"):
        compose(Composition(tmp_path / "deep.usdz"))
    monkeypatch.setenv("LOOKDEV_LAYER_BYTES", "1e9")
    with pytest.raises(OutputError, match=r"LOOKDEV_LAYER_BYTES is '1e9'; a number of bytes"):
        compose(Composition(package))
