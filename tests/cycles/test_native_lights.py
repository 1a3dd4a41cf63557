"""Lights as Cycles' own: they emit the same as in NumPy, and frames of rigs agree with the reference."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from agreement import scene_pixels
from frames import render_seeds, scene_of
from warm_blender import BlenderProcess

from lookdev.arrays import Floats
from lookdev.asset import load_asset
from lookdev.light import (
    LIGHT_KINDS,
    DistantLight,
    Emission,
    Light,
    RectLight,
    Shaping,
    make_environment,
    prepare_light,
)
from lookdev.light.dome import example_map
from lookdev.light.dome.local import LocalDome
from lookdev.light.picture import prepare_texture
from lookdev.material import Layer, Look
from lookdev.rendering.worker import Worker
from lookdev.scene import Camera, Pose

pytestmark = pytest.mark.cycles


POSITION, NORMAL = np.array([0.3, -0.2, 0.5]), np.array([0.0, -0.6, 0.8])
LEFT_HANDED = ((-1.0, 0.0, 0.0), (0.0, 0.8, 0.6), (0.0, -0.6, 0.8))
BEAM = Emission((3.0, 2.0, 1.0), shaping=Shaping(70.0, 0.6, 2.0, (0.1, 0.2, 0.3)))


def pictured() -> RectLight:
    """Return a rectangle with a texture that has no symmetry."""
    texels = np.random.default_rng(2).uniform(0.2, 1.0, (6, 4, 3))
    texels[:2, :2] *= 6.0
    return replace(RectLight.example(), texture=prepare_texture(make_environment("picture", texels)))


DOME = prepare_light(example_map(), sampled=False)  # native worlds need no tables, which take seconds
DOMES: dict[str, Light] = {"dome": DOME, "local_dome": LocalDome(dome=DOME, position=(0.5, 0.0, 0.5), radius=3.0)}
EXAMPLES = {name: DOMES.get(name) or kind.example() for name, kind in LIGHT_KINDS.items()}
CASES: dict[str, Light] = {
    **{name: light for name, light in EXAMPLES.items() if not light.native_gap()},
    "texture": pictured(),
    "mirrored texture": replace(pictured(), axes=LEFT_HANDED),
    "mirrored dome": replace(DOME, axes=LEFT_HANDED, emission=Emission((1.0, 2.0, 0.5))),
    "sphere from inside": replace(LIGHT_KINDS["sphere"].example(), position=(0.3, -0.2, 0.6)),
    "sun": replace(DistantLight.example(), angle=0.53),
    "parallel": replace(DistantLight.example(), angle=0.0),
    **{
        f"shaped {name}": replace(LIGHT_KINDS[name].example(), emission=BEAM) for name in ("rect", "sphere", "cylinder")
    },
}


@pytest.fixture(scope="module")
def towards() -> Mapping[str, Floats]:
    """Return a direction to each light, well above the surface."""
    u = 0.05 + 0.9 * np.random.default_rng(3).random((64, 2))
    directions = {name: light.sample(np.broadcast_to(POSITION, (64, 3)), u) for name, light in CASES.items()}
    return {name: wi[np.argmax(wi @ NORMAL > 0.4)] for name, wi in directions.items()}


@pytest.fixture(scope="module")
def measured(blender: BlenderProcess, towards: Mapping[str, Floats]) -> Mapping[str, dict[str, Any]]:
    """Return the values that a diffuse square and a mirror show of each light."""
    results: Mapping[str, dict[str, Any]] = blender.call("probes.measure_lamps", CASES, towards, POSITION, NORMAL)
    return results


def irradiances(lights: Mapping[str, Light], cells: int) -> Mapping[str, Floats]:
    """Return the irradiance (3,) of each light at POSITION from the light's own samples, by the midpoint rule."""
    step = (np.arange(cells) + 0.5) / cells
    u = np.stack(np.meshgrid(step, step), axis=-1).reshape(-1, 2)
    positions = np.broadcast_to(POSITION, (len(u), 3))

    def irradiance(light: Light) -> Floats:
        wi = light.sample(positions, u)
        value, pdf = light.radiance(positions, wi) * np.maximum(wi @ NORMAL, 0.0)[:, None], light.pdf(positions, wi)
        samples = np.divide(value, pdf[:, None], out=np.zeros_like(value), where=pdf[:, None] > 0.0)
        return np.asarray(samples.mean(axis=0))

    return {name: irradiance(light) for name, light in lights.items()}


