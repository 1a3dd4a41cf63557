"""A look at points is, at each point, a stack of constants: the values of its sources there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.brdf import StackLayer, complete_parameters, evaluate, pdf, sample, stack_bsdf
from lookdev.errors import ModelError
from lookdev.material import Bump, Coordinates, Formula, Layer, Look, Primvar, Texture
from lookdev.material.expression import parse
from lookdev.material.points import ImagePoints
from lookdev.material.textures import sample_slopes, sample_texture
from lookdev.material.values import look_bsdf

COUNT = 7


@dataclass(frozen=True)
class Points(ImagePoints):
    """Random UVs, a float and a colour primvar, every second point with mirrored UVs."""

    st: np.ndarray
    wear: np.ndarray
    paint: np.ndarray
    hands: np.ndarray

    def uv(self, name):
        assert name == "st"
        return self.st

    def primvar(self, primvar):
        return self.paint if isinstance(primvar.fallback, tuple) else self.wear

    def handedness(self):
        return self.hands


@pytest.fixture
def points():
    rng = np.random.default_rng(1)
    hands = np.where(np.arange(COUNT) % 2, -1.0, 1.0)
    return Points(rng.uniform(-1, 2, (COUNT, 2)), rng.uniform(-0.5, 1.5, COUNT), rng.uniform(size=(COUNT, 3)), hands)


@pytest.fixture
def image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    pixels = np.random.default_rng(2).integers(0, 256, (5, 4, 3)).astype(np.uint8)
    assert oiio.ImageBuf(pixels).write(str(tmp_path / "image.png"))
    return tmp_path / "image.png"


def directions(rng):
    wo, wi = rng.normal(size=(2, COUNT, 3))
    wo[:, 2] = np.abs(wo[:, 2])
    return tuple(w / np.linalg.norm(w, axis=-1, keepdims=True) for w in (wo, wi))


def assert_is(look, points, expected):
    """Check a look against `expected(i)`: the layers, constants only, at the point i."""
    rng = np.random.default_rng(3)
    bsdf = look_bsdf(look, points)
    wo, wi = directions(rng)
    u = rng.uniform(size=(COUNT, 2))
    f, density, drawn = evaluate(bsdf, wo, wi), pdf(bsdf, wo, wi), sample(bsdf, wo, u)
    presence = np.broadcast_to(bsdf.presence, COUNT)
    for i in range(COUNT):
        stack = [
            StackLayer(each.model, complete_parameters(each.model, each.inputs), each.mask, each.mode)
            for each in expected(i)
        ]
        one = stack_bsdf(stack)
        np.testing.assert_allclose(f[i], evaluate(one, wo[i], wi[i]), rtol=1e-12)
        np.testing.assert_allclose(density[i], pdf(one, wo[i], wi[i]), rtol=1e-12)
        np.testing.assert_allclose(drawn[i], sample(one, wo[i], u[i]), rtol=1e-9, atol=1e-12)
        assert presence[i] == pytest.approx(one.presence)


def clipped(value, low=0.0, high=1.0):
    value = np.clip(value, low, high)
    return float(value) if value.ndim == 0 else tuple(value)


@pytest.mark.parametrize("model", ["disney", "pixar"])
def test_textures_and_primvars_are_constants_at_each_point(model, points, image):
    color, rough = {"disney": ("baseColor", "roughness"), "pixar": ("surfaceColor", "roughness")}[model]
    paint = Texture(image, "rgb", "sRGB", wrap_s="mirror", scale=(1.5,) * 4, bias=(-0.1,) * 4)
    grain = Texture(image, "g", "raw", transform=(2.0, 0.5, 0.1, 0.0, 1.0, 0.3))
    gray = Texture(image, "r", "raw")
    look = Look(
        "look",
        (
            Layer("Base", model, {color: paint, rough: grain, "metallic": Primvar("wear", 0.0)}),
            Layer("Coat", model, {color: gray, "metallic": 0.5}, Primvar("wear", 0.5)),
        ),
    )
    st = points.st

    def expected(i):
        base = {color: clipped(sample_texture(paint, st[i])), rough: clipped(sample_texture(grain, st[i]))}
        coat = {color: (clipped(sample_texture(gray, st[i])),) * 3, "metallic": 0.5}
        wear = clipped(points.wear[i])
        return Layer("Base", model, base | {"metallic": wear}), Layer("Coat", model, coat, wear)

    assert_is(look, points, expected)


def test_what_follows_a_varying_parameter_varies_with_it(points):
    inputs = {"clear": 0.7, "roughness": 0.2, "specularConeScale": Primvar("wear", 0.5)}
    look = Look("look", (Layer("Base", "pixar", inputs),))

    def expected(i):
        scale = float(np.clip(points.wear[i], 0.0, 2.0))
        given = {"specularConeScale": scale, "specularTransmissionConeScale": scale}
        return (Layer("Base", "pixar", inputs | given),)

    assert_is(look, points, expected)


def test_formulas_read_textures_primvars_and_coordinates(points, image):
    dirt = Texture(image, "r", "raw")
    inputs = {"t": dirt, "p": Primvar("paint", (0.0, 0.0, 0.0)), "c": Coordinates("st", (2.0, 1.0, 0.5, 0.0, 3.0, 0.0))}
    kinds = {"t": "float", "p": "color", "c": "color"}
    mask = Formula(parse("t * p[1] + 0.1 * c[0] + 0.05 * c[1]"), inputs, kinds)
    tint = Formula(parse("p * t"), inputs, kinds)
    look = Look(
        "look", (Layer("A", "pixar", {"surfaceColor": tint, "back": 0.3}), Layer("B", "disney", {"sheen": 1.0}, mask))
    )

    def expected(i):
        s, t = points.st[i]
        dirt_here, paint = sample_texture(dirt, points.st[i]), points.paint[i]
        covered = clipped(dirt_here * paint[1] + 0.1 * (2.0 * s + t + 0.5) + 0.05 * 3.0 * t)
        base = Layer("A", "pixar", {"surfaceColor": clipped(paint * dirt_here), "back": 0.3})
        return base, Layer("B", "disney", {"sheen": 1.0}, covered)

    assert_is(look, points, expected)


@pytest.mark.parametrize("kind", ["constant", "map", "bump"])
def test_normals_lean_along_the_uvs(kind, points, image):
    height = Texture(image, "g", "raw", transform=(1.0, 0.5, 0.0, -0.5, 1.0, 0.0))
    normal_map = Texture(image, "rgb", "raw", scale=(2.0,) * 4, bias=(-1.0, -1.0, 0.2, 0.0))
    source = {"constant": (0.3, -0.4, 0.8), "map": normal_map, "bump": Bump(height, 0.05)}[kind]
    look = Look("look", (Layer("Layer", "pixar", {"highlightNormal": source, "metallic": 0.5, "clear": 0.5}),))

    def expected(i):
        if kind == "bump":
            along = 0.05 * sample_slopes(height, points.st[i])
            normal = np.array([-along[0], -along[1], 1.0])
        else:
            normal = np.clip(sample_texture(normal_map, points.st[i]), -1.0, 1.0) if kind == "map" else source
        x, y, z = normal
        # Of a unit vector's direction only: constants may not be longer than their range.
        length = max(1.0, abs(x), abs(y))
        leaning = (x / length, y * points.hands[i] / length, z / length)
        return (Layer("Layer", "pixar", {"highlightNormal": leaning, "metallic": 0.5, "clear": 0.5}),)

    assert_is(look, points, expected)


def test_transmitting_layers_and_varying_presence(points, image):
    holes = Texture(image, "b", "raw")
    look = Look(
        "look",
        (
            Layer("A", "pixar", {"back": 0.4, "presence": holes}),
            Layer("B", "pixar", {"clear": 0.7, "presence": 0.8}, 0.6, "transmit"),
        ),
    )

    def expected(i):
        here = clipped(sample_texture(holes, points.st[i]))
        return (
            Layer("A", "pixar", {"back": 0.4, "presence": here}),
            Layer("B", "pixar", {"clear": 0.7, "presence": 0.8}, 0.6, "transmit"),
        )

    assert_is(look, points, expected)


def test_a_constant_outside_its_range_is_refused(points):
    with pytest.raises(ModelError, match=r"disney\.roughness is 2"):
        look_bsdf(Look("look", (Layer("Layer", "disney", {"roughness": 2.0}),)), points)
