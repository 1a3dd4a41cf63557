"""A look as nodes has the closures of its lobes, with the weights computed by NumPy."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from layers import no_textures, of_view
from node_interpreter import Interpreter, PrimvarPoints

from lookdev.brdf import MODELS
from lookdev.brdf.frames import TiltedFrame
from lookdev.closures import STAND_INS, Closure, closure_cosine, lobe_closures
from lookdev.codegen.nodes.fits import is_fit
from lookdev.codegen.nodes.look import generate_nodes
from lookdev.codegen.source import HANDEDNESS, TANGENT, NodeLink, NodeSource, NodeTree, ShaderNode
from lookdev.material import Layer, Look, Primvar, Texture
from lookdev.material.values import look_bsdf

COUNT = 40
# Models that backend "nodes" can show.
MODELS_WITH_STAND_INS = sorted({model for model, _ in STAND_INS})
PURE_SHEEN = {"Base Color": 0.0, "Metallic": 1.0, "Roughness": 1.0, "Specular Tint": 1.0, "Coat Weight": 1.0}
PURE_SHEEN |= {"Coat Roughness": 1.0, "Coat IOR": 1.0, "Coat Normal": 0.0}


def generate(*layers: Layer) -> NodeSource:
    return generate_nodes(Look("look", layers), no_textures)


def random_inputs(model: str, rng: np.random.Generator) -> dict[str, Any]:
    """Return constants within soft ranges, many of them at an end, without options, which can be without closures."""
    inputs: dict[str, Any] = {}
    for name, parameter in MODELS[model].parameters.items():
        if parameter.kind == "token":
            if not parameter.expand:
                inputs[name] = str(rng.choice(parameter.choices))
        elif parameter.kind == "normal":
            if rng.random() < 0.3:
                inputs[name] = (*rng.uniform(-0.4, 0.4, 2), 1.0)
        elif parameter.kind == "color":
            low = parameter.hard[0]
            inputs[name] = (low, low, low) if rng.random() < 0.1 else tuple(rng.uniform(0.05, parameter.soft[1], 3))
        elif rng.random() < 0.5 and not parameter.optional:
            inputs[name] = float(rng.choice(parameter.soft) if rng.random() < 0.5 else rng.uniform(*parameter.soft))
    return inputs


def directions(rng: np.random.Generator, *, above: bool) -> Any:
    w = rng.normal(size=(COUNT, 3))
    w /= np.linalg.norm(w, axis=-1, keepdims=True)
    if above:
        w[..., 2] = np.abs(w[..., 2]) + 0.02
    return (w / np.linalg.norm(w, axis=-1, keepdims=True)).astype(np.float32)


def closures_of(shader: list[Any], axes: Any, side: Any) -> list[Closure]:
    """Return the closures of nodes in the shading frame, whose axes in world space are the rows of `axes`."""
    closures = []
    for kind, distribution, sockets in shader:
        if kind == "BsdfTransparent":
            continue
        sockets = {name: np.asarray(value, dtype=np.float64) for name, value in sockets.items()}
        frame = TiltedFrame(np.einsum("nij,nj->ni", axes, np.broadcast_to(sockets["Normal"], (COUNT, 3))))
        weight = np.clip(sockets.pop("Weight", np.ones((1, 3))), 0.0, 1.0)
        color = weight * sockets.get("Color", 0.0)
        match kind:
            case "BsdfDiffuse":
                roughness = sockets["Roughness"]
                closures.append(Closure("rough_diffuse", weight, frame=frame, f0=sockets["Color"], roughness=roughness))
            case "BsdfTranslucent":
                closures.append(Closure("translucent", color, frame=frame))
            case "BsdfAnisotropic" | "BsdfMetallic":
                # As Cycles' svm_node_closure_bsdf.
                alpha, a = sockets["Roughness"] ** 2, sockets.get("Anisotropy", np.zeros(1))
                if "Tangent" in sockets:
                    tangent = np.einsum("nij,nj->ni", axes, np.broadcast_to(sockets["Tangent"], (COUNT, 3)))
                    np.testing.assert_allclose(tangent, frame.from_local(np.array([1.0, 0.0, 0.0])), atol=1e-5)
                if kind == "BsdfMetallic":
                    assert distribution == "GGX"
                    assert (a >= 0.0).all()
                    aspect = np.sqrt(1.0 - 0.9 * a)
                    metal = Closure("conductor", weight, alpha / aspect, alpha * aspect, frame)
                    if "Extinction" in sockets:
                        metal = replace(metal, eta=sockets["IOR"], k=sockets["Extinction"])
                    else:
                        assert (sockets["Edge Tint"] == 1.0).all()
                        metal = replace(metal, kind="metal", f0=np.clip(sockets["Base Color"], 0.0, 1.0))
                    closures.append(metal)
                else:
                    assert (a <= 0.0).all()
                    x, y = alpha / (1.0 + a), alpha * (1.0 + a)
                    closures.append(Closure(distribution.lower(), color, x, y, frame))
            case "BsdfPrincipled":
                # A coat of index 1, viewed along its normal, only tints.
                constants = {
                    name: value.ravel()[0] for name, value in sockets.items() if name not in ("Coat Tint", "Normal")
                }
                assert constants | {"Coat Normal": 0.0} == PURE_SHEEN
                closures.append(Closure("sheen", weight * sockets["Coat Tint"], frame=frame))
            case "BsdfRefraction":
                alpha, ior = sockets["Roughness"] ** 2, np.where(side > 0, sockets["IOR"], 1.0 / sockets["IOR"])
                closures.append(Closure(f"{distribution.lower()}_refraction", color, alpha, alpha, frame, ior))
            case _:
                raise AssertionError(kind)
    return closures


def nodes_cosine(source: NodeSource, wo: Any, wi: Any, attributes: Mapping[str, Any] | None = None) -> Any:
    """Return f times the cosine, in a rotated shading frame, and the share of light that passes unchanged."""
    rng = np.random.default_rng(3)
    axes, _ = np.linalg.qr(rng.normal(size=(COUNT, 3, 3)))
    side = rng.choice([-1.0, 1.0], COUNT)

    def scene_outputs(node: ShaderNode) -> Mapping[str, Any] | None:
        if node.group == "Lookdev Frame":
            names = ("Tangent", "Bitangent", "Normal")
            return {name: axes[:, k].astype(np.float32) for k, name in enumerate(names)} | {"Viewer": wo}
        if node.kind == "NewGeometry":
            facing = dict.fromkeys(("Incoming", "True Normal", "Position"), np.float32([[0.0, 0.0, 1.0]]))
            return {"Backfacing": (side < 0).astype(np.float32), **facing}
        if node.kind in ("LightPath", "CameraData"):
            unit = np.ones(1, np.float32)
            return {"Ray Length": unit, "View Distance": unit, "Is Shadow Ray": 0.0 * unit}
        if node.kind == "Attribute":
            value = (attributes or {})[str(node.properties["attribute_name"]).removeprefix("primvars:")]
            return {"Fac": value, "Vector": value}
        return None

    shader = Interpreter(source.trees, scene_outputs).run(source.trees[-1].name)["Surface"]
    total = np.zeros((COUNT, 3))
    for closure in closures_of(shader, axes, side):
        total = total + closure_cosine(closure, wo.astype(np.float64), wi)
    clear = [sockets for kind, _, sockets in shader if kind == "BsdfTransparent"]
    through = [np.asarray(sockets.get("Color", 1.0)) * sockets.get("Weight", 1.0) for sockets in clear]
    return total, np.broadcast_to(sum(through, np.zeros(3)), (COUNT, 3))


def check(layers: tuple[Layer, ...], values: Mapping[str, Any] | None = None, seed: int = 0) -> NodeSource:
    """Compare a look's nodes with the closures of the NumPy model; `values` are those of primvars, by name."""
    rng = np.random.default_rng(seed)
    source = generate(*layers)
    wo, wi = directions(rng, above=True), directions(rng, above=False).astype(np.float64)
    attributes = {HANDEDNESS: np.ones(COUNT, dtype=np.float32)} | dict(values or {})
    bsdf = look_bsdf(Look("look", layers), PrimvarPoints(attributes, wo))
    expected = np.zeros((COUNT, 3))
    for lobe in bsdf.lobes(wo.astype(np.float64)):
        for closure in lobe_closures(lobe, wo.astype(np.float64)):
            expected = expected + closure_cosine(closure, wo.astype(np.float64), wi)
    result, through = nodes_cosine(source, wo, wi, attributes)
    # float32: some hundred roundings, and the peak of a mirror of alpha 0.001 moves by 1e-7 of an angle of 1e-3.
    np.testing.assert_allclose(result, expected, rtol=2e-3, atol=1e-5 * max(1.0, expected.max()))
    absence = np.broadcast_to(1.0 - np.asarray(bsdf.presence), (COUNT,))
    np.testing.assert_allclose(through, np.repeat(absence[:, None], 3, axis=1), atol=1e-6)
    assert source.see_through == bool(np.any(absence))
    assert_whole(source)
    return source


