"""Frames of meshes against the float64 reference: textures, masks, normals, views, recesses, and bounces."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from agreement import assert_scene_agreement, check_scene, scene_pixels
from failed_pictures import comparison
from frames import POSE, render_seeds, replaced, scene_of
from painted import embossed, image, painted, sparkling
from stored_references import StoredReference

from lookdev.arrays import Floats
from lookdev.asset import Asset, Instance, load_asset, make_asset
from lookdev.asset.tangents import tangents_of
from lookdev.checks.albedo import check_albedo
from lookdev.checks.finding import CheckFinding
from lookdev.light import Light
from lookdev.material import Bump, Formula, Layer, Look, Texture, ViewCosine
from lookdev.material.expression import parse
from lookdev.rendering.worker import Worker
from lookdev.scene import Sampling, Scene

pytestmark = pytest.mark.cycles

Agree = Callable[..., CheckFinding]

SIZE = 48


@pytest.fixture
def assert_agrees(worker: Worker, stored_reference: StoredReference) -> Agree:
    """Return a function that compares frames of a scene with the reference, and checks that light bounces in them."""

    def agree(scene: Scene, *, backend: str = "exact", bounces: int = 2, wrong: Scene | None = None) -> CheckFinding:
        samples = 32
        options: dict[str, Any] = {"samples": samples, "brdf_samples": 2, "ibl_samples": 4, "bounces": bounces}
        # Four frames have the fewest halves.
        frames = render_seeds(worker, scene, range(4), backend=backend, **options)
        name = f"{scene.asset.name} {scene.looks[0].name}"
        finding = assert_scene_agreement(name, frames, scene, samples, stored_reference, count=80, bounces=bounces)
        others = {f"{name} direct": (scene, 0)} | ({f"{name} wrong": (wrong, bounces)} if wrong else {})
        for label, (other, depth) in others.items():
            assert not check_scene(label, frames, other, samples, stored_reference, count=80, bounces=depth).passed
        return finding

    return agree


@pytest.mark.parametrize(
    ("name", "look"),
    [
        pytest.param("suzanne", painted, marks=pytest.mark.both_pythons),
        pytest.param("shaderball", painted, marks=pytest.mark.proof),
        pytest.param("suzanne", embossed, marks=pytest.mark.proof),
        # Heights are those of pearl, below; a normal of highlights alone is that of sparkling.
        pytest.param("shaderball", embossed, marks=pytest.mark.proof),
        ("suzanne", sparkling),
        pytest.param("shaderball", sparkling, marks=pytest.mark.proof),
    ],
)
def test_meshes_agree_within_their_own_noise(name: str, look, assert_agrees: Agree, light_of, tmp_path: Path) -> None:
    layers = Look(look.__name__, look(tmp_path))
    finding = assert_agrees(scene_of(load_asset(builtin=name), layers, (light_of("city"),), SIZE))
    # The comparison is accurate enough for a fault of a few percent to show.
    assert finding.figures["bias_limit"] < 0.05


def test_a_reflected_instance_has_its_bitangent_on_the_other_side(assert_agrees: Agree, light_of) -> None:
    suzanne = load_asset(builtin="suzanne")
    reflected = make_asset("reflected", suzanne.meshes, [Instance(0, np.diag([-1.0, 1.0, 1.0, 1.0]))], suzanne.slots)
    inputs = {"baseColor": (0.5, 0.5, 0.5), "roughness": 0.5, "normal": (0.0, 0.6, 0.8)}
    look = Look("leaning", (Layer("Leaning", "disney", inputs),))
    assert assert_agrees(scene_of(reflected, look, (light_of("city"),), SIZE)).figures["bias_limit"] < 0.05


def tangent_pixels(asset: Asset, look: Look, light: Light) -> Mapping[str, Floats]:
    """Return pixels of a mesh with its tangents, and with others, a quarter turn from them."""
    (mesh,), (tangents,) = asset.meshes, tangents_of(asset.meshes)
    arrays = {}
    for name, directions in (("right", tangents), ("turned", np.cross(mesh.normals, tangents))):
        other = replace(asset, meshes=(replace(mesh, tangents=directions),))
        reference = scene_pixels(scene_of(other, look, (light,), SIZE), POSE, 200)
        arrays |= {"pixels": reference["pixels"], name: reference["value"]}
    return arrays


@pytest.mark.parametrize(
    ("name", "backend"),
    [
        ("brushed", "exact"),
        pytest.param("normal-mapped", "nodes", marks=pytest.mark.both_pythons),
        pytest.param("brushed", "nodes", marks=pytest.mark.proof),
        pytest.param("normal-mapped", "exact", marks=pytest.mark.proof),
    ],
)
def test_looks_that_read_tangents_get_them(
    name: str, backend: str, worker: Worker, light_of, tmp_path: Path, stored_reference: StoredReference
) -> None:
    asset, light = load_asset(builtin="suzanne"), light_of("slopes")
    inputs: dict[str, Any] = {"baseColor": (0.9, 0.7, 0.4), "metallic": 1.0, "roughness": 0.4}
    if name == "brushed":
        inputs["anisotropic"] = 1.0
    else:
        grain = image(tmp_path / "grain.png", 2)
        inputs["normal"] = Texture(grain, "rgb", "raw", scale=(0.8, 0.8, 0.2, 1.0), bias=(-0.1, -0.4, 0.8, 0.0))
    look = Look("look", (Layer("Metal", "disney", inputs),))
    scene = scene_of(asset, look, (light,), SIZE)
    frames = render_seeds(worker, scene, range(2), backend=backend, samples=64, bounces=0)
    reference = stored_reference(f"tangents {name}", tangent_pixels, asset=asset, look=look, light=light)
    columns, rows = reference["pixels"].T
    picture = np.mean([(frame.a.astype(np.float64) + frame.b) / 2.0 for frame in frames], axis=0)
    with comparison(picture, reference["right"], reference["pixels"]):
        pixels, right, turned = picture[rows, columns], reference["right"], reference["turned"]
        assert np.abs(pixels - right).mean() < 0.25 * np.abs(turned - right).mean()


def view_formula(text: str, **inputs: Any) -> Formula:
    return Formula(parse(text), {"view": ViewCosine(), **inputs}, {"view": "float", **dict.fromkeys(inputs, "float")})


def pearl(bump: Bump | None = None, exponent: int = 2) -> tuple[Layer, ...]:
    """Return two-tone paint, rougher where it faces the viewer, under dust that is visible at grazing views."""
    inputs = {
        "baseColor": view_formula(f"mix([.8, .1, .05], [.05, .2, .8], (1 - view) ^ {exponent})"),
        "roughness": view_formula("0.2 + 0.5 * view"),
        "metallic": 0.5,
    }
    dust = Layer("Dust", "pixar", {"surfaceColor": (0.6, 0.5, 0.3)}, view_formula("smoothstep(1 - view, 0.4, 0.9)"))
    return Layer("Paint", "disney", inputs | ({"normal": bump} if bump else {})), dust


VEIL = Look(
    "veil",
    (
        Layer(
            "Veil",
            "pixar",
            {"presence": view_formula("0.9 - 0.6 * view"), "clear": 0.4, "back": view_formula("1 - view")},
        ),
    ),
)


@pytest.fixture
def bump(tmp_path: Path) -> Bump:
    blocks = np.kron(np.random.default_rng(1).integers(0, 256, (8, 8)), np.ones((2, 2))).astype(np.uint8)
    assert oiio.ImageBuf(blocks[..., None]).write(str(tmp_path / "height.png"))
    return Bump(Texture(tmp_path / "height.png", "r", "raw"), 0.02)


@pytest.mark.proof  # in the default tier a presence depends on the view
@pytest.mark.parametrize("name", ["shaderball", "suzanne"])
def test_a_look_that_depends_on_the_view_agrees(name: str, bump: Bump, assert_agrees: Agree, light_of) -> None:
    # Another dependence on the view is another frame.
    scene, wrong = (
        scene_of(load_asset(builtin=name), Look("pearl", pearl(bump, exponent)), (light_of("city"),), SIZE)
        for exponent in (2, 3)
    )
    assert_agrees(scene, wrong=wrong)


def test_a_view_behind_a_hole_is_that_of_the_ray(assert_agrees: Agree, light_of) -> None:
    assert_agrees(scene_of(load_asset(builtin="suzanne"), VEIL, (light_of("city"),), SIZE))


def test_the_view_of_exact_nodes_agrees(bump: Bump, assert_agrees: Agree, light_of) -> None:
    look = Look("pearl", pearl(bump))
    assert_agrees(scene_of(load_asset(builtin="shaderball"), look, (light_of("slopes"),), SIZE), backend="nodes-exact")


@pytest.mark.parametrize("backend", [pytest.param("exact", marks=pytest.mark.proof), "nodes"])
def test_albedos_are_those_of_each_view(backend: str, worker) -> None:
    def render(task: Any) -> Any:
        worker.start()
        return worker.render(task, lambda progress: None)

    finding = check_albedo(Look("pearl", pearl()), render, angles=(0.0, 45.0, 80.0), backend=backend)
    assert finding.figures["curves"] == 1.0
    assert finding.passed, "\n".join((finding.summary, *finding.details))


COPPER: dict[str, Any] = {"baseColor": (0.95, 0.64, 0.54), "metallic": 1.0, "roughness": 0.45}
OFTEN = replaced("#define LEAST_DENSITY 0.01\n", "#define LEAST_DENSITY 0.3\n")
Compare = Callable[[Callable[[str], str]], CheckFinding]


@pytest.fixture(params=[0.0, pytest.param(0.7, marks=pytest.mark.proof)], ids=["copper", "brushed copper"])
def compare(request: pytest.FixtureRequest, worker: Worker, light_of, stored_reference: StoredReference) -> Compare:
    """Return a function that renders recesses of glossy looks by altered OSL and compares them with the reference.

    The looks have their usual numbers of directions, of which Russian roulette chooses those that are traced.
    """
    look = Look("look", (Layer("Metal", "disney", COPPER | {"anisotropic": request.param}),))
    scene = scene_of(load_asset(builtin="shaderball"), look, (light_of("slopes"),), SIZE)

    def compare_altered(alter: Callable[[str], str]) -> CheckFinding:
        frames = render_seeds(worker, scene, range(4), alter=alter, samples=32)
        options = {"count": 80, "bounces": Sampling.bounces}
        return check_scene(f"recess {request.param}", frames, scene, 32, stored_reference, **options)

    return compare_altered


@pytest.mark.parametrize("alter", [pytest.param(str, marks=pytest.mark.proof), OFTEN], ids=["as is", "often"])
def test_few_directions_and_roulette_keep_the_mean(alter: Callable[[str], str], compare: Compare) -> None:
    """The mean is right even if roulette ends more than half of the light's directions."""
    finding = compare(alter)
    assert finding.passed, "\n".join((finding.summary, *finding.details))
    assert finding.figures["bias_limit"] < 0.05


@pytest.mark.proof
def test_survivors_without_their_weight_are_found(compare: Compare) -> None:
    fault = replaced("ratio /= traced;", "")
    assert not compare(lambda osl: fault(OFTEN(osl))).passed
