"""The picture of an asset under a light, in float64: what a frame of Cycles must converge to.

The integral over a pixel's area and over directions is done by randomised quasi-Monte Carlo: a scrambled Sobol set
a pixel, multiple importance sampling of BSDF and light (balance heuristic) at each depth, several independent
scrambles whose spread is the standard error.

A surface that transmits is thin and looks alike from both sides. Light that meets the asset again goes on from there,
as long as a path has bounced less than `bounces` times; a direction drawn from the light that is blocked carries
nothing. What a surface's presence leaves out goes on unchanged: to the light, unless it comes straight from the camera,
to which the background is black; or, as a bounce, to the next wall.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from lookdev.asset import Asset
from lookdev.brdf import Bsdf, evaluate_cosine, pdf, sample, seen_along
from lookdev.light import Emitter, Turned
from lookdev.material import Look
from lookdev.reference.mesh import MeshScene
from lookdev.reference.shapes import Floats, Mask, Shape
from lookdev.scene import Camera, Pose, camera_rays

Ints = NDArray[np.int64]
Places = NDArray[Any]
"""Places on a surface, one a row: what a row holds is the scene's own affair."""

# At each depth: BSDF direction (2), light direction (2), whether to go straight through (1).
_DIMENSIONS = 5
_BLOCK = 2**14  # rays at a time: enough to outweigh the calls, few enough to stay in the processor's cache


@dataclass(frozen=True)
class Estimate:
    """Pixel values (P, 3), premultiplied by coverage, and their standard errors (P, 3).

    The errors are those of the mean of `scrambles` independent values of `samples` points each.
    """

    value: Floats
    error: Floats
    samples: int
    scrambles: int


class Scene(Protocol):
    """What rays meet. All directions are unit vectors (N, 3) in world space, one for each place."""

    def hit(self, origin: Floats, ray: Floats) -> tuple[Mask, Places]:
        """Return which rays from `origin` (3,) meet the scene, (N,), and where first."""

    def onward(self, place: Places, direction: Floats) -> tuple[Mask, Places]:
        """Return which rays that leave `place` meet the scene again, (N,), and where."""

    def points(self, place: Places) -> Floats:
        """Return places in world space, (N, 3) metres."""

    def frame(self, place: Places, wo: Floats) -> tuple[Floats, Floats]:
        """Return the shading frames (N, 3, 3), as of `Shape.frame`, and the normals (N, 3) of the surface itself."""

    def bsdfs(self, place: Places) -> Iterator[tuple[Ints, Bsdf]]:
        """Yield parts of the places, by index, that together are all, and the BSDF of each part."""


@dataclass(frozen=True)
class _ShapeScene:
    """A shape of one BSDF all over."""

    shape: Shape
    bsdf: Bsdf

    def hit(self, origin: Floats, ray: Floats) -> tuple[Mask, Places]:
        return self.shape.hit(origin, ray)

    def onward(self, place: Places, direction: Floats) -> tuple[Mask, Places]:
        return self.shape.onward(place, direction)

    def points(self, place: Places) -> Floats:
        return place

    def frame(self, place: Places, wo: Floats) -> tuple[Floats, Floats]:
        frame = self.shape.frame(place, wo)
        return frame, frame[:, 2]

    def bsdfs(self, place: Places) -> Iterator[tuple[Ints, Bsdf]]:
        yield np.arange(len(place)), self.bsdf


def shape_pixels(
    bsdf: Bsdf,
    shape: Shape,
    light: Emitter,
    camera: Camera,
    pose: Pose,
    resolution: tuple[int, int],
    pixels: Ints,
    *,
    bounces: int = 0,
    samples: int = 1024,
    scrambles: int = 4,
    seed: int = 0,
) -> Estimate:
    """Estimate pixels of a shape whose surface is the same all over.

    `bsdf` is that surface, of constant presence; the rest is as of `frame_pixels`.
    """
    scene = _ShapeScene(shape, bsdf)
    return _estimate(scene, light, camera, pose, resolution, pixels, bounces, samples, scrambles, seed)


