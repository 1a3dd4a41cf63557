"""Looks read from USD: constants, connections, textures, primvars, stacks, variants, displacement, expressions."""

from math import cos, radians, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from look_files import BASE, LAYER1, STACK, disney, expression, faults_of, pixar, rough, shader, stack, texture
from variant_sets import over, selecting, variants

from lookdev.brdf import layer_shaders
from lookdev.codegen.inputs import SymbolicSurface
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.symbolic import SymbolicArray
from lookdev.material import (
    Bump,
    Coordinates,
    Displacement,
    Formula,
    Layer,
    Look,
    Primvar,
    Texture,
    ViewCosine,
    depends_on_view,
)
from lookdev.material.textures import sample_texture
from lookdev.material.usd import expand_variants, read_look
from lookdev.material.validate.examine import examine_file
from lookdev.material.values import SourceValues
from lookdev.scene.uvs import look_uvs

pytestmark = pytest.mark.both_pythons

MOVED = "token outputs:lookdev:displacement.connect = </M/Moved.outputs:displacement>\n"


def inputs_of(file: Path, **selections: str) -> dict[str, Any]:
    """Return the inputs of the first layer."""
    return dict(read_look(file, variants=selections).layers[0].inputs)


def test_only_authored_constants_become_inputs(write) -> None:
    body = 'color3f baseColor = (0.25, 0.5, 1); float roughness = 0.125; float sheen; token variant = "2012"'
    file = write(disney(body=body))
    inputs = {"baseColor": (0.25, 0.5, 1.0), "roughness": 0.125, "variant": "2012"}
    assert read_look(file) == Look("M", (Layer("Base", "disney", inputs),), f"{file}</M>")  # and no displacement
    assert read_look(file, name="matte").name == "matte"


def test_interface_inputs_and_node_graphs_are_followed(write) -> None:
    graph = """float rough = 0.5
        float unset
        def NodeGraph "Graph" {
            float in <- .rough
            float outputs:out.connect = </M/Graph.inputs:in>
            token outputs:layer.connect = </M/Graph/Base.outputs:layer>
"""
    layer = disney(body="float roughness <- Graph.out; float sheen <- .unset")
    assert inputs_of(write(graph + layer + "}", "</M/Graph.outputs:layer>")) == {"roughness": 0.5}


def test_stack_has_enabled_layers_in_order_with_their_masks(write) -> None:
    inputs = """token layer1Mode = "over"
        token layer2 <- Base.layer; float layer2Mask = 0.25; bool layer2Enabled <- .dusty
        token layer3 <- Dust.layer; float layer3Mask <- Tex.g; bool layer3Enabled = 1
        token layer4 <- Coat.layer; float layer4Mask <- Worn.result"""
    layers = disney(), disney("Coat", "float clearcoat = 1"), disney("Dust")
    wear_mask = shader("Worn", "UsdPrimvarReader_float", 'string varname = "worn"; float fallback = 0.5')
    file = write("bool dusty = 0\n" + stack(BASE + LAYER1 + inputs, *layers, texture(), wear_mask), STACK)
    base, coat, dust, again = read_look(file).layers
    assert [layer.name for layer in (base, coat, dust, again)] == ["Base", "Coat", "Dust", "Coat"]
    assert base.mask == coat.mask == 1.0
    assert coat.inputs == {"clearcoat": 1.0}
    assert dust.mask.channel == "g"
    assert again.mask == Primvar("worn", 0.5)


