"""The nodes of textures, primvars and coordinates give the values that the reference looks up."""

import itertools
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import node_interpreter
import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.brdf.parameters import Parameter
from lookdev.codegen.inputs import SymbolicSurface
from lookdev.codegen.nodes.builder import TreeBuilder
from lookdev.codegen.nodes.inputs import bind_inputs, node_digest
from lookdev.codegen.source import HANDEDNESS, AttributeBinding, GroupSocket, NodeLink, NodeTree, ShaderNode
from lookdev.codegen.trace.graph import Graph, Symbol, reachable_nodes
from lookdev.codegen.trace.symbolic import elements_of
from lookdev.errors import TextureError
from lookdev.material import Bump, Coordinates, Formula, Primvar, Texture
from lookdev.material.expression import parse
from lookdev.material.textures import image_file, sample_slopes, sample_texture
from lookdev.material.values import SourceValues

WRAPS = ("black", "clamp", "repeat", "mirror")
EXTENSIONS = {"CLIP": "black", "EXTEND": "clamp", "REPEAT": "repeat", "MIRROR": "mirror"}
ROTATION = (1.3, -0.4, 0.2, 0.5, 1.1, -0.3)

FLOAT = Parameter("x", "float", 0.0, hard=(-1e3, 1e3))
COLOR = Parameter("x", "color", (0.0, 0.0, 0.0), hard=(-1e3, 1e3))
NORMAL = Parameter("x", "normal", (0.0, 0.0, 1.0))


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    return write(tmp_path / "picture.exr", 1)


def write(file: Path, seed: int) -> Path:
    pixels = np.random.default_rng(seed).uniform(-1.0, 2.0, (3, 5, 4)).astype(np.float32)
    assert oiio.ImageBuf(pixels).write(str(file))
    return file


def tree_of(
    source: Any, parameter: Parameter, resolve: Callable[[Texture | Bump], Path] = image_file
) -> tuple[NodeTree, tuple[AttributeBinding, ...]]:
    """Return the tree that computes one input, and the attributes of the mesh that it reads."""
    inputs = SymbolicSurface(Graph(), resolve)
    value = elements_of(SourceValues(inputs).parameter_value(source, parameter))
    builder = TreeBuilder("inputs")
    names = [node.name for node in reachable_nodes(value) if isinstance(node, Symbol)]
    attributes = bind_inputs(builder, inputs, [*names, "wo_x"])
    out = builder.scalar(value[0]) if len(value) == 1 else builder.vector(value)
    builder.add("NodeGroupOutput", inputs={"out": out})
    return builder.tree(outputs=[GroupSocket("out", "float" if len(value) == 1 else "vector")]), attributes


def _image(node: ShaderNode, sockets: Mapping[str, Any]) -> dict[str, Any]:
    """Look up an image as Blender does: bilinearly, with equal wrapping of both axes, (0, 0) at the lower left."""
    assert node.image is not None
    assert isinstance(node.inputs["Vector"], NodeLink), "an image without a link reads the UVs of the mesh"
    wrap: Any = EXTENSIONS[str(node.properties["extension"])]
    texture = Texture(node.image.path, "rgb", "raw", wrap, wrap)
    st = np.asarray(sockets["Vector"], np.float64)[..., :2]
    return {"Color": sample_texture(texture, st), "Alpha": sample_texture(replace(texture, channel="a"), st)}


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Callable[[NodeTree, Mapping[str, Any]], Any]:
    """Return a function that evaluates a tree with the attributes of a mesh."""
    original = node_interpreter._node
    monkeypatch.setattr(
        node_interpreter,
        "_node",
        lambda node, sockets: (_image if node.kind == "TexImage" else original)(node, sockets),
    )

    def run_tree(tree: NodeTree, mesh: Mapping[str, Any]) -> Any:
        def answer(node: ShaderNode) -> Mapping[str, Any] | None:
            name = str(node.properties.get("uv_map", node.properties.get("attribute_name"))).removeprefix("primvars:")
            return dict.fromkeys(("UV", "Fac", "Vector"), mesh[name]) if name in mesh else None

        return node_interpreter.Interpreter((tree,), answer).run("inputs")["out"]

    return run_tree


def kinds(tree: NodeTree) -> Counter[str]:
    return Counter(node.kind for node in tree.nodes if node.kind != "NodeGroupOutput")


def random_coordinates(low: float = -2.3, high: float = 3.4) -> Any:
    """Return random coordinates, (N, 2), and the same as the output of a UV map, (N, 3)."""
    st = np.random.default_rng(7).uniform(low, high, (500, 2)).astype(np.float32)
    return st, np.concatenate([st, np.zeros((500, 1), np.float32)], axis=1)


# The rounding of coordinates of a few units in float32, times slopes of about ten differences of texels per unit.
NEAR = {"rtol": 1e-5, "atol": 2e-5}


@pytest.mark.parametrize(("wrap_s", "wrap_t"), [*itertools.product(WRAPS, WRAPS)])
@pytest.mark.parametrize("channel", ["rgb", "a"])
def test_textures_are_those_of_the_reference(wrap_s: Any, wrap_t: Any, channel: Any, picture: Path, run: Any) -> None:
    texture = Texture(picture, channel, "raw", wrap_s, wrap_t, "map", ROTATION, (2.0,) * 4, (0.5,) * 4)
    tree, attributes = tree_of(texture, COLOR if channel == "rgb" else FLOAT)
    st, uv = random_coordinates()
    np.testing.assert_allclose(run(tree, {"map": uv}), sample_texture(texture, st), **NEAR)
    assert [(binding.attribute, binding.kind) for binding in attributes] == [("map", "uv")]
    assert kinds(tree)["TexImage"] == (1 if wrap_s == wrap_t else 2 if "black" in (wrap_s, wrap_t) else 4)


