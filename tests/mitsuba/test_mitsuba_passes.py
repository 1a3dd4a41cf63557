"""The passes of a frame of Mitsuba, compared with camera rays, the parts' sum, and looks of single lobes."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from frames import orbit_camera
from light_rigs import grey, near

from lookdev.asset import Asset, Instance, load_asset, make_asset
from lookdev.light import Emission, Light, RectLight, SphereLight
from lookdev.material import Layer, Look
from lookdev.reference.mesh import MeshScene
from lookdev.rendering.cryptomatte import matte_id
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import FrameTask, frame_task
from lookdev.rendering.worker import Worker
from lookdev.run.frame_file import store_frame
from lookdev.scene import Film, Pose, Sampling, Scene, camera_rays

pytestmark = pytest.mark.mitsuba

POSE, SIZE = Pose(40.0, 15.0), (24, 18)
COATED = Look(
    "coated", (Layer("p", "disney", {"baseColor": (0.7, 0.3, 0.1), "clearcoat": 1.0, "roughness": 0.3, "sheen": 0.5}),)
)
NET = Look("net", (Layer("p", "pixar", {"surfaceColor": (0.6, 0.5, 0.4), "roughness": 0.5, "presence": 0.25}),))
PARTS = (
    ("diffuse", "specular", "clearcoat", "sheen", "transmission"),
    ("direct", "indirect"),
    ("light_key", "light_fi_ll", "light_sky"),
)


def pair() -> Asset:
    """Return a head in front of a smaller one with another slot, away from the origin."""
    head = load_asset(builtin="suzanne")
    mesh = head.meshes[0]
    meshes = [replace(mesh, face_slots=np.full(len(mesh.face_sizes), n, np.int32)) for n in range(2)]
    instances = []
    for number, (path, size, offset) in enumerate((("/set/left", 1.0, 0.0), ("/set/right", -0.8, 1.7))):
        matrix = np.diag([size, abs(size), abs(size), 1.0])
        matrix[:3, 3] = (3.0 + offset, -2.0 + 0.5 * offset, 1.0)
        instances.append(Instance(number, matrix, path))
    slots = [replace(head.slots[0], path=f"/{n}") for n in range(2)]
    return make_asset("pair", meshes, instances, slots)


def task_of(
    looks: tuple[Look, Look],
    passes: tuple[str, ...],
    pose: Pose = POSE,
    lights: tuple[Light, ...] | None = None,
    **sampling_options: object,
) -> FrameTask:
    asset = pair()
    camera = orbit_camera(asset.center, 0.8 * asset.radius)
    look_of_slot = {slot.path: look for slot, look in zip(asset.slots, looks, strict=True)}
    scene = Scene(asset, look_of_slot, lights or (near_the_pair(), grey()), camera, Film(SIZE))
    sampling = Sampling(**{"samples": 64, "bounces": 2, "passes": passes} | sampling_options)  # type: ignore[arg-type]
    return frame_task(scene_task(scene, sampling, "mitsuba"), pose, f"{passes} {sampling_options}")


def near_the_pair() -> Light:
    return replace(near("sphere"), position=(3.6, -4.0, 1.8))  # type: ignore[type-var,return-value]


def rig() -> tuple[Light, ...]:
    """Return lamps about the pair (two in one group, one visible to the camera), and a dome."""
    key, fill = near_the_pair(), Emission((1.0, 2.0, 6.0), specular=0.5, group="fi.ll")
    return (
        replace(key, emission=replace(key.emission, group="key")),
        RectLight(width=1.0, height=1.0, position=(4.5, -2.0, 3.0), emission=fill),
        SphereLight(radius=0.3, position=(4.3, -2.6, 2.4), emission=replace(fill, specular=1.0, camera=True)),
        replace(grey(), emission=Emission(group="sky")),
    )


def render(worker: Worker, task: FrameTask) -> WorkerFrame:
    worker.start()
    return worker.render(task, lambda progress: None)


@pytest.fixture(scope="module")
def solid(worker: Worker) -> WorkerFrame:
    """Return a frame of two opaque looks, with all passes of geometry and all mattes."""
    passes = ("depth", "position", "normal", "uv", "albedo", "samples", "cryptomatte")
    return render(worker, task_of((COATED, COATED), passes, samples=2048))


def test_places_are_those_that_rays_meet(solid: WorkerFrame) -> None:
    passes = solid.passes
    assert {*passes} > {"depth", "position", "normal", "uv", "albedo", "samples"}
    asset = pair()
    camera = orbit_camera(asset.center, 0.8 * asset.radius)
    scene = MeshScene(asset, [COATED, COATED])
    x, y = (coordinate.ravel() for coordinate in np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5))
    # The reference orbits the camera and leaves the asset where it is.
    origin, direction = camera_rays(camera, POSE, SIZE, x, y)
    hit, hits = scene.intersect(origin, direction)
    assert 100 < np.count_nonzero(hit) < hit.size - 100
    points = scene.points(hits[hit])
    frame, _ = scene.frame(hits[hit], -direction[hit])
    angle = np.radians(POSE.element)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    pivot = np.array((*camera.pivot, 0.0))
    world = (points - pivot) @ turn.T + pivot

    def rows(name: str) -> np.ndarray:
        return passes[name].reshape(len(hit), -1)

    # Float32 of Embree about the asset's centre: 1e-6 of its size.
    np.testing.assert_allclose(rows("position")[hit], world, atol=2e-5)
    assert not rows("position")[~hit].any()
    _, _, back = camera.orbit(0.0).frame
    depth = -(world - camera.orbit(0.0).position) @ back
    np.testing.assert_allclose(rows("depth")[hit, 0], depth, atol=2e-5)
    assert (rows("depth")[~hit] == 1e10).all()
    np.testing.assert_allclose(rows("normal")[hit], frame[:, 2] @ turn.T, atol=2e-4)
    assert ((rows("uv")[hit] >= 0.0) & (rows("uv")[hit] <= 1.0)).all()
    assert rows("uv")[hit].std(axis=0).min() > 0.05
    assert (rows("samples") == 2048.0).all()
    albedo = passes["albedo"][passes["albedo"].any(axis=-1)]
    assert (albedo[:, 0] > albedo[:, 2]).all()


def test_parts_of_the_light_sum_up_to_it_and_leave_it_as_it_is(worker: Worker) -> None:
    plain = render(worker, task_of((COATED, NET), (), lights=rig()))
    frame = render(worker, task_of((COATED, NET), ("lobes", "direct", "lights"), lights=rig()))
    np.testing.assert_array_equal(plain.alpha, frame.alpha)
    np.testing.assert_allclose(frame.a, plain.a, rtol=1e-4, atol=1e-6)
    beauty = 0.5 * (frame.a + frame.b)
    for parts in PARTS:
        np.testing.assert_allclose(sum(frame.passes[name] for name in parts), beauty, rtol=1e-4, atol=1e-6)
        for name in parts:
            assert (frame.passes[name] >= -1e-5 * (1.0 + beauty)).all(), name
    assert not frame.passes["transmission"].any()
    for name in ("clearcoat", "sheen", *PARTS[2]):
        assert frame.passes[name].mean() > 1e-3 * beauty.mean(), name
    assert 0.01 < frame.passes["indirect"].mean() / beauty.mean() < 0.5


def assert_same_light(parts: list[np.ndarray], alone: list[np.ndarray], least: float) -> None:
    """Compare the mean colours (N, 3) of a part of the light, of N seeds, with those of frames of that light alone."""
    noise = np.sqrt((np.var(parts, axis=0, ddof=1) + np.var(alone, axis=0, ddof=1)) / len(parts))
    # Student's t of 3 degrees of freedom and more: beyond 12 by chance once in a thousand.
    assert (np.abs(np.mean(parts, axis=0) - np.mean(alone, axis=0)) < 12.0 * noise).all()
    assert (noise < least * np.mean(alone, axis=0)).all(), "the test would not notice another light"


def test_a_groups_light_is_that_of_a_scene_with_its_lights_alone(worker: Worker) -> None:
    """The scene has a look that can be seen through, indirect light, and a lamp that the camera sees.

    Two of the three groups are compared: the parts sum up to all light.
    """
    lights = rig()

    def frames(lights_on: tuple[Light, ...], passes: tuple[str, ...]) -> list[WorkerFrame]:
        return [render(worker, task_of((COATED, NET), passes, lights=lights_on, samples=256, seed=n)) for n in range(4)]

    together = frames(lights, ("lights",))
    for group, number in (("key", 1), ("fi_ll", 2)):
        alone = tuple(light for light in lights if light.emission.group.replace(".", "_") == group)
        assert len(alone) == number
        parts = [frame.passes[f"light_{group}"].mean(axis=(0, 1)) for frame in together]
        assert_same_light(parts, [(0.5 * (frame.a + frame.b)).mean(axis=(0, 1)) for frame in frames(alone, ())], 0.01)


def test_light_of_one_group_is_all_there_is_and_what_reaches_nothing_is_black(worker: Worker) -> None:
    # It sends its light along -z, away from the pair.
    idle = RectLight(width=1.0, height=1.0, position=(3.0, -2.0, -9.0), emission=Emission(group="idle"))
    for light in (grey(), near_the_pair()):
        frame = render(worker, task_of((COATED, NET), ("lights",), lights=(idle, light), samples=16))
        assert {*frame.passes} == {"light_idle", f"light_{light.kind}"}
        assert not frame.passes["light_idle"].any()
        np.testing.assert_array_equal(frame.passes[f"light_{light.kind}"], 0.5 * (frame.a + frame.b))


def test_a_lobes_light_is_that_of_a_look_with_this_lobe_alone(worker: Worker) -> None:
    """The comparison includes indirect light from the other look, which does not change."""
    inputs = {"diffuse": (0.5, 0.3, 0.1), "specular": (0.1, 0.2, 0.4), "exponent": 20.0}

    def frames(**changed: object) -> list[WorkerFrame]:
        looks = [
            Look("look", (Layer("p", "modified-phong", layer_inputs),)) for layer_inputs in (inputs, inputs | changed)
        ]
        passes = ("lobes", "direct", "cryptomatte")
        return [render(worker, task_of((looks[0], looks[1]), passes, bounces=1, seed=n)) for n in range(4)]

    both = frames()
    # Where the right head alone is seen, one bounce comes by way of the left one, or of its own.
    alone = (coverage(both[0], "/set/right") > 0.0) & (coverage(both[0], "/set/left") == 0.0)
    assert np.count_nonzero(alone) > 10
    # All parts sum up to the beauty: where one of two is right, the other is.
    single = [(0.5 * (frame.a + frame.b))[alone].mean(axis=0) for frame in frames(specular=(0.0, 0.0, 0.0))]
    assert_same_light([frame.passes["diffuse"][alone].mean(axis=0) for frame in both], single, 0.02)


def coverage(frame: WorkerFrame, name: str) -> np.ndarray:
    """Return the coverage (H, W) of a prim."""
    ids = frame.passes["CryptoObject"]
    prim_id = np.array(matte_id(name), np.uint32).view(np.float32)
    return np.where(ids[..., 0::2] == prim_id, ids[..., 1::2], 0.0).sum(axis=-1)


def test_mattes_are_the_coverage_of_each_part(worker: Worker, solid: WorkerFrame, tmp_path: Path) -> None:
    task = task_of((COATED, NET), ("cryptomatte",), samples=2048, bounces=3)
    task = replace(task, files=(tmp_path / "frame.exr",))
    frame = render(worker, task)
    store_frame(task, frame)
    buffer = oiio.ImageBuf(str(task.files[0]))
    entries = {
        attribute.name: attribute.value
        for attribute in buffer.spec().extra_attribs
        if attribute.name.startswith("cryptomatte/")
    }
    names = {name for key, text in entries.items() if key.endswith("/manifest") for name in json.loads(text)}
    assert names == {"/set/left", "/set/right", "coated", "net", "pair"}
    for matte in ("CryptoObject", "CryptoMaterial", "CryptoAsset"):
        np.testing.assert_allclose(frame.passes[matte][..., 1::2].sum(axis=-1), frame.alpha, atol=1e-5)
    # The net lets three quarters through, where it has one layer.
    net, right = coverage(frame, "/set/right"), coverage(solid, "/set/right")
    only = (right > 0.0) & (coverage(frame, "/set/left") == 0.0)
    assert np.count_nonzero(only) > 10
    assert (net[only] < right[only]).all()
    assert (net[only] > 0.2 * right[only]).all()
