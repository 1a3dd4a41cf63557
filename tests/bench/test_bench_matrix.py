"""What there is to measure: assets, looks, options, and the keys of references."""

from dataclasses import replace

import numpy as np
import pytest
from bench_fakes import triangle_count

from lookdev.bench.kinds import KINDS
from lookdev.bench.matrix import skips_of
from lookdev.bench.options import BenchOptions, Cell, list_names, parse_options, restrictions
from lookdev.bench.subjects import (
    IBLS,
    LOOKS,
    MAX_LAYERS,
    RIGS,
    SCENES,
    bench_light,
    bench_lights,
    bench_scene,
    layered_look,
    make_boulder,
    picture_key,
)  # fmt: skip
from lookdev.errors import LookdevError
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.task import SceneTask


@pytest.mark.parametrize("triangles", [1000, 30_000])
def test_a_boulder_has_the_triangles_it_should(triangles: int) -> None:
    asset = make_boulder(triangles)
    assert triangle_count(asset) == pytest.approx(triangles, rel=0.07)
    assert not asset.convex
    mesh = asset.meshes[0]
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-6)
    # Outward: the surface is a sphere with waves of a tenth.
    outward = mesh.points[mesh.corner_points] / np.linalg.norm(mesh.points[mesh.corner_points], axis=1)[:, None]
    assert (mesh.normals * outward).sum(axis=1).min() > 0.3


def test_a_finer_boulder_is_the_same_shape() -> None:
    coarse, fine = make_boulder(1000), make_boulder(30_000)
    assert fine.radius == pytest.approx(coarse.radius, rel=0.02)
    assert fine.meshes[0].points.std() == pytest.approx(coarse.meshes[0].points.std(), rel=0.02)


def scene_of(look: str, backend: str = "exact", bounces: int = 2) -> SceneTask:
    lights, asset = (bench_light("white"),), make_boulder(1000)
    scene = bench_scene("shaderball", LOOKS[look].make(), lights, 32, backend, asset=asset)
    return replace(scene, sampling=replace(scene.sampling, bounces=bounces))


@pytest.mark.parametrize("look", LOOKS)
def test_a_look_has_a_shader(look: str) -> None:
    scene = scene_of(look)
    assert scene.shaders[0].transmits == (look == "pixar")
    assert len(scene.shaders[0].textures) == (5 if look == "stack" else 0)
    assert scene.sampling.bounces == 2


def test_skips_are_those_of_the_scene() -> None:
    def skips(scene: str, look: str) -> tuple[str, ...]:
        task = bench_scene(scene, LOOKS[look].make(), (bench_light("white"),), 32)
        return skips_of(Cell(scene, "white", look), task)

    opaque, even = "light from behind (nothing transmits)", "light samples (constant light)"
    # Plastic has no clearcoat.
    lobe = "1 lobe (is 0 by constants)"
    assert skips("sphere", "plastic") == ("bounces (convex asset)", "shadow rays (convex asset)", opaque, even, lobe)
    assert skips("suzanne", "plastic") == (opaque, even, lobe)
    assert skips("sphere", "pixar") == (even,)
    # All five masks are read: no texture is skipped.
    assert skips("suzanne", "stack") == (opaque, even)


def test_every_layer_adds_to_the_shader() -> None:
    assert len(layered_look(MAX_LAYERS).layers) == MAX_LAYERS
    assert len({layer.mask.file for layer in layered_look(MAX_LAYERS).layers[1:]}) == MAX_LAYERS - 1


def test_keys_of_references_depend_on_the_picture_but_not_on_samples() -> None:
    def key(look: str, backend: str = "exact", bounces: int = 2, samples: int = 64) -> str:
        scene = scene_of(look, backend, bounces)
        sampling = replace(scene.sampling, samples=samples)
        return picture_key(replace(scene, sampling=sampling), LOOKS[look].make(), "white")

    ours = [name for name in BACKENDS if name != "mitsuba-principled"]
    keys = {key(look, backend, bounces) for look in ("plastic", "metal") for backend in ours for bounces in (0, 2)}
    assert len(keys) == 2 * len(ours) * 2
    assert key("plastic", samples=128) == key("plastic")


