"""Triangle meshes against the exact shapes, against furnaces, and each rule by itself."""

from dataclasses import replace

import numpy as np
import pytest
from shapes import CAMERA, INSIDE, POSE, SIZE, Plane, Sphere

from lookdev.asset import Instance, Mesh, Slot, load_asset
from lookdev.asset.builtin import make_sphere
from lookdev.asset.store import make_asset
from lookdev.asset.tangents import tangents_of
from lookdev.asset.triangles import corner_triangles, triangulate
from lookdev.brdf import MODELS, complete_parameters
from lookdev.errors import AssetError
from lookdev.light import load_environment, prepare_light
from lookdev.material import Layer, Look, Primvar
from lookdev.reference.mesh import MeshPoints, MeshScene
from lookdev.reference.render import frame_pixels
from lookdev.scene import Camera, Pose, camera_rays

GREY = Look("grey", (Layer("Grey", "disney", {"roughness": 1.0}),))
# Roughness 1 leaves the diffuse lobes only, and back 0.5 sends half of what is scattered to the other side.
LEAF = Look("leaf", (Layer("Leaf", "pixar", {"surfaceColor": (1.0,) * 3, "roughness": 1.0, "back": 0.5}),))


@pytest.fixture(scope="module")
def lights():
    return {name: prepare_light(load_environment(builtin=name), sampled=False) for name in ("white", "forest")}


def polygons(points, faces):
    """Return a mesh of flat polygons, one a slot, whose u runs along x and v along y."""
    points, corners = np.array(points, np.float32), np.concatenate(faces).astype(np.int32)
    sizes = np.array([len(face) for face in faces], np.int32)
    edges = [points[face[1:3]] - points[face[0]] for face in faces]
    normals = np.repeat([np.cross(*edge) / np.linalg.norm(np.cross(*edge)) for edge in edges], sizes, axis=0)
    tangents = np.repeat([edge[0] / np.linalg.norm(edge[0]) for edge in edges], sizes, axis=0)
    slots, frames = np.arange(len(faces), dtype=np.int32), (np.float32(normals), np.float32(tangents))
    return Mesh("/mesh", points, corners, sizes, slots, *frames, {"st": points[corners][:, :2]})


def box_mesh():
    points = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij"), axis=-1).reshape(-1, 3)
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return polygons(points, [np.array(face) for face in faces])


def scene_of(mesh, looks, matrix=None, **options):
    instance = Instance(0, np.eye(4) if matrix is None else matrix)
    return MeshScene(make_asset("thing", [mesh], [instance], [Slot("/thing")] * len(looks)), looks, **options)


def box_scene(matrix=None, mesh=None, looks=(GREY,) * 6):
    return scene_of(mesh or box_mesh(), looks, matrix)


def trace_hits(scene, count, rng):
    """Return hits of random rays from near the middle of a scene, and the directions back."""
    ray = rng.normal(size=(count, 3))
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    is_hit, hits = scene.intersect(scene._asset.center + 0.02 * scene._asset.radius * rng.normal(size=3), ray)
    assert is_hit.all()
    return hits, -ray


# Polygons in the plane z = 0, counter-clockwise: a fan serves, a dart from its tip, a dart from its side, an L, a star.
POLYGONS = {
    "square": [(0, 0), (1, 0), (1, 1), (0, 1)],
    "dart": [(0, 0), (2, 1), (0, 2), (0.5, 1)],
    "turned dart": [(0.5, 1), (0, 0), (2, 1), (0, 2)],
    "other dart": [(2, 1), (0, 2), (0.5, 1), (0, 0)],
    "hexagon": [(np.cos(a), np.sin(a)) for a in np.arange(6) * np.pi / 3],
    "L": [(1, 2), (0, 2), (0, 0), (2, 0), (2, 1), (1, 1)],
    "star": [(np.cos(a) * r, np.sin(a) * r) for a, r in zip(np.arange(10) * np.pi / 5, [1.0, 0.3] * 5, strict=True)],
}


@pytest.mark.parametrize("name", POLYGONS)
@pytest.mark.parametrize("turned", [False, True])
def test_triangles_fill_their_polygon(name, turned):
    flat = np.array(POLYGONS[name], float)
    x, y = flat.T
    area = 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))
    points = np.stack([x, y, 0 * x] if not turned else [0 * x, y, x], axis=-1)
    mesh = polygons(points, [np.arange(len(flat))])
    triangles, faces = corner_triangles(mesh)
    corners = mesh.points[triangles].astype(float)
    vectors = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sign = vectors @ (np.array([0, 0, 1.0]) if not turned else np.array([-1.0, 0, 0]))
    assert len(triangles) == len(flat) - 2
    assert (faces == 0).all()
    # No triangle is turned over, and together they have the area: so none lies outside, and none over another.
    assert (sign >= 0.0).all()
    assert sign.sum() == pytest.approx(area, rel=1e-6)


