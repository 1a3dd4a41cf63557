"""Which material each part is bound to: each rule of UsdShade, compared with what UsdShade itself computes."""

import pytest
from pxr import Usd, UsdShade

from lookdev.asset import Slot

pytestmark = pytest.mark.both_pythons
STRONGER, WEAKER = UsdShade.Tokens.strongerThanDescendants, UsdShade.Tokens.weakerThanDescendants
ALL, FULL, PREVIEW = UsdShade.Tokens.allPurpose, UsdShade.Tokens.full, UsdShade.Tokens.preview


def binder(file, path):
    return UsdShade.MaterialBindingAPI.Apply(file.stage.GetPrimAtPath(path))


def bind(path, material, strength=WEAKER, purpose=ALL):
    """Return a function that binds a material to a prim of a file."""
    return lambda file: binder(file, path).Bind(file.material(f"/Looks/{material}"), strength, purpose)


def collect(path, name, material, includes, excludes=(), strength=WEAKER, purpose=ALL):
    """Return a function that binds a material on `path` to a collection of prims."""

    def apply(file):
        collection = Usd.CollectionAPI.Apply(file.stage.GetPrimAtPath(path), name)
        collection.IncludePath(includes)
        for excluded in excludes:
            collection.ExcludePath(excluded)
        binder(file, path).Bind(collection, file.material(f"/Looks/{material}"), name, strength, purpose)

    return apply


def subsets(**faces):
    """Return a function that makes subsets of /W/A/Cube."""
    return lambda file: [binder(file, "/W/A/Cube").CreateMaterialBindSubset(*subset) for subset in faces.items()]


def order(*names):
    properties = [f"material:binding:collection:{name}" for name in names]
    return lambda file: file.stage.GetPrimAtPath("/W").SetPropertyOrder(properties)


def check(file, expected):
    """Assert the materials of the parts below /W, by their paths, and that UsdShade computes the same."""
    asset = file.read()
    for slot in asset.slots:
        material, _ = UsdShade.MaterialBindingAPI(file.stage.GetPrimAtPath(slot.path)).ComputeBoundMaterial(FULL)
        assert slot.material == (str(material.GetPath()) if material else None)
    bound = {slot.path.removeprefix("/W/"): slot.material for slot in asset.slots}
    assert bound == {path: material and f"/Looks/{material}" for path, material in expected.items()}
    return asset


@pytest.fixture
def pair(file):
    """Two meshes, /W/A/Cube and /W/B/Cube."""
    for name in "AB":
        file.mesh(f"/W/{name}/Cube")
    return file


TOP, STRONG_TOP = bind("/W", "Top"), bind("/W", "Top", STRONGER)
MIDDLE, NEAR, OTHER = bind("/W/A", "Middle"), bind("/W/A/Cube", "Near"), bind("/W/B/Cube", "Other")
PREVIEWED, FULL_TOP = bind("/W/A/Cube", "Preview", purpose=PREVIEW), bind("/W", "Full", purpose=FULL)
RED = collect("/W", "red", "Red", "/W/B")
ZEBRA, APPLE = collect("/W", "zebra", "Zebra", "/W"), collect("/W", "apple", "Apple", "/W/A")
STRONG = collect("/W", "strong", "Strong", "/W/B", strength=STRONGER)
FULL_RED = collect("/W", "red", "Red", "/W/A", purpose=FULL)
LID, LID_BOUND = subsets(lid=[5]), bind("/W/A/Cube/lid", "Lid")
# What is bound, and the materials of the parts, Near of /W/A/Cube and so on.
RULES = {
    "nothing": ([], None, None),
    "the nearest direct binding": ([TOP, NEAR], "Near", "Top"),
    "a binding stronger than descendants": ([STRONG_TOP, MIDDLE, NEAR], "Top", "Top"),
    "the upper one of two strong bindings": ([STRONG_TOP, bind("/W/A", "Middle", STRONGER)], "Top", "Top"),
    "the full purpose, even from above": ([FULL_TOP, NEAR, bind("/W/B/Cube", "P", purpose=PREVIEW)], "Full", "Full"),
    "not the preview purpose": ([TOP, PREVIEWED], "Top", "Top"),
    "a collection of its members": ([RED], None, "Red"),
    "a collection without what it excludes": ([collect("/W", "red", "Red", "/W", ["/W/A"])], None, "Red"),
    "a collection before a direct binding on one prim": ([TOP, RED], "Top", "Red"),
    "the first by name of collections on one prim": ([ZEBRA, APPLE], "Apple", "Zebra"),
    "the first in order of collections on one prim": ([ZEBRA, APPLE, order("zebra", "apple")], "Zebra", "Zebra"),
    "a nearer direct binding before a collection above": ([NEAR, OTHER, RED, APPLE], "Near", "Other"),
    "a stronger collection above before a nearer direct binding": ([NEAR, OTHER, STRONG], "Near", "Strong"),
    "a collection of the full purpose before direct bindings of all": ([NEAR, FULL_RED], "Red", None),
}


