"""Derivatives of pictures against differences of pictures: the same integrals, hence z-tests of their means."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from frames import POSE, scene_of
from light_rigs import RIG_LOOKS, RIGS
from mitsuba_scenes import dressed
from painted import painted

from lookdev.asset import Asset, load_asset
from lookdev.light import DiskLight, Light, RectLight
from lookdev.material import Formula, Layer, Look, View
from lookdev.material.change import constant_of, live_look
from lookdev.material.expression import parse
from lookdev.rendering.scene import scene_task
from lookdev.rendering.slopes import SlopeTask, live_inputs
from lookdev.rendering.wire import decode_request, encode
from lookdev.rendering.worker import Worker
from lookdev.scene import Sampling

pytestmark = pytest.mark.mitsuba

SIZE, PAIRS = 24, 4
COPPER = Layer("Metal", "disney", {"metallic": 1.0, "baseColor": (0.9, 0.55, 0.4), "roughness": 0.35})
FADING = Formula(parse("amount * view"), {"amount": 0.6, "view": View()}, {"amount": "float", "view": "float"})


def masked(folder: Path) -> tuple[Layer, ...]:
    return (
        Layer("Base", "pixar", {"surfaceColor": (0.5, 0.2, 0.1), "roughness": 0.6}),
        Layer("Over", "pixar", {"surfaceColor": (0.1, 0.3, 0.6), "metallic": 0.5, "roughness": 0.3}, FADING),
    )


def of(*layers: Layer) -> Callable[[Path], tuple[Layer, ...]]:
    return lambda folder: layers


def one(model: str, **inputs: float) -> Callable[[Path], tuple[Layer, ...]]:
    return of(Layer("L", model, dict(inputs)))


@dataclass(frozen=True)
class Case:
    asset: str
    light: str
    layers: Callable[[Path], tuple[Layer, ...]]
    names: tuple[str, ...]
    bounces: int = 2
    samples: int = 64


CASES = {
    # In the shaderball's recess, copper is lit by copper; white light has the least noise.
    "interreflection": Case("shaderball", "white", of(COPPER), ("roughness",), bounces=3),
    "interreflection of a city": Case("shaderball", "city", of(COPPER), ("roughness",), bounces=3, samples=256),
    "colours": Case("shaderball", "city", of(COPPER), ("baseColor",), bounces=3),
    "texture": Case("suzanne", "city", painted, ("Paint.metallic", "Dust.roughness")),
    "textures": Case("suzanne", "city", painted, ("Paint.metallic", "Dust.roughness", "Dust.baseColor")),
    "presence": Case("plane", "sunset", of(replace(COPPER, inputs={**COPPER.inputs, "presence": 0.6})), ("presence",)),
    "expression": Case(
        "suzanne", "city", masked, ("Over.mask.amount", "Over.roughness", "Base.surfaceColor"), samples=256
    ),
    "pixar": Case("sphere", "studio", one("pixar", roughness=0.4, metallic=0.6), ("roughness", "metallic")),
    "leaf": Case("plane", "sunset", one("pixar", back=0.4, clear=0.3), ("back", "clear", "roughness")),
    "ward": Case("suzanne", "lamps", one("ward", alphaX=0.2, alphaY=0.3), ("alphaX", "diffuse")),
    "phong": Case("sphere", "city", one("phong", exponent=40.0), ("exponent",)),
    "torrance-sparrow": Case("sphere", "city", one("torrance-sparrow", roughness=0.3), ("roughness",)),
    "ashikhmin-shirley": Case("sphere", "city", one("ashikhmin-shirley", exponentU=30.0), ("exponentU",)),
    "oren-nayar": Case("suzanne", "sunset", one("oren-nayar", sigma=0.4), ("sigma",)),
    "controls": Case("suzanne", "controls", of(RIG_LOOKS["plastic"]), ("roughness", "baseColor"), samples=256),
    "mirror": Case("suzanne", "city", of(Layer("L", "mirror", {"tint": (0.7, 0.6, 0.5)})), ("tint",)),
}  # fmt: skip
CONTROLS = ("shadow", "response", "seen")
QUICK = ("interreflection", "texture")


def lights(name: str, light_of: Callable[[str], Light], folder: Path) -> tuple[Light, ...]:
    if name == "controls":
        return tuple(light for rig in CONTROLS for light in RIGS[rig](folder))
    return (RectLight.example(), DiskLight.example()) if name == "lamps" else (light_of(name),)


def task_of(case: Case, look: Look, light: tuple[Light, ...], asset: Asset) -> Any:
    live = live_look(look, {str(n): constant_of(look, name) for n, name in enumerate(case.names)})
    scene = dressed(asset, live.layers, *light, size=SIZE)
    return scene_task(scene, Sampling(bounces=case.bounces), "mitsuba")


@pytest.mark.parametrize("name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.proof) for n in CASES])
def test_derivatives_are_those_of_differences(name: str, drjit: Any, light_of: Any, tmp_path: Path) -> None:
    from lookdev.mitsuba.load import load_mitsuba
    from lookdev.mitsuba.slopes import SlopeScene

    case = CASES[name]
    look = Look("look", case.layers(tmp_path))
    task = task_of(case, look, lights(case.light, light_of, tmp_path), load_asset(builtin=case.asset))
    scene, bindings = SlopeScene(load_mitsuba("cpu"), task), live_inputs(task)
    constants = {str(n): constant_of(look, each) for n, each in enumerate(case.names)}

    def pictures(values: Mapping[str, tuple[float, ...]], symbols: tuple[str, ...]) -> np.ndarray:
        """Return the means (2 PAIRS, 1 + P, 4) of the pixels of halves."""
        given = {bindings[key].parameter: each for key, each in values.items()}
        seeds = [(2 * n, 2 * n + 1) for n in range(PAIRS)]
        asked = [SlopeTask(task, POSE, given, symbols, case.samples, pair, "") for pair in seeds]
        halves = [scene.render(each, lambda done, of: None) for each in asked]
        return np.concatenate(halves).astype(float).mean(axis=(2, 3))

    own = {key: each.value for key, each in constants.items()}
    symbols = tuple(symbol for key in constants for symbol in bindings[key].symbols)
    found = pictures(own, symbols)[:, 1:]
    place = 0
    for key, each in constants.items():
        low, high = each.parameter.soft
        step = 0.02 * min(high - low, max(each.value)) if high > 1.0 else 0.02
        for channel in range(len(each.value)):
            ends = []
            for sign in (1.0, -1.0):
                moved = np.array(each.value)
                moved[channel] += sign * step
                ends.append(pictures({**own, key: tuple(moved.tolist())}, ())[:, 0])
            expected = (ends[0] - ends[1]) / (2.0 * step)
            difference = found[:, place] - expected
            error = difference.std(axis=0, ddof=1) / np.sqrt(len(difference))
            size = np.abs(expected.mean(axis=0))
            # Student's t of 7 degrees of freedom, and differences' own error, of the third derivative.
            assert (np.abs(difference.mean(axis=0)) < 5.4 * error + 4e-3 * size + 1e-6).all(), (each.name, channel)
            assert (error <= 0.15 * size.max()).all(), each.name
            assert size.max() > 1e-4, each.name
            place += 1
    assert place == found.shape[1]


def test_parts_of_two_looks_are_derived_and_a_worker_answers_the_same(
    drjit: Any, worker: Worker, light_of: Any, tmp_path: Path
) -> None:
    """The looks' programs are chosen by the triangle; the task survives its way as text."""
    from lookdev.mitsuba.load import load_mitsuba
    from lookdev.mitsuba.slopes import SlopeScene

    ball = load_asset(builtin="shaderball")
    look = Look("look", (COPPER,))
    live = live_look(look, {"0": constant_of(look, "roughness")})
    scene = scene_of(ball, Look("grey", (Layer("Grey", "lambert", {}),)), (light_of("city"),), SIZE)
    scene = replace(scene, wears={**scene.wears, ball.slots[0].path: live})
    task = scene_task(scene, Sampling(bounces=1), "mitsuba")
    binding = live_inputs(task)["0"]
    asked = SlopeTask(task, POSE, {binding.parameter: (0.35,)}, binding.symbols, 8, (0, 1), "one")
    here = SlopeScene(load_mitsuba("cpu"), task).render(asked, lambda done, of: None)
    assert here.shape == (2, 2, SIZE, SIZE, 4)
    assert np.abs(here[:, 1]).max() > 0.0
    assert decode_request(encode(asked)) == asked
    worker.start()
    np.testing.assert_allclose(worker.slopes(asked, lambda progress: None), here, rtol=1e-4, atol=1e-5)
