"""The picture of a shape under an environment map, in float64: what a frame of Cycles must converge to.

The integral over a pixel's area and over directions is done by randomised quasi-Monte Carlo: a scrambled Sobol set
a pixel, multiple importance sampling of BSDF and light (balance heuristic) at each depth, several independent
scrambles whose spread is the standard error.

The surface is thin and looks alike from both sides. Light that meets the shape again goes on from there, as long as
a path has bounced less than `bounces` times; a direction drawn from the light that is blocked carries nothing. What a
surface's presence leaves out goes on unchanged: to the light, unless it comes straight from the camera, to which the
background is black; or, as a bounce, to the next wall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from lookdev.brdf import Bsdf, evaluate_cosine, pdf, sample
from lookdev.ibl import LightDistribution
from lookdev.ibl.mapping import rotate_z
from lookdev.plan.camera import camera_rays
from lookdev.plan.task import Camera, Pose
from lookdev.reference.shapes import Floats, Mask, Shape

Ints = NDArray[np.int64]

# At each depth: BSDF direction (2), place in the light's footprint (2), whether to go straight through (1).
_DIMENSIONS = 5
_BLOCK = 2**14  # rays at a time: enough to outweigh the calls, few enough to stay in the processor's cache


@dataclass(frozen=True)
class Estimate:
    """Pixel values (P, 3), premultiplied by coverage, and their standard errors (P, 3)."""

    value: Floats
    error: Floats


def shape_pixels(
    bsdf: Bsdf,
    shape: Shape,
    light: LightDistribution,
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
    """Estimate pixels of a shape.

    Parameters
    ----------
    bsdf
        The surface, the same everywhere on the shape, of constant presence.
    shape, light, camera, pose, resolution
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
    """
    estimates = np.empty((len(pixels), scrambles, 3))
    turned = _TurnedLight(light, pose.lighting - pose.element)
    blocks = np.clip(len(pixels) * scrambles * samples // _BLOCK, 1, len(pixels))
    for numbers in np.array_split(np.arange(len(pixels)), blocks):
        u, entry = _points(light, numbers, bounces + 1, samples, scrambles, seed)
        corner = np.repeat(pixels[numbers], scrambles * samples, axis=0)
        origin, ray = camera_rays(camera, pose, resolution, corner[:, 0] + u[:, 0], corner[:, 1] + u[:, 1])
        hit, point = shape.hit(origin, ray)
        radiance = np.zeros(ray.shape)
        radiance[hit] = _scattered(bsdf, shape, turned, point[hit], ray[hit], u[hit, 2:], entry[hit])
        estimates[numbers] = radiance.reshape(len(numbers), scrambles, samples, 3).mean(axis=2)
    return Estimate(estimates.mean(axis=1), estimates.std(axis=1, ddof=1) / np.sqrt(scrambles))


@dataclass(frozen=True)
class _TurnedLight:
    """The light, turned by `degrees` about z."""

    light: LightDistribution
    degrees: float

    def radiance(self, direction: Floats) -> Floats:
        return self.light.radiance(rotate_z(direction, -self.degrees))

    def pdf(self, direction: Floats) -> Floats:
        return self.light.pdf(rotate_z(direction, -self.degrees))

    def sample(self, entry: Ints, u: Floats) -> Floats:
        return rotate_z(self.light.sample(entry, u), self.degrees)


def _points(
    light: LightDistribution, numbers: Ints, depths: int, samples: int, scrambles: int, seed: int
) -> tuple[Floats, Ints]:
    """Return the Sobol points (N, 2 + 5 depths) and entries of the light's table (N, depths) of some pixels."""
    points, entries = [], []
    for number in numbers:
        for scramble in range(scrambles):
            rng = np.random.default_rng([seed, number, scramble])
            points.append(qmc.Sobol(2 + _DIMENSIONS * depths, rng=rng).random(samples))
            entries.append(np.stack([_stratified_entries(light, samples, rng) for _ in range(depths)], axis=-1))
    return np.concatenate(points), np.concatenate(entries)