@pytest.mark.parametrize(("bindings", "a", "b"), RULES.values(), ids=RULES)
def test_which_binding_wins(pair, bindings, a, b):
    for apply in bindings:
        apply(pair)
    check(pair, {"A/Cube": a, "B/Cube": b})


@pytest.mark.parametrize(
    ("bindings", "whole", "parts"),
    [
        ([MIDDLE, subsets(lid=[5], sides=[0]), LID_BOUND], "Middle", {"lid": "Lid", "sides": "Middle"}),
        ([LID, collect("/W", "lids", "Red", "/W/A/Cube/lid")], None, {"lid": "Red"}),
        # A mesh whose faces are all in subsets has no slot of its own.
        ([subsets(lid=[0, 1, 2], rest=[3, 4, 5]), LID_BOUND], "", {"lid": "Lid", "rest": None}),
    ],
)
def test_subsets_inherit_and_override(pair, bindings, whole, parts):
    for apply in bindings:
        apply(pair)
    mesh = {} if whole == "" else {"A/Cube": whole}
    check(pair, {**mesh, **{f"A/Cube/{name}": part for name, part in parts.items()}, "B/Cube": None})


def test_instances_are_bound_from_outside_and_share_their_arrays(file):
    file.mesh("/Proto/Cube")
    binder(file, "/Proto/Cube").CreateMaterialBindSubset("lid", [5])
    file.instances("/Proto", *(f"/W/{name}" for name in "ABCD"))
    for apply in (bind("/W", "Red"), collect("/W", "a", "Blue", "/W/B/Cube/lid"), collect("/W", "b", "Green", "/W/C")):
        apply(file)
    wholes, lids = {"A": "Red", "B": "Red", "C": "Green"}, {"A": "Red", "B": "Blue", "C": "Green"}
    bound = [{f"{name}/Cube": whole, f"{name}/Cube/lid": lids[name]} for name, whole in wholes.items()]
    asset = check(file, bound[0] | bound[1] | bound[2])
    instances = [(instance.mesh, instance.path) for instance in asset.instances]
    assert instances == [(number, f"/W/{name}/Cube") for number, name in zip((0, 1, 2, 0), "ABCD", strict=True)]
    first, *others = asset.meshes
    for other in others:
        assert all(getattr(other, name) is getattr(first, name) for name in ("points", "normals"))


@pytest.mark.parametrize("target", ["/Looks/Gone", "/W/A"])
def test_a_binding_to_no_material_hides_those_above_and_is_noted(pair, target):
    bind("/W", "Top")(pair)
    for path in ("/W/A", "/W/B"):
        binder(pair, path).GetDirectBindingRel().SetTargets([target])
    asset = check(pair, {"A/Cube": None, "B/Cube": None})
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