def test_texture_node_has_the_meaning_of_usd(write, tmp_path: Path) -> None:
    settings = 'token wrapS = "mirror"; float4 scale = (2, 2, 2, 1); float4 bias = (0.5, 0, 0, 0)'
    inner = "float2 in <- St.result; float rotation = 30; float2 scale = (2, 3); float2 translation = (0.25, 0.5)"
    file = write(
        disney(body="color3f baseColor <- Tex.rgb")
        + shader("Tex", "UsdUVTexture", f"asset file = @./rgb.png@; {settings}; float2 st <- Outer.result")
        + shader("Outer", "UsdTransform2d", "float2 in <- Inner.result; float2 scale = (4, 8)")
        + shader("Inner", "UsdTransform2d", inner)
        + shader("St", "UsdPrimvarReader_float2", 'token varname = "map1"')
    )
    texture_input = inputs_of(file)["baseColor"]
    assert (texture_input.file, texture_input.channel, texture_input.st) == (tmp_path / "rgb.png", "rgb", "map1")
    assert (texture_input.wrap_s, texture_input.wrap_t) == ("mirror", "black")  # useMetadata, and the file has none
    assert (texture_input.scale, texture_input.bias) == ((2.0, 2.0, 2.0, 1.0), (0.5, 0.0, 0.0, 0.0))
    # UsdTransform2d: in * scale * rotate + translation; the inner one is applied first.
    c, s = cos(radians(30)), sin(radians(30))
    expected = [4 * 2 * c, -4 * 3 * s, 4 * 0.25, 8 * 2 * s, 8 * 3 * c, 8 * 0.5]
    assert texture_input.transform == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("image", "space", "expected"),
    [
        ("rgb.png", "", "sRGB"),
        ("gray.png", "", "raw"),
        ("rgb.exr", "", "raw"),
        ("rgb.png", "raw", "raw"),
        ("rgb.exr", "sRGB", "sRGB"),
    ],
)
def test_source_color_space(write, image: str, space: str, expected: str) -> None:
    color_space = f'token sourceColorSpace = "{space}"' if space else ""
    texture_input = inputs_of(write(rough("Tex.a") + texture(color_space, f"@./{image}@")))["roughness"]
    assert (texture_input.colorspace, texture_input.channel) == (expected, "a")


def test_primvar_color(write) -> None:
    reader = 'string varname = "displayColor"\nfloat3 fallback = (1, 0.5, 0)'
    file = write(disney(body="color3f baseColor <- Color.result") + shader("Color", "UsdPrimvarReader_float3", reader))
    assert read_look(file).layers[0].inputs == {"baseColor": Primvar("displayColor", (1.0, 0.5, 0.0))}


@pytest.mark.parametrize("usd_type", ["normal3f", "vector3f", "float3"])
def test_constant_normal_need_not_be_unit(write, usd_type: str) -> None:
    file = write(pixar(body=f"{usd_type} diffuseNormal = (0, -0.375, 0.5)"))
    assert read_look(file).layers[0] == Layer("Base", "pixar", {"diffuseNormal": (0.0, -0.375, 0.5)})


@pytest.mark.parametrize(
    ("image", "scale", "bias"),
    [
        ("rgb.png", (2, 2, 2, 1), (-1, -1, -1, 0)),
        ("rgb.png", (2, -2, 2, 1), (-1, 1, -1, 0)),  # green points down
        ("rgb.png", (2, 2, 2, 1), (-256 / 255, -256 / 255, -1, 0)),  # 128 is the centre
        ("rgb16.png", (1, 1, 2, 1), (-0.5, -0.5, -1, 0)),  # flattened
        ("rgb.exr", (1, 1, 1, 1), (0, 0, 0, 0)),  # floats can be negative themselves
    ],
)
def test_normal_map(write, tmp_path: Path, image: str, scale: tuple[float, ...], bias: tuple[float, ...]) -> None:
    node = f'token sourceColorSpace = "raw"\nfloat4 scale = {scale}\nfloat4 bias = {bias}'
    layer = pixar(body="normal3f highlightNormal <- Tex.rgb")
    texture_input = inputs_of(write(layer + texture(node, f"@./{image}@")))["highlightNormal"]
    assert (texture_input.file, texture_input.channel, texture_input.colorspace) == (tmp_path / image, "rgb", "raw")
    assert texture_input.scale + texture_input.bias == pytest.approx(scale + bias, rel=2.0**-24)  # stored as float32