def _stratified_entries(light: LightDistribution, samples: int, rng: np.random.Generator) -> Ints:
    """Return a stretch of the light's table, which is in Sobol order, from a random place, in random order."""
    count = len(light.texels)
    start = int(rng.integers(count // samples)) * samples if samples <= count else 0
    return np.asarray(rng.permutation((start + np.arange(samples)) % count))


def _scattered(
    bsdf: Bsdf, shape: Shape, light: _TurnedLight, point: Floats, ray: Floats, u: Floats, entry: Ints
) -> Floats:
    """Return the radiance (N, 3) that comes back along rays (N, 3) that hit the shape at `point` (N, 3)."""
    total = np.zeros(ray.shape)
    path = np.arange(len(ray))  # the rays still under way, in `total`, `u` and `entry`
    throughput = np.ones(ray.shape)
    bounced = np.zeros(len(ray), np.bool_)
    for depth in range(entry.shape[1]):
        here = u[path, _DIMENSIONS * depth : _DIMENSIONS * (depth + 1)]
        frame = shape.frame(point, -ray)
        wo = _to_local(frame, -ray)
        from_bsdf = sample(bsdf, wo, here[:, :2])
        from_light = _to_local(frame, light.sample(entry[path, depth], here[:, 2:4]))
        onward = _meet(bsdf, shape, light, point, frame, wo, from_bsdf)
        total[path] += throughput * (onward.direct + _meet(bsdf, shape, light, point, frame, wo, from_light).direct)

        absent = 1.0 - float(bsdf.presence)
        beyond, far_point = shape.onward(point, ray)
        seen = np.flatnonzero((absent > 0.0) & bounced & ~beyond)
        total[path[seen]] += absent * throughput[seen] * light.radiance(ray[seen])
        # Where both ways lead to another wall, one of them is taken, as often as its share.
        through = beyond & (here[:, 4] < absent)
        weight = np.where(through[:, None], 1.0, onward.weight)
        weight /= np.where(beyond & ~through, 1.0 - absent, 1.0)[:, None]

        kept = np.flatnonzero((through | onward.blocked) & (weight > 0.0).any(axis=-1))
        straight = through[kept]
        path, throughput = path[kept], throughput[kept] * weight[kept]
        bounced = bounced[kept] | ~straight
        ray = np.where(straight[:, None], ray[kept], onward.direction[kept])
        point = np.where(straight[:, None], far_point[kept], onward.point[kept])
    return total


@dataclass(frozen=True)
class _Meeting:
    """What some directions (N, 3) meet: `direct` (N, 3) from the light, combined, or `blocked` (N,), a `point` (N, 3).

    `weight` (N, 3) is f times the cosine over the density of the BSDF's samples.
    """

    direction: Floats
    direct: Floats
    blocked: Mask
    point: Floats
    weight: Floats


def _meet(
    bsdf: Bsdf, shape: Shape, light: _TurnedLight, point: Floats, frame: Floats, wo: Floats, wi: Floats
) -> _Meeting:
    """Follow local directions `wi` to the light or to the next wall."""
    direction = np.einsum("nji,nj->ni", frame, wi)
    blocked, far_point = shape.onward(point, direction)
    value, density = evaluate_cosine(bsdf, wo, wi), pdf(bsdf, wo, wi)
    free = np.flatnonzero(~blocked)
    arriving = light.radiance(direction[free])
    direct = np.zeros(direction.shape)
    direct[free] = _divide(value[free] * arriving, density[free] + light.pdf(direction[free]))
    return _Meeting(direction, direct, blocked, far_point, _divide(value, density))


def _divide(value: Floats, density: Floats) -> Floats:
    """Divide values (N, 3) by densities (N,); 0 where there is no density, as nothing was drawn there."""
    drawn = (density > 0.0)[:, None]
    return np.where(drawn, value / np.where(drawn, density[:, None], 1.0), 0.0)


def _to_local(frame: Floats, world: Floats) -> Floats:
    return np.asarray(np.einsum("nij,nj->ni", frame, world))
