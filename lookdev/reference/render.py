"""Estimates pixels of a scene under lights in float64: the values to which frames of Cycles converge.

The integral over the area of a pixel and over directions is estimated by randomised quasi-Monte Carlo. Each pixel has
several independently scrambled Sobol sets, whose spread gives the standard error. At each depth of a path, BSDF and
lights are sampled, and combined by multiple importance sampling with the balance heuristic. Each light has its own
samples, which are weighted against the samples of the BSDF only. The asset occludes a light that is behind it; lights
occlude nothing.

A surface that transmits is thin and looks the same from both sides. A path that hits the scene again continues from
there, up to `bounces` times. A blocked sample of a light contributes nothing.

Where the presence of a surface is below 1, a part of the path continues unchanged through it: to the next hit, which
counts as a bounce, or else to the light. A path straight from the camera sees black in place of the light.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Protocol

import numpy as np
from scipy.stats import qmc

from lookdev.arrays import Bools, Floats, Ints, Records
from lookdev.brdf import Bsdf, Delta, bsdf_for_views, evaluate_cosine, evaluate_diffuse, pdf, sample
from lookdev.errors import EnvironmentMapError
from lookdev.light import Light, PosedLight, Shadow
from lookdev.scene import Camera, Pose, camera_rays

Hits = Records
"""Hits of rays on a surface, an array (N,) of records; the scene defines the fields of a record."""

# The number of rays that are traced at a time. It is large enough to outweigh the cost of calls, and small enough for
# the processor's cache.
_BLOCK = 2**14


@dataclass(frozen=True)
class Estimate:
    """Estimated values (P, 3) of P pixels, premultiplied by coverage, and their standard errors (P, 3).

    A value is the mean over `scrambles` independent sets of points, each of `samples` points.
    """

    value: Floats
    error: Floats
    samples: int
    scrambles: int


class ReferenceScene(Protocol):
    """The surfaces that rays are traced against. All directions are unit vectors (N, 3) in world space."""

    def intersect(self, origin: Floats, ray: Floats) -> tuple[Bools, Hits]:
        """Return a mask (N,) of the rays from `origin`, (3,) or (N, 3), that hit the scene, and the first hits."""

    def trace_onward(self, hits: Hits, direction: Floats, excluded_groups: tuple[int, ...] = ()) -> tuple[Bools, Hits]:
        """Return a mask (N,) of the rays leaving `hits` that hit the scene again, and the new hits.

        Rays pass through the parts in `excluded_groups`. These are the parts that a light's shadow excludes
        (`Emission.shadow_excluded`).
        """

    def points(self, hits: Hits) -> Floats:
        """Return the positions of hits in world space, (N, 3), in metres."""

    def frame(self, hits: Hits, wo: Floats) -> tuple[Floats, Floats]:
        """Return the shading frames (N, 3, 3) and the geometric normals (N, 3), both on the viewer's side.

        The rows of a frame are tangent, bitangent and normal; `wo` is the direction to the viewer.
        """

    def is_inside(self, hits: Hits, wo: Floats) -> Bools:
        """Return a mask (N,) of the hits seen from inside: their normals point away from the viewer."""

    def is_reached_by(self, hits: Hits, light: int) -> Bools | None:
        """Return a mask (N,) of the hits that light number `light` illuminates; None if it illuminates all hits."""

    def bsdfs(self, hits: Hits, view: Floats) -> Iterator[tuple[Ints, Bsdf]]:
        """Yield, for each look, the indices of the hits with this look, and the BSDF at these hits.

        Each hit is yielded once. `view` (N,) has the cosines between the shading normals and the directions to the
        viewer.
        """


def frame_pixels(
    scene: ReferenceScene,
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
        The content of the frame, whose exposure is 0.
    pixels : (P, 2)
        Column and row of each pixel, row 0 at the top.
    bounces
        Largest number of hits on a path after the first; 0 means only direct light.
    samples, scrambles, seed
        A pixel has `scrambles` independent sets, at least two, of `samples` points each, a power of two.

    Raises
    ------
    ModelError, TextureError, AssetError
        As in `bsdfs` of the scene.
    """
    estimates = np.empty((len(pixels), scrambles, 3))
    lens_dimensions = 2 * (camera.lens is not None)
    lamps = [_Lamp.in_pose(number, light, pose, camera.pivot) for number, light in enumerate(lights)]
    # The lights that the camera sees.
    visible_lamps = [lamp for lamp, light in zip(lamps, lights, strict=True) if light.emission.camera]
    blocks = np.clip(len(pixels) * scrambles * samples // _BLOCK, 1, len(pixels))
    for numbers in np.array_split(np.arange(len(pixels)), blocks):
        # Numbers in [0, 1) for each ray: for the lens, if there is one (2), for the position in the pixel (2), then for
        # each depth of the path.
        u = _sobol_points(
            numbers, lens_dimensions + 2 + _depth_dimensions(lights) * (bounces + 1), samples, scrambles, seed
        )
        lens, u = u[:, :lens_dimensions], u[:, lens_dimensions:]
        corner = np.repeat(pixels[numbers], scrambles * samples, axis=0)
        x, y = corner[:, 0] + u[:, 0], corner[:, 1] + u[:, 1]
        origin, ray = camera_rays(camera, pose, resolution, x, y, lens)
        is_hit, hits = scene.intersect(origin, ray)
        radiance, is_hidden = np.zeros(ray.shape), np.zeros(len(ray), np.bool_)
        for lamp in visible_lamps:
            # A light that the camera sees hides a surface that is behind the light.
            start = np.broadcast_to(origin, ray.shape)
            is_nearer = is_hit & (lamp.light.distance(start, ray) < np.linalg.norm(scene.points(hits) - start, axis=-1))
            radiance[is_nearer] += lamp.light.radiance(start[is_nearer], ray[is_nearer])
            is_hidden |= is_nearer
        is_hit &= ~is_hidden
        radiance[is_hit] += _trace_paths(scene, lamps, hits[is_hit], ray[is_hit], u[is_hit, 2:])
        estimates[numbers] = radiance.reshape(len(numbers), scrambles, samples, 3).mean(axis=2)
    error = estimates.std(axis=1, ddof=1) / np.sqrt(scrambles)
    return Estimate(estimates.mean(axis=1), error, samples, scrambles)


def _sobol_points(numbers: Ints, dimensions: int, samples: int, scrambles: int, seed: int) -> Floats:
    """Return the Sobol points (N, dimensions) of the pixels `numbers`, pixel by pixel, and in a pixel set by set."""
    rngs = (np.random.default_rng([seed, number, scramble]) for number in numbers for scramble in range(scrambles))
    return np.concatenate([qmc.Sobol(dimensions, rng=rng).random(samples) for rng in rngs])


def _depth_dimensions(lights: Sequence[object]) -> int:
    """Return the dimensions at each depth: BSDF (2), each light (2), and the choice to continue straight on (1)."""
    return 3 + 2 * len(lights)


@dataclass(frozen=True)
class _Lamp:
    """A light in the pose of a frame; `number` is its position among the lights of the scene."""

    number: int
    light: PosedLight
    shadow: Shadow
    shadow_excluded: tuple[int, ...]  # groups of parts that do not occlude this light
    diffuse: float  # multiplier of the diffuse response
    specular: float  # multiplier of the other response

    @classmethod
    def in_pose(cls, number: int, light: Light, pose: Pose, axis: tuple[float, float]) -> _Lamp:
        """Return a light turned about the vertical line at `axis` (x, y), by its rotation relative to the asset."""
        emission = light.emission
        posed = PosedLight(light, (pose.lighting if emission.turns else 0.0) - pose.element, axis)
        return cls(number, posed, emission.shadow, emission.shadow_excluded, emission.diffuse, emission.specular)

    @property
    def has_multipliers(self) -> bool:
        """Whether a multiplier differs from 1."""
        return (self.diffuse, self.specular) != (1.0, 1.0)

    def response(self, value: Floats, diffuse: Floats) -> Floats:
        """Return f times the cosine, `value` (N, 3), times the light's multipliers; `diffuse` is its diffuse part."""
        return self.diffuse * diffuse + self.specular * (value - diffuse) if self.has_multipliers else value

    def transmittance(self, point: Floats, direction: Floats, occluder: Floats) -> Floats:
        """Return the share (N, 3) of the light that arrives at points (N, 3) along directions (N, 3).

        `occluder` (N,) is the distance of the first surface in the direction, or inf.
        """
        occluded = occluder < self.light.distance(point, direction)
        return np.where(occluded[:, None], self.shadow.transmittance(np.where(occluded, occluder, 0.0)), 1.0)


def _trace_paths(scene: ReferenceScene, lamps: Sequence[_Lamp], hits: Hits, ray: Floats, u: Floats) -> Floats:
    """Return the radiance (N, 3) that the surfaces hit by rays (N, 3) scatter back along the rays.

    `u` (N, dimensions) has the random numbers of each path, depth by depth (`_depth_dimensions`).
    """
    total = np.zeros(ray.shape)
    path = np.arange(len(ray))  # the indices in `total` and `u` of paths that have not ended
    throughput = np.ones(ray.shape)
    has_bounced = np.zeros(len(ray), np.bool_)
    start = scene.points(hits)  # of each ray: the point where the path last changed its direction
    # (lights, N, 3): the share of each light that is occluded at `start` by the surfaces that the ray has passed since.
    shadowed = np.ones((len(lamps), *ray.shape))
    dimensions = _depth_dimensions(lamps)
    for depth in range(u.shape[1] // dimensions):
        u_depth = u[path, dimensions * depth : dimensions * (depth + 1)]
        surface = _Surface.build(scene, hits, -ray)
        # Direct light is estimated from a sample of the BSDF, along which the path may continue (`onward`), from the
        # delta terms, and from a sample of each light.
        onward = surface.trace(lamps, surface.sample(u_depth[:, :2]))
        direct = onward.direct
        deltas = [surface.trace_delta(lamps, number) for number in range(surface.deltas)]
        for delta in deltas:
            direct = direct + delta.direct
        for number, lamp in enumerate(lamps):
            light_directions = lamp.light.sample(surface.point, u_depth[:, 2 + 2 * number : 4 + 2 * number])
            direct = direct + surface.trace([lamp], _to_local(surface.frame, light_directions)).direct
        total[path] += throughput * direct

        # Where the surface is absent, the ray goes straight on. `has_beyond` marks the rays that then hit a surface.
        absent = 1.0 - surface.presence
        has_beyond, beyond_hits = np.zeros(len(ray), np.bool_), hits.copy()
        if len(absent_hits := np.flatnonzero(absent > 0.0)):
            if any(lamp.shadow_excluded for lamp in lamps):
                raise EnvironmentMapError(
                    "a part that can be seen through is lit by a light whose shadow excludes some parts"
                )
            has_beyond[absent_hits], beyond_hits[absent_hits] = scene.trace_onward(hits[absent_hits], ray[absent_hits])
            # The light from there arrives, except on rays that come straight from the camera.
            exits = absent_hits[has_bounced[absent_hits]]
            point = surface.point[exits]
            travelled = np.linalg.norm(point - start[exits], axis=-1)
            beyond_points = scene.points(beyond_hits[exits])
            occluder = np.where(has_beyond[exits], np.linalg.norm(beyond_points - point, axis=-1), np.inf)
            for lamp, share in zip(lamps, shadowed, strict=True):
                share[exits] *= 1.0 - lamp.shadow.transmittance(travelled)
                reaching = share[exits] * lamp.transmittance(point, ray[exits], occluder)
                reaching *= lamp.light.radiance(point, ray[exits])
                total[path[exits]] += absent[exits, None] * throughput[exits] * reaching
        # Straight on and in the sampled direction there may be another hit. A random number chooses straight on with
        # the probability `absent`.
        goes_through = has_beyond & (u_depth[:, -1] < absent)
        if deltas:
            choice = np.where(
                has_beyond, (u_depth[:, -1] - absent) / np.where(absent < 1.0, 1.0 - absent, 1.0), u_depth[:, -1]
            )
            onward = _choose_rays([onward, *deltas], choice)
        weight = np.where(goes_through[:, None], 1.0, onward.weight)
        weight /= np.where(has_beyond & ~goes_through, 1.0 - absent, 1.0)[:, None]

        continuing = np.flatnonzero((goes_through | onward.blocked) & (weight > 0.0).any(axis=-1))
        is_straight = goes_through[continuing]
        path, throughput = path[continuing], throughput[continuing] * weight[continuing]
        has_bounced = has_bounced[continuing] | ~is_straight
        ray = np.where(is_straight[:, None], ray[continuing], onward.direction[continuing])
        start = np.where(is_straight[:, None], start[continuing], surface.point[continuing])
        shadowed = np.where(is_straight[:, None], shadowed[:, continuing], 1.0)
        hits = onward.hits[continuing]
        hits[is_straight] = beyond_hits[continuing[is_straight]]
    return total


@dataclass(frozen=True)
class _TracedRays:
    """Rays from surfaces along sampled directions, with the light that arrives and the next hits.

    A ray whose value of f is 0 is not traced.
    """

    direction: Floats  # (N, 3)
    direct: Floats  # (N, 3): the contribution of the lights to the estimate, by the balance heuristic
    blocked: Bools  # (N,): the rays that hit another surface
    hits: Hits  # (N,): the hits on other surfaces
    weight: Floats  # (N, 3): f times the cosine over the density of the BSDF's samples


def _choose_rays(alternatives: Sequence[_TracedRays], u: Floats) -> _TracedRays:
    """Choose by u (N,), for each path, one of several rays that hit a surface, in proportion to their weights."""
    shares = np.stack([np.where(rays.blocked, rays.weight.mean(axis=-1), 0.0) for rays in alternatives])
    ends, total = np.cumsum(shares, axis=0), shares.sum(axis=0)
    number = np.minimum((u * total >= ends).sum(axis=0), len(alternatives) - 1)
    rows = np.arange(len(u))
    share = shares[number, rows]
    scale = np.divide(total, share, out=np.zeros_like(total), where=share > 0.0)
    names = [field.name for field in fields(_TracedRays)]
    picked = {name: np.stack([getattr(rays, name) for rays in alternatives])[number, rows] for name in names}
    rays = _TracedRays(**picked)
    return replace(rays, blocked=rays.blocked & (share > 0.0), weight=rays.weight * scale[:, None])


@dataclass(frozen=True)
class _Surface:
    """Hits of a scene with their BSDFs, seen from given directions.

    `wo` and the arguments `wi` are in the local frames of the hits.
    """

    scene: ReferenceScene
    hits: Hits
    point: Floats  # (N, 3), in world space
    frame: Floats  # (N, 3, 3): tangent, bitangent and shading normal, in world space
    facet: Floats  # (N, 3): geometric normals, in world space
    wo: Floats  # (N, 3): directions to the viewer
    # For each look: the indices of its hits, its BSDF, and the terms that scatter along single directions.
    parts: tuple[tuple[Ints, Bsdf, tuple[Delta, ...]], ...]

    @classmethod
    def build(cls, scene: ReferenceScene, hits: Hits, viewer: Floats) -> _Surface:
        """Return the surface at hits; `viewer` (N, 3) are the directions to the viewer in world space."""
        frame, facet = scene.frame(hits, viewer)
        wo, is_inside = _to_local(frame, viewer), scene.is_inside(hits, viewer)
        parts = tuple(
            (part, bsdf_for_views(bsdf, wo[part]), bsdf.deltas(wo[part], is_inside[part]))
            for part, bsdf in scene.bsdfs(hits, wo[:, 2])
        )
        return cls(scene, hits, scene.points(hits), frame, facet, wo, parts)

    @property
    def deltas(self) -> int:
        """The number of terms that scatter along single directions, of the look that has most of them."""
        return max((len(deltas) for _, _, deltas in self.parts), default=0)

    @property
    def presence(self) -> Floats:
        """The presence of the surface at each hit, (N,), in [0, 1]."""
        return self._compute_parts(lambda bsdf, part: np.asarray(bsdf.presence, np.float64), ())

    def sample(self, u: Floats) -> Floats:
        """Draw local directions (N, 3) from the BSDF by random numbers u (N, 2)."""
        return self._compute_parts(lambda bsdf, part: sample(bsdf, self.wo[part], u[part]), (3,))

    def trace(self, lamps: Sequence[_Lamp], wi: Floats) -> _TracedRays:
        """Trace rays along local directions (N, 3) to the lights and to the next hits."""
        value = self._compute_parts(lambda bsdf, part: evaluate_cosine(bsdf, self.wo[part], wi[part]), (3,))
        density = self._compute_parts(lambda bsdf, part: pdf(bsdf, self.wo[part], wi[part]), ())
        diffuse = np.zeros(wi.shape)
        if any(lamp.has_multipliers for lamp in lamps):
            diffuse = self._compute_parts(lambda bsdf, part: evaluate_diffuse(bsdf, self.wo[part], wi[part]), (3,))
        return self._trace(lamps, wi, value, density, diffuse)

    def trace_delta(self, lamps: Sequence[_Lamp], number: int) -> _TracedRays:
        """Trace rays along the directions of the delta term `number`, at hits whose look has this term."""
        wi, value = np.zeros(self.wo.shape), np.zeros(self.wo.shape)
        for part, _, deltas in self.parts:
            if number < len(deltas):
                wi[part], value[part] = deltas[number].direction, deltas[number].value
        return self._trace(lamps, wi, value, np.ones(len(wi)), None)

    def _trace(
        self, lamps: Sequence[_Lamp], wi: Floats, value: Floats, density: Floats, diffuse: Floats | None
    ) -> _TracedRays:
        """Trace rays along local directions `wi`, with given values and densities of the BSDF.

        `value` (N, 3) is f times the cosine, `diffuse` (N, 3) its diffuse part, and `density` (N,) the pdf. Without
        `diffuse` the rays belong to a delta term: light samples do not find them, and their response is specular.
        """
        direction = np.einsum("nji,nj->ni", self.frame, wi)
        # Shading normal and geometric normal must agree on which side of the surface a direction is.
        height = np.einsum("ni,ni->n", direction, self.facet)
        opaque = self._compute_parts(lambda bsdf, part: np.full(len(part), not bsdf.transmits(self.wo[part])), ()) > 0.0
        value[(wi[:, 2] * height <= 0.0) | (opaque & (height < 0.0))] = 0.0
        traced = np.flatnonzero((value > 0.0).any(axis=-1))
        blocked, hits = np.zeros(len(wi), np.bool_), self.hits.copy()
        blocked[traced], hits[traced] = self.scene.trace_onward(self.hits[traced], direction[traced])
        point, towards = self.point[traced], direction[traced]
        # By groups that cast no shadow: the distances of the next surface along the traced rays, inf if there is none.
        occluders: dict[tuple[int, ...], Floats] = {}
        for groups in {(), *(lamp.shadow_excluded for lamp in lamps)}:
            is_hit, next_hits = blocked[traced], hits[traced]
            if groups:
                is_hit, next_hits = self.scene.trace_onward(self.hits[traced], towards, groups)
            distance = np.linalg.norm(self.scene.points(next_hits) - point, axis=-1)
            occluders[groups] = np.where(is_hit, distance, np.inf)
        direct = np.zeros(direction.shape)
        if diffuse is not None:
            diffuse[(value == 0.0).all(axis=-1)] = 0.0
        for lamp in lamps:
            share = lamp.transmittance(point, towards, occluders[lamp.shadow_excluded])
            if (is_linked := self.scene.is_reached_by(self.hits[traced], lamp.number)) is not None:
                share[~is_linked] = 0.0
            reached = np.flatnonzero(share.any(axis=-1))
            arriving = share[reached] * lamp.light.radiance(point[reached], towards[reached])
            rows = traced[reached]
            light_density = 0.0 if diffuse is None else lamp.light.pdf(point[reached], towards[reached])
            response = lamp.response(value[rows], 0.0 * value[rows] if diffuse is None else diffuse[rows])
            direct[rows] += _divide(response * arriving, density[rows] + light_density)
        return _TracedRays(direction, direct, blocked, hits, _divide(value, density))

    def _compute_parts(self, compute: Callable[[Bsdf, Ints], Floats], shape: tuple[int, ...]) -> Floats:
        """Return values (N, *shape); `compute` returns one look's values from its BSDF and the indices of its hits."""
        result = np.empty((len(self.wo), *shape))
        for part, bsdf, _ in self.parts:
            result[part] = compute(bsdf, part)
        return result


def _to_local(frame: Floats, world: Floats) -> Floats:
    """Express directions (N, 3) of the world in frames (N, 3, 3)."""
    return np.asarray(np.einsum("nij,nj->ni", frame, world))


def _divide(value: Floats, density: Floats) -> Floats:
    """Divide values (N, 3) by densities (N,); 0 where the density is 0."""
    is_positive = (density > 0.0)[:, None]
    return np.where(is_positive, value / np.where(is_positive, density[:, None], 1.0), 0.0)
