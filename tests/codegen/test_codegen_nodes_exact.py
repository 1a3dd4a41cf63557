"""The nodes that sample a look draw the directions, with the weights, that NumPy does."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from layers import no_textures, of_view
from node_interpreter import Interpreter, PrimvarPoints

from lookdev.brdf.mixture import evaluate_cosine, pdf, sample
from lookdev.codegen.nodes.exact import generate_nodes_exact
from lookdev.codegen.nodes.frame import frame_tree
from lookdev.codegen.source import HANDEDNESS, NodeSource, ShaderNode
from lookdev.material import Formula, Input, Layer, Look, Primvar
from lookdev.material.expression import parse
from lookdev.material.values import look_bsdf

COUNT = 400


def layer(model: str, mask: Any = 1.0, mode: Any = "over", **inputs: Input) -> Layer:
    return Layer(model, model, inputs, mask, mode)


LEAF = layer("pixar", surfaceColor=(0.3, 0.6, 0.1), roughness=0.4, back=0.5)
COAT = layer("disney", 0.4, baseColor=(0.1, 0.2, 0.5), roughness=0.4, clearcoat=1.0)
LOOKS: dict[str, tuple[Layer, ...]] = {
    "diffuse": (layer("disney", baseColor=(0.5, 0.4, 0.3), roughness=1.0, sheen=1.0, variant="2012"),),
    "coated": (layer("disney", baseColor=(0.1, 0.2, 0.5), roughness=0.4, clearcoat=1.0, anisotropic=0.6),),
    "tilted": (layer("disney", baseColor=(0.1, 0.2, 0.5), roughness=0.4, normal=(0.3, -0.2, 0.9)),),
    "mirror": (layer("disney", baseColor=(0.9, 0.7, 0.4), metallic=1.0, roughness=0.0),),
    "painted": (layer("pixar", surfaceColor=(0.7, 0.5, 0.1), roughness=0.3, clear=0.3, back=0.2),),
    "options": (layer("disney", roughness=0.4, gamma=1.5, filmThickness=400.0, specularNormal=(0.3, -0.2, 0.9)),),
    "bent": (layer("pixar", surfaceColor=(0.7, 0.7, 0.7), clear=0.5, back=0.3, highlightNormal=(-0.4, 0.3, 0.8)),),
    "seen": (
        layer("disney", roughness=of_view("0.2 + 0.5 * view"), baseColor=of_view("[view, 0.3, 1 - view]")),
        layer("pixar", of_view("smoothstep(1 - view, 0.3, 0.9)"), clear=of_view("view"), surfaceColor=(0.9, 0.5, 0.2)),
    ),
    "lacquered": (LEAF, layer("pixar", 0.8, "transmit", surfaceColor=(0.9, 0.5, 0.2), roughness=0.15, clear=0.9)),
    "gold": (layer("disney", metal="gold", metallic=0.9, roughness=0.3, filmThickness=300.0),),
    "gilded": (LEAF, layer("pixar", 0.7, metal="gold", metallic=1.0, roughness=0.3)),
    "mixed": (LEAF, COAT),
}


def generate(*layers: Layer, bounces: int = 0) -> NodeSource:
    return generate_nodes_exact(Look("look", layers), no_textures, bounces=bounces)


def unit(vectors: Any) -> Any:
    return (vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)).astype(np.float32)


def run(source: NodeSource, scene: Mapping[str, Any]) -> tuple[Any, Any]:
    """Return the portals' weights and directions."""

    def answer(node: ShaderNode) -> Mapping[str, Any] | None:
        if node.group == "Lookdev Frame":
            axes = scene["axes"]
            return {"Tangent": axes[0], "Bitangent": axes[1], "Normal": axes[2], "Viewer": scene["wo"]}
        match node.kind:
            case "NewGeometry":
                return {"True Normal": scene["facet"], "Position": scene["wo"]}
            case "CameraData":
                return {"View Distance": np.ones(1, np.float32)}
            case "TexWhiteNoise":
                return {"Color": scene["u"]}
            case "SeparateColor":
                return {"Red": scene["u"][..., 0], "Green": scene["u"][..., 1]}
            case "LightPath":
                return {"Transparent Depth": np.full(1, scene["depth"], np.float32)}
            case "Attribute":
                value = scene[str(node.properties["attribute_name"]).removeprefix("primvars:")]
                return {"Fac": value, "Vector": value}
        return None

    ((kind, _, sockets),) = Interpreter(source.trees, answer).run(source.trees[-1].name)["Surface"]
    assert kind == "BsdfRayPortal"
    names = ("Color", "Direction", "Position")
    color, direction, start = (np.broadcast_to(sockets[name], (COUNT, 3)).astype(np.float64) for name in names)
    # Rays start above the facet, on the side that they go to.
    above = np.sum((start - scene["wo"]) * scene["facet"], axis=-1)
    sent = (color != 0.0).any(axis=-1)
    assert (above * np.sum(direction * scene["facet"], axis=-1) >= 0.0)[sent].all()
    assert (np.abs(above) < 3e-6 * (1.0 + np.linalg.norm(scene["wo"], axis=-1))).all()
    return color, direction