def frame_pixels(
    asset: Asset,
    looks: Sequence[Look],
    light: Emitter,
    camera: Camera,
    pose: Pose,
    resolution: tuple[int, int],
    pixels: Ints,
    *,
    bounces: int = 0,
    samples: int = 128,
    scrambles: int = 8,
    seed: int = 0,
) -> Estimate:
    """Estimate pixels of an asset.

    Parameters
    ----------
    asset, looks
        What is turned, and the look of each of its slots.
    light, camera, pose, resolution
        As the frame has them; exposure 0.
    pixels : (P, 2)
        Column and row of each pixel, row 0 at the top.
    bounces
        How often a path may go on from one hit to the next; 0: only direct light.
    samples, scrambles, seed
        A power of two of points in each of `scrambles` independent sets, at least two.

    Returns
    -------
    Estimate

    Raises
    ------
    ModelError, TextureError
        A look is wrong, or an image of it is.
    AssetError
        The asset lacks a UV set that a look reads, or has a primvar of another width.
    """
    scene = MeshScene(asset, looks)
    return _estimate(scene, light, camera, pose, resolution, pixels, bounces, samples, scrambles, seed)


def _estimate(
    scene: Scene,
    light: Emitter,
    camera: Camera,
    pose: Pose,
    resolution: tuple[int, int],
    pixels: Ints,
    bounces: int,
    samples: int,
    scrambles: int,
    seed: int,
) -> Estimate:
    estimates = np.empty((len(pixels), scrambles, 3))
    turned = Turned(light, pose.lighting - pose.element)
    blocks = np.clip(len(pixels) * scrambles * samples // _BLOCK, 1, len(pixels))
    for numbers in np.array_split(np.arange(len(pixels)), blocks):
        u = _points(numbers, bounces + 1, samples, scrambles, seed)
        corner = np.repeat(pixels[numbers], scrambles * samples, axis=0)
        origin, ray = camera_rays(camera, pose, resolution, corner[:, 0] + u[:, 0], corner[:, 1] + u[:, 1])
        hit, place = scene.hit(origin, ray)
        radiance = np.zeros(ray.shape)
        radiance[hit] = _scattered(scene, turned, place[hit], ray[hit], u[hit, 2:])
        estimates[numbers] = radiance.reshape(len(numbers), scrambles, samples, 3).mean(axis=2)
    error = estimates.std(axis=1, ddof=1) / np.sqrt(scrambles)
    return Estimate(estimates.mean(axis=1), error, samples, scrambles)


def _points(numbers: Ints, depths: int, samples: int, scrambles: int, seed: int) -> Floats:
    """Return the Sobol points (N, 2 + 5 depths) of some pixels."""
    points = []
    for number in numbers:
        for scramble in range(scrambles):
            rng = np.random.default_rng([seed, number, scramble])
            points.append(qmc.Sobol(2 + _DIMENSIONS * depths, rng=rng).random(samples))
    return np.concatenate(points)


def _scattered(scene: Scene, light: Emitter, place: Places, ray: Floats, u: Floats) -> Floats:
    """Return the radiance (N, 3) that comes back along rays (N, 3) that hit the scene at `place`."""
    total = np.zeros(ray.shape)
    path = np.arange(len(ray))  # the rays still under way, in `total` and `u`
    throughput = np.ones(ray.shape)
    bounced = np.zeros(len(ray), np.bool_)
    for depth in range(u.shape[1] // _DIMENSIONS):
        here = u[path, _DIMENSIONS * depth : _DIMENSIONS * (depth + 1)]
        surface = _Surface.seen(scene, place, -ray)
        from_light = surface.to_local(light.sample(surface.point, here[:, 2:4]))
        onward = surface.meet(light, surface.sample(here[:, :2]))
        total[path] += throughput * (onward.direct + surface.meet(light, from_light).direct)

        absent = 1.0 - surface.presence
        beyond, far_place = np.zeros(len(ray), np.bool_), place.copy()
        if len(holes := np.flatnonzero(absent > 0.0)):
            beyond[holes], far_place[holes] = scene.onward(place[holes], ray[holes])
            seen = holes[bounced[holes] & ~beyond[holes]]
            total[path[seen]] += absent[seen, None] * throughput[seen] * light.radiance(surface.point[seen], ray[seen])
        # Where both ways lead to another wall, one of them is taken, as often as its share.
        through = beyond & (here[:, 4] < absent)
        weight = np.where(through[:, None], 1.0, onward.weight)
        weight /= np.where(beyond & ~through, 1.0 - absent, 1.0)[:, None]

        kept = np.flatnonzero((through | onward.blocked) & (weight > 0.0).any(axis=-1))
        straight = through[kept]
        path, throughput = path[kept], throughput[kept] * weight[kept]
        bounced = bounced[kept] | ~straight
        ray = np.where(straight[:, None], ray[kept], onward.direction[kept])
        place = onward.place[kept]
        place[straight] = far_place[kept[straight]]
    return total


@dataclass(frozen=True)
class _Meeting:
    """What some directions (N, 3) meet: `direct` (N, 3) from the light, combined, or `blocked` (N,), a `place`.

    `weight` (N, 3) is f times the cosine over the density of the BSDF's samples. Directions of no weight meet nothing.
    """

    direction: Floats
    direct: Floats
    blocked: Mask
    place: Places
    weight: Floats


@dataclass(frozen=True)
class _Surface:
    """Places of a scene, seen along `wo` (N, 3). Directions are local unless stated otherwise.

    `point` (N, 3) has the places in world space.
    """

    scene: Scene
    place: Places
    point: Floats
    frame: Floats
    facet: Floats
    wo: Floats
    parts: tuple[tuple[Ints, Bsdf], ...]

    @classmethod
    def seen(cls, scene: Scene, place: Places, viewer: Floats) -> _Surface:
        """Look at places along directions (N, 3) of the world."""
        frame, facet = scene.frame(place, viewer)
        wo = _turned(frame, viewer)
        parts = tuple((part, seen_along(bsdf, wo[part])) for part, bsdf in scene.bsdfs(place))
        return cls(scene, place, scene.points(place), frame, facet, wo, parts)

    @property
    def presence(self) -> Floats:
        """How much of the surface is there, (N,)."""
        return self._each(lambda bsdf, part: np.asarray(bsdf.presence, np.float64), ())

    def to_local(self, world: Floats) -> Floats:
        """Express directions (N, 3) of the world in the shading frame."""
        return _turned(self.frame, world)

    def sample(self, u: Floats) -> Floats:
        """Draw directions (N, 3) from the BSDF by u (N, 2)."""
        return self._each(lambda bsdf, part: sample(bsdf, self.wo[part], u[part]), (3,))

    def meet(self, light: Emitter, wi: Floats) -> _Meeting:
        """Follow directions to the light or to the next wall."""
        direction = np.einsum("nji,nj->ni", self.frame, wi)
        value = self._each(lambda bsdf, part: evaluate_cosine(bsdf, self.wo[part], wi[part]), (3,))
        density = self._each(lambda bsdf, part: pdf(bsdf, self.wo[part], wi[part]), ())
        # The shading normal and the facet must agree on which side a direction is.
        value[wi[:, 2] * np.einsum("ni,ni->n", direction, self.facet) <= 0.0] = 0.0
        followed = np.flatnonzero((value > 0.0).any(axis=-1))
        blocked, place = np.zeros(len(wi), np.bool_), self.place.copy()
        blocked[followed], place[followed] = self.scene.onward(self.place[followed], direction[followed])
        free = followed[~blocked[followed]]
        point, wi = self.point[free], direction[free]
        arriving = light.radiance(point, wi)
        direct = np.zeros(direction.shape)
        direct[free] = _divide(value[free] * arriving, density[free] + light.pdf(point, wi))
        return _Meeting(direction, direct, blocked, place, _divide(value, density))

    def _each(self, compute: Callable[[Bsdf, Ints], Floats], shape: tuple[int, ...]) -> Floats:
        result = np.empty((len(self.wo), *shape))
        for part, bsdf in self.parts:
            result[part] = compute(bsdf, part)
        return result


def _turned(frame: Floats, world: Floats) -> Floats:
    return np.asarray(np.einsum("nij,nj->ni", frame, world))


def _divide(value: Floats, density: Floats) -> Floats:
    """Divide values (N, 3) by densities (N,); 0 where there is no density, as nothing was drawn there."""
    drawn = (density > 0.0)[:, None]
    return np.where(drawn, value / np.where(drawn, density[:, None], 1.0), 0.0)