@pytest.mark.parametrize(("inputs", "scale"), [("", 1.0), ("float scale = -0.25", -0.25)])
def test_bump_is_a_height_and_its_scale(write, tmp_path: Path, inputs: str, scale: float) -> None:
    layer, bump = pixar(body="normal3f diffuseNormal <- Bump.normal"), f"float height <- .h; {inputs}"
    file = write("float h <- Tex.b\n" + layer + shader("Bump", "LookdevBump", bump) + texture())
    height = Texture(tmp_path / "gray.png", "b", "raw", "black", "black")
    assert inputs_of(file) == {"diffuseNormal": Bump(height, scale)}


def test_modes_and_mixed_models(write) -> None:
    inputs = """token base <- Wood.layer
        token layer1 <- Lacquer.layer; token layer1Mode = "transmit"
        token layer2 <- Dust.layer; token layer2Mode = "over"
        token layer3 <- Old.layer
        token layer4 <- Saved.layer
        token layer5 <- Dust.layer; token layer5Mode = "transmit"; bool layer5Enabled = 0"""
    pixars = pixar("Wood"), pixar("Lacquer", "float clear = 1"), pixar("Saved", 'token energy = "conserving"')
    # Over the first layer of another model each layer stands alone, with tokens of its own.
    disneys = disney("Dust"), disney("Old", 'token variant = "2012"')
    layers = read_look(write(stack(inputs, *pixars, *disneys), STACK)).layers
    assert " ".join(f"{layer.name}:{layer.model}:{layer.mode}" for layer in layers) == (
        "Wood:pixar:over Lacquer:pixar:transmit Dust:disney:over Old:disney:over Saved:pixar:over"
    )


def test_metals_of_layers_may_differ(write) -> None:
    body = 'token fresnel = "conductor"\ncolor3f eta = (0.25, 0.5, 1.5)\ncolor3f k = (4, 2, 2)'
    base, top = read_look(write(stack(f"{BASE}\n{LAYER1}", disney(), disney("Coat", body)), STACK)).layers
    assert base.inputs == {}
    assert top.inputs == {"fresnel": "conductor", "eta": (0.25, 0.5, 1.5), "k": (4.0, 2.0, 2.0)}


def test_a_metal_beside_what_it_stands_for_is_a_fault(write) -> None:
    metal_token = 'token metal = "gold"'
    assert read_look(write(disney(body=metal_token))).layers[0].inputs == {"metal": "gold"}
    [(where, summary, _)] = faults_of(write(disney(body=f"{metal_token}\ncolor3f k = (4, 2, 2)")))
    assert where == "/M/Base"
    assert summary.startswith("disney.k is (4.0, 2.0, 2.0), but metal 'gold' stands for (")


def test_references_and_nested_variants_compose(write, tmp_path: Path) -> None:
    (tmp_path / "preset.usda").write_text("#usda 1.0\n" + disney("Gold", "float metallic = 1"))
    low, high = (over("Base", f"float roughness = {value}") for value in (0.25, 0.75))
    custom = f'"custom" {selecting(rough="low")} {{\n{variants("rough", low=low, high=high)}}}\n'
    sets = variants("finish", plain="").removesuffix("}\n") + custom + "}\n"
    file = write(sets + 'def "Base" (references = @./preset.usda@</Gold>) { }', material=selecting(finish="plain"))
    assert inputs_of(file) == {"metallic": 1.0}
    # "rough" exists only once "finish" is chosen, whatever the order in which they are given.
    assert inputs_of(file, rough="high", finish="custom") == {"metallic": 1.0, "roughness": 0.75}
    assert inputs_of(file) == {"metallic": 1.0}, "selections must not outlive the reading"


