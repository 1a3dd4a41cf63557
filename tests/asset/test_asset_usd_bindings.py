"""Which material each part is bound to: each rule of UsdShade, compared with what UsdShade itself computes."""

from __future__ import annotations

import pytest
from pxr import Sdf, Usd, UsdShade

from lookdev.asset import Slot

STRONGER = UsdShade.Tokens.strongerThanDescendants


def binder(file, path):
    return UsdShade.MaterialBindingAPI.Apply(file.stage.GetPrimAtPath(path))


def bind(file, path, material, strength=UsdShade.Tokens.weakerThanDescendants, purpose=UsdShade.Tokens.allPurpose):
    binder(file, path).Bind(file.material(f"/Looks/{material}"), strength, purpose)


def collect(file, path, name, material, includes, **options):
    """Bind a material on `path` to a collection of prims."""
    collection = Usd.CollectionAPI.Apply(file.stage.GetPrimAtPath(path), name)
    for each in includes:
        collection.IncludePath(each)
    binder(file, path).Bind(collection, file.material(f"/Looks/{material}"), name, **options)
    return collection


def check(file, **expected):
    """Assert the materials of the parts below /W, by name, and that UsdShade computes the same."""
    asset = file.read()
    found = {
        slot.path.removeprefix("/W/"): slot.material and slot.material.removeprefix("/Looks/") for slot in asset.slots
    }
    assert found == {name.replace("__", "/"): material for name, material in expected.items()}
    for slot in asset.slots:
        prim = file.stage.GetPrimAtPath(slot.path)
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(UsdShade.Tokens.full)
        assert slot.material == (str(material.GetPath()) if material else None)
    return asset


@pytest.fixture
def pair(file):
    """Two meshes, /W/A/Cube and /W/B/Cube."""
    for name in "AB":
        file.mesh(f"/W/{name}/Cube")
    return file


def test_nothing_is_bound(pair):
    check(pair, A__Cube=None, B__Cube=None)


def test_the_nearest_direct_binding_wins(pair):
    bind(pair, "/W", "Top")
    bind(pair, "/W/A/Cube", "Near")
    check(pair, A__Cube="Near", B__Cube="Top")


def test_a_binding_stronger_than_descendants_wins(pair):
    bind(pair, "/W", "Top", STRONGER)
    bind(pair, "/W/A", "Middle")
    bind(pair, "/W/A/Cube", "Near")
    check(pair, A__Cube="Top", B__Cube="Top")


def test_of_two_strong_bindings_the_upper_one_wins(pair):
    bind(pair, "/W", "Top", STRONGER)
    bind(pair, "/W/A", "Middle", STRONGER)
    check(pair, A__Cube="Top", B__Cube="Top")


def test_the_full_purpose_comes_before_all_purposes_even_from_above(pair):
    bind(pair, "/W", "Full", purpose=UsdShade.Tokens.full)
    bind(pair, "/W/A/Cube", "All")
    bind(pair, "/W/B/Cube", "Preview", purpose=UsdShade.Tokens.preview)
    check(pair, A__Cube="Full", B__Cube="Full")


def test_the_preview_purpose_is_not_that_of_renders(pair):
    bind(pair, "/W", "All")
    bind(pair, "/W/A/Cube", "Preview", purpose=UsdShade.Tokens.preview)
    check(pair, A__Cube="All", B__Cube="All")


def test_a_collection_binds_its_members(pair):
    collect(pair, "/W", "red", "Red", ["/W/B"])
    check(pair, A__Cube=None, B__Cube="Red")


def test_a_collection_can_exclude(pair):
    collect(pair, "/W", "red", "Red", ["/W"]).ExcludePath("/W/A")
    check(pair, A__Cube=None, B__Cube="Red")


def test_on_one_prim_a_collection_comes_before_a_direct_binding(pair):
    bind(pair, "/W", "Direct")
    collect(pair, "/W", "red", "Red", ["/W/B"])
    check(pair, A__Cube="Direct", B__Cube="Red")


@pytest.mark.parametrize("ordered", [False, True])
def test_of_collections_on_one_prim_the_first_property_wins(pair, ordered):
    collect(pair, "/W", "zebra", "Zebra", ["/W"])
    collect(pair, "/W", "apple", "Apple", ["/W/A"])
    if ordered:  # otherwise by name
        names = [f"material:binding:collection:{name}" for name in ("zebra", "apple")]
        pair.stage.GetPrimAtPath("/W").SetPropertyOrder(names)
    check(pair, A__Cube="Zebra" if ordered else "Apple", B__Cube="Zebra")


