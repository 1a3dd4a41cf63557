"""Mirror and glass in Cycles: spheres against ray-traced closed forms, other shapes against the reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from frames import POSE, orbit_camera
from numpy.typing import NDArray
from shapes import Sphere

from lookdev.asset import Asset, load_asset
from lookdev.asset.store import make_asset
from lookdev.checks.finding import Finding
from lookdev.checks.images import check_frame, choose_pixels
from lookdev.codegen import ShaderSource
from lookdev.light import Emission, Light, RectLight, Turned
from lookdev.material import Layer, Look, Primvar
from lookdev.reference.mesh import MeshScene
from lookdev.reference.render import Estimate, frame_pixels
from lookdev.render.scene import scene_task
from lookdev.render.task import one_frame
from lookdev.render.worker import Worker
from lookdev.scene import Film, Sampling, Scene, camera_rays

pytestmark = pytest.mark.cycles

Floats = NDArray[np.float64]

SIZE, SAMPLES, SEEDS = (32, 32), 64, 4
ETA, K = (3.2, 3.1, 2.3), (3.3, 3.3, 3.1)  # about those of chromium
TINT = (0.9, 0.95, 1.0)
MIRROR = Look("mirror", (Layer("l", "mirror", {"eta": ETA, "k": K}),))
GLASS = Look("glass", (Layer("l", "glass", {"eta": 1.5, "tint": TINT}),))
PLASTIC = Layer("base", "disney", {"baseColor": (0.6, 0.2, 0.1), "roughness": 0.4})


def compared(
    worker: Worker,
    scene: Scene,
    bounces: int,
    reference: Callable[[Any, int], Estimate],
    alter: Callable[[str], str] = lambda osl: osl,
) -> Finding:
    """Compare a scene's frame with estimates of pixels by the bounces that are rendered."""
    task = scene_task(scene, Sampling(bounces=bounces, samples=SAMPLES, error=None))
    shaders = [replace(each, osl=alter(each.osl)) for each in task.shaders if isinstance(each, ShaderSource)]
    task = replace(task, shaders=tuple(shaders))
    worker.start()
    frames = [worker.render(one_frame(task, POSE, f"{n}", seed=n), lambda progress: None) for n in range(SEEDS)]
    halves = np.stack([half for frame in frames for half in (frame.a, frame.b)])
    pixels = choose_pixels(frames[0].alpha, 100, seed=1)
    return check_frame("", halves, frames[0].alpha, SEEDS * SAMPLES, pixels, reference(pixels, task.sampling.bounces))


def assert_agrees(found: Finding) -> None:
    assert found.passed, "\n".join((found.summary, *found.details))


def scene_of(asset: Asset, look: Look, *lights: Light) -> Scene:
    camera = orbit_camera(asset.center, asset.radius)
    return Scene(asset, {slot.path: look for slot in asset.slots}, lights, camera, Film(SIZE))


def by_tracing(scene: Scene) -> Callable[[Any, int], Estimate]:
    def reference(pixels: Any, bounces: int) -> Estimate:
        shape = MeshScene(scene.asset, scene.looks)
        return frame_pixels(shape, scene.lights, scene.camera, POSE, SIZE, pixels, bounces=bounces, samples=256)

    return reference


def by_closed_form(scene: Scene, seen: Callable[[Floats, Floats, Callable[[Floats], Floats], int], Floats]) -> Any:
    """Return what estimates pixels of the sphere from the radiance that `seen` returns, by normals and rays."""

    def reference(pixels: Any, bounces: int) -> Estimate:
        rng, count, scrambles = np.random.default_rng(3), 32, 8
        sphere = Sphere()
        light = Turned(scene.lights[0], POSE.lighting - POSE.element)
        values = np.zeros((len(pixels), scrambles, 3))
        for scramble in range(scrambles):
            for i in range(count):
                for j in range(count):
                    x, y = pixels.T + (np.array([[i], [j]]) + rng.random((2, len(pixels)))) / count
                    origin, ray = camera_rays(scene.camera, POSE, SIZE, x, y)
                    hit, place = sphere.hit(origin, ray)
                    found = seen(place[hit], ray[hit], lambda w: light.radiance(np.zeros_like(w), w), bounces)
                    values[hit, scramble] += found
        values /= count**2
        return Estimate(values.mean(axis=1), values.std(axis=1, ddof=1) / np.sqrt(scrambles), count**2, scrambles)

    return reference


def dot(a: Floats, b: Floats) -> Floats:
    return np.asarray((a * b).sum(axis=-1, keepdims=True))