def test_variant_sets_above_the_material_count(tmp_path: Path) -> None:
    file = tmp_path / "look.usda"
    surface = "token outputs:lookdev:surface.connect = </Looks/M/Base.outputs:layer>"
    material = f'def Material "M" {{\n{surface}\n{disney()}}}\n'
    sets = variants("wet", no="", yes=over("M", over("Base", "float clearcoat = 1")))
    file.write_text(f'#usda 1.0\ndef Scope "Looks" {selecting(wet="no")} {{\n{material}{sets}}}\n')
    assert inputs_of(file, wet="yes") == {"clearcoat": 1.0}  # the only material


def test_unsupported_material_names_its_terminal(write) -> None:
    [(where, summary, hint)] = faults_of(write(disney(), terminal=""))
    assert (where, summary) == ("/M.outputs:lookdev:surface", "is not connected")
    assert hint == "connect it to a LookdevLayers, " + " or ".join(layer_shaders()) + " shader"


@pytest.mark.parametrize(
    ("inputs", "expected"),
    [
        ("float height = 7", Displacement(7.0, 1.0, 0.0, "object")),
        (
            'float height = 1\nfloat scale = -2\nfloat midlevel = 3\ntoken units = "world"',
            Displacement(1.0, -2.0, 3.0, "world"),
        ),
    ],
)
def test_displacement_by_a_constant(write, inputs: str, expected: Displacement) -> None:
    assert read_look(write(MOVED + disney() + shader("Moved", "LookdevDisplacement", inputs))).displacement == expected


@pytest.mark.parametrize(
    ("output", "more", "kind"),
    [
        ("Tex.g", texture(), Texture),
        ("P.result", shader("P", "UsdPrimvarReader_float", 'string varname = "h"'), Primvar),
        ("X.result", expression("2 - 5", name="X"), Formula),
    ],
)
def test_heights_come_from_nodes(write, output: str, more: str, kind: type) -> None:
    moved = shader("Moved", "LookdevDisplacement", f"float height <- {output}")
    assert isinstance(read_look(write(MOVED + disney() + moved + more)).displacement.height, kind)


def test_variants_of_two_sets(write) -> None:
    sets = variants("colour", black="", red=over("Base", "color3f baseColor = (0.5, 0.25, 0)"))
    sets += variants("wear", new=over("Layers", "bool layer1Enabled = 0"), worn="")
    layers = stack(BASE + LAYER1 + "float layer1Mask <- .amount", disney(), disney("Coat"))
    file = write("float amount = 0.75\n" + layers + sets, STACK, selecting(colour="black", wear="new"))
    assert [layer.name for layer in read_look(file).layers] == ["Base"]
    base, dust = read_look(file, variants={"colour": "red", "wear": "worn"}).layers
    assert (base.inputs["baseColor"], dust.mask) == ((0.5, 0.25, 0.0), 0.75)
    assert expand_variants(file, None, {"colour": "*", "wear": "*"}) == tuple(
        {"colour": colour, "wear": wear} for colour in ("black", "red") for wear in ("new", "worn")
    )
    assert expand_variants(file, None, {"wear": "worn", "colour": "*"})[1] == {"wear": "worn", "colour": "red"}


TEX = texture('token sourceColorSpace = "raw"\nfloat outputs:r\nfloat3 outputs:rgb')
EDGE = shader("Edge", "UsdPrimvarReader_float", 'string varname = "edge"\nfloat fallback = 0.25')


def masked_look(*shaders: str) -> str:
    return stack(BASE + LAYER1 + "float layer1Mask <- Expr.result\n", disney(), disney("Coat"), *shaders)


def mask_of(write, *shaders: str) -> Formula:
    return read_look(write(masked_look(*shaders), STACK)).layers[1].mask


