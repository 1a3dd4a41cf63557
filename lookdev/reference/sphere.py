"""The picture of a sphere under an environment map, in float64: what a frame of Cycles must converge to.

The integral over a pixel's area and over directions is done by randomised quasi-Monte Carlo: a scrambled Sobol set
a pixel, multiple importance sampling of BRDF and light (balance heuristic), several independent scrambles whose
spread is the standard error. The sphere is analytic, convex and alone, so that there is no visibility to trace.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from lookdev.brdf import LOBES, Lobe, evaluate, pdf, sample
from lookdev.brdf.vectors import Array
from lookdev.ibl import LightDistribution
from lookdev.ibl.mapping import rotate_z
from lookdev.plan.camera import camera_rays
from lookdev.plan.task import Camera, Pose

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """Pixel values (P, 3), premultiplied by coverage, and their standard errors (P, 3)."""

    value: Floats
    error: Floats


def sphere_pixels(
    model: str,
    parameters: Mapping[str, Array],
    light: LightDistribution,
    camera: Camera,
    pose: Pose,
    resolution: tuple[int, int],
    pixels: NDArray[np.int64],
    *,
    center: tuple[float, float, float] = (0.0, 0.0, 0.0),
    radius: float = 1.0,
    samples: int = 4096,
    scrambles: int = 8,
    seed: int = 0,
) -> Estimate:
    """Estimate pixels of a sphere.

    Parameters
    ----------
    model, parameters
        A model and its complete, constant parameters.
    light, camera, pose, resolution
        As the frame has them; exposure 0.
    pixels : (P, 2)
        Column and row of each pixel, row 0 at the top.
    samples, scrambles, seed
        A power of two of points in each of `scrambles` independent sets.

    Returns
    -------
    Estimate
    """
    lobes = LOBES[model](parameters)
    estimates = np.empty((len(pixels), scrambles, 3))
    for number, (column, row) in enumerate(pixels):
        for scramble in range(scrambles):
            rng = np.random.default_rng([seed, number, scramble])
            # Pixel area, BRDF direction, place in the light's footprint; the entry of its table.
            u = qmc.Sobol(6, rng=rng).random(samples)
            entry = _stratified_entries(light, samples, rng)
            origin, ray = camera_rays(camera, pose, resolution, column + u[:, 0], row + u[:, 1])
            hit, normal = _intersect(origin - np.array(center), ray, radius)
            radiance = np.zeros((samples, 3))
            if hit.any():
                turn = pose.lighting - pose.element
                radiance[hit] = _reflected(lobes, light, turn, normal[hit], -ray[hit], u[hit, 2:], entry[hit])
            estimates[number, scramble] = radiance.mean(axis=0)
    return Estimate(estimates.mean(axis=1), estimates.std(axis=1, ddof=1) / np.sqrt(scrambles))


def _stratified_entries(light: LightDistribution, samples: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Return a stretch of the light's table, which is in Sobol order, from a random place, in random order."""
    count = len(light.texels)
    start = int(rng.integers(count // samples)) * samples if samples <= count else 0
    return np.asarray(rng.permutation((start + np.arange(samples)) % count))


def _intersect(origin: Floats, ray: Floats, radius: float) -> tuple[NDArray[np.bool_], Floats]:
    """Hit a sphere about the origin of coordinates: mask (N,) and unit normals (N, 3), the nearer crossing."""
    b = ray @ origin
    discriminant = b * b - (origin @ origin - radius * radius)
    hit = discriminant > 0.0
    distance = -b - np.sqrt(np.where(hit, discriminant, 0.0))
    return hit, (origin + distance[:, None] * ray) / radius


def _reflected(
    lobes: tuple[Lobe, ...],
    light: LightDistribution,
    turn: float,
    normal: Floats,
    wo: Floats,
    u: Floats,
    entry: NDArray[np.int64],
) -> Floats:
    """Reflect the environment towards `wo`: one BRDF and one light direction each, (N, 3)."""
    # The tangent points along increasing u of the sphere's UVs, counter-clockwise about z.
    tangent = np.stack([-normal[:, 1], normal[:, 0], np.zeros(len(normal))], axis=-1)
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    frame = np.stack([tangent, np.cross(normal, tangent), normal], axis=1)
    wo_local = np.einsum("nij,nj->ni", frame, wo)
    from_brdf = sample(lobes, wo_local, u[:, :2])
    toward_light = rotate_z(light.sample(entry, u[:, 2:4]), turn)
    total = np.zeros((len(normal), 3))
    for wi_local in (from_brdf, np.einsum("nij,nj->ni", frame, toward_light)):
        wi = rotate_z(np.einsum("nji,nj->ni", frame, wi_local), -turn)
        density = pdf(lobes, wo_local, wi_local) + light.pdf(wi)
        f = evaluate(lobes, wo_local, wi_local) * np.maximum(wi_local[:, 2:], 0.0)
        usable = density > 0.0
        total += np.where(usable[:, None], f * light.radiance(wi) / np.where(usable, density, 1.0)[:, None], 0.0)
    return total