def mirror_sphere(n: Floats, ray: Floats, radiance: Callable[[Floats], Floats], bounces: int) -> Floats:
    cosine = -dot(n, ray)
    index = np.array(ETA) + 1j * np.array(K)
    inner = np.sqrt(1.0 - (1.0 - cosine**2) / index**2)
    s, p = (cosine - index * inner) / (cosine + index * inner), (index * cosine - inner) / (index * cosine + inner)
    return 0.5 * (np.abs(s) ** 2 + np.abs(p) ** 2) * radiance(ray + 2.0 * cosine * n)


def glass_sphere(n: Floats, ray: Floats, radiance: Callable[[Floats], Floats], bounces: int) -> Floats:
    """What enters is mirrored inside at one angle, again and again, and a part of it leaves at each place."""
    cosine = -dot(n, ray)
    inner = np.sqrt(1.0 - (1.0 - cosine**2) / 1.5**2)
    s, p = (cosine - 1.5 * inner) / (cosine + 1.5 * inner), (1.5 * cosine - inner) / (1.5 * cosine + inner)
    reflected = 0.5 * (s * s + p * p)
    total = reflected * radiance(ray + 2.0 * cosine * n)
    along, weight = ray / 1.5 + (cosine / 1.5 - inner) * n, (1.0 - reflected) * np.array(TINT)
    for _ in range(bounces):
        n = n + 2.0 * inner * along  # the next place
        leaving = 1.5 * along + (cosine - 1.5 * inner) * n
        total = total + weight * (1.0 - reflected) * np.array(TINT) * radiance(leaving)
        along, weight = along - 2.0 * inner * n, weight * reflected
    return np.asarray(total)


def test_a_mirror_sphere_is_its_closed_form(worker: Worker, light_of: Callable[[str], Light]) -> None:
    scene = scene_of(load_asset(builtin="sphere"), MIRROR, light_of("city"))
    assert_agrees(compared(worker, scene, 2, by_closed_form(scene, mirror_sphere)))


def test_a_glass_sphere_is_its_closed_form(worker: Worker, light_of: Callable[[str], Light]) -> None:
    scene = scene_of(load_asset(builtin="sphere"), GLASS, light_of("city"))
    for bounces in (1, 4):
        assert_agrees(compared(worker, scene, bounces, by_closed_form(scene, glass_sphere)))
    assert not compared(worker, scene, 2, lambda pixels, _: by_closed_form(scene, glass_sphere)(pixels, 1)).passed


FAULTS = {
    "inside taken for outside": ("int inside = dot(mesh_normal, facet) < 0", "int inside = 0"),
    "directions that light is drawn to count": ("pdf = 1.0 / brdf_samples", "pdf = 2.0 / brdf_samples"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_planted_faults_are_found(worker: Worker, light_of: Callable[[str], Light], fault: str) -> None:
    given, planted = FAULTS[fault]

    def alter(osl: str) -> str:
        assert given in osl
        return osl.replace(given, planted)

    scene = scene_of(load_asset(builtin="sphere"), GLASS, light_of("studio"))
    assert not compared(worker, scene, 4, by_closed_form(scene, glass_sphere), alter).passed


def blended(model: str) -> Look:
    """Return plastic of which a part, that varies, is smooth."""
    return Look(model, (PLASTIC, Layer("top", model, {}, mask=Primvar("wear", 0.5))))


def mirrored(asset: Asset) -> Asset:
    instances = [replace(each, matrix=np.diag([-1.0, 1.2, 1.0, 1.0]) @ each.matrix) for each in asset.instances]
    return make_asset("mirrored", asset.meshes, instances, asset.slots)


BESIDE = RectLight(
    width=1.0,
    height=1.0,
    position=(0.0, -1.9, 0.4),
    axes=((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)),
    emission=Emission((6.0, 5.0, 4.0), diffuse=2.0, specular=0.5),
)


@pytest.mark.parametrize(
    ("look", "lights", "flipped"),
    [
        (GLASS, ("studio",), False),
        (GLASS, ("studio",), True),
        (MIRROR, ("studio",), False),
        (blended("glass"), ("studio",), False),
        (blended("mirror"), ("studio", BESIDE), False),
    ],
    ids=["glass", "glass in a mirror", "mirror", "glass blend", "mirror blend under a lamp"],
)
def test_shapes_agree_with_the_reference(
    worker: Worker, light_of: Callable[[str], Light], look: Look, lights: tuple[Any, ...], flipped: bool
) -> None:
    asset = load_asset(builtin="suzanne")
    asset = mirrored(asset) if flipped else asset
    scene = scene_of(asset, look, *(light_of(each) if isinstance(each, str) else each for each in lights))
    assert_agrees(compared(worker, scene, 2, by_tracing(scene)))
