"""LookdevExpression nodes: what they read, and what is wrong with them."""

from __future__ import annotations

import numpy as np
import pytest
from look_files import BASE, LAYER1, STACK, disney, expression, shader, stack, texture

from lookdev.codegen.inputs import Inputs
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.symbolic import SymbolicArray
from lookdev.material import Coordinates, Formula, Primvar, Texture, View
from lookdev.material.look import depends_on_view
from lookdev.material.textures import sample_texture
from lookdev.material.usd import read_look
from lookdev.material.validate.examine import examine
from lookdev.material.values import Values
from lookdev.scene.uvs import look_uvs

TEX = texture('token sourceColorSpace = "raw"\nfloat outputs:r\nfloat3 outputs:rgb')
EDGE = shader("Edge", "UsdPrimvarReader_float", 'string varname = "edge"\nfloat fallback = 0.25')


def masked(*shaders: str) -> str:
    mask = "float layer1Mask <- Expr.result\n"
    return stack(BASE + LAYER1 + mask, disney(), disney("Coat"), *shaders)


def mask_of(write, *shaders: str) -> Formula:
    mask = read_look(write(masked(*shaders), STACK)).layers[1].mask
    assert isinstance(mask, Formula)
    return mask


def test_an_expression_reads_textures_primvars_constants_and_coordinates(write) -> None:
    inputs = """float dirt <- Tex.r
        float edge <- Edge.result
        float amount = 0.5
        color3f tint = (1, 0, 0)
        float2 st <- St.result"""
    text = "clamp(dirt * (1 - edge) * amount + tint[0] + st[1], 0, 1)"
    mask = mask_of(write, expression(text, inputs), TEX, EDGE)
    assert mask.kinds == {"dirt": "float", "edge": "float", "amount": "float", "tint": "color", "st": "color"}
    assert isinstance(mask.inputs["dirt"], Texture)
    assert mask.inputs["edge"] == Primvar("edge", 0.25)
    assert (mask.inputs["amount"], mask.inputs["tint"]) == (0.5, (1.0, 0.0, 0.0))
    assert mask.inputs["st"] == Coordinates("st")


def test_an_expression_may_read_an_expression(write) -> None:
    inner = expression("a * a", "float a = 3", "Inner")
    mask = mask_of(write, expression("inner + 1", "float inner <- Inner.result"), inner)
    inputs = Inputs(Graph(), lambda source: pytest.fail("no image is there"))
    assert float(Values(inputs).read(mask, color=False)) == 10.0


def test_a_parameter_may_be_an_expression(write) -> None:
    color = "color3f baseColor <- Expr.result"
    look = read_look(write(disney(body=color) + expression("[a, 0, a * 2]", "float a = 0.25", kind="color3f")))
    inputs = Inputs(Graph(), lambda source: pytest.fail("no image is there"))
    np.testing.assert_array_equal(Values(inputs).read(look.layers[0].inputs["baseColor"], color=True), [0.25, 0.0, 0.5])


@pytest.mark.parametrize("declared", ["", "float view"])
def test_the_view_needs_no_source(write, declared: str) -> None:
    file = write(masked(expression("smoothstep(1 - view, 0, 1) * a", f"float a = 0.5\n{declared}")), STACK)
    mask = read_look(file).layers[1].mask
    assert isinstance(mask, Formula)
    assert (mask.inputs, mask.kinds) == ({"view": View(), "a": 0.5}, {"view": "float", "a": "float"})
    assert examine(file).findings == ()


def test_an_input_named_view_is_that_input(write) -> None:
    connected = "color3f view <- Tex.rgb"
    assert mask_of(write, expression("view", "float view = 0.25")).inputs == {"view": 0.25}
    assert isinstance(mask_of(write, expression("view[0]", connected), TEX).inputs["view"], Texture)


def test_every_kind_of_parameter_may_depend_on_the_view(write) -> None:
    links = """color3f baseColor <- Color.result
        float roughness <- Expr.result
        normal3f normal <- Normal.result"""
    nodes = expression("[view, 0, 1 - view]", name="Color", kind="color3f") + expression("view ^ 2")
    normal = expression("[0.2 * view, 0, 1]", name="Normal", kind="normal3f")
    look = read_look(write(disney(body=links) + nodes + normal))
    assert all(depends_on_view(source) for source in look.layers[0].inputs.values())
    assert len(look.layers[0].inputs) == 3


def test_what_expressions_share_is_read_and_computed_once(write) -> None:
    """Each of thirty reads the next twice: 2^30 paths lead to the texture."""
    link = "float a <- E{0}.result\nfloat b <- E{0}.result"
    chain = [expression("a * b", link.format(number + 1), f"E{number}") for number in range(30)]
    dirt = expression("dirt", "float dirt <- Tex.r", "E30")
    file = write(masked(expression("a + b", link.format(0)), *chain, dirt, TEX), STACK)
    look = read_look(file)
    assert look_uvs(look) == ("st",)
    graph = Graph()
    inputs = Inputs(graph, lambda source: pytest.fail("no image is opened"))
    value = Values(inputs).read(look.layers[1].mask, color=False)
    assert isinstance(value, SymbolicArray)
    assert examine(file).findings == ()


def test_a_set_of_tiles_is_one_texture(write, tmp_path) -> None:
    for tile in ("1001", "1002", "1011"):
        (tmp_path / f"dirt.{tile}.png").write_bytes((tmp_path / "gray.png").read_bytes())
    mask = "float layer1Mask <- Tex.r\n"
    body = stack(BASE + LAYER1 + mask, disney(), disney("Coat"), TEX.replace("gray.png", "dirt.<UDIM>.png"))
    found = read_look(write(body, STACK)).layers[1].mask
    assert isinstance(found, Texture)
    assert found.file.name == "dirt.<UDIM>.png"
    st = [[0.5, 0.5], [1.5, 0.5], [0.5, 1.5], [1.5, 1.5], [2.5, 0.5], [-0.5, 0.5]]
    np.testing.assert_allclose(sample_texture(found, st), np.array([128, 128, 128, 0, 0, 0]) / 255.0, atol=1e-6)
