"""The passes of a frame besides the beauty, rendered by Cycles.

Parts of the light are recorded during the renders of the beauty. Other passes are separate renders without light, in
which OSL shaders show albedos or normals. Cycles' own passes of depth, position, normal and uv have the values of the
first sample, which is at the centre of the pixel.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np

from lookdev.arrays import Bools, Floats32
from lookdev.codegen.source import FIRST_LIGHT_PART, LOBE_GROUPS
from lookdev.cycles import engine
from lookdev.cycles.scene import ALBEDOS, MATTE, NORMALS, BlenderScene
from lookdev.light.mapping import rotate_z
from lookdev.rendering.cryptomatte import matte_samples, normalize_coverage, rename_ids
from lookdev.rendering.frame import FEATURE_SAMPLES, RenderedFrame
from lookdev.rendering.passes import MATTES, light_layer
from lookdev.rendering.task import FrameTask, SceneTask

# The passes that Cycles itself renders at the centre of a pixel, with the names that Blender's settings have for them.
_CENTER_PASSES = {"depth": "z", "position": "position", "normal": "normal", "uv": "uv"}
_COLORS = ("diffuse", "glossy", "transmission")
# The names of Cycles' passes of colours; Blender 4.5 abbreviates them.
_COLOR_NAMES = {"DiffCol", "GlossCol", "TransCol", *(f"{kind.capitalize()} Color" for kind in _COLORS)}
# The number of pairs of id and coverage in a pixel of a matte: the most that Cycles has. Pairs with equal names are
# merged afterwards.
_MATTE_DEPTH = 16


RecordingBatch = Sequence[tuple[str, int]]
"""At most three parts of the light that one render records: pairs of a name and a number in the OSL shaders."""

RecordingPlan = tuple[Sequence[RecordingBatch], Sequence[RecordingBatch]]
"""The batches of the first and of the second half of a frame. A region of the half is rendered once for each batch."""

# Shaders record the parts of a batch by closures that are never sampled. Cycles shows the colours of closures in these
# passes, one pass for each part of a batch, in order. An entry has the names of the pass (Blender 4.5 abbreviates the
# name), and the factor that turns the pass into light (`recording` in lookdev/shaders/surface.osl).
_RECORD_PASSES = (
    (("GlossCol", "Glossy Color"), -2.0),
    (("TransCol", "Transmission Color"), -2.0),
    (("DiffCol", "Diffuse Color"), 1.0 / 64.0),
)


@contextmanager
def prepare_recording(scene: BlenderScene, task: FrameTask) -> Iterator[RecordingPlan]:
    """Set a scene up to record parts of the light, and yield the plan of the renders that record them."""
    plan = _plan_recording(task.scene)
    cycles = scene.scene.cycles
    # Cycles' Russian roulette is off: it would weight the recorded parts, but not the light itself.
    bounces = {"min_transparent_bounces": cycles.transparent_max_bounces}
    color_passes = {f"use_pass_{kind}_color": True for kind in _COLORS}
    layer = scene.scene.view_layers[0]
    with (
        engine.override_settings(cycles, bounces if plan[0] else {}),
        engine.override_settings(layer, color_passes if plan[0] else {}),
    ):
        yield plan


def _plan_recording(scene: SceneTask) -> RecordingPlan:
    """Return the plan to record all parts except the last part of each set.

    The last part is the beauty minus the other parts. If one render can record all parts, both halves record them.
    Otherwise each set is recorded in only one half: the half that has fewer parts so far. The shares of the parts in
    the light of that half are then used for the whole frame.
    """
    # The numbers of the parts in the OSL shaders, by the name of the part.
    numbers = {"direct": 1} | {group: 2 + number for number, group in enumerate(LOBE_GROUPS)}
    numbers |= {light_layer(name): FIRST_LIGHT_PART + number for number, name in enumerate(scene.light_group_names)}
    sets = [[(name, numbers[name]) for name in part_set[:-1]] for part_set in scene.part_sets]
    parts = [part for part_set in sets for part in part_set]
    if len(parts) <= len(_RECORD_PASSES):
        batches = [parts] if parts else []
        return batches, batches
    halves: tuple[list[tuple[str, int]], list[tuple[str, int]]] = ([], [])
    for part_set in sorted(sets, key=len, reverse=True):
        min(halves, key=len).extend(part_set)
    size = len(_RECORD_PASSES)
    first, second = ([half[i : i + size] for i in range(0, len(half), size)] for half in halves)
    return first, second


def read_recorded(batch: RecordingBatch, passes: Mapping[str, Floats32]) -> dict[str, Floats32]:
    """Return the parts of the light that a render has recorded, by name, (H, W, 3), row 0 at the top."""
    return {
        name: np.float32(factor) * next(passes[pass_name] for pass_name in names if pass_name in passes)[::-1]
        for (name, _), (names, factor) in zip(batch, _RECORD_PASSES, strict=False)
    }


def render_frame_passes(
    scene: BlenderScene, task: FrameTask, frame: RenderedFrame
) -> tuple[dict[str, Floats32], dict[str, tuple[str, ...]]]:
    """Render the passes of a frame that are not parts of the light, in a scene that is in the pose of the frame.

    Returns the arrays by name, and the names in each cryptomatte. The coverages in a pixel of a matte sum up to the
    frame's alpha. If mattes are requested, the albedo has the same number of samples.
    """
    requested = {*task.scene.sampling.passes}
    arrays: dict[str, Floats32] = {}
    names: dict[str, tuple[str, ...]] = {}
    with engine.override_settings(scene.scene.cycles, {"max_bounces": 0}):  # these renders show no light
        if center_passes := requested & {*_CENTER_PASSES}:
            arrays |= _render_center(scene, task, center_passes)
        if surface_passes := requested & {"albedo", "cryptomatte"}:
            covered, samples = frame.alpha > 0.0, matte_samples(frame.samples)
            albedo, mattes = _render_surfaces(scene, task, surface_passes, covered, samples)
            if "albedo" in surface_passes:
                arrays["albedo"] = albedo
            for kind, matte in mattes.items():
                matte_names = _matte_names(scene, kind)
                arrays[MATTES[kind]] = normalize_coverage(rename_ids(matte, matte_names), frame.alpha)
                names[MATTES[kind]] = tuple(sorted({*matte_names.values()}))
    return arrays, names


def _render_center(scene: BlenderScene, task: FrameTask, requested: set[str]) -> dict[str, Floats32]:
    """Return the requested passes of `_CENTER_PASSES`, which have the values at the centre of each pixel."""
    scene.set_controls(task.pose, 0, NORMALS)
    with engine.override_settings(
        scene.scene.view_layers[0], {f"use_pass_{_CENTER_PASSES[name]}": True for name in requested}
    ):
        rendered = {name: image[::-1] for name, image in engine.render_whole(scene.scene, 1).items()}
    arrays: dict[str, Floats32] = {}
    covered = rendered["UV"][..., 2:] > 0.0 if scene.has_portals else rendered["Combined"][..., 3:] > 0.0
    turn = scene.world_turn(task.pose)
    if "depth" in requested:
        arrays["depth"] = rendered["Depth"]
    if "uv" in requested:
        arrays["uv"] = np.ascontiguousarray(rendered["UV"][..., :2])
    if "position" in requested:
        pivot = np.array([*task.scene.camera.pivot, 0.0])
        position = pivot + rotate_z(rendered["Position"].astype(np.float64) + scene.origin - pivot, turn)
        arrays["position"] = np.where(covered, position, 0.0).astype(np.float32)
    if "normal" in requested:
        normal = rendered["Normal"].astype(np.float64)
        if scene.is_osl:
            # OSL shaders show normals encoded in [0, 1], and black where there is no surface.
            normal = 2.0 * rendered["Combined"][..., :3].astype(np.float64) - rendered["Combined"][..., 3:]
        length = np.linalg.norm(normal, axis=-1, keepdims=True)
        unit = rotate_z(normal, turn) / np.where(length > 0.0, length, 1.0)
        arrays["normal"] = np.where(covered, unit, 0.0).astype(np.float32)
    return arrays


def _render_surfaces(
    scene: BlenderScene, task: FrameTask, requested: set[str], covered: Bools, samples: int
) -> tuple[Floats32, dict[str, Floats32]]:
    """Return the mean albedo (H, W, 3), and mattes (H, W, 2 n) of Blender's objects and materials, and of the asset.

    `requested` has ``albedo``, ``cryptomatte`` or both, which are rendered at once. Without mattes, `FEATURE_SAMPLES`
    are used in place of `samples`. Only the box of the `covered` pixels (H, W) is rendered. With Cycles' own closures,
    the albedo is from Cycles' colour passes. Mattes have the layout that `rename_ids` reads.
    """
    has_mattes, has_albedo = "cryptomatte" in requested, "albedo" in requested
    scene.set_controls(task.pose, 0, ALBEDOS if has_albedo else MATTE)
    settings: dict[str, int | bool] = {}
    if has_mattes:
        settings |= {"pass_cryptomatte_depth": _MATTE_DEPTH}
        settings |= {f"use_pass_cryptomatte_{kind}": True for kind in ("object", "material")}
    if has_albedo and not scene.is_osl:
        settings |= {f"use_pass_{kind}_color": True for kind in _COLORS}
    box = _covered_box(covered)
    with engine.override_settings(scene.scene.view_layers[0], settings):
        rendered = engine.render_passes(scene.scene, samples if has_mattes else FEATURE_SAMPLES, box=box)

    def pad_to_frame(layers: Sequence[Floats32]) -> Floats32:
        """Return the channels of all layers of the box in an array of the whole frame, 0 outside, row 0 at the top."""
        pixels = np.concatenate(layers, axis=-1)
        image = np.zeros((*covered.shape, pixels.shape[-1]), np.float32)
        image[box[1] : box[3], box[0] : box[2]] = pixels
        return image[::-1]

    colors = [image for name, image in rendered.items() if name in _COLOR_NAMES] or [rendered["Combined"][..., :3]]
    albedo = np.ascontiguousarray(pad_to_frame([np.sum(colors, axis=0, dtype=np.float32)]))
    if not has_mattes:
        return albedo, {}
    objects, materials = (
        pad_to_frame([rendered[name] for name in sorted(rendered) if f"Crypto{kind}" in name])
        for kind in ("Object", "Material")
    )
    # The matte of the asset is the matte of its objects: by `_matte_names`, the id of the asset replaces all their ids.
    return albedo, {"object": objects, "material": materials, "asset": objects}


def _covered_box(covered: Bools) -> engine.PixelBounds:
    """Return the smallest box that contains all covered pixels of an array (H, W), whose row 0 is at the top.

    Its sides are at least `engine.MIN_SIDE` pixels.
    """
    height, width = covered.shape
    ends = []
    for size, axis in ((width, 0), (height, 1)):
        indices = np.flatnonzero(covered.any(axis=axis))
        low, high = (int(indices[0]), int(indices[-1]) + 1) if len(indices) else (0, 0)
        high = min(max(high, low + engine.MIN_SIDE), size)
        ends.append((min(low, high - engine.MIN_SIDE), high))
    (left, right), (top, bottom) = ends
    return left, height - bottom, right, height - top


def _matte_names(scene: BlenderScene, kind: str) -> dict[str, str]:
    """Return the new names for a matte, by the names of Blender's objects or materials."""
    if kind == "material":
        return scene.look_names
    paths = scene.prim_paths
    return paths if kind == "object" else dict.fromkeys(paths, scene.asset_name)
