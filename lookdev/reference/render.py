"""Pixels of a scene under lights, in float64: a frame of Cycles converges to them.

The integral over a pixel's area and over directions is estimated by randomised quasi-Monte Carlo: a scrambled Sobol set
for each pixel, multiple importance sampling of BSDF and light (balance heuristic) at each depth, several independent
scrambles whose spread is the standard error. Each light has directions of its own, weighed against the BSDF's alone.
The asset occludes a light up to the light's distance; lights occlude nothing.

A surface that transmits is thin and looks alike from both sides. A path that meets the scene again continues from there
up to `bounces` times; a direction drawn from the light that is blocked contributes nothing. Where a surface is absent,
a path continues unchanged: to the light, or to a black background if it comes straight from the camera; or, counted as
a bounce, to the next hit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from lookdev.brdf import Bsdf, Delta, evaluate_cosine, evaluate_diffuse, pdf, sample, seen_along
from lookdev.errors import EnvironmentMapError
from lookdev.light import Light, Shadow, Turned
from lookdev.scene import Camera, Pose, camera_rays

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
Places = NDArray[Any]
"""Places on a surface, one a row; the scene defines the content of a row."""

_BLOCK = 2**14  # rays at a time: enough to outweigh the calls, few enough for the processor's cache


@dataclass(frozen=True)
class Estimate:
    """Pixel values (P, 3), premultiplied by coverage, and the standard errors (P, 3) of these means.

    Means are over `scrambles` independent values of `samples` points each.
    """

    value: Floats
    error: Floats
    samples: int
    scrambles: int


class Scene(Protocol):
    """Surfaces that rays meet. All directions are unit vectors (N, 3) in world space, one for each place."""

    def hit(self, origin: Floats, ray: Floats) -> tuple[Mask, Places]:
        """Return which rays from `origin`, (3,) or (N, 3), meet the scene, (N,), and the places of the first hits."""

    def onward(self, place: Places, direction: Floats, spared: tuple[int, ...] = ()) -> tuple[Mask, Places]:
        """Return which rays that leave `place` meet the scene again, (N,), and the places.

        They pass parts of the groups `spared`, as `lookdev.light.Emission` has them.
        """

    def points(self, place: Places) -> Floats:
        """Return places in world space, (N, 3) metres."""

    def frame(self, place: Places, wo: Floats) -> tuple[Floats, Floats]:
        """Return the shading frames (N, 3, 3) and the geometric normals (N, 3), both on the viewer's side.

        The rows of a frame are tangent, bitangent and normal; `wo` is the direction to the viewer.
        """

    def inside(self, place: Places, wo: Floats) -> Mask:
        """Return which places are seen from inside, (N,): their normals point away from the viewer."""

    def lit(self, place: Places, light: int) -> Mask | None:
        """Return which places a light lights, by its number, (N,); None: all."""

    def bsdfs(self, place: Places, view: Floats) -> Iterator[tuple[Ints, Bsdf]]:
        """Yield a partition of the places, by index, and the BSDF of each part.

        `view` (N,) are the cosines between the shading normals and the directions to the viewer.
        """


def frame_pixels(
    scene: Scene,
    lights: Sequence[Light],
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
    """Estimate pixels of a scene.

    Parameters
    ----------
    scene, lights, camera, pose, resolution
        Of the frame, whose exposure is 0.
    pixels : (P, 2)
        Column and row of each pixel, row 0 at the top.
    bounces
        Largest number of hits on a path after the first; 0: only direct light.
    samples, scrambles, seed
        A power of two of points in each of `scrambles` independent sets, at least two.

    Raises
    ------
    ModelError, TextureError, AssetError
        As `Scene.bsdfs` of the scene.
    """
    estimates = np.empty((len(pixels), scrambles, 3))
    on_lens = 2 * (camera.lens is not None)
    turned = [_Lamp.turned(number, light, pose, camera.pivot) for number, light in enumerate(lights)]
    before = [each for each, light in zip(turned, lights, strict=True) if light.emission.camera]
    blocks = np.clip(len(pixels) * scrambles * samples // _BLOCK, 1, len(pixels))
    for numbers in np.array_split(np.arange(len(pixels)), blocks):
        u = _points(numbers, on_lens + 2 + _dimensions(lights) * (bounces + 1), samples, scrambles, seed)
        lens, u = u[:, :on_lens], u[:, on_lens:]
        corner = np.repeat(pixels[numbers], scrambles * samples, axis=0)
        x, y = corner[:, 0] + u[:, 0], corner[:, 1] + u[:, 1]
        origin, ray = camera_rays(camera, pose, resolution, x, y, lens)
        hit, place = scene.hit(origin, ray)
        radiance, hidden = np.zeros(ray.shape), np.zeros(len(ray), np.bool_)
        for lamp in before:
            # What the camera sees of a light before the surface hides the surface.
            start = np.broadcast_to(origin, ray.shape)
            nearer = hit & (lamp.light.distance(start, ray) < np.linalg.norm(scene.points(place) - start, axis=-1))
            radiance[nearer] += lamp.light.radiance(start[nearer], ray[nearer])
            hidden |= nearer
        hit &= ~hidden
        radiance[hit] += _scattered(scene, turned, place[hit], ray[hit], u[hit, 2:])
        estimates[numbers] = radiance.reshape(len(numbers), scrambles, samples, 3).mean(axis=2)
    error = estimates.std(axis=1, ddof=1) / np.sqrt(scrambles)
    return Estimate(estimates.mean(axis=1), error, samples, scrambles)


def _points(numbers: Ints, dimensions: int, samples: int, scrambles: int, seed: int) -> Floats:
    """Return the Sobol points (N, dimensions) of some pixels."""
    points = []
    for number in numbers:
        for scramble in range(scrambles):
            rng = np.random.default_rng([seed, number, scramble])
            points.append(qmc.Sobol(dimensions, rng=rng).random(samples))
    return np.concatenate(points)


def _dimensions(lights: Sequence[object]) -> int:
    """Return the dimensions at each depth: of BSDF (2) and each light (2), and whether to continue straight on (1)."""
    return 3 + 2 * len(lights)


@dataclass(frozen=True)
class _Lamp:
    """A light in the pose of a frame."""

    number: int
    light: Turned
    shadow: Shadow
    spared: tuple[int, ...]
    diffuse: float
    specular: float

    @classmethod
    def turned(cls, number: int, light: Light, pose: Pose, axis: tuple[float, float]) -> _Lamp:
        emission = light.emission
        turn = pose.lighting if emission.turns else 0.0
        turned = Turned(light, turn - pose.element, axis)
        return cls(number, turned, emission.shadow, emission.spared, emission.diffuse, emission.specular)

    @property
    def scales(self) -> bool:
        """Whether the diffuse and the specular response have factors other than 1."""
        return (self.diffuse, self.specular) != (1.0, 1.0)

    def response(self, value: Floats, diffuse: Floats) -> Floats:
        """Return f times the cosine (N, 3), `diffuse` of which is diffuse, by the light's multipliers."""
        return self.diffuse * diffuse + self.specular * (value - diffuse) if self.scales else value

    def passed(self, point: Floats, direction: Floats, occluder: Floats) -> Floats:
        """Return the share (N, 3) that reaches points (N, 3) which the scene occludes at distances (N,), or at inf."""
        occluded = occluder < self.light.distance(point, direction)
        return np.where(occluded[:, None], self.shadow.passed(np.where(occluded, occluder, 0.0)), 1.0)