def test_rigs_light_the_asset_as_they_light_a_ball_of_radius_1() -> None:
    asset = make_boulder(1000)
    points = np.random.default_rng(1).normal(size=(50, 3))
    for name, rig in RIGS.items():
        lights, around = rig.make(), bench_lights(name, asset)
        assert [light.kind for light in lights] == [light.kind for light in around]
        assert len({light.digest for light in around}) == len(around)
        for light, larger in zip(lights, around, strict=True):
            direction = light.sample(points, np.full((50, 2), 0.4))
            moved = np.array(asset.center) + asset.radius * points
            np.testing.assert_allclose(larger.radiance(moved, direction), light.radiance(points, direction), rtol=1e-6)
        assert BACKENDS["principled"].light_gaps(around) == ()


def test_cells_and_their_backends() -> None:
    ibls, looks = ("city", "studio"), ("plastic", "pixar")
    options = BenchOptions(scenes=("sphere",), ibls=ibls, looks=looks)
    assert list(options.cells()) == [Cell("sphere", ibl, look) for ibl in ibls for look in looks]
    assert options.backends_of(Cell("sphere", "city", "plastic")) == ("exact", "principled")
    assert options.backends_of(Cell("sphere", "city", "pixar")) == ("exact",)


def test_the_list_names_everything() -> None:
    words = list_names().split()
    for name in (*SCENES, *IBLS, *RIGS, *LOOKS, *BACKENDS):
        assert name in words


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"scenes": ("spere",)}, "no scene 'spere' (did you mean 'sphere'?)"),
        ({"ibls": ("citty",)}, "no IBL 'citty' (did you mean 'city'?)"),
        ({"looks": ("plastik",)}, "did you mean 'plastic'?"),
        ({"backends": ("cycles",)}, "known: exact, nodes, nodes-exact, mitsuba, principled, mitsuba-principled"),
        ({"backends": ()}, "no backend is given"),
        ({"scenes": ("sphere", "sphere")}, "given twice"),
        ({"samples": (4, 6)}, "6 samples"),
        ({"samples": (1, 4)}, "1 samples"),
        ({"samples": (16, 4)}, "rising"),
        ({"samples": ()}, "at least one"),
        ({"resolution": 8}, "resolution 8"),
        ({"repeats": 0}, "0 repeats"),
        ({"seed": -1}, "seed -1"),
        ({"frames": 3}, "3 frames"),
        ({"reference": 2}, "a reference of 2 times"),
    ],
)
def test_wrong_options_are_refused(fields: dict[str, object], message: str) -> None:
    with pytest.raises(LookdevError) as caught:
        BenchOptions(**fields)  # type: ignore[arg-type]
    assert message in str(caught.value)


def test_options_of_a_command_line() -> None:
    lists = {"scenes": "sphere, million", "ibls": "", "looks": "", "backends": "exact", "samples": "2,8"}
    options = parse_options(lists, resolution=64, repeats=None)
    assert options.scenes == ("sphere", "million")
    assert options.ibls == ("studio", "city", "forest")
    assert options.samples == (2, 8)
    assert (options.resolution, options.repeats) == (64, 3)
    everything = parse_options(lists, everything=True)
    assert (everything.scenes, everything.looks) == (("sphere", "million"), tuple(LOOKS))
    with pytest.raises(LookdevError, match="'many' is no whole number"):
        parse_options({"samples": "4,many"})


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_is_whole_unless_options_restrict_it(kind: str) -> None:
    defaults = KINDS[kind].DEFAULTS
    assert restrictions(parse_options({}, defaults=defaults), defaults) == ()
    part = parse_options({"looks": "metal"}, defaults=defaults, repeats=2)
    assert restrictions(part, defaults) == ("looks", "repeats")
    # Other samples of the same, and better references.
    assert restrictions(parse_options({}, defaults=defaults, seed=3, reference=64, fresh=True), defaults) == ()
