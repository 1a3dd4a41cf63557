"""A diffuse surface, domes, and estimates of pixels of one shape, for tests of the reference renderer."""

from dataclasses import replace

import numpy as np
from shapes import CAMERA, INSIDE, POSE, SIZE

from lookdev.brdf import Bsdf, Lobe
from lookdev.light import make_environment, prepare_light
from lookdev.reference.render import frame_pixels

# Sixteen scrambles: beyond five of their standard errors is, with fifteen degrees of freedom, one in six thousand.
SIGMAS = 5.0


def lambert(reflected, transmitted=0.0, presence=1.0):
    """Return a diffuse surface that reflects and transmits given fractions of the light."""

    def lobe(name, albedo, transmits):
        def draw(u1, u2):
            radius, angle = np.sqrt(u1), 2.0 * np.pi * u2
            return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1.0 - u1)], axis=-1)

        share = presence * albedo
        functions = lambda d: np.full(d.wi.shape, share / np.pi), lambda d: d.cos_theta_i / np.pi, draw
        return Lobe("test", name, share, *functions, "diffuse", transmits=transmits)

    lobes = lobe("reflected", reflected, False), lobe("transmitted", transmitted, True)
    return Bsdf(lambda wo: lobes, presence, two_sided=True)


def dome(radiance):
    return prepare_light(make_environment("test", radiance), sampled=False)


def estimate(bsdf, shape, *lights, camera=CAMERA, pose=POSE, size=SIZE, pixels=INSIDE, samples=128, **options):
    scene = replace(shape, bsdf=bsdf)
    return frame_pixels(scene, lights, camera, pose, size, pixels, samples=samples, scrambles=16, **options)
