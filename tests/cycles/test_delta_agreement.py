"""Mirror and glass in Cycles: spheres against ray-traced closed forms, other shapes against the reference."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from agreement import assert_scene_agreement, compute_live, coverage, estimate_of
from frames import POSE, render_seeds, replaced, scene_of
from light_rigs import FACING
from shapes import Sphere
from stored_references import Arrays, StoredReference

from lookdev.arrays import Floats
from lookdev.asset import Asset, load_asset, make_asset
from lookdev.checks.finding import CheckFinding
from lookdev.checks.images import check_frame, choose_pixels
from lookdev.light import Emission, Light, PosedLight, RectLight
from lookdev.material import Layer, Look, Primvar
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.worker import Worker
from lookdev.scene import Scene, camera_rays

pytestmark = pytest.mark.cycles


SIZE, SAMPLES, SEEDS = 32, 64, 4
ETA, K = (3.2, 3.1, 2.3), (3.3, 3.3, 3.1)  # about those of chromium
TINT = (0.9, 0.95, 1.0)
MIRROR = Look("mirror", (Layer("l", "mirror", {"eta": ETA, "k": K}),))
GLASS = Look("glass", (Layer("l", "glass", {"eta": 1.5, "tint": TINT}),))
PLASTIC = Layer("base", "disney", {"baseColor": (0.6, 0.2, 0.1), "roughness": 0.4})


def frames_of(
    worker: Worker, scene: Scene, bounces: int, alter: Callable[[str], str] | None = None
) -> list[WorkerFrame]:
    return render_seeds(worker, scene, range(SEEDS), alter=alter, bounces=bounces, samples=SAMPLES, error=None)


def closed_form_pixels(model: str, scene: Scene, bounces: int) -> Arrays:
    """Return pixels of a smooth sphere by the radiance that reaches its viewer, at 32 x 32 jittered points of each."""
    rng, count, scrambles, size = np.random.default_rng(3), 32, 8, (SIZE, SIZE)
    sphere, light = Sphere(), PosedLight(scene.lights[0], POSE.lighting - POSE.element)
    pixels = choose_pixels(coverage(sphere, scene.camera, POSE, size), 100, seed=1)
    values = np.zeros((len(pixels), scrambles, 3))

    def radiance(direction: Floats) -> Floats:
        return np.asarray(light.radiance(np.zeros_like(direction), direction))

    for scramble in range(scrambles):
        for i in range(count):
            for j in range(count):
                x, y = pixels.T + (np.array([[i], [j]]) + rng.random((2, len(pixels)))) / count
                origin, ray = camera_rays(scene.camera, POSE, size, x, y)
                is_hit, points = sphere.intersect(origin, ray)
                values[is_hit, scramble] += CLOSED_FORMS[model](points[is_hit], ray[is_hit], radiance, bounces)
    values /= count**2
    error = values.std(axis=1, ddof=1) / np.sqrt(scrambles)
    numbers = {"samples": np.array(count**2), "scrambles": np.array(scrambles)}
    return {"pixels": pixels, "value": values.mean(axis=1), "error": error, **numbers}


def dot(a: Floats, b: Floats) -> Floats:
    return np.asarray((a * b).sum(axis=-1, keepdims=True))


def mirror_sphere(n: Floats, ray: Floats, radiance: Callable[[Floats], Floats], bounces: int) -> Floats:
    cosine = -dot(n, ray)
    index = np.array(ETA) + 1j * np.array(K)
    inner = np.sqrt(1.0 - (1.0 - cosine**2) / index**2)
    s, p = (cosine - index * inner) / (cosine + index * inner), (index * cosine - inner) / (index * cosine + inner)
    return 0.5 * (np.abs(s) ** 2 + np.abs(p) ** 2) * radiance(ray + 2.0 * cosine * n)


def glass_sphere(n: Floats, ray: Floats, radiance: Callable[[Floats], Floats], bounces: int) -> Floats:
    """Return the radiance of a glass sphere: light inside is reflected at one angle, and a part leaves at each hit."""
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


CLOSED_FORMS = {"mirror": mirror_sphere, "glass": glass_sphere}


def check_sphere(
    stored: StoredReference, frames: list[WorkerFrame], model: str, scene: Scene, bounces: int
) -> CheckFinding:
    """Compare frames with the closed form of light that is reflected inside up to `bounces` times."""
    name = f"{model} sphere {bounces}"
    reference = stored(name, closed_form_pixels, model=model, scene=scene, bounces=bounces)
    halves = np.stack([half for frame in frames for half in (frame.a, frame.b)])
    return check_frame(name, halves, frames[0].alpha, SEEDS * SAMPLES, reference["pixels"], estimate_of(reference))


@pytest.mark.parametrize(
    ("look", "bounces"),
    [
        pytest.param(MIRROR, 2, marks=pytest.mark.proof, id="mirror"),
        pytest.param(GLASS, 1, marks=pytest.mark.proof, id="glass, 1"),
        pytest.param(GLASS, 4, id="glass, 4"),
    ],
)
def test_a_sphere_is_its_closed_form(look: Look, bounces: int, worker: Worker, light_of, stored_reference) -> None:
    scene = scene_of(load_asset(builtin="sphere"), look, (light_of("city"),), SIZE)
    frames = frames_of(worker, scene, bounces)
    finding = check_sphere(stored_reference, frames, look.name, scene, bounces)
    assert finding.passed, "\n".join((finding.summary, *finding.details))
    if bounces == 4:
        assert not check_sphere(stored_reference, frames, look.name, scene, 1).passed


FAULTS = {
    "inside taken for outside": ("int inside = dot(mesh_normal, facet) < 0", "int inside = 0"),
    "directions that light is drawn to count": ("pdf = 1.0 / brdf_samples", "pdf = 2.0 / brdf_samples"),
}


@pytest.mark.proof
@pytest.mark.parametrize("fault", FAULTS)
def test_planted_faults_are_found(worker: Worker, light_of: Callable[[str], Light], fault: str) -> None:
    scene = scene_of(load_asset(builtin="sphere"), GLASS, (light_of("studio"),), SIZE)
    frames = frames_of(worker, scene, 4, replaced(*FAULTS[fault]))
    assert not check_sphere(compute_live, frames, "glass", scene, 4).passed


def blend(model: str) -> Look:
    """Return plastic of which a part, that varies, is smooth."""
    return Look(model, (PLASTIC, Layer("top", model, {}, mask=Primvar("wear", 0.5))))


def mirror(asset: Asset) -> Asset:
    instances = [
        replace(instance, matrix=np.diag([-1.0, 1.2, 1.0, 1.0]) @ instance.matrix) for instance in asset.instances
    ]
    return make_asset("mirrored", asset.meshes, instances, asset.slots)


SENT = Emission((6.0, 5.0, 4.0), diffuse=2.0, specular=0.5)
BESIDE = RectLight(width=1.0, height=1.0, position=(0.0, -1.9, 0.4), axes=FACING, emission=SENT)


@pytest.mark.parametrize(
    ("look", "lights", "flipped"),
    [
        pytest.param(GLASS, ("studio",), False, marks=pytest.mark.proof, id="glass"),
        pytest.param(GLASS, ("studio",), True, id="glass in a mirror"),
        pytest.param(MIRROR, ("studio",), False, marks=pytest.mark.proof, id="mirror"),
        pytest.param(blend("glass"), ("studio",), False, marks=pytest.mark.proof, id="glass blend"),
        pytest.param(blend("mirror"), ("studio", BESIDE), False, id="mirror blend under a lamp"),
    ],
)
def test_shapes_agree_with_the_reference(
    worker: Worker, light_of, look: Look, lights: tuple[Any, ...], flipped: bool, stored_reference: StoredReference
) -> None:
    asset = load_asset(builtin="suzanne")
    asset = mirror(asset) if flipped else asset
    lights = tuple(light_of(light) if isinstance(light, str) else light for light in lights)
    scene = scene_of(asset, look, lights, SIZE)
    frames = frames_of(worker, scene, 2)
    name, options = f"smooth {asset.name} {look.name}", {"bounces": 2, "samples": 256}
    assert_scene_agreement(name, frames, scene, SAMPLES, stored_reference, **options)
