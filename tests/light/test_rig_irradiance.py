"""Irradiance of a white Lambert plane in Cycles, against closed forms."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from closed_forms import Floats, of_cone
from looks import quick_among
from test_light_irradiance import AXES, NORMALS, PLACES, light_and_irradiance

from lookdev.asset import load_asset
from lookdev.light import DiskLight, DistantLight, Emission, Light, SphereLight
from lookdev.light.emission import Falloff
from lookdev.light.placement import checked_axes, vector
from lookdev.material import Layer, Look
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import FrameTask, frame_task
from lookdev.rendering.worker import Worker
from lookdev.scene import Pose, Sampling, Scene

pytestmark = pytest.mark.cycles

Render = Callable[[FrameTask], WorkerFrame]

FAR = 1000.0  # of the plane's size: the light is the same all over it


@pytest.fixture
def render(cycles_worker: Worker) -> Render:
    cycles_worker.start()
    return lambda task: cycles_worker.render(task, lambda progress: None)


def irradiance(render: Render, light: Light, point: Floats, normal: Floats, samples: int) -> float:
    """Render a small plane about a point, in a frame whose -y is the normal, scaled to a size of 1."""
    away = np.linalg.norm(np.array(light.position or (0.0, 0.0, 1.0)) - point)
    larger = FAR / max(away - light.reach, 1e-3 * away)
    x = np.cross(normal, (0.36, 0.48, 0.8) if abs(normal[2]) > 0.9 else (0.0, 0.0, 1.0))
    x /= np.linalg.norm(x)
    frame = np.stack([x, -normal, np.cross(normal, x)])  # the plane faces -y
    axes = checked_axes(np.array(light.axes) @ frame.T)
    moved = replace(light, axes=axes)  # type: ignore[type-var]
    if light.position:
        moved = replace(moved, position=vector(larger * frame @ (np.array(light.position) - point)))
    names = (name for name in ("width", "height", "radius", "length") if hasattr(light, name))
    sizes = {name: larger * getattr(light, name) for name in names}
    if isinstance(light, DiskLight):
        sizes["radii"] = (larger * light.radii[0], larger * light.radii[1])
    return reflected(render, replace(moved, **sizes), samples)


def reflected(render: Render, light: Light, samples: int = 1024) -> float:
    """Return pi times the radiance that a plane of size 1 at the origin reflects."""
    asset, look = load_asset(builtin="plane"), Look("look", (Layer("l", "lambert", {"reflectance": (1.0, 1.0, 1.0)}),))
    task = scene_task(Scene.of_look(asset, look, light, (8, 8)), Sampling(bounces=0, samples=samples, error=None))
    rendered = render(frame_task(task, Pose(0.0, 0.0), "plane"))
    return float(np.pi * ((rendered.a + rendered.b) / 2.0)[rendered.alpha == 1.0].astype(np.float64).mean())


def case_of(kind: str, number: int) -> tuple[Light, Floats, float]:
    """Return a light, a normal, and the irradiance of a point."""
    if kind != "distant":
        return light_and_irradiance(kind, number)
    normal, wide = NORMALS[number], (0.01, 0.53, 3.0, 20.0, 60.0, 90.0, 120.0, 150.0, 170.0, 179.0)[number]
    return DistantLight(angle=wide, axes=AXES), normal, of_cone(np.sin(np.radians(wide / 2.0)), float(normal[2]))


CASES = [(kind, number) for kind in ("rect", "disk", "sphere", "cylinder", "distant") for number in range(10)]
# One point each: cut by the horizon, near, far.
QUICK = [(kind, (3 * k + n) % 10) for k, (kind, n) in enumerate(CASES[::10]) for n in (1, 6)]


@pytest.mark.parametrize(("kind", "number"), quick_among(CASES, QUICK))
def test_irradiance_is_that_of_the_closed_form(render: Render, kind: str, number: int) -> None:
    light, normal, expected = case_of(kind, number)
    if expected == 0.0:
        pytest.skip("all of it is below the horizon")
    # Little of that disk is above the horizon, so that few directions hit it.
    samples = 1 << 16 if (kind, number) == ("disk", 8) else 4096
    assert irradiance(render, light, PLACES[number], normal, samples) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("exponent", [3.0, *(pytest.param(e, marks=pytest.mark.proof) for e in (0.0, 1.0, 2.0))])
def test_falloff_has_its_exponent(render: Render, exponent: float) -> None:
    lights = (SphereLight(radius=1.0, position=(0.0, -away, 0.0)) for away in (FAR, 2.0 * FAR))
    near, far = (reflected(render, replace(lamp, emission=Emission(falloff=Falloff(0.0, exponent)))) for lamp in lights)
    assert np.log2(near / far) == pytest.approx(exponent, abs=1e-3)
