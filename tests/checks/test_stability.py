"""The stress test: its cases are extreme, it finds faults, and models pass."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from lookdev.arrays import Floats, Floats32
from lookdev.asset.tangents import tangents_of
from lookdev.brdf import CONTINUOUS_MODELS, MODELS
from lookdev.brdf.fresnel import schlick_weight
from lookdev.brdf.pixar import partition
from lookdev.brdf.vectors import mix_color
from lookdev.checks import stability
from lookdev.checks.evaluate import Batch, evaluate_lines, evaluate_numpy
from lookdev.checks.extremes import SceneCase, extreme_cases, moderate_numbers, random_normal_scenes, scene_cases
from lookdev.checks.finding import CheckFinding
from lookdev.checks.frames import RenderHalves
from lookdev.checks.samples import case_line
from lookdev.checks.stability import check_scenes, check_stability, check_stack, look_stack, model_stacks
from lookdev.codegen.points import PointLayer
from lookdev.errors import WorkerError
from lookdev.light import make_environment
from lookdev.material import Layer, Look, Texture
from lookdev.rendering.task import FrameTask

STACKS = {name: layers for model in CONTINUOUS_MODELS for name, layers in model_stacks(model).items()}
GREY = Look("grey", (Layer("Grey", "disney", {"roughness": 1.0}),))


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.mark.parametrize("layers", STACKS.values(), ids=STACKS)
def test_cases_are_extreme_and_legal(layers: tuple[PointLayer, ...]) -> None:
    cases = extreme_cases(layers, 4000, rng())
    wo, wi = cases.batch.wo, cases.batch.wi
    for w in (wo, wi):
        np.testing.assert_allclose(np.linalg.norm(w, axis=-1), 1.0, rtol=1e-6)
        np.testing.assert_array_equal(w, w.astype(np.float32))
    grazing = np.abs(wo[:, 2]) < 1.1e-7
    assert (grazing & cases.comparable).any()
    assert (np.abs(wo[cases.comparable][:, 2]) > 9e-8).all()
    assert ((np.abs(wo[:, 2]) < 2.0**-126) & (wo[:, 2] != 0.0)).any()
    assert (wo == wi).all(axis=-1).any()
    assert ((wo + wi)[:, :2] == 0.0).all(axis=-1).any()
    for layer, numbers in zip(layers, cases.batch.numbers, strict=True):
        for name, parameter in MODELS[layer.model].parameters.items():
            if parameter.kind != "token" and name not in layer.constants:
                low, high = np.float32(parameter.hard).tolist()
                value = numbers[name]
                assert ((value >= low) & (value <= high)).all()
                # Float32 may not have the ends.
                ends = np.nextafter(np.float32([low, high]), np.float32([high, low]))
                assert parameter.kind == "normal" or (value.min() <= ends[0] and value.max() >= ends[1])
        denormal = [(np.abs(value) < 2.0**-126) & (value != 0.0) for value in numbers.values()]
        assert any(mask.any() for mask in denormal)
        assert not any(mask[cases.comparable].any() for mask in denormal)


def test_moderate_numbers_amplify_nothing() -> None:
    for numbers in moderate_numbers(STACKS["pixar over disney"], 200, rng()):
        for name, value in numbers.items():
            assert name in ("ior", "eta", "k") or value.max() <= 1.0


def test_a_case_replays() -> None:
    cases = extreme_cases(STACKS["disney over pixar"], 50, rng())
    lines = [case_line(cases.batch, index, excess=2.0) for index in range(50)]
    got = [json.loads(line) for line in evaluate_lines(lines, "numpy")]
    for name, values in zip(("f", "pdf"), evaluate_numpy(cases.batch), strict=True):
        np.testing.assert_array_equal([answer[name] for answer in got], values)
    assert got[0]["excess"] == 2.0


def test_what_a_look_fixes_stays() -> None:
    inputs = {"metallic": 0.1, "baseColor": (0.1, 0.2, 0.3), "variant": "2012"}
    (layer,) = look_stack(Look("rusty", (Layer("Metal", "disney", inputs),)))
    assert layer.tokens == {"variant": "2012", "fresnel": "schlick", "metal": "none", "metalColor": "nearest"}
    assert layer.constants["metallic"] == np.float32(0.1)
    cases = extreme_cases((layer,), 100, rng())
    assert cases.batch.numbers == ({},)
    varied = Look("varied", (Layer("Metal", "disney", {"metallic": Texture(Path("none.png"), "r", "raw")}),))
    with pytest.raises(Exception, match=r"none\.png"):
        look_stack(varied)


def _fake(batch: Batch, change: str) -> tuple[Floats, Floats]:
    f, density = evaluate_numpy(batch)
    usual = int(np.argmin(np.abs(f[: len(f) // 2] - 0.3).max(axis=-1)))
    match change:
        case "nan":
            f[7, 1] = np.nan
        case "negative":
            density[7] = -1e-30
        case "infinite":
            f[-1, 0] = np.inf
        case "wrong":
            f[usual] *= 1.01
    return f, density


@pytest.mark.parametrize("change", ["", "nan", "negative", "infinite", "wrong"])
def test_one_bad_value_fails_a_stack(change: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stability, "evaluate_cycles", lambda batch: _fake(batch, change))
    finding = check_stack("disney", STACKS["disney 2014 schlick"], rng(), "quick")
    assert finding.passed is (change == "")
    assert finding.figures["failed"] == float(change != "")
    assert finding.figures["unsound_cycles"] == float(change in ("nan", "negative", "infinite"))
    if change:
        assert json.loads(finding.details[0])["excess"] > 1.0


def test_too_much_light_fails_a_stack(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stability, "evaluate_cycles", evaluate_numpy)
    monkeypatch.setitem(MODELS, "disney", replace(MODELS["disney"], energy=lambda tokens: 1.0))
    finding = check_stack("disney", STACKS["disney 2014 schlick"], rng(), "quick")
    assert not finding.passed
    assert finding.figures["failed"] == 0.0
    assert finding.figures["largest_albedo"] > 1.0


@dataclass(frozen=True)
class Picture:
    a: Floats32
    b: Floats32
    alpha: Floats32


def picture(value: float = 0.5, seed: int = 0, alpha: float = 1.0) -> Picture:
    a, b = np.random.default_rng(seed).normal(value, 0.01, (2, 8, 8, 3)).astype(np.float32)
    return Picture(a, b, np.full((8, 8), alpha, np.float32))


CASES = {case.name: case for case in scene_cases()}


def constant_light(case: SceneCase) -> SceneCase:
    """Return a case whose light, as bright as the brightest of its own, needs no tables: nothing is rendered by it."""
    radiance = np.full((2, 4, 3), case.light.radiance.max(), np.float32)
    return replace(case, light=make_environment("constant", radiance))


def judge(name: str, frame: Picture) -> CheckFinding:
    pictures = {"usual": picture(seed=1), name: frame}
    cases = [constant_light(CASES[other]) for other in dict.fromkeys([CASES[name].base_case or name, name])]
    *_, finding = check_scenes(GREY, cases, lambda task: pictures[task.digest.partition(", ")[2]])
    return finding


def _with_pixel(frame: Picture, value: float) -> Picture:
    a = frame.a.copy()
    a[3, 3, 1] = value
    return replace(frame, a=a)


BLACK = Picture(*np.zeros((2, 8, 8, 3), np.float32), np.ones((8, 8), np.float32))


@pytest.mark.parametrize(
    ("name", "frame", "passed"),
    [
        ("usual", picture(), True),
        ("usual", _with_pixel(picture(), np.nan), False),
        ("usual", _with_pixel(picture(), np.inf), False),
        ("usual", _with_pixel(picture(), -1e-30), False),
        ("usual", replace(picture(), alpha=np.zeros((8, 8), np.float32)), False),
        ("10 km", picture(), True),
        ("10 km", picture(0.53), False),
        ("10 km", picture(alpha=0.9), False),
        ("light times 1e6", replace(picture(), a=1e6 * picture().a, b=1e6 * picture().b), True),
        ("light times 1e6", picture(), False),
        ("black", BLACK, True),
        ("black", _with_pixel(BLACK, 1e-30), False),
        ("white", picture(0.9), True),
        ("white", picture(4.1), False),
    ],
)
def test_a_picture_is_judged(name: str, frame: Picture, passed: bool) -> None:
    assert judge(name, frame).passed is passed


def test_no_picture_is_a_finding() -> None:
    def render(task: FrameTask) -> Picture:
        raise WorkerError("the render worker's array 'a' has pixels that are not finite")

    cases = [constant_light(CASES[name]) for name in ("usual", "10 km")]
    findings = list(check_scenes(GREY, cases, render))
    assert [finding.passed for finding in findings] == [False, False]
    assert "not finite" in findings[0].summary


def test_scenes_are_as_named() -> None:
    for case in CASES.values():
        assert not case.base_case or case.base_case in CASES
    triangles = CASES["degenerate triangles"].asset.meshes[0].corner_points[-3 * 100 :].reshape(-1, 3)
    assert all(len(set(triangle)) < 3 for triangle in triangles.tolist())
    flat = CASES["zero-area UVs"].asset.meshes[0]
    assert np.ptp(flat.uvs["st"]) == 0.0
    np.testing.assert_allclose(np.linalg.norm(tangents_of([flat])[0], axis=-1), 1.0, rtol=1e-6)
    assert CASES["0.1 mm, 100 km away"].asset.radius < 2e-4
    assert np.linalg.norm(CASES["0.1 mm, 100 km away"].asset.center) > 1e5
    assert CASES["sun of a texel, 1e6"].light.radiance.max() == 1e6


@pytest.mark.cycles
def test_far_and_tiny_is_like_near_and_usual(render: RenderHalves) -> None:
    # Cycles' float32 has steps of 1/128 m there, much larger than an asset of 0.1 mm.
    cases = [CASES[name] for name in ("usual", "100 km away", "0.1 mm, 100 km away", "flipped normals")]
    findings = list(check_scenes(GREY, cases, render))
    assert [finding.summary for finding in findings if not finding.passed] == []


@pytest.mark.cycles
def test_another_picture_is_found(render: RenderHalves) -> None:
    other = replace(CASES["10 km"], asset=random_normal_scenes()[0].asset)
    findings = list(check_scenes(GREY, [CASES["usual"], other], render))
    assert [finding.passed for finding in findings] == [True, False]


@pytest.mark.cycles
@pytest.mark.usefixtures("warm_points")
@pytest.mark.parametrize("scenes", [1, pytest.param(2, marks=pytest.mark.proof)])  # the sun's tables take seconds
def test_a_look_of_constants_passes(scenes: int, render: RenderHalves, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stability, "random_normal_scenes", lambda: random_normal_scenes()[:scenes])
    look = Look("lacquer", (Layer("Lacquer", "pixar", {"roughness": 0.0, "clear": 1.0, "energy": "conserving"}),))
    findings = list(check_stability([look], render, depth="quick"))
    subjects = ["lacquer", "lacquer, normals anywhere", "lacquer, normals anywhere, sun of 1e6"]
    assert [finding.subject for finding in findings] == subjects[: 1 + scenes]
    assert len(random_normal_scenes()) == len(subjects) - 1
    assert [finding.summary for finding in findings if not finding.passed] == []


@pytest.mark.cycles
@pytest.mark.usefixtures("warm_points")
def test_a_formula_that_cancels_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    layers = STACKS["pixar published schlick"]
    assert check_stack("pixar", layers, rng(), "default").passed
    monkeypatch.setattr(
        partition, "fresnel_blend", lambda normal, grazing, cos: mix_color(normal, grazing, schlick_weight(cos))
    )
    finding = check_stack("pixar", layers, rng(), "default")
    assert not finding.passed
    assert finding.figures["unsound_numpy"] == 0.0


@pytest.mark.cycles
@pytest.mark.usefixtures("warm_points")
def test_a_normal_bent_by_less_than_float32_resolves_gives_no_negative_light() -> None:
    normal = [-0.36725595593452454, 0.2055877447128296, 0.8102683424949646]
    params = {"baseColor": [1.0, 0.8, 0.5], "subsurface": 1.0, "normal": normal}
    wo = [0.747011661529541, -0.6648108959197998, 9.999999682655225e-21]
    case = {"model": "disney", "params": params, "wo": wo, "wi": [-wo[0], -wo[1], wo[2]]}
    (line,) = evaluate_lines([json.dumps(case)], "cycles")
    assert min(json.loads(line)["f"]) >= 0.0