@pytest.mark.parametrize(("wrap_s", "wrap_t"), [*((wrap, wrap) for wrap in WRAPS), ("mirror", "clamp")])
def test_bumps_are_those_of_the_reference(wrap_s: Any, wrap_t: Any, picture: Path, run: Any) -> None:
    height = Texture(picture, "g", "raw", wrap_s, wrap_t, "st", ROTATION)
    tree, _ = tree_of(Bump(height, 0.2), NORMAL)
    st, uv = random_coordinates()
    normal = run(tree, {"st": uv, HANDEDNESS: np.ones(500, np.float32)})
    slopes = 0.2 * sample_slopes(height, st)
    # Away from the lines where slopes change sign: there the last digit of a coordinate decides.
    image = st @ np.reshape(ROTATION, (2, 3))[:, :2].T + np.reshape(ROTATION, (2, 3))[:, 2]
    clear = (np.abs(image - np.round(image)) > 1e-5).all(axis=-1)
    np.testing.assert_allclose(normal[clear, :2], -slopes[clear], rtol=1e-5, atol=1e-4)
    np.testing.assert_array_equal(normal[:, 2], 1.0)


def test_a_set_of_tiles_is_looked_up_tile_by_tile(tmp_path: Path, run: Any) -> None:
    for seed, tile in enumerate((1001, 1002, 1012)):
        write(tmp_path / f"wear.{tile}.exr", seed)
    texture = Texture(tmp_path / "wear.<UDIM>.exr", "rgb", "raw")
    tree, _ = tree_of(texture, COLOR)
    st, uv = random_coordinates(-1.0, 2.5)
    colors = run(tree, {"st": uv})
    np.testing.assert_allclose(colors, sample_texture(texture, st), **NEAR)
    assert not colors[(st < 0.0).any(axis=-1)].any()
    assert kinds(tree)["TexImage"] == 3


@pytest.mark.parametrize("transform", [(0.0, 0.0, 0.3, 0.0, 0.0, 0.7), (0.0,) * 6])
@pytest.mark.parametrize("wraps", [("repeat", "repeat"), ("clamp", "mirror")])
def test_a_place_that_is_constant_is_looked_up_there(transform: Any, wraps: Any, picture: Path, run: Any) -> None:
    texture = Texture(picture, "rgb", "raw", *wraps, transform=transform)
    tree, _ = tree_of(texture, COLOR)
    st, uv = random_coordinates()
    np.testing.assert_allclose(np.broadcast_to(run(tree, {"st": uv}), (500, 3)), sample_texture(texture, st), **NEAR)


def test_a_plain_texture_is_two_nodes(picture: Path) -> None:
    tree, _ = tree_of(Texture(picture, "rgb", "raw"), COLOR)
    assert kinds(tree)["TexImage"] == kinds(tree)["UVMap"] == 1
    (image,) = (node for node in tree.nodes if node.kind == "TexImage")
    assert (image.label, image.properties["projection"]) == ("picture", "FLAT")
    assert isinstance(image.inputs["Vector"], NodeLink)
    assert image.inputs["Vector"].node.startswith("UVMap")


def test_two_channels_are_one_look_up(picture: Path, run: Any) -> None:
    red, alpha = (Texture(picture, channel, "raw", "clamp", "clamp") for channel in ("r", "a"))
    tree, _ = tree_of(Formula(parse("r - 2 * a"), {"r": red, "a": alpha}, {"r": "float", "a": "float"}), FLOAT)
    st, uv = random_coordinates()
    np.testing.assert_allclose(
        run(tree, {"st": uv}), sample_texture(red, st) - 2.0 * sample_texture(alpha, st), rtol=1e-5, atol=4e-5
    )
    assert kinds(tree)["TexImage"] == 1


def test_primvars_and_coordinates_are_read(run: Any) -> None:
    wear, hue = Primvar("wear", 0.25), Primvar("hue", (1.0, 0.0, 0.0))
    inputs = {"wear": wear, "hue": hue, "st": Coordinates("st", ROTATION)}
    both = Formula(parse("wear * hue + st"), inputs, {"wear": "float", "hue": "color", "st": "color"})
    tree, attributes = tree_of(both, COLOR)
    st, uv = random_coordinates()
    rng = np.random.default_rng(1)
    mesh = {"wear": rng.random(500, dtype=np.float32), "hue": rng.random((500, 3), dtype=np.float32), "st": uv}
    image = st @ np.reshape(ROTATION, (2, 3))[:, :2].T + np.reshape(ROTATION, (2, 3))[:, 2]
    expected = mesh["wear"][:, None] * mesh["hue"] + np.concatenate([image, np.zeros((500, 1))], axis=1)
    np.testing.assert_allclose(run(tree, mesh), expected, rtol=1e-5, atol=1e-5)
    fallbacks = {binding.attribute: binding.fallback for binding in attributes}
    assert fallbacks == {"wear": (0.25,), "hue": (1.0, 0.0, 0.0), "st": None}


def test_a_missing_image_is_reported(tmp_path: Path) -> None:
    with pytest.raises(TextureError, match=r"none\.exr: no such image"):
        tree_of(Texture(tmp_path / "none.exr", "r", "raw"), FLOAT)


def test_digests_depend_on_what_images_hold(tmp_path: Path) -> None:
    def digest(content: str, folder: str) -> str:
        (tmp_path / folder).mkdir()
        file = tmp_path / folder / "image.exr"
        file.write_text(content)
        tree, attributes = tree_of(Texture(file, "r", "raw"), FLOAT, lambda texture: file)
        return node_digest((tree,), attributes)

    assert digest("one", "a") == digest("one", "b") != digest("another", "c")
