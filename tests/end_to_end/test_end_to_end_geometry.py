"""The right thing stands in the right place: poses, cameras, placements and backgrounds, on rendered pictures."""

import math
from dataclasses import replace

import numpy as np
import pytest
from looks import quick_among
from stage import Stage, difference

from lookdev.arrays import Floats
from lookdev.asset import Asset, Instance, Mesh, make_asset
from lookdev.asset.builtin import make_sphere
from lookdev.asset.tangents import tangents_of
from lookdev.light import EnvironmentMap, make_environment
from lookdev.light.mapping import direction_to_uv, rotate_z, uv_to_direction
from lookdev.material import Layer, Look
from lookdev.output.background import environment_background
from lookdev.scene import Camera, Pose, camera_rays

pytestmark = pytest.mark.cycles


METAL = {"baseColor": (0.8, 0.5, 0.3), "metallic": 0.7, "roughness": 0.5, "anisotropic": 0.8}
BRUSHED = Look("brushed", (Layer("Metal", "disney", METAL),))
MIRROR = Look("mirror", (Layer("Metal", "disney", {"baseColor": (1.0, 1.0, 1.0), "metallic": 1.0, "roughness": 0.1}),))
CAMERA = Camera(fov=40.0, elevation=20.0, target=(0.0, 0.0, 0.0), distance=7.0)
STILL = Pose(0.0, 0.0)

# Two renders of one thing differ by what their halves differ: the ratio is 1 but for chance, heavy tails included.
SAME, OTHER = 1.5, 4.0


@pytest.fixture(scope="module")
def light() -> EnvironmentMap:
    """Dim, with a broad lamp in one corner and another colour on the other side: no two turns look alike."""
    height, width = 32, 64
    v, u = (np.mgrid[:height, :width] + 0.5) / np.array([height, width])[:, None, None]
    direction = uv_to_direction(np.stack([u, 1.0 - v], axis=-1))
    lamp, fill = np.array([0.6, -0.6, 0.5]), np.array([-0.8, 0.1, 0.2])
    return make_environment(
        "made",
        0.1
        + 6.0 * np.exp(8.0 * (direction @ lamp - 1.0))[..., None] * [1.0, 0.9, 0.7]
        + 0.8 * np.exp(3.0 * (direction @ fill - 1.0))[..., None] * [0.2, 0.4, 1.0],
    )


def placed(*matrices: Floats) -> Asset:
    """Return spheres of radius 1 under these transforms."""
    ball = make_sphere(segments=128, rings=64)
    return make_asset("balls", ball.meshes, [Instance(0, matrix) for matrix in matrices], ball.slots)


def affine(linear: Floats, at: tuple[float, float, float]) -> Floats:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, at
    return matrix


def turned(degrees: float) -> Floats:
    return affine(rotate_z(np.eye(3), degrees).T, (0.0, 0.0, 0.0))


# Front, back, left and right differ, and one ball shades another.
GROUP = (
    affine(np.diag([1.2, 0.4, 0.8]), (0.3, 0.5, 0.0)),
    affine(0.4 * np.eye(3), (1.0, -0.8, 0.6)),
    affine(np.diag([0.3, 0.7, 0.3]), (-1.0, -0.5, -0.6)),
)


def proof(*values: object) -> object:
    return pytest.param(*values, marks=pytest.mark.proof)


@pytest.mark.parametrize(("element", "lighting"), [proof(90.0, 0.0), proof(0.0, 90.0), (135.0, 270.0)])
def test_a_pose_shows_the_asset_and_the_light_turned(
    stage: Stage, light: EnvironmentMap, element: float, lighting: float
) -> None:
    """A pose, for which the renderer turns the camera, against geometry and pixels that really are turned."""
    posed = stage.render(placed(*GROUP), BRUSHED, light, CAMERA, Pose(element, lighting))
    asset = placed(*(turned(element) @ matrix for matrix in GROUP))
    width = light.radiance.shape[1]
    # u grows clockwise, the angle of light counter-clockwise.
    rolled = make_environment("made", np.roll(light.radiance, -round(width * lighting / 360.0), axis=1))
    # By directions of the surface alone: those of another light would need tables of its own, of three seconds.
    assert difference(posed, stage.render(asset, BRUSHED, rolled, CAMERA, STILL, seed=1, ibl_samples=0)) < SAME
    wrong = stage.render(placed(*GROUP), BRUSHED, light, CAMERA, Pose(-element, -lighting), seed=1)
    assert difference(posed, wrong) > OTHER


