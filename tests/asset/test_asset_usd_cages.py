"""Subdivision surfaces of a USD file: control cages with UsdGeom's rules."""

import numpy as np
import pytest
from usd_file import CUBE_POINTS, TYPES, primvar

from lookdev.asset.mesh import Subdivision
from lookdev.errors import AssetError


def rules(file) -> Subdivision:
    (mesh,) = file.read().meshes
    return mesh.subdivision


def test_a_mesh_is_a_catmull_clark_cage_by_default(file):
    file.mesh("/Cube").GetNormalsAttr().Set([(0, 0, 1)] * 3)  # authored ones are ignored, whatever their number
    (mesh,) = file.read().meshes
    cage = mesh.subdivision
    assert (cage.scheme, cage.interpolate_boundary) == ("catmullClark", "edgeAndCorner")
    assert (cage.face_varying, cage.triangle_rule) == ("cornersPlus1", "catmullClark")
    assert [len(tags) for tags in (cage.crease_edges, cage.corner_points, cage.holes)] == [0, 0, 0]
    # Its normals are the smooth ones of the polygons.
    np.testing.assert_allclose(mesh.normals, mesh.points[mesh.corner_points] / np.sqrt(3), atol=1e-6)


@pytest.mark.parametrize(
    ("attribute", "value", "field"),
    [
        ("subdivisionScheme", "bilinear", "scheme"),
        ("interpolateBoundary", "edgeOnly", "interpolate_boundary"),
        ("faceVaryingLinearInterpolation", "all", "face_varying"),
        ("triangleSubdivisionRule", "smooth", "triangle_rule"),
    ],
)
def test_the_rules_are_those_of_the_file(file, attribute, value, field):
    mesh = file.mesh("/Cube")
    mesh.GetPrim().GetAttribute(attribute).Set(value)
    assert getattr(rules(file), field) == value
    mesh.GetPrim().GetAttribute(attribute).Set("smoth")
    with pytest.raises(AssetError, match=rf"thing\.usda: /Cube: {attribute} is 'smoth' \((did you mean|known)"):
        file.read()


def test_no_scheme_is_no_cage(file):
    file.mesh("/Cube").GetSubdivisionSchemeAttr().Set("none")
    assert file.read().meshes[0].subdivision is None


@pytest.mark.parametrize(
    ("sharpness", "expected"),
    [([3.0, 20.0], [3.0, 3.0, 10.0]), ([1.0, 2.0, np.inf], [1.0, 2.0, 10.0])],
    ids=["by crease", "by edge"],
)
def test_creases_are_chains_of_points_with_a_sharpness_each_or_for_each_edge(file, sharpness, expected):
    mesh = file.mesh("/Cube")
    mesh.GetCreaseIndicesAttr().Set([0, 1, 3, 4, 5])
    mesh.GetCreaseLengthsAttr().Set([3, 2])
    mesh.GetCreaseSharpnessesAttr().Set(sharpness)
    cage = rules(file)
    np.testing.assert_array_equal(cage.crease_edges, [[0, 1], [1, 3], [4, 5]])
    np.testing.assert_array_equal(cage.crease_sharpness, expected)


def test_corners_and_what_is_not_sharp(file):
    mesh = file.mesh("/Cube")
    mesh.GetCornerIndicesAttr().Set([7, 2, 1])
    mesh.GetCornerSharpnessesAttr().Set([2.5, 0.0, -1.0])
    cage = rules(file)
    np.testing.assert_array_equal(cage.corner_points, [7])
    np.testing.assert_array_equal(cage.corner_sharpness, [2.5])


def test_holes_stay_in_the_cage_and_all_numbers_follow_what_is_left_out(file):
    # Point 0 and face 0, which has a point twice, are left out; the first square is a hole.
    points = [(9, 9, 9), (0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0)]
    mesh = file.mesh("/Mesh", points, [1, 2, 1, 1, 2, 5, 4, 2, 3, 6, 5], [3, 4, 4])
    mesh.GetHoleIndicesAttr().Set([1])
    mesh.GetCreaseIndicesAttr().Set([2, 5, 0, 1])
    mesh.GetCreaseLengthsAttr().Set([2, 2])
    mesh.GetCreaseSharpnessesAttr().Set([4.0, 5.0])
    mesh.GetCornerIndicesAttr().Set([0, 6])
    mesh.GetCornerSharpnessesAttr().Set([1.0, 2.0])
    primvar(mesh, "face", TYPES.FloatArray, "uniform", [0.0, 1.0, 2.0])
    (got,) = file.read().meshes
    np.testing.assert_array_equal(got.corner_points, [0, 1, 4, 3, 1, 2, 5, 4])
    cage = got.subdivision
    np.testing.assert_array_equal(cage.holes, [0])
    np.testing.assert_array_equal(np.column_stack([cage.crease_edges, cage.crease_sharpness]), [[1, 4, 4.0]])
    np.testing.assert_array_equal(np.column_stack([cage.corner_points, cage.corner_sharpness]), [[5, 2.0]])
    np.testing.assert_array_equal(got.primvars["face"], [1, 1, 1, 1, 2, 2, 2, 2])
    (polygons,) = file.load().meshes
    np.testing.assert_array_equal(polygons.primvars["face"], [2, 2, 2, 2])