def test_a_mesh_of_triangles_is_the_same_surface():
    whole = replace(box_mesh(), primvars={"wear": np.arange(24, dtype=np.float32)})
    split = triangulate(whole)
    triangles, faces = corner_triangles(whole)
    assert (split.face_sizes == 3).all()
    assert (split.face_slots == whole.face_slots[faces]).all()
    for name in ("corner_points", "normals", "tangents"):
        assert (getattr(split, name).reshape(12, 3, -1) == getattr(whole, name)[triangles].reshape(12, 3, -1)).all()
    assert (split.uvs["st"].reshape(12, 3, 2) == whole.uvs["st"][triangles]).all()
    assert (split.primvars["wear"].reshape(12, 3) == triangles).all()


def test_rays_pass_the_groups_that_a_light_spares():
    """Three squares above each other, each a slot and a group of its own: from the floor up, past the second."""
    faces = [np.arange(4) + 4 * i for i in range(3)]
    points = [(x, y, z) for z in (0, 1, 2) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    scene = scene_of(polygons(points, faces), [GREY] * 3, groups=(0, 1, 2))
    up = np.array([[0.0, 0.0, 1.0]])
    _, floor = scene.intersect(np.array([0.2, 0.3, 0.5]), -up)
    for excluded, height in {(): 1.0, (1,): 2.0, (2,): 1.0, (1, 2): None}.items():
        is_hit, hits = scene.trace_onward(floor, up, excluded)
        assert is_hit[0] == (height is not None)
        if height:
            np.testing.assert_allclose(scene.points(hits), [[0.2, 0.3, height]], atol=1e-7)
    # From a square that is spared itself.
    _, second = scene.intersect(np.array([0.2, 0.3, 1.5]), -up)
    assert scene.trace_onward(second, -up, (1,))[0].all()
    assert not scene.trace_onward(second, -up, (0, 1))[0].any()


def test_a_square_is_split_from_its_first_corner_and_a_dart_from_its_dent():
    square, dart = (polygons([(x, y, 0) for x, y in POLYGONS[name]], [np.arange(4)]) for name in ("square", "dart"))
    assert corner_triangles(square)[0].tolist() == [[0, 1, 2], [0, 2, 3]]
    assert corner_triangles(dart)[0].tolist() == [[0, 1, 3], [1, 2, 3]]


@pytest.mark.parametrize(("name", "shape"), [("plane", Plane()), ("sphere", Sphere((1.0, -2.0, 0.5), 0.7))])
def test_rays_meet_a_mesh_where_they_meet_its_shape(name, shape):
    (mesh,) = load_asset(builtin=name).meshes
    matrix = np.eye(4)
    if name == "sphere":
        matrix[:3, :3], matrix[:3, 3] = 0.7 * np.eye(3), shape.center
    scene, rng = scene_of(mesh, [GREY], matrix), np.random.default_rng(11)
    middle = matrix[:3, 3]
    for origin in middle + np.array([[0.7, -4.0, 1.0], [0.7, 4.0, 1.0]]):  # from either side of the card
        ray = middle + rng.uniform(-1.5, 1.5, (500, 3)) * (1.0, name == "sphere", 1.0) - origin
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
        (is_hit, hits), (expected, points) = scene.intersect(origin, ray), shape.intersect(origin, ray)
        assert 50 < expected.sum() < 450
        # 256 rings lack 4e-5 of the radius.
        nearest = np.linalg.norm(np.cross(middle - origin, ray), axis=-1)
        np.testing.assert_array_equal(
            is_hit, expected & (nearest < 0.7 * (1.0 - 4e-5)) if name == "sphere" else expected
        )
        hits, points, ray = hits[is_hit], points[is_hit], ray[is_hit]
        tolerance = 0.01 if name == "sphere" else 1e-6  # the most at the rim, which rays graze
        np.testing.assert_allclose(scene.points(hits), points, atol=tolerance)
        frames, _ = shape.frame(points, -ray)
        np.testing.assert_allclose(scene.frame(hits, -ray)[0], frames, atol=3.0 * tolerance)
        (is_hit_again, far_hits), (expected, far_points) = (
            scene.trace_onward(hits, ray),
            shape.trace_onward(points, ray),
        )
        np.testing.assert_array_equal(is_hit_again, expected)
        np.testing.assert_allclose(scene.points(far_hits[is_hit_again]), far_points[is_hit_again], atol=2.0 * tolerance)
        assert not shape.intersect(origin, -ray)[0].any()
        assert not shape.trace_onward(far_points[is_hit_again], ray[is_hit_again])[0].any()


@pytest.mark.parametrize(("name", "shape"), [("plane", Plane()), ("sphere", Sphere())])
@pytest.mark.parametrize("model", ["disney", "pixar"])
def test_a_mesh_is_the_shape_that_it_stands_for(name, shape, model, lights):
    layers = {
        "disney": {"metallic": 1.0, "roughness": 0.4, "anisotropic": 0.8},
        "pixar": {"roughness": 0.6, "back": 0.4, "clear": 0.3, "presence": 0.7, "highlightNormal": (0.2, 0.1, 0.9)},
    }
    asset = make_sphere(128, 64) if name == "sphere" else load_asset(builtin=name)
    look = Look("look", (Layer("Layer", model, layers[model]),))
    options = {"bounces": 1, "samples": 256, "scrambles": 4}
    shape = replace(shape, bsdf=MODELS[model].bsdf(complete_parameters(model, layers[model])))
    mesh, exact = (
        frame_pixels(scene, [lights["forest"]], CAMERA, POSE, SIZE, INSIDE, **options)
        for scene in (MeshScene(asset, [look]), shape)
    )
    # The same directions are drawn, so that noise cancels. 64 rings are up to 3e-4 off the sphere and their facets
    # 1.4 degrees off its normals, so that a few paths end elsewhere; the card is exact but for float32 tangents.
    tolerance = 0.25 * exact.error if name == "sphere" else 1e-6
    assert (np.abs(mesh.value - exact.value) <= tolerance).all()


@pytest.mark.parametrize("bounces", [0, 1, 4])
def test_a_lossless_box_in_a_furnace_lacks_what_is_still_inside(bounces, lights):
    options = {"bounces": bounces, "samples": 64, "scrambles": 16}
    got = frame_pixels(box_scene(looks=[LEAF] * 6), [lights["white"]], CAMERA, POSE, SIZE, INSIDE, **options)
    # Half of what is inside leaves at every wall. Sixteen scrambles: beyond five errors is one in six thousand.
    assert (np.abs(got.value - (1.0 - 0.5 ** (bounces + 1))) <= 5.0 * got.error + 1e-9).all()
    assert (got.error < 0.02).all()


def test_every_slot_has_its_own_look(lights):
    black = Look("black", (Layer("Black", "pixar", {"surfaceColor": (0.0,) * 3, "normalScale": 0.0}),))
    camera, pose = Camera(20.0, 0.0, (0.0, 0.0, 0.0), 8.0), Pose(0.0, 0.0)  # sees the wall of -y, the third
    for white in range(6):
        box = box_scene(looks=[LEAF if slot == white else black for slot in range(6)])
        got = frame_pixels(box, [lights["white"]], camera, pose, SIZE, INSIDE[:1], bounces=0, samples=16, scrambles=2)
        assert (got.value > 0.4).all() == (white == 2)


@pytest.mark.parametrize(("size", "offset"), [(1.0, 0.0), (1e-4, 0.0), (1.0, 1e5), (1e4, -3e5)])
def test_a_ray_never_meets_the_triangle_that_it_leaves(size, offset):
    matrix = np.diag([size, size, size, 1.0])
    matrix[:3, 3] = offset
    scene = box_scene(matrix)
    rng = np.random.default_rng(4)
    hits, inward = trace_hits(scene, 2000, rng)
    frame, _ = scene.frame(hits, inward)
    # From steep to grazing, inwards and outwards.
    angle, z = rng.uniform(0.0, 2.0 * np.pi, 2000), 10.0 ** rng.uniform(-6.0, -0.01, 2000)
    side = np.sqrt(1.0 - z**2)
    local = np.stack([side * np.cos(angle), side * np.sin(angle), z], axis=-1)
    is_hit, next_hits = scene.trace_onward(hits, np.einsum("nji,nj->ni", frame, local))
    assert is_hit.all()
    assert (next_hits["triangle"] != hits["triangle"]).all()
    assert not scene.trace_onward(hits, np.einsum("nji,nj->ni", frame, local * (1.0, 1.0, -1.0)))[0].any()


@pytest.mark.both_pythons
def test_hits_are_exact_to_float64():
    scene = box_scene()
    origin, ray = camera_rays(CAMERA, POSE, SIZE, *np.random.default_rng(2).uniform(20.0, 44.0, (2, 500)))
    is_hit, hits = scene.intersect(origin, ray)
    points = scene.points(hits)[is_hit]
    across = np.linalg.norm(np.cross(points - origin, ray[is_hit]), axis=-1)
    assert is_hit.sum() > 400
    assert (np.abs(np.abs(points).max(axis=-1) - 1.0) < 1e-12).all()
    assert (across < 1e-12).all()


def test_frames_stay_orthonormal_and_normals_perpendicular_under_any_matrix():
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([[1.0, 0.4, 0.0], [0.0, 0.5, 0.1], [0.2, 0.0, 2.0]])
    scene = box_scene(matrix)
    hits, wo = trace_hits(scene, 300, np.random.default_rng(7))
    frame, facet = scene.frame(hits, wo)
    np.testing.assert_allclose(frame @ frame.swapaxes(1, 2), np.tile(np.eye(3), (300, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(frame[:, 2], facet, atol=1e-6)
    assert ((frame[:, 2] * wo).sum(axis=-1) > 0.0).all()


def test_a_reflected_instance_reflects_its_frames():
    rng = np.random.default_rng(8)
    plain, mirror = box_scene(), box_scene(np.diag([-1.0, 1.0, 1.0, 1.0]))
    hits, wo = trace_hits(plain, 50, rng)
    reflection = np.array([-1.0, 1.0, 1.0])
    frame, _ = plain.frame(hits, wo)
    reflected, _ = mirror.frame(hits, wo * reflection)
    np.testing.assert_allclose(reflected, frame * reflection, atol=1e-12)


def test_a_normal_that_leans_away_is_bent_towards_its_viewer():
    mesh = box_mesh()
    leaning = mesh.normals + 3.0 * tangents_of([mesh])[0]
    leaning /= np.linalg.norm(leaning, axis=-1, keepdims=True)
    scene = box_scene(mesh=replace(mesh, normals=leaning.astype(np.float32)))
    hits, wo = trace_hits(scene, 400, np.random.default_rng(9))
    frame, facet = scene.frame(hits, wo)
    lean = (frame[:, 2] * wo).sum(axis=-1)
    assert ((facet * wo).sum(axis=-1) > 0.0).all()
    assert (lean > 0.99e-4).all()
    # Some are bent and some need not be.
    assert 0 < (lean < 1.01e-4).sum() < 400


def test_what_corners_carry_is_interpolated():
    mesh = box_mesh()
    height = mesh.points[mesh.corner_points, 2]
    scene = box_scene(mesh=replace(mesh, primvars={"height": height, "point": mesh.points[mesh.corner_points]}))
    hits, _ = trace_hits(scene, 100, np.random.default_rng(5))
    points, surface = scene.points(hits), MeshPoints(scene, hits, np.ones(100))
    np.testing.assert_allclose(surface.uv("st"), points[:, :2], atol=1e-12)
    np.testing.assert_allclose(surface.primvar(Primvar("height", 0.0)), points[:, 2], atol=1e-12)
    np.testing.assert_allclose(surface.primvar(Primvar("point", (0.0, 0.0, 0.0))), points, atol=1e-12)
    for fallback in (0.25, 0.75, (0.5, 0.25, 0.125)):
        value = surface.primvar(Primvar("none", fallback))
        np.testing.assert_allclose(value, np.broadcast_to(fallback, value.shape), atol=1e-12)
    # The x axis is u's and y is v's, as seen from +z: from -z the UVs are mirrored, and side walls have no area.
    below = (points[:, 2] < -0.999) & (np.abs(points[:, :2]) < 0.999).all(axis=-1)
    assert below.any()
    np.testing.assert_allclose(surface.handedness(), np.where(below, -1.0, 1.0), atol=1e-12)


def test_a_look_that_reads_what_is_not_there_is_refused():
    mesh = box_mesh()
    scene = box_scene(mesh=replace(mesh, primvars={"height": mesh.points[mesh.corner_points, 2]}))
    surface = MeshPoints(scene, trace_hits(scene, 10, np.random.default_rng(5))[0], np.ones(10))
    with pytest.raises(AssetError, match=r"/mesh: no UV set 'other'; it has: st"):
        surface.uv("other")
    with pytest.raises(AssetError, match=r"/mesh: primvar 'height' has 1 numbers a corner, the look reads 3"):
        surface.primvar(Primvar("height", (0.0, 0.0, 0.0)))


def test_triangles_without_area_are_not_there():
    mesh = polygons([(0, 0, 0), (1, 0, 0), (1, 1, 0), (2, 0, 0)], [np.arange(3), np.array([0, 1, 2])])
    line = replace(mesh, corner_points=np.array([0, 1, 2, 0, 1, 3], np.int32))
    rays = np.array([[0.0, 0.0, -1.0], [-0.5, 0.2, -1.0] / np.sqrt(1.29)])
    hit, _ = scene_of(line, [GREY] * 2).intersect(np.array([1.5, 0.0, 1.0]), rays)
    assert hit.tolist() == [False, True]