@pytest.fixture
def scene() -> dict[str, Any]:
    """Return outputs of nodes that read the scene: a rotated shading frame, whose normal is also the facet's."""
    rng = np.random.default_rng(4)
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    wo = rng.normal(size=(COUNT, 3))
    wo[:, 2] = np.abs(wo[:, 2]) + 0.05
    axes = axes.astype(np.float32)
    return {
        "axes": axes,
        "facet": axes[2],
        "wo": unit(wo),
        "u": rng.random((COUNT, 3), dtype=np.float32),
        "depth": 0,
        HANDEDNESS: np.ones(COUNT, np.float32),
    }


def assert_samples(layers: tuple[Layer, ...], scene: dict[str, Any]) -> NodeSource:
    """Compare the nodes of a look with `evaluate_cosine`, `pdf` and `sample` of its model."""
    source = generate(*layers, bounces=2)
    weight, world = run(source, scene)
    bsdf = look_bsdf(Look("look", layers), PrimvarPoints(scene, scene["wo"]))
    wo = scene["wo"].astype(np.float64)
    wi = world @ np.linalg.inv(scene["axes"].astype(np.float64))
    expected_wi = sample(bsdf, wo, scene["u"][..., :2].astype(np.float64))
    # Sines of angles up to 2 pi and square roots of differences from 1, in float32.
    np.testing.assert_allclose(wi, expected_wi, atol=5e-4)
    valid = np.abs(expected_wi[..., 2]) > 1e-3
    assert valid.mean() > 0.8
    wi = wi[valid] / np.linalg.norm(wi[valid], axis=-1, keepdims=True)
    wo, weight = wo[valid], weight[valid]
    scene_used = {name: value[valid] for name, value in scene.items() if np.shape(value)[:1] == (COUNT,)}
    bsdf = look_bsdf(Look("look", layers), PrimvarPoints(scene_used, scene_used["wo"]))
    expected = evaluate_cosine(bsdf, wo, wi) / pdf(bsdf, wo, wi)[..., None]
    # The quotient is smooth in wi. There are several hundred roundings; lobes with alpha 0.001 magnify those of wm.
    np.testing.assert_allclose(weight, expected, rtol=5e-3, atol=1e-5)
    return source


@pytest.mark.parametrize("name", LOOKS)
def test_nodes_sample_as_numpy_does(name: str, scene: dict[str, Any]) -> None:
    source = assert_samples(LOOKS[name], scene)
    assert source.exact
    assert not source.see_through
    assert source.transmits == (name in ("painted", "bent", "lacquered", "gilded", "mixed", "seen"))


