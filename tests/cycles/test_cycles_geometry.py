"""The data of Blender that show an asset: the attributes of meshes, and the transforms of instances."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from warm_blender import BlenderProcess

from lookdev.asset import Asset, Instance, Slot, make_asset
from lookdev.asset.builtin import make_sphere
from lookdev.codegen.source import HANDEDNESS, TANGENT, AttributeBinding, ShaderSource

# Blender is started, but nothing is rendered.
pytestmark = [pytest.mark.cycles, pytest.mark.both_pythons]

BALL = make_sphere(8, 4).meshes[0]
CORNERS, FACES = len(BALL.corner_points), len(BALL.face_sizes)
WEAR = BALL.uvs["st"][:, 0].copy()


def source(name: str, *attributes: AttributeBinding) -> ShaderSource:
    return ShaderSource(name, "", (), attributes, name)


PLAIN = source("plain")
WEATHERED = source("worn", AttributeBinding("u", "st", "uv"), AttributeBinding("w", "wear", "float", (0.25,)))
TINTED = source(
    "tinted", AttributeBinding("w", "wear", "float", (0.75,)), AttributeBinding("t", "tint", "color", (0.1, 0.2, 0.3))
)
LEANING = source("leaning", AttributeBinding("h", HANDEDNESS, "float"), AttributeBinding("t", TANGENT, "vector"))
SOURCES = (PLAIN, WEATHERED, TINTED, LEANING)
# Names that Blender cuts, or that mean something else in it; and one of both a UV set and a primvar.
ODD_UVS, ODD_PRIMVARS = ("u" * 63, "position", "st"), ("w" * 60, "w" * 68, "größe", "material_index", "lookdev_normal")
ODD = source(
    "odd",
    *(AttributeBinding(f"u{i}", name, "uv") for i, name in enumerate(ODD_UVS)),
    *(AttributeBinding(f"w{i}", name, "float", (0.0,)) for i, name in enumerate((*ODD_PRIMVARS, "st"))),
)


def moved(x: float, shear: float = 0.0) -> np.ndarray:
    matrix = np.eye(4)
    matrix[0, 1], matrix[:3, 3] = shear, (x, 0.5, -0.25)
    return matrix


def balls() -> Asset:
    """Return five balls: the second has two slots, the last has a primvar of its own and two UV sets."""
    halves = (np.arange(FACES) >= FACES // 2).astype(np.int32)
    slots = [np.zeros(FACES, np.int32), 1 + halves, *(np.full(FACES, slot, np.int32) for slot in (3, 4, 5))]
    meshes = [replace(BALL, name=f"/{i}", face_slots=face_slots) for i, face_slots in enumerate(slots)]
    meshes[4] = replace(meshes[4], primvars={"wear": WEAR}, uvs=BALL.uvs | {"more": BALL.uvs["st"]})
    instances = [Instance(i, moved(3.0 * i)) for i in range(5)]
    return make_asset("balls", meshes, instances, [Slot(f"/{slot}") for slot in range(6)])


def oddly_named() -> Asset:
    uvs = {name: BALL.uvs["st"] + np.float32(i) for i, name in enumerate(ODD_UVS)}
    primvars = {name: WEAR + np.float32(i) for i, name in enumerate(ODD_PRIMVARS)}
    mesh = replace(BALL, name="/odd", uvs=uvs, primvars=primvars)
    return make_asset("odd", [mesh], [Instance(0, np.eye(4))], [Slot("/a")])


SHARED = {
    "FACE": np.repeat(np.arange(FACES, dtype=np.float32), BALL.face_sizes),
    "POINT": BALL.corner_points.astype(np.float32),
    "CORNER": np.arange(CORNERS, dtype=np.float32),
}
"""A primvar that changes from face to face, from point to point, from corner to corner."""


def sharing() -> Asset:
    meshes = [replace(BALL, name=f"/{name}", primvars={"wear": values}) for name, values in SHARED.items()]
    return make_asset("shared", meshes, [Instance(i, moved(3.0 * i)) for i in range(3)], [Slot("/a")])


def crowd(count: int = 3) -> Asset:
    """Return two meshes, each shown several times, and one that is shown once."""
    meshes = [replace(BALL, name=name) for name in ("/a", "/b", "/c")]
    instances = [Instance(i % 2, moved(3.0 * i, 0.1 * i)) for i in range(2 * count)]
    return make_asset("crowd", meshes, [*instances, Instance(2, moved(-5.0))], [Slot("/a")])


@pytest.fixture(scope="module")
def built(blender: BlenderProcess) -> dict[str, Any]:
    cases = {
        "balls": (balls(), SOURCES, (0, 1, 2, 3, 2, 1), {}),
        "covered": (balls(), SOURCES, (0,) * 6, {"add_uv": True}),
        "apart": (balls(), SOURCES, (0,) * 6, {"separate": True}),
        "shared": (sharing(), SOURCES, (1,), {}),
        "odd": (oddly_named(), (ODD,), (0,), {}),
        "crowd": (crowd(), SOURCES, (0,), {}),
        "crowd apart": (crowd(), SOURCES, (0,), {"separate": True}),
        "crowd of many": (crowd(1000), SOURCES, (0,), {}),
    }
    answers: dict[str, Any] = blender.call("probes.build_assets", cases)
    return answers


def test_a_mesh_has_the_materials_of_its_own_faces(built: dict[str, Any]) -> None:
    meshes = built["balls"]["meshes"]
    expected = [["plain"], ["worn", "tinted"], ["leaning"], ["tinted"], ["worn"]]
    assert [meshes[f"/{i}"]["materials"] for i in range(5)] == expected
    np.testing.assert_array_equal(meshes["/1"]["material_index"], np.arange(FACES) >= FACES // 2)
    assert all(meshes[f"/{i}"]["material_index"] is None for i in (0, 2, 3, 4))


def test_a_mesh_carries_what_its_sources_read(built: dict[str, Any]) -> None:
    meshes = built["balls"]["meshes"]
    assert [set(meshes[f"/{i}"]["attributes"]) - {"lookdev_normal"} for i in range(5)] == [
        set(),
        {"st", "primvars:wear", "primvars:tint"},
        {HANDEDNESS, TANGENT},
        {"primvars:wear", "primvars:tint"},
        {"st", "primvars:wear"},
    ]
    for mesh in meshes.values():
        np.testing.assert_array_equal(mesh["attributes"]["lookdev_normal"], BALL.normals)
    np.testing.assert_array_equal(meshes["/4"]["attributes"]["primvars:wear"][:, 0], WEAR)
    np.testing.assert_array_equal(meshes["/4"]["attributes"]["st"], BALL.uvs["st"])
    np.testing.assert_array_equal(meshes["/2"]["attributes"][HANDEDNESS], 1.0)
    np.testing.assert_array_equal(meshes["/2"]["attributes"][TANGENT], BALL.tangents)


def test_names_of_attributes_are_neither_cut_nor_mixed_up(built: dict[str, Any]) -> None:
    mesh_attributes = built["odd"]["meshes"]["/odd"]["attributes"]
    np.testing.assert_array_equal(mesh_attributes["lookdev_normal"], BALL.normals)
    stored = {(binding.kind, binding.attribute): mesh_attributes[binding.mesh_name] for binding in ODD.attributes}
    for i, name in enumerate(ODD_UVS):
        np.testing.assert_array_equal(stored["uv", name], BALL.uvs["st"] + np.float32(i))
    for i, name in enumerate(ODD_PRIMVARS):
        np.testing.assert_array_equal(stored["float", name][:, 0], WEAR + np.float32(i))
    assert not stored["float", "st"].any()


def test_what_a_mesh_lacks_has_the_fallback_of_each_faces_source(built: dict[str, Any]) -> None:
    mesh_attributes = built["balls"]["meshes"]["/1"]["attributes"]
    second = np.repeat(np.arange(FACES) >= FACES // 2, BALL.face_sizes)
    np.testing.assert_array_equal(
        mesh_attributes["primvars:wear"][:, 0], np.where(second, 0.75, 0.25).astype(np.float32)
    )
    np.testing.assert_allclose(mesh_attributes["primvars:tint"][second], [[0.1, 0.2, 0.3]] * second.sum())


@pytest.mark.parametrize("domain", ["FACE", "POINT", "CORNER"])
def test_what_corners_share_is_written_once(built: dict[str, Any], domain: str) -> None:
    mesh = built["shared"]["meshes"][f"/{domain}"]
    assert mesh["domains"]["primvars:wear"] == domain
    np.testing.assert_array_equal(mesh["attributes"]["primvars:wear"][:, 0], SHARED[domain])


def test_users_of_blender_find_edges_and_all_uv_sets(built: dict[str, Any]) -> None:
    meshes = built["apart"]["meshes"]
    assert all(mesh["edges"] > FACES for mesh in meshes.values())
    assert [meshes[f"/{i}"]["uvs"] for i in (0, 4)] == [["st"], ["st", "more"]]


def test_a_pass_of_coordinates_finds_a_uv_set(built: dict[str, Any]) -> None:
    assert all(len(mesh["uvs"]) == 1 for mesh in built["covered"]["meshes"].values())


@pytest.mark.parametrize(
    ("case", "count", "objects"), [("crowd", 3, 2), ("crowd apart", 3, 7), ("crowd of many", 1000, 2)]
)
def test_every_instance_stands_in_its_place(built: dict[str, Any], case: str, count: int, objects: int) -> None:
    asset = crowd(count)
    assert built[case]["objects"] == objects
    # Instances of nodes have their object's colour: one assignment controls all of them.
    expected = sorted((asset.meshes[instance.mesh].name, instance.matrix.tolist()) for instance in asset.instances)
    visible = sorted((name, matrix.tolist()) for name, matrix, _ in built[case]["seen"])
    assert [name for name, _ in visible] == [name for name, _ in expected]
    np.testing.assert_allclose([matrix for _, matrix in visible], [matrix for _, matrix in expected], rtol=1e-6)


def test_instances_have_the_colour_of_their_object(built: dict[str, Any]) -> None:
    assert {(name, color) for name, _, color in built["crowd"]["seen"]} == {
        ("/c", (0.25, 0.5, 0.75, 0.0)),
        ("/a", (0.25, 0.5, 0.75, 1.0)),
        ("/b", (0.25, 0.5, 0.75, 1.0)),
    }
