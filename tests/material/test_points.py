"""A look at points is, at each point, a stack of constants: the values of its sources there, and for a view."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.arrays import Floats
from lookdev.brdf import (
    Bsdf,
    StackLayer,
    complete_parameters,
    evaluate,
    evaluate_cosine,
    pdf,
    sample,
    stack_bsdf,
)
from lookdev.checks.samples import constant_looks
from lookdev.errors import ModelError
from lookdev.material import Bump, Coordinates, Formula, Layer, Look, Primvar, Texture, ViewCosine
from lookdev.material.expression import parse
from lookdev.material.points import ImagePoints
from lookdev.material.textures import sample_slopes, sample_texture
from lookdev.material.values import look_bsdf
from lookdev.reference.albedo import integrate_albedo, sample_albedo

COUNT = 7


@dataclass(frozen=True)
class Points(ImagePoints):
    """UVs, a float and a colour primvar, whether the UVs are mirrored (-1 or 1), and the cosine to the view."""

    st: Floats
    wear: Any = 0.5
    paint: Any = None
    hands: Any = 1.0
    cosine: Any = 1.0

    def uv(self, name: str) -> Floats:
        assert name == "st"
        return self.st

    def primvar(self, primvar: Primvar) -> Floats:
        return np.asarray(self.paint if isinstance(primvar.fallback, tuple) else self.wear)

    def handedness(self) -> Floats:
        return np.asarray(self.hands)

    def view(self) -> Floats:
        return np.asarray(self.cosine)


@pytest.fixture
def points() -> Points:
    """Return random points, of which every second has mirrored UVs."""
    rng = np.random.default_rng(1)
    hands = np.where(np.arange(COUNT) % 2, -1.0, 1.0)
    return Points(rng.uniform(-1, 2, (COUNT, 2)), rng.uniform(-0.5, 1.5, COUNT), rng.uniform(size=(COUNT, 3)), hands)


@pytest.fixture
def image(tmp_path: Path) -> Path:
    pixels = np.random.default_rng(2).integers(0, 256, (5, 4, 3)).astype(np.uint8)
    assert oiio.ImageBuf(pixels).write(str(tmp_path / "image.png"))
    return tmp_path / "image.png"


def assert_is(points: Points, layers: Sequence[Layer], expected: Callable[[int], Sequence[Layer]]) -> None:
    """Check layers at points against `expected`: those of constants only, at a point."""
    rng = np.random.default_rng(3)
    bsdf = look_bsdf(Look("look", tuple(layers)), points)
    wo, wi = rng.normal(size=(2, COUNT, 3))
    wo[:, 2] = np.abs(wo[:, 2])
    wo, wi = (w / np.linalg.norm(w, axis=-1, keepdims=True) for w in (wo, wi))
    u = rng.uniform(size=(COUNT, 2))
    f, density, drawn = evaluate(bsdf, wo, wi), pdf(bsdf, wo, wi), sample(bsdf, wo, u)
    presence = np.broadcast_to(bsdf.presence, COUNT)
    for i in range(COUNT):
        inputs = ((layer, complete_parameters(layer.model, layer.inputs)) for layer in expected(i))
        point_bsdf = stack_bsdf(
            [StackLayer(layer.model, parameters, layer.mask, layer.mode) for layer, parameters in inputs]
        )
        np.testing.assert_allclose(f[i], evaluate(point_bsdf, wo[i], wi[i]), rtol=1e-12)
        np.testing.assert_allclose(density[i], pdf(point_bsdf, wo[i], wi[i]), rtol=1e-12)
        np.testing.assert_allclose(drawn[i], sample(point_bsdf, wo[i], u[i]), rtol=1e-9, atol=1e-12)
        assert presence[i] == pytest.approx(point_bsdf.presence)


def clip_value(value: Any, maximum: float = 1.0) -> Any:
    value = np.clip(value, 0.0, maximum)
    return float(value) if value.ndim == 0 else tuple(value)


@pytest.mark.parametrize(("model", "color"), [("disney", "baseColor"), ("pixar", "surfaceColor")])
def test_textures_and_primvars_are_constants_at_each_point(model: str, color: str, points: Points, image: Path) -> None:
    paint = Texture(image, "rgb", "sRGB", wrap_s="mirror", scale=(1.5,) * 4, bias=(-0.1,) * 4)
    grain = Texture(image, "g", "raw", transform=(2.0, 0.5, 0.1, 0.0, 1.0, 0.3))
    gray, wear, st = Texture(image, "r", "raw"), Primvar("wear", 0.5), points.st

    def layers(paint: Any, grain: Any, gray: Any, wear: Any) -> tuple[Layer, Layer]:
        base = Layer("Base", model, {color: paint, "roughness": grain, "metallic": wear})
        return base, Layer("Coat", model, {color: gray, "metallic": 0.5}, wear)

    def expected(i: int) -> Sequence[Layer]:
        texel, rough, shade = (clip_value(sample_texture(image, st[i])) for image in (paint, grain, gray))
        return layers(texel, rough, (shade,) * 3, clip_value(points.wear[i]))

    assert_is(points, layers(paint, grain, gray, wear), expected)


def test_what_follows_a_varying_parameter_varies_with_it(points: Points) -> None:
    inputs = {"clear": 0.7, "roughness": 0.2, "specularConeScale": Primvar("wear", 0.5)}

    def expected(i: int) -> Sequence[Layer]:
        scales = dict.fromkeys(("specularConeScale", "specularTransmissionConeScale"), clip_value(points.wear[i], 2.0))
        return [Layer("Base", "pixar", inputs | scales)]

    assert_is(points, [Layer("Base", "pixar", inputs)], expected)


def test_formulas_read_textures_primvars_and_coordinates(points: Points, image: Path) -> None:
    dirt = Texture(image, "r", "raw")
    inputs = {"t": dirt, "p": Primvar("paint", (0.0, 0.0, 0.0)), "c": Coordinates("st", (2.0, 1.0, 0.5, 0.0, 3.0, 0.0))}
    kinds = {"t": "float", "p": "color", "c": "color"}
    mask = Formula(parse("t * p[1] + 0.1 * c[0] + 0.05 * c[1]"), inputs, kinds)

    def layers(tint: Any, mask: Any) -> list[Layer]:
        return [Layer("A", "pixar", {"surfaceColor": tint, "back": 0.3}), Layer("B", "disney", {"sheen": 1.0}, mask)]

    def expected(i: int) -> Sequence[Layer]:
        s, t = points.st[i]
        texel, paint = sample_texture(dirt, points.st[i]), points.paint[i]
        covered = clip_value(texel * paint[1] + 0.1 * (2.0 * s + t + 0.5) + 0.05 * 3.0 * t)
        return layers(clip_value(paint * texel), covered)

    assert_is(points, layers(Formula(parse("p * t"), inputs, kinds), mask), expected)


@pytest.mark.parametrize("kind", ["constant", "map", "bump"])
def test_normals_lean_along_the_uvs(kind: str, points: Points, image: Path) -> None:
    height = Texture(image, "g", "raw", transform=(1.0, 0.5, 0.0, -0.5, 1.0, 0.0))
    normal_map = Texture(image, "rgb", "raw", scale=(2.0,) * 4, bias=(-1.0, -1.0, 0.2, 0.0))
    source = {"constant": (0.3, -0.4, 0.8), "map": normal_map, "bump": Bump(height, 0.05)}[kind]

    def layers(normal: Any) -> list[Layer]:
        return [Layer("Layer", "pixar", {"highlightNormal": normal, "metallic": 0.5, "clear": 0.5})]

    def expected(i: int) -> Sequence[Layer]:
        if kind == "bump":
            x, y, z = *(-0.05 * sample_slopes(height, points.st[i])), 1.0
        else:
            x, y, z = np.clip(sample_texture(normal_map, points.st[i]), -1.0, 1.0) if kind == "map" else source
        # Only the direction of unit vectors: constants may not be longer than their range.
        length = max(1.0, abs(x), abs(y))
        return layers((x / length, y * points.hands[i] / length, z / length))

    assert_is(points, layers(source), expected)


def test_transmitting_layers_and_varying_presence(points: Points, image: Path) -> None:
    holes, clear = Texture(image, "b", "raw"), Layer("B", "pixar", {"clear": 0.7, "presence": 0.8}, 0.6, "transmit")

    def layers(presence: Any) -> list[Layer]:
        return [Layer("A", "pixar", {"back": 0.4, "presence": presence}), clear]

    assert_is(points, layers(holes), lambda i: layers(clip_value(sample_texture(holes, points.st[i]))))


def test_a_constant_outside_its_range_is_refused(points: Points) -> None:
    with pytest.raises(ModelError, match=r"disney\.roughness is 2"):
        look_bsdf(Look("look", (Layer("Layer", "disney", {"roughness": 2.0}),)), points)


def of_view(text: str, **inputs: Any) -> Formula:
    kinds = {name: "color" if isinstance(source, Coordinates | tuple) else "float" for name, source in inputs.items()}
    return Formula(parse(text), {"view": ViewCosine(), **inputs}, {"view": "float", **kinds})


PAINT = {"baseColor": of_view("mix([.8, .1, .05], [.05, .2, .8], view)"), "metallic": 0.5}
LEAF = {"roughness": of_view("0.3 + 0.3 * view"), "back": of_view("1 - view"), "clear": of_view("view")}
COVER = of_view("smoothstep(1 - view, 0.1, 0.9)")
LOOK = Look("look", (Layer("Paint", "disney", PAINT), Layer("Leaf", "pixar", LEAF, COVER)))
VIEWS = (1.0, 0.7, 0.3, 0.05)
SAMPLES = 2**16


def seen_at(cosine: Any) -> Points:
    return Points(np.array([0.25, 0.75]), cosine=cosine)


def direction(cosine: float) -> Floats:
    return np.array([np.sqrt(1.0 - cosine * cosine), 0.0, cosine])


def bsdf_of_view(cosine: Any) -> Bsdf:
    return look_bsdf(LOOK, seen_at(cosine))


def test_values_at_points_are_those_of_each_view() -> None:
    rng = np.random.default_rng(1)
    cosines = np.array(VIEWS)
    wo = np.stack([direction(cosine) for cosine in VIEWS])
    wi = sample(bsdf_of_view(cosines), wo, rng.random((len(VIEWS), 2)))
    values, densities = evaluate(bsdf_of_view(cosines), wo, wi), pdf(bsdf_of_view(cosines), wo, wi)
    for k, cosine in enumerate(VIEWS):
        np.testing.assert_allclose(values[k], evaluate(bsdf_of_view(cosine), wo[k], wi[k]), rtol=1e-12)
        np.testing.assert_allclose(densities[k], pdf(bsdf_of_view(cosine), wo[k], wi[k]), rtol=1e-12)


@pytest.mark.parametrize("cosine", VIEWS)
def test_sampling_at_a_hit_agrees_with_brute_force(cosine: float) -> None:
    """Light from each side: directions of the BSDF over its pdf, quadrature, and directions uniform over the sphere."""
    rng = np.random.default_rng(2)
    bsdf, wo = bsdf_of_view(cosine), direction(cosine)
    z, phi = rng.uniform(-1.0, 1.0, SAMPLES), rng.uniform(0.0, 2.0 * np.pi, SAMPLES)
    r = np.sqrt(1.0 - z * z)
    wi = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1)
    view = np.broadcast_to(wo, wi.shape)
    weight = evaluate_cosine(bsdf, view, wi) * (4.0 * np.pi)
    sides = np.stack([weight * (z > 0.0)[:, None], weight * (z < 0.0)[:, None]])
    brute, error = sides.mean(axis=1), sides.std(axis=1) / np.sqrt(SAMPLES)
    drawn, exact = sample_albedo(bsdf, wo, 1024, 16, rng), integrate_albedo(bsdf, wo)
    # 24 comparisons over the four views: noise exceeds 4.5 standard errors once in 6,000 runs.
    assert (np.abs(brute - drawn.value) <= 4.5 * np.hypot(error, drawn.error) + exact.error).all()
    assert (np.abs(exact.value - drawn.value) <= 4.5 * drawn.error + exact.error).all()
    # Directions over the sphere are drawn with probability 1, except those that no lobe samples.
    density = pdf(bsdf, view, wi) * (4.0 * np.pi)
    assert density.mean() < 1.0 + 4.5 * density.std() / np.sqrt(SAMPLES)


def test_a_look_at_a_point_keeps_its_dependence_on_the_view() -> None:
    inner = of_view("view * wear", wear=Primvar("wear", 0.5))
    inputs = {
        "roughness": of_view("a * c[0]", a=inner, c=Coordinates("st")),
        "metallic": Primvar("wear", 0.5),
        "baseColor": of_view("c * [view, 1, 1]", c=(0.3, 0.6, 0.9)),
    }
    under, wo, wi = Layer("Under", "disney"), direction(0.6), np.array([-0.5, 0.2, np.sqrt(0.71)])
    varying = Look("look", (under, Layer("Base", "disney", inputs, of_view("view"))))
    looks = constant_looks(varying, 3, np.random.default_rng(3))
    assert len(looks) == 3
    for look in looks:
        metal, rough = (look.layers[1].inputs[name] for name in ("metallic", "roughness"))
        values = {"roughness": 0.6 * metal * rough.inputs["c"][0], "metallic": metal, "baseColor": (0.18, 0.6, 0.9)}
        plain = look_bsdf(Look("plain", (under, Layer("Base", "disney", values, 0.6))), seen_at(1.0))
        reflected = evaluate(look_bsdf(look, seen_at(0.6)), wo, wi)
        np.testing.assert_allclose(reflected, evaluate(plain, wo, wi), rtol=1e-12)
    assert len(constant_looks(LOOK, 3, np.random.default_rng(3))) == 1