def test_what_varies_over_the_surface_is_read(scene: dict[str, Any]) -> None:
    rng = np.random.default_rng(2)
    scene |= {"rough": rng.uniform(0.2, 0.9, COUNT).astype(np.float32), "rust": rng.random(COUNT, dtype=np.float32)}
    scene["rust"][: COUNT // 4] = 0.0
    scene["tint"] = rng.uniform(0.1, 0.9, (COUNT, 3)).astype(np.float32)
    below = layer("disney", baseColor=Primvar("tint", (0.5, 0.5, 0.5)), roughness=Primvar("rough", 0.5), clearcoat=0.5)
    above = layer("disney", Primvar("rust", 0.0), baseColor=(0.4, 0.2, 0.1), roughness=0.8, metallic=0.5)
    source = assert_samples((below, above), scene)
    assert [binding.attribute for binding in source.attributes] == ["rough", "rust", "tint"]


def test_a_portal_opens_as_often_as_there_are_bounces(scene: dict[str, Any]) -> None:
    for bounces in (0, 1, 3):
        source = generate(COAT, bounces=bounces)
        for depth in (bounces, bounces + 1):
            weight, _ = run(source, scene | {"depth": depth})
            assert (weight.max() > 0.0) == (depth == bounces)


def test_a_direction_that_the_facet_hides_is_dark(scene: dict[str, Any]) -> None:
    t, _, n = scene["axes"]
    leaning = unit(n + 1.5 * t)
    source = generate(*LOOKS["painted"])
    full_weight, world = run(source, scene)
    weight, _ = run(source, scene | {"facet": leaning})
    valid = np.sign(world @ n) == np.sign(world @ leaning)
    assert 0.05 < valid.mean() < 0.95
    np.testing.assert_array_equal(weight, np.where(valid[..., None], full_weight, 0.0))


def test_an_opaque_surface_that_leans_opens_no_portal_behind_it(scene: dict[str, Any]) -> None:
    for clear in (0.0, 0.01):
        leaning = layer("pixar", clear=clear, diffuseNormal=(0.6, 0.0, 0.8), roughness=0.9)
        weight, world = run(generate(leaning), scene)
        behind = world @ scene["axes"][2] < 0.0
        assert 0.05 < behind.mean() < 0.5
        assert (weight[behind].max() > 0.0) == (clear > 0.0)


def test_a_black_look_sends_nothing_on(scene: dict[str, Any]) -> None:
    black = layer("pixar", surfaceColor=(0.0, 0.0, 0.0), specularTint=(0.0, 0.0, 0.0))
    weight, _ = run(generate(black), scene)
    assert not weight.any()


def test_what_folds_away_leaves_no_node() -> None:
    hidden = layer("disney", Formula(parse("x * 0"), {"x": Primvar("unread", 0.0)}, {"x": "float"}), roughness=0.1)
    plain = generate(COAT, bounces=1)
    assert plain == generate(COAT, hidden, bounces=1)
    assert not plain.attributes
    kinds = [node.kind for node in plain.trees[-1].nodes]
    assert kinds.count("TexWhiteNoise") == kinds.count("BsdfRayPortal") == 1


def test_digests_of_different_looks_differ() -> None:
    def digest(roughness: float, bounces: int) -> str:
        return generate(replace(COAT, inputs={**COAT.inputs, "roughness": roughness}), bounces=bounces).digest

    assert digest(0.4, 1) == digest(0.4, 1)
    assert len({digest(0.4, 1), digest(0.4, 2), digest(0.41, 1)}) == 3


@pytest.mark.parametrize(("mirrored", "directed"), [(False, True), (True, True), (False, False), (True, False)])
def test_the_frame_faces_the_viewer(mirrored: bool, directed: bool) -> None:
    rng = np.random.default_rng(1)
    viewer, normal, tangent = (unit(rng.normal(size=(COUNT, 3))) for _ in range(3))
    tangent = unit(np.cross(normal, tangent))
    facet = unit(normal + 0.1 * rng.normal(size=(COUNT, 3)))
    facet = np.where(np.sum(facet * viewer, axis=-1, keepdims=True) < 0.0, -facet, facet)
    # The mesh of a reflected instance has vectors that the reflection maps to the expected ones.
    axes = np.diag([-1.0 if mirrored else 1.0, 1.0, 1.0]).astype(np.float32)
    transformed = {"NORMAL": normal, "VECTOR": tangent}

    def answer(node: ShaderNode) -> Mapping[str, Any] | None:
        match node.kind:
            case "NewGeometry":
                return {"True Normal": facet, "Incoming": viewer}
            case "Attribute":
                return {"Vector": np.zeros(3)}
            case "VectorTransform":
                vector = node.inputs["Vector"]
                kind = str(node.properties["vector_type"])
                return {"Vector": axes @ np.float32(vector) if isinstance(vector, tuple) else transformed[kind]}
        return None

    outputs = Interpreter((frame_tree(reads_tangent=directed, bends_normals=True),), answer).run("Lookdev Frame")
    n, t, b, wo = (np.asarray(outputs[name], np.float64) for name in ("Normal", "Tangent", "Bitangent", "Viewer"))
    side = np.where(np.sum(normal * facet, axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    lean = np.sum(side * normal * viewer, axis=-1)
    assert (lean < -1e-3).any()
    assert (side < 0.0).any()
    np.testing.assert_allclose(n[lean > 1e-3], (side * normal)[lean > 1e-3], atol=1e-6)
    assert (np.sum(n * viewer, axis=-1)[lean < -1e-3] > 0.0).all()
    # A few roundings of unit vectors; bending a normal that leans by a right angle shortens the axes by tenths.
    np.testing.assert_allclose(np.sum(n * t, axis=-1), 0.0, atol=5e-6)
    np.testing.assert_allclose(b, side * np.cross(n, t) * (-1.0 if mirrored else 1.0), atol=5e-6)
    np.testing.assert_allclose(wo, np.stack([np.sum(viewer * axis, axis=-1) for axis in (t, b, n)], axis=-1), atol=5e-6)
