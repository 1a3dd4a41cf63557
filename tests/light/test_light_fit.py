"""A light that is scaled and moved gives the same radiance at points that are scaled and moved alike."""

from pathlib import Path

import numpy as np
import pytest
from light_cases import make_tables_small

from lookdev.light import LIGHT_KINDS, Emission, Shadow
from lookdev.light.emission import Falloff
from lookdev.light.placed import PlacedLight

SCALE, ORIGIN = 2.5, (3.0, -1.0, 0.5)


@pytest.mark.parametrize("kind", LIGHT_KINDS)
def test_places_scaled_along_see_the_same(kind: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    make_tables_small(monkeypatch)
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path))
    rng = np.random.default_rng(5)
    light = LIGHT_KINDS[kind].example()
    falloff = Falloff(0.7, 1.3, 0.5, 9.0) if isinstance(light, PlacedLight) else None
    emission = Emission((3.0, 2.0, 1.0), falloff=falloff, shadow=Shadow(distance=2.0, falloff=0.5))
    light = light.with_emission(emission)
    there = light.rescale(SCALE, ORIGIN)
    point = rng.uniform(-1.5, 1.5, (200, 3))
    towards = light.sample(point, rng.random((200, 2)))
    moved = SCALE * point + np.array(ORIGIN)
    here = light.radiance(point, towards)
    assert (here > 0.0).mean() > 0.3
    # Rounding may turn hits at the outline into misses.
    same = np.isclose(there.radiance(moved, towards), here, rtol=1e-9).all(axis=-1)
    assert same.mean() > 0.99
    distance = light.distance(point, towards)
    assert np.isclose(there.distance(moved, towards), SCALE * distance, rtol=1e-9).mean() > 0.99
    assert (there.emission.shadow.distance, there.emission.shadow.falloff) == (2.0 * SCALE, 0.5 * SCALE)
