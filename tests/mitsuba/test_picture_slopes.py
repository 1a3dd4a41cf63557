"""Derivatives of pictures against differences of pictures: the same integrals, hence z-tests of their means."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from frames import POSE, scene_of
from light_rigs import RIG_LOOKS, RIGS
from mitsuba_scenes import scene_with_look
from painted import painted

from lookdev.asset import Asset, load_asset
from lookdev.light import DiskLight, Light, RectLight
from lookdev.material import Formula, Layer, Look, ViewCosine
from lookdev.material.change import constant_named, look_with_live_inputs
from lookdev.material.expression import parse
from lookdev.rendering.derivatives import DerivativeTask, live_inputs
from lookdev.rendering.scene import scene_task
from lookdev.rendering.wire import decode_task, encode_task
from lookdev.rendering.worker import Worker
from lookdev.scene import Sampling

pytestmark = pytest.mark.mitsuba

SIZE, PAIRS = 24, 4
COPPER = Layer("Metal", "disney", {"metallic": 1.0, "baseColor": (0.9, 0.55, 0.4), "roughness": 0.35})
FOIL = replace(COPPER, inputs={**COPPER.inputs, "presence": 0.6})
FADING = Formula(parse("amount * view"), {"amount": 0.6, "view": ViewCosine()}, {"amount": "float", "view": "float"})


def masked(folder: Path) -> tuple[Layer, ...]:
    return (
        Layer("Base", "pixar", {"surfaceColor": (0.5, 0.2, 0.1), "roughness": 0.6}),
        Layer("Over", "pixar", {"surfaceColor": (0.1, 0.3, 0.6), "metallic": 0.5, "roughness": 0.3}, FADING),
    )


def of_layers(*layers: Layer) -> Callable[[Path], tuple[Layer, ...]]:
    return lambda folder: layers


def model_layer(model: str, **inputs: float) -> Callable[[Path], tuple[Layer, ...]]:
    return of_layers(Layer("L", model, dict(inputs)))


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
    "interreflection": Case("shaderball", "white", of_layers(COPPER), ("roughness",), bounces=3),
    "interreflection of a city": Case("shaderball", "city", of_layers(COPPER), ("roughness",), bounces=3, samples=256),
    "colours": Case("shaderball", "city", of_layers(COPPER), ("baseColor",), bounces=3),
    "texture": Case("suzanne", "city", painted, ("Paint.metallic", "Dust.roughness")),
    "textures": Case("suzanne", "city", painted, ("Paint.metallic", "Dust.roughness", "Dust.baseColor")),
    "presence": Case("plane", "sunset", of_layers(FOIL), ("presence",)),
    "expression": Case(
        "suzanne", "city", masked, ("Over.mask.amount", "Over.roughness", "Base.surfaceColor"), samples=256
    ),
    "pixar": Case("sphere", "studio", model_layer("pixar", roughness=0.4, metallic=0.6), ("roughness", "metallic")),
    "leaf": Case("plane", "sunset", model_layer("pixar", back=0.4, clear=0.3), ("back", "clear", "roughness")),
    "ward": Case("suzanne", "lamps", model_layer("ward", alphaX=0.2, alphaY=0.3), ("alphaX", "diffuse")),
    "phong": Case("sphere", "city", model_layer("phong", exponent=40.0), ("exponent",)),
    "torrance-sparrow": Case("sphere", "city", model_layer("torrance-sparrow", roughness=0.3), ("roughness",)),
    "ashikhmin-shirley": Case("sphere", "city", model_layer("ashikhmin-shirley", exponentU=30.0), ("exponentU",)),
    "oren-nayar": Case("suzanne", "sunset", model_layer("oren-nayar", sigma=0.4), ("sigma",)),
    "controls": Case("suzanne", "controls", of_layers(RIG_LOOKS["plastic"]), ("roughness", "baseColor"), samples=256),
    "mirror": Case("suzanne", "city", of_layers(Layer("L", "mirror", {"tint": (0.7, 0.6, 0.5)})), ("tint",)),
}  # fmt: skip
CONTROLS = ("shadow", "response", "seen")
QUICK = ("interreflection", "texture")


def lights(name: str, light_of: Callable[[str], Light], folder: Path) -> tuple[Light, ...]:
    if name == "controls":
        return tuple(light for rig in CONTROLS for light in RIGS[rig](folder))
    return (RectLight.example(), DiskLight.example()) if name == "lamps" else (light_of(name),)


def task_of(case: Case, look: Look, light: tuple[Light, ...], asset: Asset) -> Any:
    live = look_with_live_inputs(look, {str(n): constant_named(look, name) for n, name in enumerate(case.names)})
    scene = scene_with_look(asset, live.layers, *light, size=SIZE)
    return scene_task(scene, Sampling(bounces=case.bounces), "mitsuba")


@pytest.mark.parametrize("name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.proof) for n in CASES])
def test_derivatives_are_those_of_differences(name: str, drjit: Any, light_of: Any, tmp_path: Path) -> None:
    from lookdev.mitsuba.derivatives import DerivativeScene
    from lookdev.mitsuba.load import load_mitsuba

    case = CASES[name]
    look = Look("look", case.layers(tmp_path))
    task = task_of(case, look, lights(case.light, light_of, tmp_path), load_asset(builtin=case.asset))
    scene, bindings = DerivativeScene(load_mitsuba("cpu"), task), live_inputs(task)
    constants = {str(n): constant_named(look, name) for n, name in enumerate(case.names)}

    def pictures(values: Mapping[str, tuple[float, ...]], symbols: tuple[str, ...]) -> np.ndarray:
        """Return the means (2 PAIRS, 1 + P, 4) of the pixels of halves."""
        inputs = {bindings[key].parameter: value for key, value in values.items()}
        seeds = [(2 * n, 2 * n + 1) for n in range(PAIRS)]
        slope_tasks = [DerivativeTask(task, POSE, inputs, symbols, case.samples, pair, "") for pair in seeds]
        halves = [scene.render(slope_task, lambda done, planned: None) for slope_task in slope_tasks]
        return np.concatenate(halves).astype(float).mean(axis=(2, 3))

    start = {key: constant.value for key, constant in constants.items()}
    symbols = tuple(symbol for key in constants for symbol in bindings[key].symbols)
    derivatives = pictures(start, symbols)[:, 1:]
    column = 0
    for key, constant in constants.items():
        low, high = constant.parameter.soft
        step = 0.02 * min(high - low, max(constant.value)) if high > 1.0 else 0.02
        for channel in range(len(constant.value)):
            ends = []
            for sign in (1.0, -1.0):
                moved = np.array(constant.value)
                moved[channel] += sign * step
                ends.append(pictures({**start, key: tuple(moved.tolist())}, ())[:, 0])
            expected = (ends[0] - ends[1]) / (2.0 * step)
            difference = derivatives[:, column] - expected
            error = difference.std(axis=0, ddof=1) / np.sqrt(len(difference))
            size = np.abs(expected.mean(axis=0))
            # Student's t of 7 degrees of freedom, and differences' own error, of the third derivative.
            assert (np.abs(difference.mean(axis=0)) < 5.4 * error + 4e-3 * size + 1e-6).all(), (constant.name, channel)
            assert (error <= 0.15 * size.max()).all(), constant.name
            assert size.max() > 1e-4, constant.name
            column += 1
    assert column == derivatives.shape[1]


def test_parts_of_two_looks_are_derived_and_a_worker_answers_the_same(
    drjit: Any, worker: Worker, light_of: Any, tmp_path: Path
) -> None:
    """Each triangle selects the program of its look; the task is the same after encoding and decoding."""
    from lookdev.mitsuba.derivatives import DerivativeScene
    from lookdev.mitsuba.load import load_mitsuba

    ball = load_asset(builtin="shaderball")
    look = Look("look", (COPPER,))
    live = look_with_live_inputs(look, {"0": constant_named(look, "roughness")})
    scene = scene_of(ball, Look("grey", (Layer("Grey", "lambert", {}),)), (light_of("city"),), SIZE)
    scene = replace(scene, look_of_slot={**scene.look_of_slot, ball.slots[0].path: live})
    task = scene_task(scene, Sampling(bounces=1), "mitsuba")
    binding = live_inputs(task)["0"]
    slope_task = DerivativeTask(task, POSE, {binding.parameter: (0.35,)}, binding.symbols, 8, (0, 1), "one")
    halves = DerivativeScene(load_mitsuba("cpu"), task).render(slope_task, lambda done, planned: None)
    assert halves.shape == (2, 2, SIZE, SIZE, 4)
    assert np.abs(halves[:, 1]).max() > 0.0
    assert decode_task(encode_task(slope_task)) == slope_task
    worker.start()
    np.testing.assert_allclose(
        worker.render_derivatives(slope_task, lambda progress: None), halves, rtol=1e-4, atol=1e-5
    )
