"""The passes of a frame besides its light: cheap renders, in which OSL shaders show their features.

Cycles' own passes of places are those of the first sample, which is at the centre of the pixel.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.codegen import ShaderSource
from lookdev.codegen.source import FIRST_LIGHT_PART, LOBE_GROUPS
from lookdev.cycles import engine
from lookdev.cycles.scene import ALBEDOS, MATTE, NORMALS, Scene
from lookdev.rendering.cryptomatte import filled, matte_samples, renamed
from lookdev.rendering.frame import FEATURE_SAMPLES, Image, RenderedFrame
from lookdev.rendering.passes import LIGHTS, MATTES, light_layer, parts_of_light
from lookdev.rendering.task import FrameTask

_OF_CYCLES = {"depth": "z", "position": "position", "normal": "normal", "uv": "uv"}
_COLORS = ("diffuse", "glossy", "transmission")
# Blender 4.5 abbreviates the names of passes.
_COLOR_NAMES = {"DiffCol", "GlossCol", "TransCol", *(f"{kind.capitalize()} Color" for kind in _COLORS)}
_MATTE_DEPTH = 16  # the most that Cycles has: things of one name are merged afterwards


@dataclass(frozen=True)
class Passes:
    """Arrays (H, W, channels) by the names of `lookdev.rendering.passes.arrays_of`, and the names in each matte."""

    arrays: Mapping[str, Image]
    names: Mapping[str, tuple[str, ...]]


Batch = Sequence[tuple[str, int]]
"""Parts of the light that are recorded in one render, at most three: names, and numbers in the shaders' template."""

Plan = tuple[Sequence[Batch], Sequence[Batch]]
"""The renders of each half of a frame."""

# The passes that have them, and what their values are multiplied by; Blender 4.5 abbreviates names.
_RECORDS = (
    (("GlossCol", "Glossy Color"), -2.0),
    (("TransCol", "Transmission Color"), -2.0),
    (("DiffCol", "Diffuse Color"), 1.0 / 64.0),
)


@contextmanager
def recording(scene: Scene, task: FrameTask) -> Iterator[Plan]:
    """Yield the parts that have to be recorded, by renders of each half."""
    plan = _plan(task)
    cycles = scene.scene.cycles
    # Cycles' Russian roulette would weigh recorded light, and not the light itself.
    bounces = {"min_transparent_bounces": cycles.transparent_max_bounces}
    stored = {f"use_pass_{kind}_color": True for kind in _COLORS}
    layer = scene.scene.view_layers[0]
    with _changed(cycles, bounces if plan[0] else {}), _changed(layer, stored if plan[0] else {}):
        yield plan


def _sets(task: FrameTask) -> list[list[tuple[str, int]]]:
    """Return the sets of parts that sum up to the beauty, with the numbers of parts in the shaders' template."""
    wanted, scene = task.scene.sampling.passes, task.scene
    lobes = {each for source in scene.shaders if isinstance(source, ShaderSource) for each in source.recorded}
    sets = []
    if "lobes" in wanted:
        sets.append([(group, 2 + LOBE_GROUPS.index(group)) for group in LOBE_GROUPS if group in lobes])
    if "direct" in wanted:
        sets.append([("direct", 1), ("indirect", -1)])
    if LIGHTS in wanted:
        names = dict.fromkeys(scene.light_groups[: len(scene.lights)])
        sets.append([(light_layer(name), FIRST_LIGHT_PART + number) for number, name in enumerate(names)])
    return [each for each in sets if each]


def _plan(task: FrameTask) -> Plan:
    """Return what is recorded: of each set of parts all but the last, which is what remains.

    What one render can record is recorded in both halves. Else each set is recorded in the half that has fewer so far:
    its shares of that half are those of the frame.
    """
    every = [each[:-1] for each in _sets(task)]
    parts = [part for each in every for part in each]
    if len(parts) <= len(_RECORDS):
        batches = [parts] if parts else []
        return batches, batches
    halves: tuple[list[tuple[str, int]], list[tuple[str, int]]] = ([], [])
    for each in sorted(every, key=len, reverse=True):
        min(halves, key=len).extend(each)
    size = len(_RECORDS)
    first, second = ([half[i : i + size] for i in range(0, len(half), size)] for half in halves)
    return first, second


def record_of(batch: Batch, passes: Mapping[str, Image]) -> dict[str, Image]:
    """Return what shaders recorded (`recording` in the template), rows top-down."""
    return {
        name: np.float32(factor) * next(passes[each] for each in names if each in passes)[::-1]
        for (name, _), (names, factor) in zip(batch, _RECORDS, strict=False)
    }


def completed(task: FrameTask, frame: RenderedFrame) -> dict[str, Image]:
    """Return the passes of a frame with what remains of the light, and black for parts that no look or light has."""
    passes = dict(frame.passes)
    beauty = 0.5 * (frame.a + frame.b) if frame.raw is None else frame.raw
    for *others, (last, _) in _sets(task):
        passes[last] = beauty - sum(passes[name] for name, _ in others)
    for name in parts_of_light(task.scene.sampling.passes, task.scene.names_of_light) - {*passes}:
        passes[name] = np.zeros_like(beauty)
    return passes