def assert_whole(source: NodeSource) -> None:
    """Assert that links lead to earlier nodes, and groups to earlier trees, and that nodes and trees exist once."""
    names = [tree.name for tree in source.trees]
    assert len(set(names)) == len(names)
    for index, tree in enumerate(source.trees):
        earlier: set[str] = set()
        contents = [repr((node.kind, node.properties, node.inputs, node.group)) for node in tree.nodes]
        assert len(set(contents)) == len(contents)
        for node in tree.nodes:
            assert node.name not in earlier
            assert all(link.node in earlier for link in node.inputs.values() if isinstance(link, NodeLink))
            earlier.add(node.name)
            if node.group:
                group = source.trees[names.index(node.group)]
                assert names.index(node.group) < index
                assert set(node.inputs) <= {socket.name for socket in group.inputs}
        groups = {node.name: source.trees[names.index(node.group)] for node in tree.nodes if node.group}
        links = [link for node in tree.nodes for link in node.inputs.values() if isinstance(link, NodeLink)]
        for link in links:
            if link.node in groups:
                assert link.socket in [socket.name for socket in groups[link.node].outputs]


def tree_of(source: NodeSource, name: str) -> NodeTree:
    return next(tree for tree in source.trees if tree.name == name)


def sockets(source: NodeSource, name: str) -> list[str]:
    return [socket.name for socket in tree_of(source, name).inputs]


