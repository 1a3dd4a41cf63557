"""Skips: the condition of each, and of a look that is the same all around."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lookdev.asset import load_asset
from lookdev.brdf import CONTINUOUS_MODELS, MODELS, complete_parameters, evaluate_cosine
from lookdev.cache import Content
from lookdev.codegen.setting import SourceSetting
from lookdev.codegen.source import AttributeBinding, NodeSource, NodeTree, ShaderNode, ShaderSource, TextureBinding
from lookdev.job import Job
from lookdev.light import Dome, load_environment, prepare_light
from lookdev.light.mapping import rotate_z
from lookdev.material import Bump, Coordinates, Formula, Layer, Look, Primvar, Texture
from lookdev.material.expression import parse
from lookdev.plan import Setup, TurntableFrames, make_setup
from lookdev.plan.plan import find_skips
from lookdev.plan.skips import is_rotation_invariant, scene_skips
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.task import SceneTask
from lookdev.scene import Camera, Sampling, Scene

MakeJob = Callable[..., Job]
SkipsOf = Callable[..., list[str]]
MAP = Texture(Path("map.png"), "r", "raw")
OTHER = replace(MAP, file=Path("other.png"))
PLAIN = Layer("Base", "disney", {"baseColor": (0.5, 0.4, 0.3), "roughness": 0.3})
NOISE = Formula(parse("noise(uv[0], uv[1])"), {"uv": Coordinates("st")}, {"uv": "color"})
MASK = Formula(parse("a"), {"a": MAP, "b": OTHER}, {"a": "float", "b": "float"})
BLUE = replace(MAP, channel="b", bias=(0.1,) * 4)
SAMPLING = Sampling(samples=4, bounces=0)
LIGHT = Dome(*(Content(part, ".exr") for part in "rpsb"), 64, 32, "119147")


def look(*layers: Layer) -> Look:
    return Look("gold", layers)


def base(model: str = "disney", **inputs: Any) -> Layer:
    return Layer("Base", model, inputs)


def dirt(mask: Any = 0.0, **inputs: Any) -> Layer:
    return Layer("Dirt", "disney", inputs, mask)


@pytest.fixture
def shader(tmp_path: Path) -> Callable[..., ShaderSource]:
    """Return a function that generates the shader of a look; its images are empty files."""
    image = tmp_path / "linear.exr"
    image.touch()

    def generate(one_look: Look, light: Dome = LIGHT, **sampling: Any) -> ShaderSource:
        setting = SourceSetting((light,), (8, 8), replace(SAMPLING, **sampling), resolve=lambda texture: image)
        return BACKENDS["exact"].generate(one_look, setting)

    return generate


def nodes(*labels: str, **values: Any) -> NodeSource:
    image = Content("linear", ".exr")
    images = tuple(ShaderNode(f"Image {n}", "TexImage", label=label, image=image) for n, label in enumerate(labels))
    return NodeSource("gold", (NodeTree("gold", images),), (), "500d", exact=False, **values)


@pytest.mark.parametrize(
    ("layers", "same"),
    [
        ((PLAIN,), True),
        ((PLAIN, dirt(0.4, clearcoat=1.0)), True),
        ((base(normal=(0.0, 0.0, 0.5), anisotropic=0.0),), True),
        ((base("pixar", clear=0.5, presence=0.7),), True),
        ((base(anisotropic=0.1),), False),
        ((PLAIN, dirt(0.4, anisotropic=0.5)), False),
        ((base(normal=(0.1, 0.0, 1.0)),), False),
        ((base("pixar", highlightNormal=(0.0, -0.1, 1.0)),), False),
        ((base(roughness=MAP),), False),
        ((base(roughness=Primvar("wear", 0.5)),), False),
        ((base(normal=Bump(MAP)),), False),
        ((PLAIN, dirt(MAP)), False),
        ((PLAIN, dirt(NOISE)), False),
        # What reaches no pixel does not count.
        ((PLAIN, dirt(roughness=MAP)), True),
        ((PLAIN, dirt(anisotropic=MAP)), True),
        ((base("ward", alphaX=0.2, alphaY=0.2),), True),
        ((base("ward", alphaX=0.2, alphaY=0.1),), False),
    ],
)
def test_is_rotation_invariant(layers: tuple[Layer, ...], same: bool, shader: Callable[..., ShaderSource]) -> None:
    one_look = look(*layers)
    assert is_rotation_invariant([shader(one_look)]) is same


def test_every_part_must_be_the_same_all_around_and_read_nothing() -> None:
    even = ShaderSource("even", "", (), (), "")
    mapped = replace(even, textures=(TextureBinding("texture0_file", Content("m", ".exr")),))
    wear = (AttributeBinding("primvar_wear", "wear", "float", (0.0,)),)
    assert is_rotation_invariant([even] * 2)
    assert is_rotation_invariant([nodes()])
    for parts in ([even, mapped], [replace(even, attributes=wear), even], [nodes("map")]):
        assert not is_rotation_invariant(parts)
    assert not is_rotation_invariant([replace(nodes(), attributes=wear)])


@pytest.mark.parametrize(("axis", "around"), [(None, True), ((0.0, 1e-7), True), ((0.0, 0.5), False)])
def test_a_ball_looks_the_same_all_around_its_axis(axis: tuple[float, float] | None, around: bool) -> None:
    ball = load_asset(builtin="sphere")
    camera = replace(Camera(40.0, 10.0, ball.center, 5.0), axis=axis)
    scene = Scene.of_look(ball, look(PLAIN), prepare_light(load_environment(builtin="white")), (8, 8), camera)
    assert make_setup("plain", "white", scene, Sampling()).is_rotation_invariant is around


@pytest.mark.parametrize("model", CONTINUOUS_MODELS)
def test_no_input_of_any_model_has_a_direction_unknown_here(model: str, shader: Callable[..., ShaderSource]) -> None:
    """A BSDF that changes when both directions turn about the normal is not the same all around."""
    usual = {"pixar": {"clear": 0.4, "back": 0.4, "roughness": 0.4}, "disney": {"metallic": 0.5, "clearcoat": 0.5}}
    rng = np.random.default_rng(0)
    wo, wi = rng.normal(size=(2, 200, 3))
    wo, wi = (w / np.linalg.norm(w, axis=-1, keepdims=True) for w in (np.abs(wo) * [-1.0, 1.0, 1.0], wi))
    for name in CONTINUOUS_MODELS[model].parameters:
        parameter = MODELS[model].parameters[name]
        if name == "variant":
            continue
        value: Any = {"color": (0.9, 0.2, 0.4), "normal": (0.3, -0.2, 0.9), "token": parameter.choices[-1:]}.get(
            parameter.kind, parameter.soft[0] + 0.7 * (parameter.soft[1] - parameter.soft[0])
        )
        # Every lobe is there.
        inputs = usual.get(model, {}) | MODELS[model].probe | {name: value[0] if parameter.kind == "token" else value}
        bsdf = MODELS[model].bsdf(complete_parameters(model, inputs))
        f, turned = (evaluate_cosine(bsdf, rotate_z(wo, angle), rotate_z(wi, angle)) for angle in (0.0, 50.0))
        assert f.any(), name
        same = np.allclose(f, turned, rtol=1e-6, atol=1e-12)
        assert is_rotation_invariant([shader(look(base(model, **inputs)))]) == same, name


@pytest.fixture
def skips_of(make_job: MakeJob, make_setups: Callable[..., list[Setup]]) -> SkipsOf:
    """Return a function that returns the skips of one look, the same under both lights."""

    def skips_of(job_or_text: Job | str, scene: SceneTask, one_look: Look, around: bool = False) -> list[str]:
        job = make_job(job_or_text) if isinstance(job_or_text, str) else job_or_text
        scenes = {(entry.name, ibl.name): scene for entry in job.look for ibl in job.ibl}
        setups = make_setups(job, scenes, scenes if around else (), one_look)
        scene_of_look: Any = SimpleNamespace(looks=(one_look,) * len(scene.slot_shaders), lights=scene.lights)
        setups = [replace(entry, scene=scene_of_look) for entry in setups]
        skips = list(find_skips(setups, TurntableFrames(job.turntable, job.output, job.camera.azimuth)))
        by_scene = [[str(skip) for skip in skips if (skip.look, skip.ibl) == key] for key in scenes]
        assert all(entry == by_scene[0] for entry in by_scene)
        assert [(skip.look, skip.ibl) for skip in skips] == [key for key in scenes for _ in by_scene[0]]
        # element 0, 90, 180, 270 and lighting 0, 120, 240: pose 0 is shared in any case.
        assert by_scene[0].count("1 of 7 frames (same pose)") == (len(job.turntable) == 2)
        return [entry for entry in by_scene[0] if not entry.endswith("(same pose)")]

    return skips_of


@pytest.fixture
def bare(scene: SceneTask) -> SceneTask:
    """Return a scene that skips nothing under a job with two bounces."""
    source = ShaderSource("gold", "", (), (), "500d", transmits=True, directions=(4, 4))
    return replace(scene, shaders=(source,), sampling=replace(SAMPLING, bounces=2))


def test_each_skip_has_its_cause(skips_of: SkipsOf, make_job: MakeJob, bare: SceneTask) -> None:
    (source,) = bare.shaders

    def changed(shaders: tuple[ShaderSource, ...] = bare.shaders, more: str = "", **values: Any) -> list[str]:
        job = make_job(more)
        # An element turntable alone: a constant light leaves its frames as they are.
        job = job.model_copy(update={"turntable": job.turntable[:1]})
        return skips_of(job, replace(bare, shaders=shaders, **values), look(PLAIN))

    assert skips_of("", bare, look(PLAIN)) == []
    convex = replace(bare.sampling, bounces=0)
    assert changed(sampling=convex) == ["bounces (convex asset)"]
    assert changed(sampling=convex, more="[render]\nbounces = 0\n") == []
    unshaded = replace(source, shadows=False)
    assert changed((unshaded,)) == ["shadow rays (convex asset)"]
    assert changed((unshaded, source)) == []
    opaque = replace(source, transmits=False)
    assert changed((opaque,)) == ["light from behind (nothing transmits)"]
    assert changed((opaque, source)) == []
    unlit, white = replace(source, directions=(4, 0)), replace(bare.lights[0], constant=True)
    assert changed((unlit,), lights=(white,)) == ["light samples (constant light)"]
    assert changed((unlit,), lights=(white,), more="[render]\nibl_samples = 0\n") == []
    assert changed((unlit, source), lights=(white,)) == []
    assert changed((replace(source, folded=1),)) == ["1 lobe (is 0 by constants)"]
    assert changed((replace(source, folded=1), replace(source, folded=2))) == ["3 lobes (are 0 by constants)"]
    broad = replace(source, directions=(0, 4))
    assert changed((broad, broad)) == ["BRDF samples (every lobe is broad)"]
    assert changed((broad, source)) == []


@pytest.mark.parametrize(
    ("lights", "skips"), [(1, []), (2, [("1 light", "reaches no part")]), (3, [("2 lights", "reach no part")])]
)
def test_lights_that_a_scene_does_not_have_are_counted(
    bare: SceneTask, lights: int, skips: list[tuple[str, str]]
) -> None:
    assert list(scene_skips(bare, [look(PLAIN)], bare.sampling, lights)) == skips


def test_generated_shaders_have_the_facts(skips_of: SkipsOf, bare: SceneTask, shader: Callable[..., Any]) -> None:
    diffuse = look(base("pixar", roughness=1.0))
    scene = replace(bare, shaders=(shader(diffuse),), sampling=SAMPLING)
    assert skips_of("", scene, diffuse) == [
        "bounces (convex asset)",
        "light from behind (nothing transmits)",
        "BRDF samples (every lobe is broad)",
        "5 lobes (are 0 by constants)",
    ]
    white = replace(LIGHT, constant=True)
    leaf = look(base("pixar", roughness=0.5, back=0.5))
    assert skips_of("", replace(bare, lights=(white,), shaders=(shader(leaf, white),)), leaf) == [
        "light samples (constant light)",
        "3 lobes (are 0 by constants)",
        "2 of 6 frames (constant light)",
    ]


@pytest.mark.parametrize(
    ("layers", "skip"),
    [
        ((base(roughness=MAP, metallic=OTHER),), None),
        ((base(roughness=MAP), dirt(roughness=OTHER)), "1 texture (reaches no pixel)"),
        # One look-up of three channels is one texture; what is also read elsewhere is not skipped.
        (
            (base(roughness=MAP), dirt(roughness=OTHER, metallic=replace(OTHER, channel="g")), dirt(roughness=BLUE)),
            "1 texture (reaches no pixel)",
        ),
        ((base(roughness=0.5), dirt(normal=Bump(MAP, 0.3), roughness=OTHER)), "2 textures (reach no pixel)"),
        ((PLAIN, dirt(MASK, roughness=0.9)), "1 texture (reaches no pixel)"),
    ],
)
def test_textures_that_reach_no_pixel_are_counted(
    skips_of: SkipsOf, bare: SceneTask, shader: Callable[..., Any], layers: tuple[Layer, ...], skip: str | None
) -> None:
    one_look = look(*layers)
    source = replace(shader(one_look), transmits=True, directions=(4, 4), folded=0)
    # Two slots that wear one look read its textures once.
    assert skips_of("", replace(bare, shaders=(source,), slot_shaders=(0, 0)), one_look) == ([skip] if skip else [])


def test_skips_of_native_nodes(skips_of: SkipsOf, make_job: MakeJob, bare: SceneTask) -> None:
    """They have no directions of the BRDF and the light."""
    white = replace(bare.lights[0], constant=True)
    element = make_job().model_copy(update={"turntable": make_job().turntable[:1]})

    def skipped(source: NodeSource, *layers: Layer) -> list[str]:
        return skips_of(element, replace(bare, backend="nodes", shaders=(source,), lights=(white,)), look(*layers))

    assert skipped(nodes(transmits=True), PLAIN) == []
    assert skipped(nodes(), PLAIN) == ["light from behind (nothing transmits)"]
    two = base(roughness=MAP, metallic=OTHER)
    assert skipped(nodes("map", "other", transmits=True), two) == []
    assert skipped(nodes("other", transmits=True), two) == ["1 texture (reaches no pixel)"]
    # A set is one texture; its tiles are nodes with one label.
    tiled = base(roughness=replace(MAP, file=Path("t.<UDIM>.png")))
    assert skipped(nodes("t.<UDIM>", "t.<UDIM>", transmits=True), tiled) == []
    tiles = tuple(TextureBinding(f"texture0_{number}_file", Content("t", ".exr")) for number in (1001, 1002))
    assert skips_of("", replace(bare, shaders=(replace(bare.shaders[0], textures=tiles),)), look(tiled)) == []


@pytest.mark.parametrize("backend", [name for name, entry in BACKENDS.items() if entry.source is NodeSource])
def test_generated_nodes_have_the_facts(skips_of: SkipsOf, backend: str, bare: SceneTask, tmp_path: Path) -> None:
    image = tmp_path / "linear.exr"
    image.touch()
    one_look = look(base(roughness=MAP), dirt(roughness=OTHER))
    source = BACKENDS[backend].generate(
        one_look, SourceSetting((LIGHT,), (8, 8), SAMPLING, resolve=lambda texture: image)
    )
    skips = skips_of("", replace(bare, backend=backend, shaders=(source,)), one_look)
    assert skips == ["light from behind (nothing transmits)", "1 texture (reaches no pixel)"]


def test_frames_are_counted_by_pose(skips_of: SkipsOf, make_job: MakeJob, bare: SceneTask) -> None:
    assert skips_of("", bare, look(PLAIN), around=True) == ["3 of 6 frames (same all around)"]
    still = make_job().model_copy(update={"turntable": make_job().turntable[1:]})
    assert skips_of(still, bare, look(PLAIN), around=True) == []
    white = replace(bare, lights=(replace(bare.lights[0], constant=True),))
    assert skips_of("", white, look(PLAIN)) == ["2 of 6 frames (constant light)"]
    assert skips_of("", white, look(PLAIN), around=True) == ["5 of 6 frames (same all around, constant light)"]
    turned = make_job().model_copy(update={"turntable": make_job().turntable[:1]})
    assert skips_of(turned, white, look(PLAIN)) == []
