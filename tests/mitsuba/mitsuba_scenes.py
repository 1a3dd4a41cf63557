"""Scenes of the tests of Mitsuba, of which each part is compared with the reference by itself."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from agreement import Arrays, StoredReference, check_frame, comparison, estimate_of, scene_pixels
from frames import orbit_camera, scene_of
from light_rigs import RIG_LOOKS, RIGS, grey
from numpy.typing import NDArray

from lookdev.asset import Asset, Instance, load_asset, make_asset
from lookdev.light import Light
from lookdev.light.link import Link
from lookdev.material import Layer, Look
from lookdev.reference.mesh import MeshScene
from lookdev.rendering.results import Rendered
from lookdev.scene import Film, Pose, Scene, camera_rays
from lookdev.scene.linking import link_lights

RenderSeeds = Callable[..., list[Rendered]]
"""Renders a scene: pose, number of seeds, and what of its sampling is not the default."""

LIGHTS_OF_HEADS = {
    **{kind: (kind,) for kind in ("rect", "disk", "sphere")},
    "controls": ("shadow", "response", "seen"),
    "images": ("texture", "profile", "local_dome"),
    **{kind: (kind,) for kind in ("cylinder", "distant")},
}
"""Of `RIGS`; lights whose control is that they do not turn are in a test of their own."""


def dressed(asset: Asset | str, layers: Sequence[Layer], *lights: Light, size: int = 40) -> Scene:
    """Return a scene of one look, whose camera sees the asset whole."""
    shape = load_asset(builtin=asset) if isinstance(asset, str) else asset
    return scene_of(shape, Look("look", tuple(layers)), lights, size)


def looks_side_by_side(
    looks: Mapping[str, Sequence[Layer]], shape: Asset, light: Light, size: tuple[int, int]
) -> Scene:
    """Return copies of an asset of one slot, five in a row, each of a look of its own."""
    meshes, instances, wears = [], [], {}
    for number, (name, layers) in enumerate(looks.items()):
        row, column = divmod(number, 5)
        matrix = np.eye(4)
        matrix[:3, 3] = 2.3 * column, 0.0, -2.3 * row
        slots = np.full_like(shape.meshes[0].face_slots, number)
        meshes.append(replace(shape.meshes[0], name=name, face_slots=slots))
        instances.append(Instance(number, matrix, f"/{name}"))
        wears[f"/{name}"] = Look(name, tuple(layers))
    asset = make_asset("looks", meshes, instances, [replace(shape.slots[0], path=path) for path in wears])
    return Scene(asset, wears, (light,), orbit_camera(asset.center, asset.radius), Film(size))


def heads_under_lights(folder: Path, size: int, names: Sequence[str] = tuple(LIGHTS_OF_HEADS)) -> Scene:
    """Return a row of heads, each of them linked to lights of `LIGHTS_OF_HEADS`, and all to a dome."""
    head = load_asset(builtin="suzanne")
    lights, instances = [], []
    for number, name in enumerate(names):
        x = 2.6 * (number - 0.5 * (len(names) - 1))
        matrix = np.eye(4)
        matrix[0, 3] = x
        instances.append(Instance(0, matrix, f"/{name}/head"))
        link = Link(((f"/{name}", "expandPrims"),))
        for light in (light for rig in LIGHTS_OF_HEADS[name] for light in RIGS[rig](folder)):
            beside = light.scaled(1.0, (x, 0.0, 0.0))
            lights.append(beside.with_emission(replace(beside.emission, light_link=link)))
    path = instances[0].path
    row = make_asset("heads", (replace(head.meshes[0], name=path),), instances, (replace(head.slots[0], path=path),))
    made = link_lights(row, {path: Look("look", (RIG_LOOKS["plastic"],))}, (*lights, grey()))
    camera = orbit_camera(made.asset.center, made.asset.radius)
    return Scene(made.asset, made.wears, made.lights, camera, Film((len(names) * size, size)), made.lit, made.groups)


def assert_parts_agree(
    name: str,
    frames: Sequence[Rendered],
    scene: Scene,
    pose: Pose,
    per_frame: int,
    stored: StoredReference,
    **options: int,
) -> Arrays:
    """Compare random pixels of frames, of so many samples, with the reference: all, and those of each instance."""
    found = stored(name, scene_pixels, scene=scene, pose=pose, **options)
    pixels, reference = found["pixels"], estimate_of(found)
    halves = np.stack([half for frame in frames for half in (frame.a, frame.b)])
    parts, failed = part_of(scene, pose, pixels), []
    groups = {instance.path: parts == number for number, instance in enumerate(scene.asset.instances)}
    for path, own in {"all": np.ones(len(pixels), np.bool_), **groups}.items():
        assert own.sum() > 20, f"{path} has {own.sum()} pixels"
        expected = replace(reference, value=reference.value[own], error=reference.error[own])
        finding = check_frame(path, halves, frames[0].alpha, len(frames) * per_frame, pixels[own], expected)
        if not finding.passed:
            failed += [f"{path}: {finding.summary}", *finding.details]
    with comparison(halves.mean(axis=0, dtype=np.float64), reference.value, pixels):
        assert not failed, "\n".join(failed)
    return found


def part_of(scene: Scene, pose: Pose, pixels: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the instance whose place is next to what the middle of each pixel (P, 2) shows; -1 where it is nothing."""
    meshes = MeshScene(scene.asset, scene.looks)
    hit, place = meshes.intersect(*camera_rays(scene.camera, pose, scene.film.resolution, *(pixels.T + 0.5)))
    centers = np.array([instance.matrix[:3, 3] for instance in scene.asset.instances])
    found = np.full(len(pixels), -1)
    found[hit] = np.linalg.norm(meshes.points(place)[hit][:, None] - centers, axis=-1).argmin(axis=1)
    return found
