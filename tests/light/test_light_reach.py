"""Lights of which `may_reach` is false send no light into the sphere."""

from dataclasses import replace

import numpy as np
import pytest

from lookdev.light import CylinderLight, DiskLight, DistantLight, Emission, RectLight, Shaping, SphereLight
from lookdev.light.emission import Falloff
from lookdev.light.placed import PlacedLight
from lookdev.light.placement import Axes

KINDS = [RectLight.example(), DiskLight.example(), SphereLight.example(), CylinderLight.example()]


def random_axes(rng: np.random.Generator) -> Axes:
    turned, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turned *= np.sign(np.linalg.det(turned))
    return tuple(tuple(map(float, row)) for row in turned)  # type: ignore[return-value]


@pytest.mark.parametrize("light", KINDS, ids=lambda light: light.kind)
def test_no_light_arrives_where_none_may(light: PlacedLight) -> None:
    """No radiance arrives in the sphere if `may_reach` is false; in some placements the light reaches it."""
    rng = np.random.default_rng(7)
    center, radius = (0.3, -0.2, 0.5), 0.8
    said = []
    for number in range(300):
        shaping = Shaping(cone_angle=float(rng.uniform(5.0, 120.0)), cone_softness=0.3) if number % 2 else None
        falloff = Falloff(end=float(rng.uniform(0.5, 4.0))) if number % 3 == 0 else None
        emission = Emission((1.0, 2.0, 3.0), shaping=shaping, falloff=falloff)
        position = tuple(map(float, rng.normal(size=3) * 2.0))
        placed = replace(light, position=position, axes=random_axes(rng), emission=emission)
        inside = rng.normal(size=(400, 3))
        inside *= radius * rng.random((400, 1)) ** (1 / 3) / np.linalg.norm(inside, axis=-1, keepdims=True)
        places = np.array(center) + inside
        arriving = placed.radiance(places, placed.sample(places, rng.random((400, 2)))).max()
        said.append((placed.may_reach(center, radius), bool(arriving > 0.0)))
    never = [arrives for may, arrives in said if not may]
    assert not any(never)
    # `may_reach` is false for most lights that do not reach the sphere; of 300 draws, some are at the edge.
    missed = sum(may and not arrives for may, arrives in said)
    assert len(never) > 30 > missed, (len(never), missed)


def test_lights_without_a_place_reach_everything_unless_they_are_off() -> None:
    assert DistantLight.example().may_reach((0.0, 0.0, 0.0), 1.0)
    off = replace(DistantLight.example(), emission=Emission((0.0, 0.0, 0.0)))
    assert not off.may_reach((0.0, 0.0, 0.0), 1.0)
