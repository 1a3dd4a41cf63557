"""Every registered kind of light, and a new one (`cone`): its protocol in NumPy, and frames by its OSL."""

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import cone
import numpy as np
import pytest
from agreement import assert_scene_agreement
from frames import render_seeds, scene_of
from light_cases import Floats, assert_follows, cells, dome, overcast, sunny
from looks import quick_among
from pydantic import TypeAdapter, ValidationError
from sample_density import jacobian

from lookdev.asset import load_asset
from lookdev.cache import Content
from lookdev.codegen.osl.light import light_sections
from lookdev.errors import CodegenError, EnvironmentMapError
from lookdev.light import LIGHT_KINDS, AnyLight, EnvironmentMap, Light, PosedLight, RectLight, SphereLight
from lookdev.light.dome.environment import make_environment
from lookdev.light.emission import Emission, Falloff, LightLink, Shadow, Shaping
from lookdev.light.ies import IesProfile
from lookdev.light.picture import prepare_texture
from lookdev.material import Layer, Look
from lookdev.rendering.scene import scene_task
from lookdev.rendering.worker import Worker
from lookdev.scene import Sampling, Scene
from lookdev.studio.viewport import view_scene


def overcast_map() -> EnvironmentMap:
    return make_environment("picture", np.random.default_rng(2).uniform(size=(8, 16, 3)) ** 3)


def shaped() -> Light:
    """Return a sphere light with every optional feature."""
    angles = np.array([[0.0, 0.0, 90.0, 180.0], [0.0, 3.0, 1.0, 0.5], [360.0, 3.0, 1.0, 0.5]], np.float32)
    profile = IesProfile(Content.store_written(".npy", lambda path: np.save(path, angles)), 0.5, 1.5)
    shaping = Shaping(80.0, 0.5, 2.0, (0.1, 0.2, 0.3), profile)
    shadow, falloff = Shadow(True, (0.1, 0.0, 0.0), 3.0, 1.0, 2.0), Falloff(0.5, 1.5, 1.0, 9.0)
    emission = Emission((3.0, 2.0, 1.0), 0.5, 2.0, shaping, shadow, falloff, turns=False, camera=True, group="key")
    return replace(SphereLight.example(), emission=emission)


KINDS = LIGHT_KINDS | {"cone": cone.CONE}
EXAMPLES: dict[str, Callable[[], Light]] = {
    **{name: kind.example for name, kind in KINDS.items()},
    "textured rect": lambda: replace(RectLight.example(), texture=prepare_texture(overcast_map())),
    "shaped sphere": shaped,
    "sunny dome": sunny,
    "overcast dome": overcast,
    "black dome": partial(dome, np.zeros((8, 16, 3))),
}
WHITE = Look("white", (Layer("White", "disney", {"baseColor": (1.0,) * 3, "roughness": 1.0, "specular": 0.0}),))
PLAIN = Look("plain", (Layer("Plain", "disney", {}),))
PLACE = np.array([0.3, -0.2, 0.5])
SAMPLING = {"samples": 32, "brdf_samples": 2, "ibl_samples": 4, "bounces": 0}


@pytest.fixture(autouse=True)
def _registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(LIGHT_KINDS, "cone", cone.CONE)


@pytest.fixture(params=EXAMPLES)
def light(request: pytest.FixtureRequest) -> Light:
    return EXAMPLES[request.param]()


def draw(light: Light | PosedLight, count: int = 50_000) -> Floats:
    u = np.random.default_rng(4).random((count, 2))
    return light.sample(np.broadcast_to(PLACE, (count, 3)), u)


def test_directions_follow_the_pdf(light: Light) -> None:
    # The pdf of a texture has edges between its cells.
    towards, solid = cells(512 if getattr(light, "texture", None) else 256)
    density = light.pdf(PLACE, towards)
    mass = density * solid
    # The midpoint rule over cells of pi / 256 is off by (pi / 256)^2 / 24 times the curvature, 20 at most. An edge
    # crosses cells at random positions: each of these is off by 0.3 of its value.
    beside = [np.roll(density, step, axis) == 0.0 for step in (-1, 1) for axis in (0, 1)]
    edge = 0.3 * np.sqrt((mass[np.any(beside, axis=0)] ** 2).sum())
    assert mass.sum() == pytest.approx(1.0, abs=2e-4 + 4.0 * edge)
    # No light arrives from directions that are never drawn.
    is_inside = (light.radiance(PLACE, towards) > 0.0).any(axis=-1)
    assert is_inside.any() == (light.digest != EXAMPLES["black dome"]().digest)
    assert (density[is_inside] > 0.0).all()
    drawn = draw(light)
    np.testing.assert_allclose(np.linalg.norm(drawn, axis=-1), 1.0, rtol=1e-12)
    assert_follows(drawn, density)