def first_of(quick: int, count: int) -> list[Any]:
    """Return seeds, of which those from `quick` on are marked as proof."""
    return [pytest.param(seed, marks=pytest.mark.proof if seed >= quick else ()) for seed in range(count)]


@pytest.mark.parametrize("model", MODELS_WITH_STAND_INS)
@pytest.mark.parametrize("seed", first_of(4, 12))
def test_a_layer_has_the_closures_of_its_model(model: str, seed: int) -> None:
    source = check((Layer("base", model, random_inputs(model, np.random.default_rng(seed))),), seed=seed)
    names = [tree.name for tree in source.trees if not is_fit(tree.name)]
    assert names == ["Lookdev Frame", "Lookdev Coincident", f"Lookdev {model.title()}", "look"]


MODEL_STACKS = [("disney",) * 2, ("disney",) * 3, ("pixar",) * 2, ("disney", "pixar"), ("pixar", "disney", "pixar")]
MODEL_STACKS += [("disney", "disney", "pixar", "pixar")]


@pytest.mark.parametrize("models", MODEL_STACKS)
@pytest.mark.parametrize("seed", first_of(2, 4))
def test_layers_are_combined_by_the_rule_of_their_model(models: tuple[str, ...], seed: int) -> None:
    rng = np.random.default_rng(seed)
    tokens = {"disney": {"variant": "2014"}, "pixar": {"energy": "published"}}
    layers = tuple(
        Layer(f"layer{k}", model, random_inputs(model, rng) | tokens[model], mask=float(rng.uniform(0.2, 0.9)))
        for k, model in enumerate(models)
    )
    check(layers, seed=seed)


