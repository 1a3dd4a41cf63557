"""Parts of the beauty that shaders record: by lights, by sheen, and how the halves of a frame share them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from test_passes import CENTER, COATED, SIZE, balls, covered, render_task, task_of

from lookdev.light import Emission, Light, RectLight, SphereLight, load_environment, prepare_light
from lookdev.material import Layer, Look
from lookdev.rendering.passes import channels_of_passes, light_layer
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.worker import Worker

pytestmark = pytest.mark.cycles

VELVET = Look("velvet", (Layer("v", "disney", {"baseColor": (0.3, 0.1, 0.1), "sheen": 1.0, "clearcoat": 1.0}),))
PLAIN = Look("plain", (Layer("v", "disney", {"baseColor": (0.3, 0.1, 0.1), "sheen": 0.0, "clearcoat": 1.0}),))


def rig() -> tuple[Light, ...]:
    """Return a dome, and lamps about the balls, two of them of one group."""
    dome = prepare_light(load_environment(builtin="studio"))
    sky = replace(dome, emission=replace(dome.emission, color=(0.4, 0.4, 0.4), group="sky"))
    x, y, z = CENTER
    lamp = RectLight(width=2.0, height=2.0, position=(x, y, z + 4.0), emission=Emission((3.0, 2.5, 2.0), group="key"))
    fill = [
        SphereLight(radius=0.5, position=(x + side, y - 3.0, z), emission=Emission(color, specular=0.5, group="fi.ll"))
        for side, color in ((4.0, (1.0, 2.0, 6.0)), (-3.0, (4.0, 1.0, 1.0)))
    ]
    return (lamp, sky, *fill)


def frame_of(
    worker: Worker, look: Look, lights: tuple[Light, ...], passes: tuple[str, ...], **options: Any
) -> WorkerFrame:
    return render_task(
        worker, task_of(balls(), passes, ball=look, others=look, lights=lights, **{"samples": 64} | options)
    )


def assert_sums(frame: WorkerFrame, groups: tuple[str, ...]) -> None:
    """Check that each set of parts sums up to the beauty, and that no part is negative beyond rounding."""
    beauty = 0.5 * (frame.a + frame.b) if frame.raw is None else frame.raw
    for name in ("lobes", "direct", "lights"):
        parts = [*channels_of_passes((name,), groups)]
        if not {*parts} <= {*frame.passes}:
            continue
        total = np.sum([frame.passes[part] for part in parts], axis=0)
        assert (np.abs(total - beauty) <= 1e-4 * beauty).all(), name
        for part in parts:
            assert (frame.passes[part] >= -1e-5 * (1.0 + beauty)).all(), part


GROUPS = ("key", "sky", "fi_ll")


def test_a_groups_light_is_that_of_a_scene_with_its_lights_alone(worker: Worker) -> None:
    lamp, *others = rig()
    x, y, z = CENTER
    # It sends its light along -z, away from the balls: left out of the shader, it is a black layer.
    idle = RectLight(width=1.0, height=1.0, position=(x, y, z - 9.0), emission=Emission(group="idle"))
    lights = (lamp, idle, *others)
    frames = [frame_of(worker, COATED, lights, ("lights",), seed=seed) for seed in range(4)]
    for frame in frames:
        assert_sums(frame, (*GROUPS, "idle"))
        assert not frame.passes["light_idle"].any()
    # The parts sum up to the beauty: where all others are right, the sky is.
    for name in GROUPS[::2]:
        alone = tuple(light for light in lights if light.emission.group.replace(".", "_") == name)
        single = [frame_of(worker, COATED, alone, (), seed=seed) for seed in range(2)]
        recorded = np.array([frame.passes[light_layer(name)].mean(axis=(0, 1)) for frame in frames])
        # The halves of a frame are independent: four values of each.
        rendered_alone = np.array([half.mean(axis=(0, 1)) for frame in single for half in (frame.a, frame.b)])
        noise = np.sqrt((recorded.var(axis=0, ddof=1) + rendered_alone.var(axis=0, ddof=1)) / 4.0)
        difference = np.abs(recorded.mean(axis=0) - rendered_alone.mean(axis=0))
        # Student's t of 3 degrees of freedom: beyond 12 by chance once in a thousand.
        assert (difference < 12.0 * noise).all(), (name, difference, noise)
        assert (noise < 0.01 * rendered_alone.mean(axis=0)).all(), "the test would notice one percent"


@pytest.mark.parametrize(
    "options", [{}, {"denoise": "measured"}, {"error": 1e-2, "samples": 64}], ids=["samples", "denoise", "error"]
)
def test_sets_that_do_not_fit_one_render_are_shared_by_the_halves(options: dict[str, object], worker: Worker) -> None:
    passes = ("lobes", "direct", "lights")
    frame = frame_of(worker, VELVET, rig(), passes, **{"bounces": 2, "samples": 16} | options)
    assert_sums(frame, GROUPS)
    assert frame.passes["sheen"].mean() > 2e-4
    assert not frame.passes["transmission"].any()
    assert frame.passes["indirect"].mean() > 3e-4
    assert {*frame.passes} == {*channels_of_passes(passes, GROUPS)}


def test_light_belongs_to_the_lobe_of_the_first_hit(worker: Worker) -> None:
    """A ball without a diffuse lobe has no diffuse light, whatever lobes reflected the light before."""
    metal = Look("metal", (Layer("m", "disney", {"metallic": 1.0, "baseColor": (0.8,) * 3, "roughness": 0.4}),))
    on_ball = covered(("/set/ball", "/set/left", "/set/top"), SIZE, 8)["/set/ball"] == 1.0
    white = (prepare_light(load_environment(builtin="white")),)
    frame = render_task(worker, task_of(balls(), ("lobes", "direct"), ball=metal, lights=white, samples=64, bounces=3))
    assert frame.passes["indirect"][on_ball].mean() > 1e-3
    assert frame.passes["diffuse"][~on_ball].mean() > 1e-3
    assert not frame.passes["diffuse"][on_ball].any()


@pytest.mark.proof
def test_parts_of_one_half_are_those_of_both_but_for_noise(worker: Worker) -> None:
    # Four sets of lobes, of lights and direct light need 3 + 2 + 1 records: each half has three of them.
    shared = [
        frame_of(worker, VELVET, rig(), ("lobes", "direct", "lights"), samples=128, seed=seed) for seed in range(4)
    ]
    for name, part in (("lobes", "specular"), ("lights", "light_key"), ("direct", "direct")):
        whole = [frame_of(worker, VELVET, rig(), (name,), samples=128, seed=seed) for seed in range(4, 8)]
        a, b = (np.array([frame.passes[part].mean(axis=(0, 1)) for frame in frames]) for frames in (shared, whole))
        noise = np.sqrt((a.var(axis=0, ddof=1) + b.var(axis=0, ddof=1)) / 4.0)
        # Student's t of 3 degrees of freedom: beyond 12 by chance once in a thousand; a quotient's bias, .2 percent.
        assert (np.abs(a.mean(axis=0) - b.mean(axis=0)) < 12.0 * noise + 2e-3 * b.mean(axis=0)).all(), name


def test_sheen_is_what_a_look_has_more_with_it(worker: Worker) -> None:
    white = (prepare_light(load_environment(builtin="white")),)
    velvet, plain = (frame_of(worker, look, white, ("lobes",), bounces=0, samples=256) for look in (VELVET, PLAIN))
    more = 0.5 * (velvet.a + velvet.b) - 0.5 * (plain.a + plain.b)
    sheen = velvet.passes["sheen"].mean(axis=(0, 1))
    assert (sheen > 2e-4).all()
    noise = np.sqrt(sum(np.var(0.5 * (e.a - e.b), axis=(0, 1)) for e in (velvet, plain)) / more[..., 0].size)
    assert (np.abs(more.mean(axis=(0, 1)) - sheen) < 5.0 * noise).all()
    assert (noise < 0.1 * sheen).all(), "the test would notice a half"
    assert not plain.passes["sheen"].any()
    for name in ("diffuse", "specular", "clearcoat"):
        a, b = (frame.passes[name].mean(axis=(0, 1)) for frame in (velvet, plain))
        np.testing.assert_allclose(a, b, rtol=0.02)