def baked(mesh: Mesh, matrix: Floats) -> Mesh:
    """Return a mesh with its placement in its points, normals and tangents."""
    linear = matrix[:3, :3]
    corners = mesh.corner_points
    if np.linalg.det(linear) < 0.0:  # seen in a mirror, what ran counter-clockwise runs clockwise
        starts = np.cumsum(mesh.face_sizes) - mesh.face_sizes
        order = np.repeat(2 * starts + mesh.face_sizes - 1, mesh.face_sizes) - np.arange(len(corners))
    else:
        order = np.arange(len(corners))
    normals = mesh.normals[order] @ np.linalg.inv(linear)
    tangents = tangents_of([mesh])[0][order] @ linear.T
    return replace(
        mesh,
        points=(mesh.points @ linear.T + matrix[:3, 3]).astype(np.float32),
        corner_points=corners[order],
        normals=(normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
        tangents=(tangents / np.linalg.norm(tangents, axis=1, keepdims=True)).astype(np.float32),
        uvs={name: uv[order] for name, uv in mesh.uvs.items()},
    )


def in_pieces(asset: Asset, count: int) -> Asset:
    """Return the only mesh of an asset as so many, with instances turned and moved at random."""
    (mesh,), rng = asset.meshes, np.random.default_rng(5)
    owners = np.sort(rng.integers(0, count, len(mesh.face_sizes)))
    pieces, instances = [], []
    for owner in np.unique(owners):
        faces, corners = owners == owner, np.repeat(owners == owner, mesh.face_sizes)
        used, numbers = np.unique(mesh.corner_points[corners], return_inverse=True)
        piece = replace(
            mesh,
            points=mesh.points[used],
            corner_points=numbers.astype(np.int32),
            face_sizes=mesh.face_sizes[faces],
            face_slots=mesh.face_slots[faces],
            normals=mesh.normals[corners],
            tangents=tangents_of([mesh])[0][corners],
            uvs={name: uv[corners] for name, uv in mesh.uvs.items()},
        )
        matrix = affine(turned(360.0 * rng.random())[:3, :3] * 3.0 ** rng.normal(), tuple(rng.normal(size=3)))
        pieces.append(baked(piece, np.linalg.inv(matrix)))
        instances.append(Instance(len(instances), matrix))
    return make_asset("pieces", pieces, instances, asset.slots)


SHEAR = np.array([[1.0, 0.9, 0.0], [0.0, 1.0, 0.0], [0.4, 0.0, 0.7]])
PLACEMENTS = {
    "sheared": SHEAR,
    "mirrored": np.diag([-1.0, 1.0, 1.0]) @ turned(25.0)[:3, :3],
    "stretched": turned(30.0)[:3, :3] @ np.diag([1.3, 0.3, 0.8]),
    "all": np.diag([1.0, 1.0, -1.0]) @ SHEAR @ turned(40.0)[:3, :3] @ np.diag([0.5, 1.2, 0.8]),
}
CELLS = [*((name, False) for name in PLACEMENTS), ("all", True), ("sheared", True)]


@pytest.mark.parametrize(("name", "shared"), quick_among(CELLS, [("all", False), ("all", True)]))
def test_a_placement_is_shaded_like_geometry_that_stands_there(
    stage: Stage, light: EnvironmentMap, name: str, shared: bool
) -> None:
    """Cycles may apply the transform of a mesh with one object to its points; of one that two share, never."""
    matrices = [affine(PLACEMENTS[name], (-0.4, 0.0, 0.3))]
    if shared:
        matrices.append(affine(0.5 * np.eye(3), (1.4, -0.6, -0.6)))
    asset = placed(*matrices)
    meshes = [baked(asset.meshes[0], matrix) for matrix in matrices]
    plain = make_asset("baked", meshes, [Instance(i, np.eye(4)) for i in range(len(meshes))], asset.slots)
    one = stage.render(asset, BRUSHED, light, CAMERA)
    assert difference(one, stage.render(plain, BRUSHED, light, CAMERA, seed=1)) < SAME


@pytest.mark.parametrize("count", [20, 200])
def test_a_mesh_in_pieces_looks_like_the_whole(stage: Stage, light: EnvironmentMap, count: int) -> None:
    """A few pieces are objects of their own, many are joined."""
    ball, stretch = placed(np.eye(4)), affine(np.diag([1.2, 0.6, 0.9]), (0.0, 0.0, 0.0))
    whole = make_asset("whole", [baked(ball.meshes[0], stretch)], ball.instances, ball.slots)
    one = stage.render(whole, BRUSHED, light, CAMERA)
    assert difference(one, stage.render(in_pieces(whole, count), BRUSHED, light, CAMERA, seed=1)) < SAME


@pytest.mark.parametrize(
    ("resolution", "elevation", "element"),
    [((48, 80), -20.0, 290.0), ((80, 48), -90.0, 200.0), proof((48, 48), 35.0, 50.0), proof((48, 48), 90.0, 300.0)],
)
def test_the_camera_is_that_of_camera_rays(
    stage: Stage, light: EnvironmentMap, resolution: tuple[int, int], elevation: float, element: float
) -> None:
    """A ball beside the middle covers the pixels whose rays meet it: what the background is looked up with."""
    camera = Camera(fov=35.0, elevation=elevation, target=(0.5, -0.3, 0.4), distance=6.0)
    pose, samples = Pose(element, 0.0), 64
    alpha = stage.render(placed(np.eye(4)), BRUSHED, light, camera, pose, resolution, samples).alpha

    (width, height), grid = resolution, 16
    y, x = (np.mgrid[: height * grid, : width * grid] + 0.5) / grid
    origin, direction = camera_rays(camera, pose, resolution, x, y)
    along = direction @ -origin
    hit = (along > 0.0) & (origin @ origin - along**2 < 1.0)
    expected = hit.reshape(height, grid, width, grid).mean(axis=(1, 3))
    # A pixel half covered varies most; 5 standard deviations of independent samples, which these are better than.
    tolerance = 5.0 * math.sqrt(0.25 / samples)
    assert 0.1 < expected.mean() < 0.9
    assert np.abs(alpha - expected).max() < tolerance
    assert abs(float(alpha.mean() - expected.mean())) < tolerance / math.sqrt(width * height)


@pytest.mark.parametrize("pose", [proof(Pose(0.0, 0.0)), Pose(30.0, 75.0)], ids=str)
def test_the_background_is_what_a_mirror_ball_shows(stage: Stage, light: EnvironmentMap, pose: Pose) -> None:
    resolution = (48, 48)
    shot = (placed(np.eye(4)), MIRROR, light, CAMERA, pose, resolution, 64)
    task, rendered = stage.task(*shot), stage.render(*shot)
    y, x = np.mgrid[:48, :48] + 0.5
    origin, direction = camera_rays(CAMERA, pose, resolution, x, y)

    def map_at(directions: Floats) -> Floats:
        """Look the map up at the nearest texel."""
        uv = direction_to_uv(rotate_z(directions, pose.element - pose.lighting))
        rows, columns = light.radiance.shape[:2]
        row = np.clip(((1.0 - uv[..., 1]) * rows).astype(int), 0, rows - 1)
        return light.radiance[row, (uv[..., 0] * columns).astype(int) % columns].astype(np.float64)

    # A texel is 5.6 degrees: between neighbours this light changes by less than half.
    assert np.allclose(environment_background(task), map_at(direction), rtol=0.5)
    along = direction @ -origin
    depth = along - np.sqrt(np.maximum(1.0 - (origin @ origin - along**2), 0.0))
    normal = origin + depth[..., None] * direction
    cosine = -(normal * direction).sum(axis=-1)
    facing = (rendered.alpha == 1.0) & (cosine > 0.5)
    expected = map_at(direction + 2.0 * cosine[..., None] * normal)
    shown = (rendered.a + rendered.b) / 2.0
    correlation = np.corrcoef(shown[facing].ravel(), expected[facing].ravel())[0, 1]
    assert facing.sum() > 200
    assert correlation > 0.98
    assert shown[facing].mean() == pytest.approx(expected[facing].mean(), rel=0.05)