def test_the_pdf_is_one_over_the_jacobian(light: Light) -> None:
    u = np.random.default_rng(7).uniform(0.01, 0.99, (3000, 2))
    point = np.broadcast_to(PLACE, (len(u), 3))
    spread, error = jacobian(lambda u: light.sample(point, u), u, 1e-6)
    off = np.abs(light.pdf(point, light.sample(point, u)) * spread - 1.0)
    # Random numbers next to an edge of the sampling's cells are left out.
    smooth = error < 1e-5 * spread
    assert smooth.mean() > 0.6
    assert off[smooth].max() < 1e-4


def test_a_turned_light_is_the_light_in_a_turned_frame(light: Light) -> None:
    turned, turn = PosedLight(light, 90.0), np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    point, towards, u = np.broadcast_to(PLACE, (1000, 3)), draw(light, 1000), np.random.default_rng(8).random((1000, 2))
    for got, expected in (
        (turned.radiance(point @ turn.T, towards @ turn.T), light.radiance(point, towards)),
        (turned.pdf(point @ turn.T, towards @ turn.T), light.pdf(point, towards)),
        (turned.sample(point @ turn.T, u), light.sample(point, u) @ turn.T),
        (turned.distance(point @ turn.T, towards @ turn.T), light.distance(point, towards)),
    ):
        np.testing.assert_allclose(got, expected, atol=1e-9)


def test_a_light_is_plain_data(light: Light) -> None:
    adapter: TypeAdapter[Light] = TypeAdapter(AnyLight)
    again = adapter.validate_json(adapter.dump_json(light))
    assert again == light
    assert again.digest == light.digest
    assert light.kind.encode() in adapter.dump_json(light)
    with pytest.raises(ValidationError, match=f"a light has a kind, one of: {', '.join(LIGHT_KINDS)}"):
        adapter.validate_python({"kind": "candle"})


def test_a_file_without_a_section_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert cone.CONE.osl
    text = cone.CONE.osl.read_text(encoding="utf-8").replace("section density", "section pdf")
    (tmp_path / "wrong.osl.h").write_text(text)
    monkeypatch.setitem(LIGHT_KINDS, "cone", replace(cone.CONE, osl=tmp_path / "wrong.osl.h"))
    with pytest.raises(CodegenError, match=r"wrong\.osl\.h: a light has sections .*: density, pdf"):
        light_sections([cone.CONE.example()])


@pytest.mark.parametrize("backend", ["nodes", "nodes-exact", "mitsuba", "principled", "viewport"])
@pytest.mark.parametrize("kind", [name for name, kind in KINDS.items() if kind.osl and name != "dome"])
def test_a_light_that_a_backend_does_not_know_is_refused_by_name(kind: str, backend: str) -> None:
    scene = Scene.of_look(load_asset(builtin="sphere"), PLAIN, KINDS[kind].example(), (8, 8))
    with pytest.raises(EnvironmentMapError, match=rf"light 1 \({kind}\): .*backend 'exact' renders it"):
        view_scene(scene) if backend == "viewport" else scene_task(scene, Sampling(), backend)


@pytest.mark.parametrize("kind", KINDS)
def test_names_change_no_digest(kind: str) -> None:
    light = KINDS[kind].example()
    renamed = light.with_emission(replace(light.emission, group="rim", path="/Rim", light_link=LightLink(())))
    brighter = light.with_emission(replace(light.emission, color=(9.0, 9.0, 9.0)))
    assert light.digest == renamed.digest != brighter.digest


def test_a_kind_with_osl_of_its_own_stands_alone() -> None:
    lights = (cone.CONE.example(), KINDS["rect"].example())
    scene = replace(Scene.of_look(load_asset(builtin="sphere"), WHITE, lights[0], (8, 8)), lights=lights)
    with pytest.raises(EnvironmentMapError, match=r"light 1 \(cone\): .* neither a lamp nor a dome; backend 'exact'"):
        scene_task(scene, Sampling())


@pytest.fixture(scope="module")
def worker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Worker]:
    folder = tmp_path_factory.mktemp("worker")
    with Worker([sys.executable, cone.__file__], folder / "worker.log", folder, 300.0) as process:
        yield process


@pytest.mark.cycles  # those of rigs are compared in tests/cycles, too
@pytest.mark.parametrize("kind", quick_among([(name,) for name in KINDS], [("cone",)]))
def test_frames_agree_with_the_reference(kind: str, worker: Worker) -> None:
    scene = scene_of(load_asset(builtin="sphere"), WHITE, [KINDS[kind].example()], 48)
    assert_scene_agreement(kind, render_seeds(worker, scene, range(4), **SAMPLING), scene, SAMPLING["samples"])