def test_a_diffuse_surface_is_lit_alike(measured: Mapping[str, dict[str, Floats]], stored_reference) -> None:
    expected = stored_reference("irradiance of lamps", irradiances, lights=CASES, cells=400)
    assert_close(measured["diffuse"], expected)


@pytest.mark.both_pythons
def test_a_mirror_shows_the_light(measured: Mapping[str, dict[str, Floats]], towards: Mapping[str, Floats]) -> None:
    assert_close(measured["mirror"], {name: CASES[name].radiance(POSITION, towards[name]) for name in CASES})


def assert_close(measured: Mapping[str, Floats], expected: Mapping[str, Floats]) -> None:
    differing = [name for name in CASES if not np.allclose(measured[name], expected[name], rtol=5e-3, atol=0.0)]
    assert {name: (measured[name], expected[name]) for name in differing} == {}


LOOK = (Layer("White", "disney", {"baseColor": (0.8, 0.8, 0.8), "roughness": 1.0, "specular": 0.0}),)
STILL = Emission((4.0, 6.0, 9.0), turns=False, group="still")
RIGS: dict[str, tuple[Light, ...]] = {
    "lamps": (
        replace(RectLight.example(), emission=replace(STILL, turns=True)),
        replace(LIGHT_KINDS["sphere"].example(), position=(1.4, -1.4, 0.7), emission=STILL),
        replace(LIGHT_KINDS["cylinder"].example(), position=(-1.9, 0.6, 0.5), emission=Emission((2.0, 2.0, 6.0))),
    ),
    "two domes": (
        DOME,
        replace(DOME, axes=LEFT_HANDED, emission=Emission((1.0, 2.0, 0.5))),
        replace(LIGHT_KINDS["disk"].example(), emission=STILL),
    ),
    "still dome": (
        replace(DOME, emission=replace(STILL, color=(1.0, 1.0, 1.0))),
        replace(RectLight.example(), emission=Emission((9.0, 6.0, 3.0))),
    ),
}


@pytest.mark.parametrize(
    ("name", "samples"),
    [("lamps", 1024), ("two domes", 256), pytest.param("still dome", 1024, marks=pytest.mark.proof)],
)
def test_frames_of_rigs_agree_with_the_reference(name: str, samples: int, worker: Worker, stored_reference) -> None:
    scene = scene_of(load_asset(builtin="sphere"), Look("white", LOOK), RIGS[name], 24)
    # Off the axis of the world, about which nothing turns.
    scene = replace(scene, camera=Camera(30.0, 20.0, (0.2, 0.1, 0.0), 4.5 * scene.asset.radius))
    pose = Pose(30.0, 75.0)
    (frame,) = render_seeds(worker, scene, pose=pose, backend="nodes", samples=samples, bounces=0)
    picture = (frame.a.astype(np.float64) + frame.b) / 2.0

    def relative_error(pose: Pose) -> float:
        label = f"rig {name} {pose.element:g} {pose.lighting:g}"
        reference = stored_reference(label, scene_pixels, scene=scene, pose=pose, count=120, samples=64)
        columns, rows = reference["pixels"].T
        return float(np.abs(picture[rows, columns] - reference["value"]).mean() / reference["value"].mean())

    # Noise, and what the closures' fit leaves: 2.4 % under the dome of `RIGS` alone.
    assert relative_error(pose) < 0.035
    # Another turn of the rig, or of all.
    assert relative_error(Pose(30.0, 45.0)) > 0.07
    assert relative_error(Pose(0.0, 45.0)) > 0.07
