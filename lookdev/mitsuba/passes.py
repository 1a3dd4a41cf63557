"""The passes of a frame besides its light: what rays of the camera meet."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from lookdev.light.mapping import rotate_z
from lookdev.mitsuba import sobol
from lookdev.mitsuba.geometry import Geometry
from lookdev.mitsuba.surface import Looks, Surface
from lookdev.mitsuba.view import View
from lookdev.rendering.cryptomatte import RANKS, filled, matte_id, matte_samples
from lookdev.rendering.frame import FEATURE_SAMPLES, Image
from lookdev.rendering.passes import MATTES
from lookdev.rendering.task import FrameTask

Floats = NDArray[np.float64]

CENTRAL = frozenset(("depth", "position", "normal", "uv"))
_NOTHING = 1e10  # metres, where no surface is
_MOST_SAMPLES = 1 << 22  # of a launch
_UNSEEN = np.iinfo(np.uint32).max


class Features:
    """What of a scene is seen from the camera, in one variant's arrays."""

    def __init__(self, mi: Any, geometry: Geometry, looks: Looks, bounces: int) -> None:
        self._mi = mi
        self._geometry = geometry
        self._looks = looks
        self._bounces = bounces

    def guides(self, view: View) -> tuple[Image, Image]:
        """Return the mean albedos, premultiplied, and normals (H, W, 3) of all pixels."""
        mi, size = self._mi, FEATURE_SAMPLES
        lane = dr.arange(mi.UInt32, view.width * view.height * size)
        pixel = lane // size
        triangle, uv, ray, hit, _ = view.seen(mi, self._geometry, pixel, lane & (size - 1), sobol.hashed(pixel))
        guides = [dr.select(hit, each, 0.0) for each in Surface(self._looks, triangle, uv, -ray.d, hit).guide()]
        dr.eval(guides)
        albedo, normal = (
            np.stack([np.array(dr.block_sum(component, size)) for component in each], axis=-1) / size for each in guides
        )
        shape = view.height, view.width, 3
        return albedo.astype(np.float32).reshape(shape), normal.astype(np.float32).reshape(shape)

    def central(self, view: View, task: FrameTask) -> dict[str, Image]:
        """Return what the rays through the centres of pixels meet, (H, W, channels) by the names of passes."""
        mi, wanted = self._mi, CENTRAL.intersection(task.scene.sampling.passes)
        pixel = dr.arange(mi.UInt32, view.width * view.height)
        row = pixel // view.width
        ray = view.rays(mi, mi.Float(pixel - row * view.width) + 0.5, mi.Float(row) + 0.5, mi.Float(0.0), mi.Float(0.0))
        triangle, uv, hit, _ = self._geometry.first_hit(ray)
        place = self._geometry.at(triangle, uv, hit)
        shown: dict[str, Image] = {}

        def array(value: Any, nothing: float = 0.0) -> Floats:
            channels = [value] if isinstance(value, mi.Float) else list(value)
            values = [np.array(dr.select(hit, each, nothing), np.float64) for each in channels]
            return np.stack(values, axis=-1).reshape(view.height, view.width, -1)

        if "depth" in wanted:
            # Along the camera's axis a ray through the film passes 1 where its direction is not yet normalised.
            axis = dr.normalize(dr.cross(view.right, view.up))
            away = place.point - view.origin
            shown["depth"] = array(-dr.dot(axis, away), _NOTHING).astype(np.float32)
        if "uv" in wanted:
            shown["uv"] = array(place.first_uv).astype(np.float32)
        covered = array(mi.Float(1.0)) > 0.0
        angle, pivot = task.pose.element, task.scene.camera.pivot
        if "position" in wanted:
            axis_of_turn = np.array((*pivot, 0.0))
            points = rotate_z(array(place.point) + self._geometry.center - axis_of_turn, angle) + axis_of_turn
            shown["position"] = np.where(covered, points, 0.0).astype(np.float32)
        if "normal" in wanted:
            _, bent = Surface(self._looks, triangle, uv, -ray.d, hit).guide()
            vectors = rotate_z(array(bent), angle)
            lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
            shown["normal"] = (vectors / np.where(lengths > 0.0, lengths, 1.0)).astype(np.float32)
        return shown

    def mattes(
        self, view: View, task: FrameTask, alpha: Image, samples: int
    ) -> tuple[dict[str, Image], dict[str, Any]]:
        """Return the mattes of a frame, (H, W, channels) by their names, and the names of things in each.

        They take half as many samples as the frame, and sum up to its alpha.
        """
        scene, asset = task.scene, self._geometry.asset
        paths = scene.prims or tuple(each.path for each in asset.instances)
        things = {
            "object": [path or asset.name for path in paths],
            "material": [source.name for source in scene.shaders],
            "asset": [asset.name],
        }
        size = matte_samples(samples)
        numbers = {kind: np.unique(names, return_inverse=True) for kind, names in things.items()}
        found: dict[str, Image] = {}
        total = view.width * view.height
        for kind in things:
            found[kind] = np.zeros((total, 2 * RANKS), np.float32)
        for first in range(0, total, step := max(1, _MOST_SAMPLES // size)):
            count = min(step, total - first)
            layers = list(self._layers(view, first, count, size))
            for kind, (names, number) in numbers.items():
                keys, weights = [], []
                for instance, worn, weight in layers:
                    thing = {"object": instance, "material": worn, "asset": np.zeros_like(worn)}[kind]
                    seen = weight > 0.0
                    pixel = np.repeat(np.arange(count), size)[seen]
                    keys.append(pixel * len(names) + number[thing[seen]])
                    weights.append(weight[seen])
                ids = np.array([matte_id(str(name)) for name in names], np.uint32)
                of = np.concatenate(keys), np.concatenate(weights) / size
                found[kind][first : first + count] = _ranked(*of, ids, count)
        shape = view.height, view.width, 2 * RANKS
        arrays = {MATTES[kind]: filled(each.reshape(shape), alpha) for kind, each in found.items()}
        return arrays, {MATTES[kind]: tuple(sorted({*names})) for kind, names in things.items()}

    def _layers(self, view: View, first: int, count: int, size: int) -> Iterator[tuple[Any, Any, Floats]]:
        """Yield the instances and the sources that samples of pixels meet, and how much of each is seen."""
        mi = self._mi
        lane = dr.arange(mi.UInt32, count * size)
        pixel = dr.opaque(mi.UInt32, first) + lane // size
        triangle, uv, ray, hit, _ = view.seen(mi, self._geometry, pixel, lane & (size - 1), sobol.hashed(pixel))
        left = dr.select(hit, mi.Float(1.0), 0.0)
        for depth in range(1 + self._bounces if self._looks.see_through else 1):
            presence = mi.Float(1.0)
            if self._looks.see_through:
                surface = Surface(self._looks, triangle, uv, -ray.d, hit)
                presence = surface.presence()
            worn, instance = self._geometry.worn(triangle), self._geometry.instance(triangle)
            shown = left * presence
            dr.eval(worn, instance, shown)
            yield np.array(instance), np.array(worn), np.array(shown, np.float64)
            if self._looks.see_through and depth < self._bounces:
                left *= 1.0 - presence
                side = dr.select(dr.dot(ray.d, surface.facet) < 0.0, -surface.lift, surface.lift)
                onward = mi.Ray3f(mi.Point3f(surface.point + side * surface.facet), ray.d)
                triangle, uv, hit, _ = self._geometry.first_hit(onward, hit)
                left = dr.select(hit, left, 0.0)
                dr.eval(triangle, uv, left, hit)


def _ranked(keys: NDArray[Any], weights: Floats, ids: NDArray[np.uint32], pixels: int) -> Image:
    """Return ids and coverage (P, 2 RANKS) of pixels' things, those of most coverage first.

    keys : (N,) a pixel times the number of things, plus the thing.
    """
    ranked = np.zeros((pixels, RANKS, 2), np.float32)
    different, inverse = np.unique(keys, return_inverse=True)
    if len(different):
        coverage = np.bincount(inverse, weights)
        pixel, thing = different // len(ids), different % len(ids)
        order = np.lexsort((-coverage, pixel))
        pixel, thing, coverage = pixel[order], thing[order], coverage[order]
        starts = np.flatnonzero(np.r_[True, pixel[1:] != pixel[:-1]])
        rank = np.arange(len(pixel)) - np.repeat(starts, np.diff(np.r_[starts, len(pixel)]))
        kept = rank < RANKS
        ranked[pixel[kept], rank[kept], 0] = ids[thing[kept]].view(np.float32)
        ranked[pixel[kept], rank[kept], 1] = coverage[kept]
    return ranked.reshape(pixels, 2 * RANKS)
