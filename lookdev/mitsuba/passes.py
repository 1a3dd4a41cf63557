"""The passes of a frame that are not light: geometry, albedo, and cryptomattes, from the first hits of camera rays."""

from __future__ import annotations

from collections.abc import Iterator

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from lookdev.arrays import Floats, Floats32, Ints
from lookdev.light.mapping import rotate_z
from lookdev.mitsuba import sobol
from lookdev.mitsuba.surface import SceneLooks, SurfacePoints
from lookdev.mitsuba.types import UV, AnyArray, Bool, Ray3f, UInt
from lookdev.mitsuba.view import KernelView
from lookdev.rendering.cryptomatte import RANKS, matte_id, matte_samples, normalize_coverage
from lookdev.rendering.frame import FEATURE_SAMPLES
from lookdev.rendering.passes import MATTES
from lookdev.rendering.task import FrameTask

CENTER_PASSES = frozenset(("depth", "position", "normal", "uv"))
"""The passes that have the value at the centre of a pixel, and not a mean over samples."""

_NO_DEPTH = 1e10  # the depth in metres of pixels without a surface
_MAX_LAUNCH_SAMPLES = 1 << 22  # the most samples in a launch of a kernel


class Features:
    """Renders passes from the surfaces that the camera sees, through at most `bounces` other surfaces."""

    def __init__(self, looks: SceneLooks, bounces: int) -> None:
        self._mi, self._geometry, self._looks, self._bounces = looks.mi, looks.geometry, looks, bounces

    def guides(self, view: KernelView) -> tuple[Floats32, Floats32]:
        """Return the mean albedo, premultiplied, and the mean normal of each pixel, (H, W, 3) each."""
        size = FEATURE_SAMPLES
        triangle, uv, ray, hit = self._first_hits(view, 0, view.width * view.height, size)
        guides = [dr.select(hit, guide, 0.0) for guide in SurfacePoints(self._looks, triangle, uv, -ray.d, hit).guide()]
        dr.eval(guides)
        albedo, normal = (
            np.stack([np.array(dr.block_sum(component, size)) for component in guide], axis=-1) / size
            for guide in guides
        )
        shape = view.height, view.width, 3
        return albedo.astype(np.float32).reshape(shape), normal.astype(np.float32).reshape(shape)

    def _first_hits(self, view: KernelView, first: int, count: int, size: int) -> tuple[UInt, UV, Ray3f, Bool]:
        """Return triangles, barycentric coordinates, rays and hit masks of samples.

        `first` is the number of the first pixel, and `count` is the number of pixels. `size` is the number of samples
        per pixel, a power of two.
        """
        mi = self._mi
        lane = dr.arange(mi.UInt32, count * size)
        pixel = dr.opaque(mi.UInt32, first) + lane // size
        return view.first_hits(mi, self._geometry, pixel, lane & (size - 1), sobol.hash_integers(pixel))[:4]

    def center_passes(self, view: KernelView, task: FrameTask) -> dict[str, Floats32]:
        """Return the passes in `CENTER_PASSES` that a task requests, by name, (H, W, channels) each."""
        mi, requested = self._mi, CENTER_PASSES.intersection(task.scene.sampling.passes)
        pixel = dr.arange(mi.UInt32, view.width * view.height)
        row = pixel // view.width
        ray = view.rays(mi, mi.Float(pixel - row * view.width) + 0.5, mi.Float(row) + 0.5, mi.Float(0.0), mi.Float(0.0))
        triangle, uv, hit, _ = self._geometry.first_hit(ray)
        hit_point = self._geometry.at(triangle, uv, hit)
        arrays: dict[str, Floats32] = {}

        def array(value: AnyArray, background: float = 0.0) -> Floats:
            """Return values at hits as an array (H, W, channels), with `background` where nothing is hit."""
            channels = [value] if isinstance(value, mi.Float) else list(value)
            values = [np.array(dr.select(hit, channel, background), np.float64) for channel in channels]
            return np.stack(values, axis=-1).reshape(view.height, view.width, -1)

        if "depth" in requested:
            # Depth is along the axis of the camera, not along the ray.
            axis = dr.normalize(dr.cross(view.right, view.up))
            away = hit_point.point - view.origin
            arrays["depth"] = array(-dr.dot(axis, away), _NO_DEPTH).astype(np.float32)
        if "uv" in requested:
            arrays["uv"] = array(hit_point.first_uv).astype(np.float32)
        covered = array(mi.Float(1.0)) > 0.0
        angle, pivot = task.pose.element, task.scene.camera.pivot
        if "position" in requested:
            axis_of_turn = np.array((*pivot, 0.0))
            points = rotate_z(array(hit_point.point) + self._geometry.center - axis_of_turn, angle) + axis_of_turn
            arrays["position"] = np.where(covered, points, 0.0).astype(np.float32)
        if "normal" in requested:
            _, bent = SurfacePoints(self._looks, triangle, uv, -ray.d, hit).guide()
            vectors = rotate_z(array(bent), angle)
            lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
            arrays["normal"] = (vectors / np.where(lengths > 0.0, lengths, 1.0)).astype(np.float32)
        return arrays

    def mattes(
        self, view: KernelView, task: FrameTask, alpha: Floats32, samples: int
    ) -> tuple[dict[str, Floats32], dict[str, tuple[str, ...]]]:
        """Return the cryptomattes of a frame, (H, W, 2 `RANKS`) by name, and the names in each of them.

        Mattes take `matte_samples` of the frame's `samples`. Coverages in a pixel are scaled to sum up to its alpha.
        """
        scene, asset = task.scene, self._geometry.asset
        paths = scene.prims or tuple(instance.path for instance in asset.instances)
        names_of_kind = {
            "object": [path or asset.name for path in paths],
            "material": [source.name for source in scene.shaders],
            "asset": [asset.name],
        }
        size = matte_samples(samples)
        numbers = {kind: np.unique(names, return_inverse=True) for kind, names in names_of_kind.items()}
        mattes: dict[str, Floats32] = {}
        total = view.width * view.height
        for kind in names_of_kind:
            mattes[kind] = np.zeros((total, 2 * RANKS), np.float32)
        for first in range(0, total, step := max(1, _MAX_LAUNCH_SAMPLES // size)):
            count = min(step, total - first)
            layers = list(self._hits_in_depth(view, first, count, size))
            for kind, (names, number) in numbers.items():
                keys, weights = [], []
                for instance, source, weight in layers:
                    members = {"object": instance, "material": source, "asset": np.zeros_like(source)}[kind]
                    visible = weight > 0.0
                    pixel = np.repeat(np.arange(count), size)[visible]
                    keys.append(pixel * len(names) + number[members[visible]])
                    weights.append(weight[visible])
                ids = np.array([matte_id(str(name)) for name in names], np.uint32)
                coverage = np.concatenate(weights) / size
                mattes[kind][first : first + count] = _rank_by_coverage(np.concatenate(keys), coverage, ids, count)
        shape = view.height, view.width, 2 * RANKS
        arrays = {MATTES[kind]: normalize_coverage(matte.reshape(shape), alpha) for kind, matte in mattes.items()}
        return arrays, {MATTES[kind]: tuple(sorted({*names})) for kind, names in names_of_kind.items()}

    def _hits_in_depth(
        self, view: KernelView, first: int, count: int, size: int
    ) -> Iterator[tuple[Ints, Ints, Floats]]:
        """Yield the surfaces along camera rays: the first surface, then surfaces that are seen through others.

        Each item has three arrays over samples: the number of the instance, the number of the source (the code of a
        look), and the visible share of the surface.
        """
        mi = self._mi
        triangle, uv, ray, hit = self._first_hits(view, first, count, size)
        remaining = dr.select(hit, mi.Float(1.0), 0.0)
        for depth in range(1 + self._bounces if self._looks.see_through else 1):
            presence = mi.Float(1.0)
            if self._looks.see_through:
                surface = SurfacePoints(self._looks, triangle, uv, -ray.d, hit)
                presence = surface.presence()
            source, instance = self._geometry.look_of(triangle), self._geometry.instance(triangle)
            weight = remaining * presence
            dr.eval(source, instance, weight)
            yield np.array(instance), np.array(source), np.array(weight, np.float64)
            if self._looks.see_through and depth < self._bounces:
                remaining *= 1.0 - presence
                side = dr.select(dr.dot(ray.d, surface.facet) < 0.0, -surface.lift, surface.lift)
                onward = mi.Ray3f(mi.Point3f(surface.point + side * surface.facet), ray.d)
                triangle, uv, hit, _ = self._geometry.first_hit(onward, hit)
                remaining = dr.select(hit, remaining, 0.0)
                dr.eval(triangle, uv, remaining, hit)


def _rank_by_coverage(keys: Ints, weights: Floats, ids: NDArray[np.uint32], pixels: int) -> Floats32:
    """Return the pairs of id and coverage (pixels, 2 `RANKS`) of pixels, largest coverage first.

    keys : (N,) for each hit, the number of its pixel times the number of ids, plus the index of its id in `ids`;
    weights : (N,) the coverage of each hit; ids : the bits of the ids.
    """
    ranked = np.zeros((pixels, RANKS, 2), np.float32)
    unique, inverse = np.unique(keys, return_inverse=True)
    if len(unique):
        coverage = np.bincount(inverse, weights)
        pixel, entry = unique // len(ids), unique % len(ids)
        order = np.lexsort((-coverage, pixel))
        pixel, entry, coverage = pixel[order], entry[order], coverage[order]
        starts = np.flatnonzero(np.r_[True, pixel[1:] != pixel[:-1]])
        rank = np.arange(len(pixel)) - np.repeat(starts, np.diff(np.r_[starts, len(pixel)]))
        within = rank < RANKS
        ranked[pixel[within], rank[within], 0] = ids[entry[within]].view(np.float32)
        ranked[pixel[within], rank[within], 1] = coverage[within]
    return ranked.reshape(pixels, 2 * RANKS)
