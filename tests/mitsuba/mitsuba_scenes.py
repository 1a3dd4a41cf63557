"""Scenes of the tests of Mitsuba, whose parts are compared with the reference one by one."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from agreement import Arrays, StoredReference, check_frame, comparison, estimate_of, scene_pixels
from frames import orbit_camera, scene_of
from light_rigs import RIG_LOOKS, RIGS, grey

from lookdev.arrays import Ints
from lookdev.asset import Asset, Instance, load_asset, make_asset
from lookdev.light import Light
from lookdev.light.emission import LightLink
from lookdev.material import Layer, Look
from lookdev.reference.mesh import MeshScene
from lookdev.rendering.results import WorkerFrame
from lookdev.scene import Film, Pose, Scene, camera_rays
from lookdev.scene.scene import link_lights

RenderSeeds = Callable[..., list[WorkerFrame]]
"""Renders a scene, from a pose, a number of seeds, and those fields of the sampling that differ from the defaults."""

LIGHTS_OF_HEADS = {
    **{kind: (kind,) for kind in ("rect", "disk", "sphere")},
    "controls": ("shadow", "response", "seen"),
    "images": ("texture", "profile", "local_dome"),
    **{kind: (kind,) for kind in ("cylinder", "distant")},
}
"""Lights of `RIGS`; those that do not turn have a test of their own."""


def scene_with_look(asset: Asset | str, layers: Sequence[Layer], *lights: Light, size: int = 40) -> Scene:
    """Return a scene of one look, whose camera sees all of the asset."""
    shape = load_asset(builtin=asset) if isinstance(asset, str) else asset
    return scene_of(shape, Look("look", tuple(layers)), lights, size)


def looks_side_by_side(
    looks: Mapping[str, Sequence[Layer]], shape: Asset, light: Light, size: tuple[int, int]
) -> Scene:
    """Return copies of an asset with one slot, five in a row, each with a look of its own."""
    meshes, instances, look_of_slot = [], [], {}
    for number, (name, layers) in enumerate(looks.items()):
        row, column = divmod(number, 5)
        matrix = np.eye(4)
        matrix[:3, 3] = 2.3 * column, 0.0, -2.3 * row
        slots = np.full_like(shape.meshes[0].face_slots, number)
        meshes.append(replace(shape.meshes[0], name=name, face_slots=slots))
        instances.append(Instance(number, matrix, f"/{name}"))
        look_of_slot[f"/{name}"] = Look(name, tuple(layers))
    asset = make_asset("looks", meshes, instances, [replace(shape.slots[0], path=path) for path in look_of_slot])
    return Scene(asset, look_of_slot, (light,), orbit_camera(asset.center, asset.radius), Film(size))


def heads_under_lights(folder: Path, size: int, names: Sequence[str] = tuple(LIGHTS_OF_HEADS)) -> Scene:
    """Return a row of heads, each linked to lights of `LIGHTS_OF_HEADS`, and all linked to a dome."""
    head = load_asset(builtin="suzanne")
    lights, instances = [], []
    for number, name in enumerate(names):
        x = 2.6 * (number - 0.5 * (len(names) - 1))
        matrix = np.eye(4)
        matrix[0, 3] = x
        instances.append(Instance(0, matrix, f"/{name}/head"))
        link = LightLink(((f"/{name}", "expandPrims"),))
        for light in (light for rig in LIGHTS_OF_HEADS[name] for light in RIGS[rig](folder)):
            moved = light.rescale(1.0, (x, 0.0, 0.0))
            lights.append(moved.with_emission(replace(moved.emission, light_link=link)))
    path = instances[0].path
    row = make_asset("heads", (replace(head.meshes[0], name=path),), instances, (replace(head.slots[0], path=path),))
    looks, camera = {path: Look("look", (RIG_LOOKS["plastic"],))}, orbit_camera(row.center, row.radius)
    return link_lights(Scene(row, looks, (*lights, grey()), camera, Film((len(names) * size, size))))


def assert_parts_agree(
    name: str,
    frames: Sequence[WorkerFrame],
    scene: Scene,
    pose: Pose,
    per_frame: int,
    stored: StoredReference,
    **options: int,
) -> Arrays:
    """Compare random pixels of frames with the reference: all pixels, and those of each instance."""
    arrays = stored(name, scene_pixels, scene=scene, pose=pose, **options)
    pixels, reference = arrays["pixels"], estimate_of(arrays)
    halves = np.stack([half for frame in frames for half in (frame.a, frame.b)])
    parts, failed = part_of(scene, pose, pixels), []
    groups = {instance.path: parts == number for number, instance in enumerate(scene.asset.instances)}
    for path, in_part in {"all": np.ones(len(pixels), np.bool_), **groups}.items():
        assert in_part.sum() > 20, f"{path} has {in_part.sum()} pixels"
        expected = replace(reference, value=reference.value[in_part], error=reference.error[in_part])
        finding = check_frame(path, halves, frames[0].alpha, len(frames) * per_frame, pixels[in_part], expected)
        if not finding.passed:
            failed += [f"{path}: {finding.summary}", *finding.details]
    with comparison(halves.mean(axis=0, dtype=np.float64), reference.value, pixels):
        assert not failed, "\n".join(failed)
    return arrays


def part_of(scene: Scene, pose: Pose, pixels: Ints) -> Ints:
    """Return the instance nearest to the surface at the centre of each pixel (P, 2); -1 where there is no surface."""
    meshes = MeshScene(scene.asset, scene.looks)
    hit, hits = meshes.intersect(*camera_rays(scene.camera, pose, scene.film.resolution, *(pixels.T + 0.5)))
    centers = np.array([instance.matrix[:3, 3] for instance in scene.asset.instances])
    instances = np.full(len(pixels), -1)
    instances[hit] = np.linalg.norm(meshes.points(hits)[hit][:, None] - centers, axis=-1).argmin(axis=1)
    return instances