def test_a_cage_of_holes_alone_is_left_out(file):
    file.mesh("/Cube").GetHoleIndicesAttr().Set(list(range(6)))
    file.mesh("/Seen")
    asset = file.read()
    assert [mesh.name for mesh in asset.meshes] == ["/Seen"]
    assert asset.notes == (f"{file.path}: without a face, left out (1): /Cube",)


def test_the_interpolation_of_each_primvar_is_kept(file):
    file.stage.DefinePrim("/World", "Xform")
    primvar(file.stage.GetPrimAtPath("/World"), "above", TYPES.FloatArray, "constant", [2.0])
    mesh = file.mesh("/World/Cube")
    kinds = {"constant": 1, "uniform": 6, "varying": 8, "vertex": 8, "faceVarying": 24}
    for kind, count in kinds.items():
        primvar(mesh, f"p_{kind}", TYPES.FloatArray, kind, [0.0] * count)
    primvar(mesh, "st", TYPES.TexCoord2fArray, "faceVarying", [(0, 0)] * 24)
    expected = {f"p_{kind}": kind for kind in kinds} | {"st": "faceVarying", "above": "constant"}
    assert rules(file).interpolation == expected


def test_loop_of_other_faces_than_triangles_is_refined_as_catmull_clark(file):
    file.mesh("/Quads").GetSubdivisionSchemeAttr().Set("loop")
    tetra = file.mesh("/Tetra", CUBE_POINTS[:4], [0, 1, 2, 0, 2, 3, 0, 3, 1, 1, 3, 2], [3] * 4)
    tetra.GetSubdivisionSchemeAttr().Set("loop")
    asset = file.read()
    assert {mesh.name: mesh.subdivision.scheme for mesh in asset.meshes} == {"/Quads": "catmullClark", "/Tetra": "loop"}
    (note,) = asset.notes
    assert note.endswith("of scheme loop, but with other faces than triangles, refined as catmullClark (1): /Quads")


def crease(indices, lengths, sharpness=(1.0,)):
    return {"creaseIndices": indices, "creaseLengths": lengths, "creaseSharpnesses": list(sharpness)}


def corner(indices, *sharpness):
    return {"cornerIndices": indices, "cornerSharpnesses": list(sharpness)}


@pytest.mark.parametrize(
    ("tags", "message"),
    [
        (crease([0, 8], [2]), r"creaseIndices\[1\] is 8, but there are 8 points"),
        (crease([0, -1], [2]), r"creaseIndices\[1\] is -1"),
        (crease([0, 1, 2], [2]), "creaseLengths add up to 2 points, creaseIndices has 3"),
        (crease([0, 1, 2], [2, 1]), r"creaseLengths\[1\] is 1; a crease has at least 2"),
        (crease([0, 1], [2, 0]), r"creaseLengths\[1\] is 0"),
        (crease([0, 1], [2], []), "creaseSharpnesses has 0 values"),
        (crease([0, 1, 3, 2], [4], [1, 2]), "Sharpnesses has 2 values; one for each of the 1 creases or of the 3"),
        (crease([0, 1], [2], [np.nan]), r"creaseSharpnesses\[0\] is not a number"),
        (corner([8], 1.0), r"cornerIndices\[0\] is 8"),
        (corner([1, 2], 1.0), "cornerSharpnesses has 1 values, cornerIndices 2"),
        (corner([1], np.nan), r"cornerSharpnesses\[0\] is not a number"),
        ({"holeIndices": [1, 6]}, r"holeIndices\[1\] is 6, but there are 6 faces"),
    ],
)
def test_malformed_tags_are_faults_of_their_attribute(file, tags, message):
    mesh = file.mesh("/World/Cube")
    for name, value in tags.items():
        mesh.GetPrim().GetAttribute(name).Set(value)
    with pytest.raises(AssetError, match=r"thing\.usda: /World/Cube: .*" + message):
        file.read()