def render_frame_passes(scene: Scene, task: FrameTask, alpha: Image, samples: int) -> Passes:
    """Render the passes that a task wants, in a scene that shows its pose; `alpha`, `samples` are those of the frame.

    Mattes sum up to the frame's alpha; where they are wanted, albedos take as many samples.
    """
    wanted = {*task.scene.sampling.passes}
    arrays: dict[str, Image] = {}
    names: dict[str, tuple[str, ...]] = {}
    with _changed(scene.scene.cycles, {"max_bounces": 0}):  # light is not what these renders are for
        if central := wanted & {*_OF_CYCLES}:
            arrays |= _central(scene, task, central)
        if surfaces := wanted & {"albedo", "cryptomatte"}:
            albedo, mattes = _surfaces(scene, task, surfaces, alpha > 0.0, matte_samples(samples))
            if "albedo" in surfaces:
                arrays["albedo"] = albedo
            for kind, matte in mattes.items():
                known = _names(scene, kind)
                arrays[MATTES[kind]] = filled(renamed(matte, known), alpha)
                names[MATTES[kind]] = tuple(sorted({*known.values()}))
    return Passes(arrays, names)


def _central(scene: Scene, task: FrameTask, wanted: set[str]) -> dict[str, Image]:
    """Return what is at the centre of each pixel."""
    scene.control(task.pose, 0, NORMALS)
    with _changed(scene.scene.view_layers[0], {f"use_pass_{_OF_CYCLES[name]}": True for name in wanted}):
        shown = {name: each[::-1] for name, each in engine.render_whole(scene.scene, 1).items()}
    found: dict[str, Image] = {}
    covered = shown["UV"][..., 2:] > 0.0 if scene.by_portals else shown["Combined"][..., 3:] > 0.0
    turn = scene.turn_of_world(task.pose)
    if "depth" in wanted:
        found["depth"] = shown["Depth"]
    if "uv" in wanted:
        found["uv"] = np.ascontiguousarray(shown["UV"][..., :2])
    if "position" in wanted:
        pivot = np.array([*task.scene.camera.pivot, 0.0])
        place = pivot + _turned(shown["Position"].astype(np.float64) + scene.origin - pivot, turn)
        found["position"] = np.where(covered, place, 0.0).astype(np.float32)
    if "normal" in wanted:
        normal = shown["Normal"].astype(np.float64)
        if scene.by_shaders:
            # Shown in [0, 1], and black where there is no surface.
            normal = 2.0 * shown["Combined"][..., :3].astype(np.float64) - shown["Combined"][..., 3:]
        length = np.linalg.norm(normal, axis=-1, keepdims=True)
        unit = _turned(normal, turn) / np.where(length > 0.0, length, 1.0)
        found["normal"] = np.where(covered, unit, 0.0).astype(np.float32)
    return found


def _surfaces(
    scene: Scene, task: FrameTask, wanted: set[str], covered: NDArray[np.bool_], samples: int
) -> tuple[Image, dict[str, Image]]:
    """Return the mean albedo of each pixel, and the coverage (H, W, 2 n) of Blender's objects and materials.

    `wanted` is what of ``albedo`` and ``cryptomatte`` is rendered, in one render with `samples` for both. The albedo of
    closures is theirs; coverage is as `renamed` takes it.
    """
    matted, colored = "cryptomatte" in wanted, "albedo" in wanted
    scene.control(task.pose, 0, ALBEDOS if colored else MATTE)
    settings: dict[str, Any] = {}
    if matted:
        settings |= {"pass_cryptomatte_depth": _MATTE_DEPTH}
        settings |= {f"use_pass_cryptomatte_{kind}": True for kind in ("object", "material")}
    if colored and not scene.by_shaders:
        settings |= {f"use_pass_{kind}_color": True for kind in _COLORS}
    box = _around(covered)
    with _changed(scene.scene.view_layers[0], settings):
        shown = engine.render_passes(scene.scene, samples if matted else FEATURE_SAMPLES, box=box)

    def whole(layers: Sequence[Image]) -> Image:
        found = np.concatenate(layers, axis=-1)
        image = np.zeros((*covered.shape, found.shape[-1]), np.float32)
        image[box[1] : box[3], box[0] : box[2]] = found
        return image[::-1]

    colors = [each for name, each in shown.items() if name in _COLOR_NAMES] or [shown["Combined"][..., :3]]
    albedo = np.ascontiguousarray(whole([np.sum(colors, axis=0, dtype=np.float32)]))
    if not matted:
        return albedo, {}
    objects, materials = (
        whole([shown[name] for name in sorted(shown) if f"Crypto{kind}" in name]) for kind in ("Object", "Material")
    )
    return albedo, {"object": objects, "material": materials, "asset": objects}


def _around(covered: NDArray[np.bool_]) -> engine.Box:
    """Return the least box of pixels that are covered, rows top-down."""
    height, width = covered.shape
    ends = []
    for size, axis in ((width, 0), (height, 1)):
        there = np.flatnonzero(covered.any(axis=axis))
        low, high = (int(there[0]), int(there[-1]) + 1) if len(there) else (0, 0)
        high = min(max(high, low + engine.SMALLEST), size)
        ends.append((min(low, high - engine.SMALLEST), high))
    (left, right), (top, bottom) = ends
    return left, height - bottom, right, height - top


def _names(scene: Scene, kind: str) -> dict[str, str]:
    """Return the names in a matte, by those of Blender's data."""
    if kind == "material":
        return scene.names_of_materials
    names = scene.names_of_objects
    return names if kind == "object" else dict.fromkeys(names, scene.name_of_asset)


def _turned(vectors: NDArray[np.float64], degrees: float) -> NDArray[np.float64]:
    """Return vectors (..., 3) turned about the vertical."""
    sine, cosine = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=-1)


@contextmanager
def _changed(owner: Any, values: Mapping[str, Any]) -> Iterator[None]:
    """Give settings of Blender other values, and those before back also after a fault: the worker goes on."""
    before = {name: getattr(owner, name) for name in values}
    try:
        for name, value in values.items():
            setattr(owner, name, value)
        yield
    finally:
        for name, value in before.items():
            setattr(owner, name, value)