def test_a_layer_that_transmits() -> None:
    top = Layer("top", "pixar", {"clear": 0.7, "roughness": 0.2}, mask=0.6, mode="transmit")
    check((Layer("base", "pixar", {"surfaceColor": (0.5, 0.2, 0.1)}), top))


def test_a_coat_withholds_what_it_reflects() -> None:
    values = {"worn": np.random.default_rng(2).uniform(0.1, 0.9, COUNT).astype(np.float32)}
    base = Layer("base", "pixar", {"surfaceColor": (0.3, 0.5, 0.7), "roughness": 1.0})
    coat = Layer("coat", "disney", {"metallic": 1.0, "baseColor": (0.04, 0.05, 0.06), "roughness": 0.3}, 1.0, "coat")
    check((base, coat))
    check((base, replace(coat, mask=Primvar("worn", 0.5)), replace(coat, inputs={"presence": 0.5})), values)
    check((replace(coat, mode="over"), replace(coat, inputs={"presence": Primvar("worn", 0.5)})), values)


@pytest.mark.parametrize("presence", [0.0, 0.5])
@pytest.mark.parametrize("mode", ["over", "coat"])
def test_a_black_layer_that_is_not_everywhere_lies_beneath_others(presence: float, mode: Any) -> None:
    black = Layer("black", "pixar", {"surfaceColor": (0.0, 0.0, 0.0), "presence": presence})
    check((black, Layer("coat", "disney", {"metallic": 1.0, "baseColor": (0.04, 0.05, 0.06)}, 0.5, mode)))


def test_primvars_reach_parameters_and_masks() -> None:
    rng = np.random.default_rng(1)
    values = {
        "wear": rng.uniform(0.1, 0.9, COUNT).astype(np.float32),
        "paint": rng.uniform(0.1, 0.9, (COUNT, 3)).astype(np.float32),
        "rough": rng.uniform(0.2, 0.9, COUNT).astype(np.float32),
    }
    base = Layer("base", "disney", {"baseColor": Primvar("paint", (0.5, 0.5, 0.5)), "roughness": Primvar("rough", 0.5)})
    for model in MODELS_WITH_STAND_INS:
        source = check((base, Layer("top", model, {}, mask=Primvar("wear", 0.0))), values)
        assert [binding.attribute for binding in source.attributes] == ["paint", "rough", "wear"]


def test_the_view_reaches_parameters_masks_and_presence() -> None:
    paint = {"baseColor": of_view("[view, 0.3, 1 - view]"), "roughness": of_view("0.2 + 0.5 * view")}
    base = Layer("base", "disney", paint | {"presence": of_view("1 - 0.5 * view")})
    for model in MODELS_WITH_STAND_INS:
        source = check((base, Layer("top", model, {}, mask=of_view("smoothstep(1 - view, 0.3, 0.9)"))))
        assert source.attributes == ()


def test_constants_that_end_a_term_have_no_socket() -> None:
    source = generate(Layer("base", "disney", {"roughness": 0.3}))
    assert sockets(source, "Lookdev Disney") == ["baseColor", "specular", "roughness"]
    labels = [(node.kind, node.label) for node in tree_of(source, "Lookdev Disney").nodes if "Bsdf" in node.kind]
    assert labels == [("BsdfDiffuse", "diffuse"), ("BsdfMetallic", "specular"), ("BsdfAnisotropic", "specular")]
    metal = generate(Layer("base", "disney", {"metallic": 1.0, "anisotropic": 0.5}))
    assert sockets(metal, "Lookdev Disney") == ["baseColor", "roughness", "anisotropic"]
    kinds = [node.kind for node in tree_of(metal, "Lookdev Disney").nodes]
    assert (kinds.count("BsdfMetallic"), kinds.count("BsdfDiffuse")) == (1, 0)


