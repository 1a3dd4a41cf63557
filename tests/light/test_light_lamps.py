"""Several lights as numbers: the estimates for choosing one of them, and the rows that a shader reads."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from closed_forms import by_sampling
from light_cases import make_tables_small

from lookdev.light import LIGHT_KINDS, Emission, RectLight, RigOrigin, Shadow, Shaping, lights_code
from lookdev.light.cylinder import Cylinder
from lookdev.light.disk import Ellipse
from lookdev.light.distant import Cone
from lookdev.light.emission import Falloff, beam_bound
from lookdev.light.lamps import CONTROLS, FIELDS, SHAPES, CodedRig, estimate_irradiance
from lookdev.light.placement import to_local
from lookdev.light.rect import RectangleShape
from lookdev.light.shape import greatest_cosine
from lookdev.light.sphere import Sphere

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


def test_estimates_of_shapes_by_hand() -> None:
    """Solid angles: area cosine / distance^2 from afar, 2 pi on the light; cones about the farthest points."""
    aside, behind = np.array([3.0, 2.0, -1.0]), np.array([3.0, 2.0, 1.0])
    # The nearest point of a rectangle of 2 x 1 is at (1, 0.5).
    squared = 4.0 + 2.25 + 1.0
    for shape, area, reach2 in ((RectangleShape(2.0, 1.0), 2.0, 1.25), (Ellipse(1.0, 0.5), 0.5 * np.pi, 1.0)):
        expected = area / np.sqrt(squared) / (squared + 0.5 * area / np.pi)
        assert shape.solid_angle(aside) == pytest.approx(expected, rel=1e-12)
        assert shape.solid_angle(behind) == 0.0
        assert shape.solid_angle(np.array([0.2, 0.1, -1e-9])) == pytest.approx(2.0 * np.pi, rel=1e-6)
        assert shape.cone(aside)[1] == pytest.approx(reach2 / 14.0, rel=1e-12)
        np.testing.assert_allclose(shape.cone(aside)[0], -aside / np.sqrt(14.0), rtol=1e-12)
    ball = Sphere(0.5)
    assert ball.solid_angle(aside) == pytest.approx(2.0 * np.pi * (1.0 - np.sqrt(1.0 - 0.25 / 14.0)), rel=1e-9)
    assert ball.solid_angle(np.array([0.1, 0.2, 0.3])) == 0.0
    assert (ball.cone(aside)[1], ball.cone(0.1 * aside)[1]) == (pytest.approx(0.25 / 14.0), 1.0)
    assert ball.cone(0.0 * aside)[1] == 1.0
    tube = Cylinder(3.0, 0.5)
    # The point is 1.5 beyond the end and 1.5 from the side; the sine to the axis is 4/5.
    expected = 3.0 * 0.8 / (4.5 + 1.5 / np.pi)
    assert tube.solid_angle(np.array([3.0, 0.0, -2.0])) == pytest.approx(expected, rel=1e-12)
    assert tube.solid_angle(np.array([2.5, 0.3, -0.3])) == 0.0
    assert tube.cone(np.array([2.5, 0.0, -2.0]))[1] == pytest.approx(2.5 / 10.25, rel=1e-12)
    assert (Cone(0.1).solid_angle(aside), Cone(0.1).cone(aside)[1]) == pytest.approx((0.2 * np.pi, 0.19))
    # A cone of 20 degrees about 60 off the axis: 40 are nearest, in a beam that ends softly, at 50, and in a hard one.
    sine2, tint, focused = np.sin(np.radians(20.0)) ** 2, 0.2, np.cos(np.radians(40.0)) ** 3
    for softness, share in ((0.4, 0.5), (0.0, 1.0)):
        cone = Shaping(50.0, softness).cone
        bound = beam_bound(np.cos(np.radians(60.0)), sine2, *cone, 3.0, tint)
        assert bound == pytest.approx(share * (focused + (1.0 - focused) * tint), rel=1e-12)
        # Rounded beyond what a cosine can be.
        assert beam_bound(1.0 + 1e-15, sine2, *cone, 3.0, tint) == 1.0
    # A normal at 30 degrees to a cone of 10 degrees has the cosine of 20 degrees. An estimate is the product of all.
    rect, down = RectangleShape(0.02, 0.01), np.array([0.0, 0.0, -3.0])
    normal = np.array([np.sin(np.radians(30.0)), 0.0, np.cos(np.radians(30.0))])
    beam, fall = (*Shaping(50.0, 0.4).cone, 2.0, 0.2), Falloff(1.0, 3.0).numbers
    bare = rect.solid_angle(down) * np.cos(np.radians(30.0) - np.arcsin(np.hypot(0.01, 0.005) / 3.0))
    assert estimate_irradiance(rect, None, None, down, normal) == pytest.approx(bare, rel=1e-12)
    assert estimate_irradiance(rect, beam, fall, down, normal) == pytest.approx(bare * 9.0 / 64.0, rel=1e-12)


@pytest.mark.parametrize("emission", [Emission(), Emission(shaping=BEAM, falloff=Falloff(0.5, 3.0))])
@pytest.mark.parametrize("kind", LAMPS)
def test_the_estimate_is_positive_where_light_arrives_and_near_its_irradiance(kind: str, emission: Emission) -> None:
    if kind == "distant":
        emission = replace(emission, falloff=None)
    light = replace(LIGHT_KINDS[kind].example(), emission=emission)  # type: ignore[type-var]
    rng = np.random.default_rng(3)
    shaping, falloff = emission.shaping, emission.falloff
    beam = (*shaping.cone, shaping.focus, np.mean(shaping.focus_tint)) if shaping else None
    lit_count = 0
    ratios = []
    for point in rng.normal(size=(60, 3)):
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        position = np.array(light.position or (0.0, 0.0, 0.0))
        local, facing = to_local(light.axes, point - position), to_local(light.axes, normal)
        estimate = float(estimate_irradiance(light.shape, beam, falloff and falloff.numbers, local, facing))
        irradiance = by_sampling(light, point, normal, panels=8)
        assert estimate >= 0.0
        assert estimate > 0.0 or irradiance == 0.0
        lit_count += irradiance > 0.0
        if irradiance > 0.0:
            ratios.append(estimate / irradiance)
    assert lit_count >= 5
    # A good estimate is in proportion to the irradiance, within a small factor, where no beam ends within the light.
    assert shaping or np.quantile(ratios, 0.9) / np.quantile(ratios, 0.1) < 20.0


@pytest.fixture(autouse=True)
def _small_tables(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    make_tables_small(monkeypatch)
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path))


def test_rows_hold_where_lights_stand_from_the_axis() -> None:
    shaping, falloff = Shaping(50.0, 0.4, 2.0, (0.1, 0.2, 0.3)), Falloff(0.5, 1.5, 1.0, 9.0)
    shadow = Shadow(True, (0.1, 0.0, 0.0), 3.0, 1.0, 2.0)
    emission = Emission((3.0, 2.0, 0.25), 0.5, 2.0, shaping, shadow, falloff, turns=False, camera=True)
    rect, dome = replace(RectLight.example(), emission=emission), LIGHT_KINDS["dome"].example()
    code = lights_code((dome, rect), sampled=True, rig_origin=RigOrigin((1.0, 2.0, 3.0), (0.5, 0.25)))
    numbers = code.numbers["lamps"]
    assert numbers[:3].tolist() == [0.5, 1.75, 3.0]
    lamp, world = numbers[3:].reshape(2, len(FIELDS))
    row = dict(zip(FIELDS, lamp.tolist(), strict=True))
    assert list(SHAPES)[int(row["kind"])] == "rect"
    # By hand: a cone of 50 degrees that softens from 30 on, a falloff that ends, a shadow that fades.
    expected = {"x": -0.1, "y": -1.25, "z": 1.6, "x0": 1.0, "y1": 0.8, "y2": 0.6, "z1": -0.6, "z2": 0.8}
    expected |= {"a": 1.2, "b": 0.8}
    expected |= {"reach": np.hypot(0.6, 0.4), "red": 3, "green": 2, "blue": 0.25, "mean": 1.75, "turns": 0, "camera": 1}
    expected |= {"cone": np.radians(50.0), "start": np.radians(30.0), "rise": 1.0 / np.radians(20.0), "focus": 2.0}
    expected |= {"tint0": 0.1, "tint1": 0.2, "tint2": 0.3, "profile": -1, "profile_scale": 1, "angle_scale": 0}
    expected |= {"virtual": 0.5, "power": -1.5, "fade": 1.0, "fade_rise": 0.125, "shadow": 1, "limit": 3.0, "zone": 1.0}
    expected |= {"gamma": 2.0, "shadow0": 0.1, "diffuse": 0.5, "specular": 2.0, "picture": -1, "tree": -1, "spares": 0}
    assert {name: row[name] for name in expected} == pytest.approx(expected, rel=1e-6)
    assert dict(zip(FIELDS, world.tolist(), strict=True))["kind"] == -1
    assert "#define RIG_LAMPS 1" in code.constants


def test_a_rig_generates_what_it_has() -> None:
    plain = CodedRig.from_lights([LIGHT_KINDS[kind].example() for kind in ("sphere", "dome")])
    assert plain.kinds == ("sphere",)
    assert not any(map(plain.needs, CONTROLS))
    assert not plain.pictures