def test_a_nearer_direct_binding_comes_before_a_collection_above_unless_that_is_stronger(pair):
    bind(pair, "/W/A/Cube", "NearA")
    bind(pair, "/W/B/Cube", "NearB")
    collect(pair, "/W", "weak", "Weak", ["/W/A"])
    collect(pair, "/W", "strong", "Strong", ["/W/B"], bindingStrength=STRONGER)
    check(pair, A__Cube="NearA", B__Cube="Strong")


def test_a_collection_of_the_full_purpose_comes_before_direct_bindings_of_all(pair):
    bind(pair, "/W/A/Cube", "All")
    collect(pair, "/W", "red", "Red", ["/W/A"], materialPurpose=UsdShade.Tokens.full)
    check(pair, A__Cube="Red", B__Cube=None)


def test_a_subset_inherits_and_overrides(pair):
    bind(pair, "/W/A", "Whole")
    api = binder(pair, "/W/A/Cube")
    api.CreateMaterialBindSubset("lid", [5])
    api.CreateMaterialBindSubset("sides", [0, 1])
    bind(pair, "/W/A/Cube/lid", "Lid")
    check(pair, A__Cube="Whole", A__Cube__lid="Lid", A__Cube__sides="Whole", B__Cube=None)


def test_a_collection_binds_a_subset(pair):
    binder(pair, "/W/A/Cube").CreateMaterialBindSubset("lid", [5])
    collect(pair, "/W", "lids", "Red", ["/W/A/Cube/lid"])
    check(pair, A__Cube=None, A__Cube__lid="Red", B__Cube=None)


def test_a_mesh_whose_faces_are_all_in_subsets_has_no_slot_of_its_own(pair):
    api = binder(pair, "/W/A/Cube")
    api.CreateMaterialBindSubset("front", [0, 1, 2])
    api.CreateMaterialBindSubset("back", [3, 4, 5])
    bind(pair, "/W/A/Cube/back", "Back")
    check(pair, A__Cube__front=None, A__Cube__back="Back", B__Cube=None)


def test_instances_are_bound_from_outside_and_share_their_arrays(file):
    file.mesh("/Proto/Cube")
    binder(file, "/Proto/Cube").CreateMaterialBindSubset("lid", [5])
    file.stage.GetPrimAtPath("/Proto").SetSpecifier(Sdf.SpecifierClass)
    for name in "ABC":
        prim = file.stage.DefinePrim(f"/W/{name}", "Xform")
        prim.GetReferences().AddInternalReference("/Proto")
        prim.SetInstanceable(True)
    bind(file, "/W", "Red")
    collect(file, "/W", "lids", "Blue", ["/W/B/Cube/lid"])
    collect(file, "/W", "cubes", "Green", ["/W/C"])
    asset = check(
        file,
        A__Cube="Red",
        A__Cube__lid="Red",
        B__Cube="Red",
        B__Cube__lid="Blue",
        C__Cube="Green",
        C__Cube__lid="Green",
    )
    assert [(each.mesh, each.path) for each in asset.instances] == [
        (0, "/W/A/Cube"),
        (1, "/W/B/Cube"),
        (2, "/W/C/Cube"),
    ]
    first, *others = asset.meshes
    for other in others:
        assert all(getattr(other, name) is getattr(first, name) for name in ("points", "normals"))


@pytest.mark.parametrize("target", ["/Looks/Gone", "/W/A"])
def test_a_binding_to_no_material_hides_those_above_and_is_noted(pair, target):
    bind(pair, "/W", "Top")
    binder(pair, "/W/A").GetDirectBindingRel().SetTargets([target])
    binder(pair, "/W/B").GetDirectBindingRel().SetTargets([target])
    asset = check(pair, A__Cube=None, B__Cube=None)
    note = f"{pair.path}: material:binding names {target}, which is not a material (2): /W/A, /W/B"
    assert asset.notes == (note,)


def test_a_binding_beyond_a_reference_is_noted(file, tmp_path, capfd):
    (tmp_path / "part.usda").write_text(
        '#usda 1.0\n(\n    upAxis = "Z"\n)\ndef Material "Gold"\n{\n}\ndef Xform "Part"\n{\n    def Mesh "M" (\n'
        '        prepend apiSchemas = ["MaterialBindingAPI"]\n    )\n    {\n        rel material:binding = </Gold>\n'
        "        int[] faceVertexCounts = [3]\n        int[] faceVertexIndices = [0, 1, 2]\n"
        "        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n    }\n}\n"
    )
    file.stage.DefinePrim("/W").GetReferences().AddReference("./part.usda", "/Part")
    asset = file.read()
    assert asset.slots == (Slot("/W/M", None),)
    assert len(asset.notes) == 1
    assert "The relationship target </Gold>" in asset.notes[0]
    assert capfd.readouterr().err == ""