def test_what_vanishes_takes_its_texture_with_it() -> None:
    inputs = {"metallic": 1.0, "subsurface": Texture(Path("missing.exr"), "r", "raw")}
    assert "subsurface" not in sockets(generate(Layer("base", "disney", inputs)), "Lookdev Disney")


def test_sockets_are_those_of_the_parameters() -> None:
    source = generate(
        Layer("base", "disney", {"roughness": 0.25}), Layer("coat", "disney", {"clearcoat": 0.5}, mask=0.4)
    )
    layers = {socket.name: socket for socket in tree_of(source, "Lookdev Layers").inputs}
    parameter = MODELS["disney"].parameters["roughness"]
    socket = layers["base roughness"]
    assert (socket.kind, socket.default, socket.soft) == ("float", parameter.default, parameter.soft)
    assert (socket.help, socket.panel) == (parameter.help, "base")
    assert layers["coat clearcoat"].panel == "coat"
    assert "base clearcoat" not in layers
    assert "base mask" not in layers
    (group_node,) = [node for node in source.trees[-1].nodes if node.group == "Lookdev Layers"]
    assert group_node.inputs["base roughness"] == 0.25
    assert group_node.inputs["coat mask"] == 0.4


def test_a_socket_can_be_slid() -> None:
    """The group of a look, with other values of its sockets, is the group of the look with these values."""
    inputs, other_inputs = ({"roughness": rough, "specular": 0.9, "sheen": 0.5} for rough in (0.3, 0.7))
    source = generate(Layer("base", "disney", inputs))
    other_source = generate(Layer("base", "disney", other_inputs))
    assert tree_of(source, "Lookdev Disney") == tree_of(other_source, "Lookdev Disney")
    assert source.digest != other_source.digest
    assert source.digest == generate(Layer("base", "disney", dict(inputs))).digest


def test_layers_of_one_name_have_panels_of_their_own() -> None:
    source = generate(Layer("paint", "disney", {}), Layer("paint", "disney", {"metallic": 0.5}, mask=0.5))
    assert {"paint roughness", "paint 2 roughness"} <= set(sockets(source, "Lookdev Layers"))


def test_a_black_surface_has_no_closures() -> None:
    black = {"surfaceColor": (0.0, 0.0, 0.0), "roughness": 1.0, "normalScale": 0.0, "grazingScale": 0.0}
    source = check((Layer("base", "pixar", black),))
    assert [node.kind for node in tree_of(source, "Lookdev Pixar").nodes] == ["NodeGroupOutput"]


@pytest.mark.parametrize(
    ("inputs", "transmits", "see_through"),
    [({}, False, False), ({"back": 0.5}, True, False), ({"clear": 0.5}, True, False), ({"presence": 0.5}, False, True)],
)
def test_light_that_passes_through_is_reported(inputs: dict[str, Any], transmits: bool, see_through: bool) -> None:
    source = generate(Layer("base", "pixar", inputs))
    assert (source.exact, source.transmits, source.see_through) == (False, transmits, see_through)


def test_a_normal_that_leans_reads_the_handedness() -> None:
    source = check((Layer("base", "disney", {"normal": (0.2, 0.3, 1.0)}),))
    assert [binding.attribute for binding in source.attributes] == [HANDEDNESS, TANGENT]
    crossed = [node for node in tree_of(source, "Lookdev Frame").nodes if node.kind == "VectorTransform"]
    plain = tree_of(generate(Layer("base", "disney", {})), "Lookdev Frame")
    assert len(crossed) > len([node for node in plain.nodes if node.kind == "VectorTransform"])