def test_an_expression_reads_textures_primvars_constants_and_coordinates(write) -> None:
    inputs = "float dirt <- Tex.r; float edge <- Edge.result; float amount = 0.5; color3f tint = (1, 0, 0)"
    text = "clamp(dirt * (1 - edge) * amount + tint[0] + st[1], 0, 1)"
    mask = mask_of(write, expression(text, inputs + "; float2 st <- St.result"), TEX, EDGE)
    assert mask.kinds == {"dirt": "float", "edge": "float", "amount": "float", "tint": "color", "st": "color"}
    assert isinstance(mask.inputs["dirt"], Texture)
    assert mask.inputs["edge"] == Primvar("edge", 0.25)
    assert (mask.inputs["amount"], mask.inputs["tint"]) == (0.5, (1.0, 0.0, 0.0))
    assert mask.inputs["st"] == Coordinates("st")


def test_an_expression_may_read_an_expression(write) -> None:
    inner = expression("a * a", "float a = 3", "Inner")
    mask = mask_of(write, expression("inner + 1", "float inner <- Inner.result"), inner)
    inputs = SymbolicSurface(Graph(), lambda source: pytest.fail("no image is there"))
    assert float(SourceValues(inputs).source_value(mask, color=False)) == 10.0


def test_a_parameter_may_be_an_expression(write) -> None:
    color = "color3f baseColor <- Expr.result"
    look = read_look(write(disney(body=color) + expression("[a, 0, a * 2]", "float a = 0.25", kind="color3f")))
    inputs = SymbolicSurface(Graph(), lambda source: pytest.fail("no image is there"))
    np.testing.assert_array_equal(
        SourceValues(inputs).source_value(look.layers[0].inputs["baseColor"], color=True), [0.25, 0.0, 0.5]
    )


@pytest.mark.parametrize("declared", ["", "float view"])
def test_the_view_needs_no_source(write, declared: str) -> None:
    file = write(masked_look(expression("smoothstep(1 - view, 0, 1) * a", f"float a = 0.5\n{declared}")), STACK)
    mask = read_look(file).layers[1].mask
    assert (mask.inputs, mask.kinds) == ({"view": ViewCosine(), "a": 0.5}, {"view": "float", "a": "float"})
    assert examine_file(file).findings == ()


def test_an_input_named_view_is_that_input(write) -> None:
    connected = "color3f view <- Tex.rgb"
    assert mask_of(write, expression("view", "float view = 0.25")).inputs == {"view": 0.25}
    assert isinstance(mask_of(write, expression("view[0]", connected), TEX).inputs["view"], Texture)


def test_every_kind_of_parameter_may_depend_on_the_view(write) -> None:
    links = "color3f baseColor <- Color.result; float roughness <- Expr.result; normal3f normal <- Normal.result"
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
    file = write(masked_look(expression("a + b", link.format(0)), *chain, dirt, TEX), STACK)
    look = read_look(file)
    assert look_uvs(look) == ("st",)
    inputs = SymbolicSurface(Graph(), lambda source: pytest.fail("no image is opened"))
    assert isinstance(SourceValues(inputs).source_value(look.layers[1].mask, color=False), SymbolicArray)
    assert examine_file(file).findings == ()


def test_a_set_of_tiles_is_one_texture(write, tmp_path) -> None:
    for tile in ("1001", "1002", "1011"):
        (tmp_path / f"dirt.{tile}.png").write_bytes((tmp_path / "gray.png").read_bytes())
    mask = "float layer1Mask <- Tex.r\n"
    body = stack(BASE + LAYER1 + mask, disney(), disney("Coat"), TEX.replace("gray.png", "dirt.<UDIM>.png"))
    texture = read_look(write(body, STACK)).layers[1].mask
    assert texture.file.name == "dirt.<UDIM>.png"
    st = [[0.5, 0.5], [1.5, 0.5], [0.5, 1.5], [1.5, 1.5], [2.5, 0.5], [-0.5, 0.5]]
    np.testing.assert_allclose(sample_texture(texture, st), np.array([128, 128, 128, 0, 0, 0]) / 255.0, atol=1e-6)
