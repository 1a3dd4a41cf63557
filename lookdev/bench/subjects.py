"""The assets, looks and lights that benchmarks render by name, their scenes, and the keys of their pictures."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from scipy.ndimage import gaussian_filter

from lookdev.asset import BUILTINS, Asset, Instance, Mesh, Slot
from lookdev.asset.builtin import make_sphere
from lookdev.asset.normals import area_vectors, smooth_normals
from lookdev.asset.store import make_asset
from lookdev.cache import Content, cached_files
from lookdev.light import (
    DiskLight,
    Dome,
    Emission,
    EnvironmentMap,
    Light,
    RectLight,
    SphereLight,
    load_environment,
    prepare_light,
)  # fmt: skip
from lookdev.light.placement import placement
from lookdev.material import Input, Layer, Look, Texture
from lookdev.output.exr import write_frame
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import SceneTask
from lookdev.scene import Pose, Sampling, Scene

T = TypeVar("T")

POSE = Pose(0.0, 0.0)  # neither the asset nor the light is rotated
MILLION = 1_000_000  # triangles
MAX_LAYERS = 8
_LOBES = {"metallic": 1.0, "clearcoat": 1.0, "anisotropic": 0.7}  # parameters of a varied look, if it has them
_MASK_SIZE = 256  # side of a mask texture, texels
_MASK_VERSION = 1  # part of a mask file's key in the cache: increase it with any change of the mask


@dataclass(frozen=True)
class SubjectEntry(Generic[T]):
    """A named subject: its description for `lookdev bench --list`, and the function that makes the object."""

    help: str
    make: Callable[[], T]


@dataclass(frozen=True)
class BenchScene(SubjectEntry[Asset]):
    """An asset, and the number of bounces of light; the renderer skips bounces if the asset is convex."""

    bounces: int = Sampling.bounces


def make_boulder(triangles: int) -> Asset:
    """Return a wavy sphere of about `triangles` triangles, with a radius of about 1 m, whose waves occlude each other.

    The sphere is displaced by a sum of plane waves, so its shape does not depend on the number of triangles.
    """
    # A sphere of s segments and r = s / 2 rings has s (r - 2) quads and 2 s triangles. Since a quad is two triangles,
    # these are s (s - 2) triangles in all.
    segments = 2 * max(4, round(0.5 * (1.0 + np.sqrt(1.0 + triangles))))
    sphere = make_sphere(segments, segments // 2).meshes[0]
    directions = sphere.points.astype(np.float64)
    heights, rng = np.zeros(len(directions)), np.random.default_rng(6)
    for octave in range(5):
        for direction in rng.normal(size=(4, 3)):
            frequency = 3.0 * 2.0**octave * direction / np.linalg.norm(direction)
            heights += 0.03 * 0.5**octave * np.sin(directions @ frequency + rng.uniform(0.0, 2.0 * np.pi))
    points = (sphere.points * (1.0 + heights)[:, None]).astype(np.float32)
    corners, sizes = sphere.corner_points, sphere.face_sizes
    areas = area_vectors(points[corners].astype(np.float64), sizes)
    normals = smooth_normals(areas, corners, sizes, len(points)).astype(np.float32)
    mesh = Mesh("/boulder", points, corners, sizes, sphere.face_slots, normals, None, sphere.uvs)
    return make_asset(f"boulder of {triangles} triangles", [mesh], [Instance(0, np.eye(4))], [Slot("/boulder")])


SCENES: dict[str, BenchScene] = {
    "sphere": BenchScene("convex: direct light only", BUILTINS["sphere"]),
    "shaderball": BenchScene("the built-in shaderball", BUILTINS["shaderball"]),
    "suzanne": BenchScene("with three bounces of indirect light", BUILTINS["suzanne"], 3),
    "million": BenchScene("a boulder of a million triangles", partial(make_boulder, MILLION)),
}


def layered_look(layers: int) -> Look:
    """Return a stack of Disney layers. The masks above the base are textures, so no layer is optimized away."""
    stack = [Layer("layer0", "disney", {"baseColor": (0.35, 0.06, 0.04), "roughness": 0.35, "clearcoat": 0.5})]
    for number in range(1, layers):
        share = number / MAX_LAYERS
        inputs: dict[str, Input] = {
            "baseColor": (0.8 * share, 0.3, 0.7 - 0.6 * share),
            "metallic": float(number % 2),
            "roughness": 0.2 + 0.6 * share,
            "sheen": share,
            "anisotropic": 0.5 * (number % 3),
        }
        stack.append(Layer(f"layer{number}", "disney", inputs, cloudy_mask(number)))
    return Look(f"{layers} layers", tuple(stack))


def varied_look(number: int) -> Look:
    """Return one of many looks of one Disney layer, with a colour and a roughness of its own.

    The bits of `number` choose the lobes, so that all looks together need eight different shader programs.
    """
    share = number / (number + 4.0)
    color, roughness = (0.2 + 0.6 * share, 0.5, 0.7 - 0.5 * share), 0.25 + 0.5 * share
    lobes = {name: weight * (number >> bit & 1) for bit, (name, weight) in enumerate(_LOBES.items())}
    return _disney(f"look{number}", "Layer", baseColor=color, roughness=roughness, **lobes)()


def cloudy_mask(number: int) -> Texture:
    """Return a cloudy mask; `number` determines its random pattern. Its file is made unless the cache has it."""

    def write(file: Path) -> None:
        clouds = gaussian_filter(np.random.default_rng(number).random((_MASK_SIZE, _MASK_SIZE)), 8.0, mode="wrap")
        levels = np.clip(0.5 + 0.25 * (clouds - clouds.mean()) / clouds.std(), 0.0, 1.0)
        write_frame(file, np.repeat(levels[..., None], 3, axis=-1), np.ones_like(levels), {})

    (content,) = cached_files("bench", f"mask{number}.{_MASK_VERSION}", lambda: (Content.store_written(".exr", write),))
    return Texture(content.path, "r", "raw")


def _disney(name: str, layer: str, **inputs: Input) -> Callable[[], Look]:
    """Return a function that makes a look of one Disney layer."""
    return lambda: Look(name, (Layer(layer, "disney", inputs),))


def _transmitting_look() -> Look:
    """Return a transmitting Pixar layer under a varnish, which lets the light of the layer below through."""
    body: dict[str, Input] = {"surfaceColor": (0.8, 0.55, 0.3), "roughness": 0.4, "clear": 0.5, "back": 0.4}
    varnish: dict[str, Input] = {"surfaceColor": (0.9, 0.95, 0.9), "roughness": 0.15, "clear": 0.9}
    return Look("pixar", (Layer("Body", "pixar", body), Layer("Varnish", "pixar", varnish, 1.0, "transmit")))


LOOKS: dict[str, SubjectEntry[Look]] = {
    "plastic": SubjectEntry(
        "blue plastic, one Disney layer", _disney("plastic", "Plastic", baseColor=(0.1, 0.2, 0.5), roughness=0.3)
    ),
    "car_paint": SubjectEntry(
        "red paint under a clear coat, one Disney layer",
        _disney("car_paint", "Paint", baseColor=(0.46, 0.02, 0.02), roughness=0.4, clearcoat=1.0, clearcoatGloss=0.9),
    ),
    "metal": SubjectEntry(
        "anisotropic metal, one Disney layer",
        _disney("metal", "Metal", baseColor=(0.9, 0.75, 0.5), metallic=1.0, roughness=0.35, anisotropic=0.8),
    ),
    "brushed_metal": SubjectEntry(
        "aluminium, brushed strongly, one Disney layer",
        _disney("brushed_metal", "Brushed", baseColor=(0.91, 0.92, 0.92), metallic=1.0, roughness=0.3, anisotropic=0.9),
    ),
    "copper": SubjectEntry(
        "isotropic metal, smooth enough to see itself in its recesses, one Disney layer",
        _disney("copper", "Copper", baseColor=(0.95, 0.64, 0.54), metallic=1.0, roughness=0.25),
    ),
    "stack": SubjectEntry("six Disney layers, their masks textures", partial(layered_look, 6)),
    "pixar": SubjectEntry("two Pixar layers that transmit light, and each other's light", _transmitting_look),
}


def _facing_origin(x: float, y: float, z: float) -> dict[str, Any]:
    """Return the arguments `position` and `axes` of a light at (x, y, z) that faces the origin."""
    backward = np.array([x, y, z]) / np.linalg.norm([x, y, z])
    across = np.cross((0.0, 0.0, 1.0), backward)
    across /= np.linalg.norm(across)
    matrix = np.eye(4)
    matrix[:3] = np.stack([across, np.cross(backward, across), backward, (x, y, z)], axis=-1)
    position, axes, _ = placement(matrix)
    return {"position": position, "axes": axes}


def _three_lamps(dome: str) -> tuple[Light, ...]:
    """Return a dimmed dome light with a rectangle as key light, a disk as fill light and a sphere as rim light."""
    return (
        prepare_light(load_environment(builtin=dome)).with_emission(Emission((0.3,) * 3)),
        RectLight(width=1.2, height=0.8, emission=Emission((18.0, 16.0, 14.0)), **_facing_origin(-2.2, -2.2, 1.8)),
        DiskLight(radii=(0.7, 0.7), emission=Emission((3.0, 4.0, 5.0)), **_facing_origin(2.6, -1.4, 0.6)),
        SphereLight(radius=0.3, position=(0.8, 2.6, 1.6), emission=Emission((30.0, 30.0, 36.0))),
    )


def rectangles(count: int) -> tuple[Light, ...]:
    """Return rectangle lights at random positions above the horizon, whose total power does not depend on `count`."""
    rng = np.random.default_rng(7)
    lights = []
    for _ in range(count):
        height, azimuth = rng.uniform(0.1, 0.95), rng.uniform(0.0, 2.0 * np.pi)
        across = 3.0 * np.sqrt(1.0 - height * height)
        position = _facing_origin(across * np.cos(azimuth), across * np.sin(azimuth), 3.0 * height)
        r, g, b = (rng.uniform(0.2, 1.0, 3) * 40.0 / count).tolist()
        lights.append(RectLight(width=0.6, height=0.4, emission=Emission((r, g, b)), **position))
    return tuple(lights)


IBLS: dict[str, str] = {
    "studio": "soft boxes: large, and about equally bright",
    "city": "a small and very bright sun",
    "forest": "light through leaves: many small bright spots",
}
"""The built-in environment maps, with their descriptions."""

RIGS: dict[str, SubjectEntry[tuple[Light, ...]]] = {
    "studio+3": SubjectEntry(
        "the studio, dimmed, with a rectangle, a disk and a sphere", partial(_three_lamps, "studio")
    ),
    "city+3": SubjectEntry("the city, dimmed, with a rectangle, a disk and a sphere", partial(_three_lamps, "city")),
    "lamp": SubjectEntry("1 rectangles", partial(rectangles, 1)),
    "100lamps": SubjectEntry("100 rectangles", partial(rectangles, 100)),
}
"""Rigs, which are sets of lights, around an asset of radius 1 at the origin; `scale_lights` fits them to an asset."""


@cache
def bench_asset(scene: str) -> Asset:
    """Return the asset of one of `SCENES`."""
    return SCENES[scene].make()


@cache
def bench_environment(ibl: str) -> EnvironmentMap:
    """Return one of the built-in environment maps `IBLS`."""
    return load_environment(builtin=ibl)


@cache
def bench_light(ibl: str) -> Dome:
    """Return the dome light with one of the built-in maps `IBLS`."""
    return prepare_light(bench_environment(ibl))


def scale_lights(lights: Sequence[Light], asset: Asset) -> tuple[Light, ...]:
    """Scale and move lights around the unit ball, so that they stand around the bounding ball of an asset."""
    return tuple(light.rescale(asset.radius, asset.center) for light in lights)


def bench_lights(name: str, asset: Asset) -> tuple[Light, ...]:
    """Return the lights with a name in `IBLS` or `RIGS`; the lights of a rig are placed around an asset."""
    return scale_lights(RIGS[name].make(), asset) if name in RIGS else (bench_light(name),)


def bench_scene(
    name: str,
    look: Look,
    lights: Sequence[Light],
    resolution: int,
    backend: str = "exact",
    *,
    asset: Asset | None = None,
    denoise: bool = False,
) -> SceneTask:
    """Return a scene with one look and the default sampling; `name` is one of `SCENES`.

    With `denoise`, the scene is denoised if its backend can do so. `asset` replaces the asset of the named scene.
    """
    scene = Scene.of_look(asset or bench_asset(name), look, lights[0], (resolution, resolution))
    denoised = denoise and BACKENDS[backend].has_denoising_guides
    sampling = Sampling(bounces=SCENES[name].bounces, denoise="measured" if denoised else "off")
    return scene_task(replace(scene, lights=tuple(lights)), sampling, backend)


def picture_key(scene: SceneTask, look: Look, ibl: str, pose: Pose = POSE) -> str:
    """Return a text of everything that a converged picture depends on, except its sampling and its shader's code.

    After a change of sampling or code, renders are therefore measured against an earlier reference. If the change
    alters the picture, the measurement shows a bias.
    """
    # The digest of a dome light includes the tables for sampling its map; the digest of the map does not.
    light = [light.digest for light in scene.lights] if ibl in RIGS else bench_environment(ibl).digest
    parts = {
        "asset": scene.asset.digest,
        "light": light,
        "camera": asdict(scene.camera),
        "pose": asdict(pose),
        "resolution": scene.resolution,
        "bounces": scene.sampling.bounces,
        "look": hashlib.sha256(repr(look).encode()).hexdigest(),
        "backend": scene.backend,
        "version": BACKENDS[scene.backend].version(),
    }
    return json.dumps(parts, sort_keys=True)
