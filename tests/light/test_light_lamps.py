"""Several lights as numbers: the estimates by which one of them is chosen, and the rows that a shader reads."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from closed_forms import by_sampling
from light_cases import make_tables_small

from lookdev.light import LIGHT_KINDS, Emission, Falloff, Shaping, Stand, lights_code
from lookdev.light.emission import beam_bound
from lookdev.light.lamps import FIELDS, SHAPES, CodedRig, weight
from lookdev.light.placement import to_local
from lookdev.light.shape import greatest_cosine

LAMPS = ("rect", "disk", "sphere", "cylinder", "distant")
BEAM = Shaping(40.0, 0.3, 2.0, (0.2, 0.1, 0.3))


def test_no_direction_of_a_cone_has_a_greater_cosine() -> None:
    rng = np.random.default_rng(1)
    axis, normal = (values / np.linalg.norm(values, axis=-1, keepdims=True) for values in rng.normal(size=(2, 5000, 3)))
    angle = rng.uniform(0.0, np.pi / 2.0, 5000)
    greatest = greatest_cosine(axis, np.sin(angle) ** 2, normal)
    apart = np.arccos(np.clip((axis * normal).sum(axis=-1), -1.0, 1.0))
    np.testing.assert_allclose(greatest, np.maximum(np.cos(np.maximum(apart - angle, 0.0)), 0.0), atol=1e-12)
    assert (greatest_cosine(axis, np.ones(5000), normal) == 1.0).all()  # all directions


def test_no_direction_of_a_cone_gets_more_of_a_beam() -> None:
    rng = np.random.default_rng(2)
    tint = np.mean(BEAM.focus_tint)
    axis, aside = (values / np.linalg.norm(values, axis=-1, keepdims=True) for values in rng.normal(size=(2, 4000, 3)))
    aside -= axis * (axis * aside).sum(axis=-1, keepdims=True)
    aside /= np.linalg.norm(aside, axis=-1, keepdims=True)
    half, part = rng.uniform(0.0, np.pi / 2.0, 4000), rng.uniform(0.0, 1.0, 4000)
    within = np.cos(part * half)[:, None] * axis + np.sin(part * half)[:, None] * aside
    bound = beam_bound(axis[:, 2], np.sin(half) ** 2, *BEAM.cone, BEAM.focus, tint)
    assert (BEAM.factor(within).mean(axis=-1) <= bound + 1e-9).all()
    assert (bound == 0.0).any()


@pytest.mark.parametrize("emission", [Emission(), Emission(shaping=BEAM, falloff=Falloff(0.5, 3.0))])
@pytest.mark.parametrize("kind", LAMPS)
def test_the_estimate_is_positive_where_light_arrives_and_near_its_irradiance(kind: str, emission: Emission) -> None:
    if kind == "distant":
        emission = replace(emission, falloff=None)
    light = replace(LIGHT_KINDS[kind].example(), emission=emission)  # type: ignore[type-var]
    rng = np.random.default_rng(3)
    shaping, falloff = emission.shaping, emission.falloff
    beam = (*shaping.cone, shaping.focus, np.mean(shaping.focus_tint)) if shaping else None
    lit = 0
    ratios = []
    for place in rng.normal(size=(60, 3)):
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        position = np.array(getattr(light, "position", (0.0, 0.0, 0.0)))
        local, facing = to_local(light.axes, place - position), to_local(light.axes, normal)
        estimate = float(weight(light.shape, beam, falloff and falloff.numbers, local, facing))
        irradiance = by_sampling(light, place, normal, panels=8)
        assert estimate >= 0.0
        assert estimate > 0.0 or irradiance == 0.0
        lit += irradiance > 0.0
        if irradiance > 0.0:
            ratios.append(estimate / irradiance)
    assert lit >= 5
    # A good choice is in proportion: within a factor of some, where no beam ends within the light.
    assert shaping or np.quantile(ratios, 0.9) / np.quantile(ratios, 0.1) < 20.0


@pytest.fixture(autouse=True)
def _small_tables(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    make_tables_small(monkeypatch)
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path))


def test_rows_hold_where_lights_stand_from_the_axis() -> None:
    rect, dome = LIGHT_KINDS["rect"].example(), LIGHT_KINDS["dome"].example()
    code = lights_code((dome, rect), sampled=True, stand=Stand((1.0, 2.0, 3.0), (0.5, 0.25)))
    numbers = code.numbers["lamps"]
    assert numbers[:3].tolist() == [0.5, 1.75, 3.0]
    lamp, world = numbers[3:].reshape(2, len(FIELDS))
    row = dict(zip(FIELDS, lamp.tolist(), strict=True))
    assert list(SHAPES)[int(row["kind"])] == "rect"
    assert (row["x"], row["y"], row["z"]) == pytest.approx((-0.1, -1.25, 1.6))
    assert (row["a"], row["b"], row["turns"], row["profile"], row["picture"]) == pytest.approx((1.2, 0.8, 1, -1, -1))
    assert dict(zip(FIELDS, world.tolist(), strict=True))["kind"] == -1
    assert "#define RIG_LAMPS 1" in code.constants


def test_a_rig_generates_what_it_has() -> None:
    plain = CodedRig.of([LIGHT_KINDS[kind].example() for kind in ("sphere", "dome")])
    assert plain.kinds == ("sphere",)
    assert not any((plain.shaped, plain.falling, plain.shadowed, plain.still, plain.split, plain.pictures))
