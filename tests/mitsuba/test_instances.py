"""Instances of one mesh look like separate meshes: mirrored, stretched, far from the origin, excluded from a shadow."""

from dataclasses import replace

import numpy as np
import pytest
from frames import orbit_camera
from light_rigs import grey, near
from mitsuba_scenes import RenderSeeds

from lookdev.asset import Asset, Instance, load_asset, make_asset
from lookdev.asset.builtin import make_sphere
from lookdev.light.emission import LightLink
from lookdev.light.mapping import rotate_z
from lookdev.material import Layer, Look
from lookdev.reference.mesh import MeshScene
from lookdev.rendering.results import WorkerFrame
from lookdev.scene import Film, Pose, Scene, camera_rays
from lookdev.scene.scene import link_lights

pytestmark = pytest.mark.mitsuba

POSE, SIZE = Pose(40.0, 15.0), (48, 36)
PASSES = ("depth", "position", "normal", "uv", "cryptomatte")
PLACES = {"/left": (1.0, 1.0, 1.0), "/middle": (-0.8, 1.4, 1.1), "/right": (0.7, 0.7, -0.7)}
METAL = {"baseColor": (0.7, 0.5, 0.3), "metallic": 1.0, "roughness": 0.3, "anisotropic": 0.8}
BRUSHED = Look("brushed", (Layer("p", "disney", METAL),))


def row(*, instances: bool) -> Asset:
    """Return a row of heads, of a mesh whose points are 40 m from its origin, and a ball."""
    head, ball = load_asset(builtin="suzanne"), make_sphere(64, 32)
    far = replace(head.meshes[0], points=head.meshes[0].points + np.float32(40.0))
    placed = []
    for number, (path, sizes) in enumerate(PLACES.items()):
        matrix = np.eye(4)
        matrix[:3, :3] = rotate_z(np.eye(3), np.degrees(0.4 * number)).T @ np.diag(sizes)
        matrix[:3, 3] = np.array((2.3 * number - 2.3, 0.0, 0.0)) - matrix[:3, :3] @ np.full(3, 40.0)
        placed.append(Instance(0 if instances else number, matrix, path))
    meshes = [replace(far, name=f"m{number}") for number in range(1 if instances else len(placed))]
    matrix = np.diag([0.4, 0.4, 0.4, 1.0])
    matrix[:3, 3] = 0.0, 0.5, 1.6
    placed.append(Instance(len(meshes), matrix, "/ball"))
    slots = [replace(head.slots[0], path="/left"), replace(ball.slots[0], path="/ball")]
    ball_mesh = replace(ball.meshes[0], face_slots=np.ones(len(ball.meshes[0].face_sizes), np.int32))
    return make_asset("row", [*meshes, ball_mesh], placed, slots)


@pytest.fixture(scope="module")
def frames(render_seeds: RenderSeeds) -> tuple[WorkerFrame, WorkerFrame]:
    """Return the frame of instances and that of meshes, under a light whose shadow excludes the ball."""
    without_ball = LightLink((("/", "expandPrims"), ("/ball", "exclude")))
    rect = near("rect")
    lights = (replace(rect, emission=replace(rect.emission, shadow_link=without_ball)), grey())
    frames_of_both = []
    for instances in (True, False):
        asset = row(instances=instances)
        camera = orbit_camera(asset.center, asset.radius)
        scene = link_lights(Scene(asset, {slot.path: BRUSHED for slot in asset.slots}, lights, camera, Film(SIZE)))
        frames_of_both += render_seeds(scene, POSE, 1, samples=64, bounces=2, passes=PASSES)
    return frames_of_both[0], frames_of_both[1]


def test_instances_show_what_meshes_show(frames: tuple[WorkerFrame, WorkerFrame]) -> None:
    first, second = frames
    np.testing.assert_allclose(first.alpha, second.alpha, atol=1 / 64)
    same = (first.passes["depth"] < 1e9)[..., 0] & (second.passes["depth"] < 1e9)[..., 0]
    for name in ("depth", "position", "uv", "normal"):
        # Points of the mesh are some 40 m from its origin: float32 has 4e-6 m there.
        np.testing.assert_allclose(first.passes[name][same], second.passes[name][same], atol=5e-4, err_msg=name)
    assert first.names == second.names
    assert set(first.names["CryptoObject"]) == {*PLACES, "/ball"}
    for matte in first.names:
        np.testing.assert_allclose(first.passes[matte][..., 0::2], second.passes[matte][..., 0::2])
    # The paths are the same, except for a few, as the two ways to compute a point round differently in float32.
    a, b = (0.5 * (frame.a + frame.b) for frame in frames)
    covered = first.alpha > 0.0
    assert np.count_nonzero(covered) > 300
    off = np.abs(a - b).max(axis=-1) / (1e-3 + a.mean(axis=-1))
    assert (off[covered] < 1e-2).mean() > 0.95
    assert a[covered].mean() == pytest.approx(b[covered].mean(), rel=2e-3)


@pytest.mark.parametrize("instances", [True, False])
def test_normals_are_those_of_the_reference(frames: tuple[WorkerFrame, WorkerFrame], instances: bool) -> None:
    """They are interpolated in the space of the mesh: in a stretched space, their mean has another direction."""
    asset, frame = row(instances=instances), frames[not instances]
    camera, scene = orbit_camera(asset.center, asset.radius), MeshScene(asset, [BRUSHED] * len(asset.slots))
    x, y = (coordinate.ravel() + 0.5 for coordinate in np.meshgrid(*map(np.arange, SIZE)))
    origin, direction = camera_rays(camera, POSE, SIZE, x, y)
    hit, hits = scene.intersect(origin, direction)
    hit &= frame.passes["depth"].ravel() < 1e9
    assert np.count_nonzero(hit) > 300
    normals = scene.frame(hits[hit], -direction[hit])[0][:, 2]
    expected = rotate_z(normals, POSE.element)
    # In float32, 40 m from the origin, a few rays hit a neighbouring triangle.
    off = np.linalg.norm(frame.passes["normal"].reshape(-1, 3)[hit] - expected, axis=-1)
    assert np.quantile(off, 0.99) < 5e-4