def _scattered(scene: Scene, lamps: Sequence[_Lamp], place: Places, ray: Floats, u: Floats) -> Floats:
    """Return the radiance (N, 3) that comes back along rays (N, 3) that hit the scene at `place`."""
    total = np.zeros(ray.shape)
    path = np.arange(len(ray))  # the paths not ended, in `total` and `u`
    throughput = np.ones(ray.shape)
    bounced = np.zeros(len(ray), np.bool_)
    start = scene.points(place)  # of the ray, where it last bounced
    shadowed = np.ones((len(lamps), *ray.shape))  # the share of each light that the surfaces passed since then occlude
    dimensions = _dimensions(lamps)
    for depth in range(u.shape[1] // dimensions):
        here = u[path, dimensions * depth : dimensions * (depth + 1)]
        surface = _Surface.seen(scene, place, -ray)
        onward = surface.meet(lamps, surface.sample(here[:, :2]))
        direct = onward.direct
        deltas = [surface.follow(lamps, number) for number in range(surface.deltas)]
        for each in deltas:
            direct = direct + each.direct
        for number, lamp in enumerate(lamps):
            drawn = lamp.light.sample(surface.point, here[:, 2 + 2 * number : 4 + 2 * number])
            direct = direct + surface.meet([lamp], _to_local(surface.frame, drawn)).direct
        total[path] += throughput * direct

        absent = 1.0 - surface.presence
        beyond, far_place = np.zeros(len(ray), np.bool_), place.copy()
        if len(holes := np.flatnonzero(absent > 0.0)):
            if any(lamp.spared for lamp in lamps):
                raise EnvironmentMapError("a part that can be seen through is lit by a light that spares some parts")
            beyond[holes], far_place[holes] = scene.onward(place[holes], ray[holes])
            seen = holes[bounced[holes]]
            point = surface.point[seen]
            travelled = np.linalg.norm(point - start[seen], axis=-1)
            far = scene.points(far_place[seen])
            occluder = np.where(beyond[seen], np.linalg.norm(far - point, axis=-1), np.inf)
            for lamp, share in zip(lamps, shadowed, strict=True):
                share[seen] *= 1.0 - lamp.shadow.passed(travelled)
                reaching = share[seen] * lamp.passed(point, ray[seen], occluder)
                reaching *= lamp.light.radiance(point, ray[seen])
                total[path[seen]] += absent[seen, None] * throughput[seen] * reaching
        # Where both directions lead to another hit, one of them is chosen in proportion to its share.
        through = beyond & (here[:, -1] < absent)
        if deltas:
            among = np.where(beyond, (here[:, -1] - absent) / np.where(absent < 1.0, 1.0 - absent, 1.0), here[:, -1])
            onward = _chosen([onward, *deltas], among)
        weight = np.where(through[:, None], 1.0, onward.weight)
        weight /= np.where(beyond & ~through, 1.0 - absent, 1.0)[:, None]

        kept = np.flatnonzero((through | onward.blocked) & (weight > 0.0).any(axis=-1))
        straight = through[kept]
        path, throughput = path[kept], throughput[kept] * weight[kept]
        bounced = bounced[kept] | ~straight
        ray = np.where(straight[:, None], ray[kept], onward.direction[kept])
        start = np.where(straight[:, None], start[kept], surface.point[kept])
        shadowed = np.where(straight[:, None], shadowed[:, kept], 1.0)
        place = onward.place[kept]
        place[straight] = far_place[kept[straight]]
    return total


@dataclass(frozen=True)
class _Meeting:
    """What rays along directions (N, 3) meet: lights, and another place where they are `blocked` (N,).

    `direct` (N, 3) is the lights' part of the estimator, by the balance heuristic; `weight` (N, 3) is f times the
    cosine over the density of the BSDF's samples. Rays without weight are not traced.
    """

    direction: Floats
    direct: Floats
    blocked: Mask
    place: Places
    weight: Floats


def _chosen(meetings: Sequence[_Meeting], u: Floats) -> _Meeting:
    """Choose one meeting of each row by u (N,), of those that are blocked in proportion to their weights."""
    shares = np.stack([np.where(each.blocked, each.weight.mean(axis=-1), 0.0) for each in meetings])
    ends, total = np.cumsum(shares, axis=0), shares.sum(axis=0)
    number = np.minimum((u * total >= ends).sum(axis=0), len(meetings) - 1)
    rows = np.arange(len(u))

    def pick(name: str) -> Any:
        return np.stack([getattr(each, name) for each in meetings])[number, rows]

    share = shares[number, rows]
    scale = np.divide(total, share, out=np.zeros_like(total), where=share > 0.0)
    weight = pick("weight") * scale[:, None]
    return _Meeting(pick("direction"), pick("direct"), pick("blocked") & (share > 0.0), pick("place"), weight)


@dataclass(frozen=True)
class _Surface:
    """Places of a scene seen along `wo` (N, 3), and their points (N, 3) in world space. Directions are local.

    `parts` are the rows of each look, its BSDF and the terms of it that scatter along single directions.
    """

    scene: Scene
    place: Places
    point: Floats
    frame: Floats
    facet: Floats
    wo: Floats
    parts: tuple[tuple[Ints, Bsdf, tuple[Delta, ...]], ...]

    @classmethod
    def seen(cls, scene: Scene, place: Places, viewer: Floats) -> _Surface:
        """Return places seen along directions (N, 3) of the world."""
        frame, facet = scene.frame(place, viewer)
        wo, inside = _to_local(frame, viewer), scene.inside(place, viewer)
        parts = tuple(
            (part, seen_along(bsdf, wo[part]), bsdf.deltas(wo[part], inside[part]))
            for part, bsdf in scene.bsdfs(place, wo[:, 2])
        )
        return cls(scene, place, scene.points(place), frame, facet, wo, parts)

    @property
    def deltas(self) -> int:
        """The most terms that scatter along single directions of any place."""
        return max((len(deltas) for _, _, deltas in self.parts), default=0)

    @property
    def presence(self) -> Floats:
        return self._each(lambda bsdf, part: np.asarray(bsdf.presence, np.float64), ())

    def sample(self, u: Floats) -> Floats:
        """Draw directions (N, 3) from the BSDF by u (N, 2)."""
        return self._each(lambda bsdf, part: sample(bsdf, self.wo[part], u[part]), (3,))

    def meet(self, lamps: Sequence[_Lamp], wi: Floats) -> _Meeting:
        """Trace rays along directions (N, 3) to lights and to the next hit."""
        value = self._each(lambda bsdf, part: evaluate_cosine(bsdf, self.wo[part], wi[part]), (3,))
        density = self._each(lambda bsdf, part: pdf(bsdf, self.wo[part], wi[part]), ())
        diffuse = np.zeros(wi.shape)
        if any(lamp.scales for lamp in lamps):
            diffuse = self._each(lambda bsdf, part: evaluate_diffuse(bsdf, self.wo[part], wi[part]), (3,))
        return self._meet(lamps, wi, value, density, diffuse)

    def follow(self, lamps: Sequence[_Lamp], number: int) -> _Meeting:
        """Trace rays along the single directions of a term of each part, by its number."""
        wi, value = np.zeros(self.wo.shape), np.zeros(self.wo.shape)
        for part, _, deltas in self.parts:
            if number < len(deltas):
                wi[part], value[part] = deltas[number].direction, deltas[number].value
        return self._meet(lamps, wi, value, np.ones(len(wi)), None)

    def _meet(
        self, lamps: Sequence[_Lamp], wi: Floats, value: Floats, density: Floats, diffuse: Floats | None
    ) -> _Meeting:
        """Trace rays; without `diffuse`, (N, 3), no light is drawn in their directions, and all is specular."""
        direction = np.einsum("nji,nj->ni", self.frame, wi)
        # The shading normal and the facet must agree on which side a direction is.
        height = np.einsum("ni,ni->n", direction, self.facet)
        opaque = self._each(lambda bsdf, part: np.full(len(part), not bsdf.transmits(self.wo[part])), ()) > 0.0
        value[(wi[:, 2] * height <= 0.0) | (opaque & (height < 0.0))] = 0.0
        followed = np.flatnonzero((value > 0.0).any(axis=-1))
        blocked, place = np.zeros(len(wi), np.bool_), self.place.copy()
        blocked[followed], place[followed] = self.scene.onward(self.place[followed], direction[followed])
        point, towards = self.point[followed], direction[followed]
        occluders: dict[tuple[int, ...], Floats] = {}
        for spared in {(), *(lamp.spared for lamp in lamps)}:
            met, far = blocked[followed], place[followed]
            if spared:
                met, far = self.scene.onward(self.place[followed], towards, spared)
            distance = np.linalg.norm(self.scene.points(far) - point, axis=-1)
            occluders[spared] = np.where(met, distance, np.inf)
        direct = np.zeros(direction.shape)
        if diffuse is not None:
            diffuse[(value == 0.0).all(axis=-1)] = 0.0
        for lamp in lamps:
            passed = lamp.passed(point, towards, occluders[lamp.spared])
            if (linked := self.scene.lit(self.place[followed], lamp.number)) is not None:
                passed[~linked] = 0.0
            lit = np.flatnonzero(passed.any(axis=-1))
            arriving = passed[lit] * lamp.light.radiance(point[lit], towards[lit])
            rows, drawn = followed[lit], 0.0 if diffuse is None else lamp.light.pdf(point[lit], towards[lit])
            response = lamp.response(value[rows], 0.0 * value[rows] if diffuse is None else diffuse[rows])
            direct[rows] += _divide(response * arriving, density[rows] + drawn)
        return _Meeting(direction, direct, blocked, place, _divide(value, density))

    def _each(self, compute: Callable[[Bsdf, Ints], Floats], shape: tuple[int, ...]) -> Floats:
        result = np.empty((len(self.wo), *shape))
        for part, bsdf, _ in self.parts:
            result[part] = compute(bsdf, part)
        return result


def _to_local(frame: Floats, world: Floats) -> Floats:
    """Express directions (N, 3) of the world in frames (N, 3, 3)."""
    return np.asarray(np.einsum("nij,nj->ni", frame, world))


def _divide(value: Floats, density: Floats) -> Floats:
    """Divide values (N, 3) by densities (N,); 0 where the density is 0."""
    drawn = (density > 0.0)[:, None]
    return np.where(drawn, value / np.where(drawn, density[:, None], 1.0), 0.0)
