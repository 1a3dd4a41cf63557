"""Looks read from USD, and every fault of one told with its place."""

from __future__ import annotations

from math import cos, radians, sin
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.errors import LookError
from lookdev.material.look import Layer, Look, Primvar, Texture
from lookdev.material.usd import has_look, read_look

SHADER = 'def Shader "{name}" {{\n uniform token info:id = "{id}"\n {body}\n}}\n'


def shader(name: str, shader_id: str, body: str = "") -> str:
    return SHADER.format(name=name, id=shader_id, body=body)


def disney(name: str = "Base", body: str = "") -> str:
    return shader(name, "LookdevDisney", body)


ST = shader("St", "UsdPrimvarReader_float2", 'string inputs:varname = "st"')
BASE = "token inputs:base.connect = </M/Base.outputs:layer>\n"
LAYER1 = "token inputs:layer1.connect = </M/Coat.outputs:layer>\n"


@pytest.fixture
def write(tmp_path: Path):
    """Write a material /M beside some images; its surface is connected to `terminal`."""
    for name, channels, kind in (
        ("gray.png", 1, oiio.UINT8),
        ("rgb.png", 3, oiio.UINT8),
        ("rgb.exr", 3, oiio.HALF),
    ):
        output = oiio.ImageOutput.create(str(tmp_path / name))
        assert output.open(str(tmp_path / name), oiio.ImageSpec(2, 2, channels, kind))
        assert output.write_image(np.full((2, 2, channels), 0.5, np.float32))
        assert output.close()

    def write(body: str, terminal: str = "</M/Base.outputs:layer>", material: str = "", before: str = "") -> Path:
        file = tmp_path / "look.usda"
        surface = f"token outputs:lookdev:surface.connect = {terminal}" if terminal else ""
        file.write_text(
            f'#usda 1.0\n(\n defaultPrim = "M"\n)\n{before}\ndef Material "M" {material}\n{{\n{surface}\n{body}\n}}\n'
        )
        return file

    return write


def stack(inputs: str, *shaders: str) -> str:
    return shader("Layers", "LookdevLayers", inputs) + "".join(shaders)


STACK = "</M/Layers.outputs:surface>"


def faults_of(file: Path, **options: object) -> list[tuple[str, str, str]]:
    with pytest.raises(LookError) as caught:
        read_look(file, **options)
    assert all(fault.file == str(file) for fault in caught.value.faults)
    return [(fault.where, fault.what, fault.hint) for fault in caught.value.faults]


def test_only_authored_constants_become_inputs(write) -> None:
    file = write(
        disney(
            body="""color3f inputs:baseColor = (0.25, 0.5, 1)
            float inputs:roughness = 0.125
            float inputs:sheen
            token inputs:variant = "2012" """
        )
    )
    inputs = {"baseColor": (0.25, 0.5, 1.0), "roughness": 0.125, "variant": "2012"}
    assert read_look(file) == Look("M", (Layer("Base", "disney", inputs),), f"{file}</M>")
    assert read_look(file, name="matte").name == "matte"


def test_interface_inputs_and_node_graphs_are_followed(write) -> None:
    file = write(
        """float inputs:rough = 0.5
        float inputs:unset
        def NodeGraph "Graph" {
            float inputs:in.connect = </M.inputs:rough>
            float outputs:out.connect = </M/Graph.inputs:in>
            token outputs:layer.connect = </M/Graph/Base.outputs:layer>
"""
        + disney(
            body="""float inputs:roughness.connect = </M/Graph.outputs:out>
            float inputs:sheen.connect = </M.inputs:unset>"""
        )
        + "}",
        terminal="</M/Graph.outputs:layer>",
    )
    assert read_look(file).layers[0].inputs == {"roughness": 0.5}


def test_stack_has_enabled_layers_in_order_with_their_masks(write) -> None:
    tex = "asset inputs:file = @./gray.png@\nfloat2 inputs:st.connect = </M/St.outputs:result>"
    file = write(
        "bool inputs:dusty = 0\n"
        + stack(
            BASE
            + LAYER1
            + """token inputs:layer1Mode = "over"
            token inputs:layer2.connect = </M/Base.outputs:layer>
            float inputs:layer2Mask = 0.25
            bool inputs:layer2Enabled.connect = </M.inputs:dusty>
            token inputs:layer3.connect = </M/Dust.outputs:layer>
            float inputs:layer3Mask.connect = </M/Tex.outputs:g>
            bool inputs:layer3Enabled = 1
            token inputs:layer4.connect = </M/Coat.outputs:layer>
            float inputs:layer4Mask.connect = </M/Worn.outputs:result>""",
            disney(),
            disney("Coat", "float inputs:clearcoat = 1"),
            disney("Dust"),
            shader("Tex", "UsdUVTexture", tex),
            shader(
                "Worn",
                "UsdPrimvarReader_float",
                'string inputs:varname = "worn"\nfloat inputs:fallback = 0.5',
            ),
            ST,
        ),
        STACK,
    )
    layers = read_look(file).layers
    assert [layer.name for layer in layers] == ["Base", "Coat", "Dust", "Coat"]
    assert layers[0].mask == layers[1].mask == 1.0
    assert layers[1].inputs == {"clearcoat": 1.0}
    mask = layers[2].mask
    assert isinstance(mask, Texture)
    assert mask.channel == "g"
    assert layers[3].mask == Primvar("worn", 0.5)


def test_texture_node_means_what_usd_says(write, tmp_path: Path) -> None:
    file = write(
        disney(body="color3f inputs:baseColor.connect = </M/Tex.outputs:rgb>")
        + shader(
            "Tex",
            "UsdUVTexture",
            """asset inputs:file = @./rgb.png@
            token inputs:wrapS = "mirror"
            float4 inputs:scale = (2, 2, 2, 1)
            float4 inputs:bias = (0.5, 0, 0, 0)
            float2 inputs:st.connect = </M/Outer.outputs:result>""",
        )
        + shader(
            "Outer",
            "UsdTransform2d",
            "float2 inputs:in.connect = </M/Inner.outputs:result>\nfloat2 inputs:scale = (4, 8)",
        )
        + shader(
            "Inner",
            "UsdTransform2d",
            """float2 inputs:in.connect = </M/St.outputs:result>
            float inputs:rotation = 30
            float2 inputs:scale = (2, 3)
            float2 inputs:translation = (0.25, 0.5)""",
        )
        + shader("St", "UsdPrimvarReader_float2", 'token inputs:varname = "map1"')
    )
    texture = read_look(file).layers[0].inputs["baseColor"]
    assert isinstance(texture, Texture)
    assert (texture.file, texture.channel, texture.st) == (tmp_path / "rgb.png", "rgb", "map1")
    assert (texture.wrap_s, texture.wrap_t) == ("mirror", "black")  # useMetadata, and the file says nothing
    assert (texture.scale, texture.bias) == ((2.0, 2.0, 2.0, 1.0), (0.5, 0.0, 0.0, 0.0))
    # UsdTransform2d: in * scale * rotate + translation; the inner one is applied first.
    c, s = cos(radians(30)), sin(radians(30))
    expected = [4 * 2 * c, -4 * 3 * s, 4 * 0.25, 8 * 2 * s, 8 * 3 * c, 8 * 0.5]
    assert texture.transform == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("image", "said", "expected"),
    [
        ("rgb.png", "", "sRGB"),
        ("gray.png", "", "raw"),
        ("rgb.exr", "", "raw"),
        ("rgb.png", "raw", "raw"),
        ("rgb.exr", "sRGB", "sRGB"),
    ],
)
def test_source_color_space(write, image: str, said: str, expected: str) -> None:
    said = f'token inputs:sourceColorSpace = "{said}"' if said else ""
    body = f"asset inputs:file = @./{image}@\nfloat2 inputs:st.connect = </M/St.outputs:result>\n{said}"
    file = write(
        disney(body="float inputs:roughness.connect = </M/Tex.outputs:a>") + shader("Tex", "UsdUVTexture", body) + ST
    )
    texture = read_look(file).layers[0].inputs["roughness"]
    assert isinstance(texture, Texture)
    assert (texture.colorspace, texture.channel) == (expected, "a")


def test_primvar_color(write) -> None:
    reader = 'string inputs:varname = "displayColor"\nfloat3 inputs:fallback = (1, 0.5, 0)'
    file = write(
        disney(body="color3f inputs:baseColor.connect = </M/Color.outputs:result>")
        + shader("Color", "UsdPrimvarReader_float3", reader)
    )
    assert read_look(file).layers[0].inputs == {"baseColor": Primvar("displayColor", (1.0, 0.5, 0.0))}


def test_references_and_nested_variants_compose(write, tmp_path: Path) -> None:
    (tmp_path / "preset.usda").write_text("#usda 1.0\n" + disney("Gold", "float inputs:metallic = 1"))
    file = write(
        """variantSet "finish" = {
            "plain" {
            }
            "custom" (prepend variantSets = "rough"; variants = { string rough = "low" }) {
                variantSet "rough" = {
                    "low" {
                        over "Base" {
                            float inputs:roughness = 0.25
                        }
                    }
                    "high" {
                        over "Base" {
                            float inputs:roughness = 0.75
                        }
                    }
                }
            }
        }
        def "Base" (references = @./preset.usda@</Gold>) { }""",
        material='(prepend variantSets = "finish"; variants = { string finish = "plain" })',
    )
    assert read_look(file).layers[0].inputs == {"metallic": 1.0}
    # "rough" exists only once "finish" is chosen, whatever the order in which they are given.
    look = read_look(file, variants={"rough": "high", "finish": "custom"})
    assert look.layers[0].inputs == {"metallic": 1.0, "roughness": 0.75}
    assert read_look(file).layers[0].inputs == {"metallic": 1.0}, "selections must not outlive the reading"


def test_variant_sets_above_the_material_count(tmp_path: Path) -> None:
    file = tmp_path / "look.usda"
    file.write_text(
        f"""#usda 1.0
        def Scope "Looks" (prepend variantSets = "wet"; variants = {{ string wet = "no" }}) {{
            def Material "M" {{
                token outputs:lookdev:surface.connect = </Looks/M/Base.outputs:layer>
                {disney()}
            }}
            variantSet "wet" = {{
                "no" {{
                }}
                "yes" {{
                    over "M" {{
                        over "Base" {{
                            float inputs:clearcoat = 1
                        }}
                    }}
                }}
            }}
        }}"""
    )
    assert read_look(file, variants={"wet": "yes"}).layers[0].inputs == {"clearcoat": 1.0}  # the only material


def test_has_look(write) -> None:
    file = write(disney(), before='def Material "Plain" { }\ndef Scope "Scope" { }\n')
    assert [has_look(file, path) for path in ("/M", "/Plain", "/Scope", "/Nothing")] == [
        True,
        False,
        False,
        False,
    ]


def textured(node: str = "", file: str = "@./gray.png@") -> str:
    st = "" if "inputs:st" in node else "float2 inputs:st.connect = </M/St.outputs:result>\n"
    return (
        disney(body="float inputs:roughness.connect = </M/Tex.outputs:r>")
        + shader("Tex", "UsdUVTexture", f"asset inputs:file = {file}\n{st}{node}")
        + ST
    )


FAULTS = {
    "misspelt input": (
        disney(body="float inputs:roughnes = 1"),
        "/M/Base.inputs:roughnes",
        "did you mean 'roughness'",
    ),
    "wrong type": (disney(body="double inputs:roughness = 1"), "/M/Base.inputs:roughness", "must be float"),
    "float for a colour": (
        disney(body="float inputs:baseColor = 1"),
        "/M/Base.inputs:baseColor",
        "must be color3f",
    ),
    "wrong type behind the interface": (
        "int inputs:r = 1\n" + disney(body="float inputs:roughness.connect = </M.inputs:r>"),
        "/M/Base.inputs:roughness",
        "has type int at </M.inputs:r>",
    ),
    "out of range": (
        disney(body="float inputs:roughness = 1.5"),
        "/M/Base.inputs:roughness",
        "within [0, 1]",
    ),
    "one channel out of range": (
        disney(body="color3f inputs:baseColor = (0, 1.5, 0)"),
        "/M/Base.inputs:baseColor",
        "0, 1.5, 0 is out of range",
    ),
    "NaN": (disney(body="float inputs:roughness = nan"), "/M/Base.inputs:roughness", "not finite"),
    "infinite": (
        disney(body="color3f inputs:baseColor = (0, inf, 0)"),
        "/M/Base.inputs:baseColor",
        "not finite",
    ),
    "animated": (
        disney(body="float inputs:roughness.timeSamples = { 1: 0.5 }"),
        "/M/Base.inputs:roughness",
        "animated",
    ),
    "unknown token": (
        disney(body='token inputs:variant = "2013"'),
        "/M/Base.inputs:variant",
        "did you mean '201",
    ),
    "computed token": (
        disney(body="token inputs:variant.connect = </M/St.outputs:result>") + ST,
        "/M/Base.inputs:variant",
        "choose one of 2014, 2012",
    ),
    "dangling": (
        disney(body="float inputs:roughness.connect = </M/Gone.outputs:r>"),
        "/M/Base.inputs:roughness",
        "</M/Gone.outputs:r>, which is no output",
    ),
    "dangling interface": (
        disney(body="float inputs:roughness.connect = </M.inputs:gone>"),
        "/M/Base.inputs:roughness",
        "no interface input",
    ),
    "two connections": (
        disney(body="float inputs:roughness.connect = [</M.inputs:a>, </M.inputs:b>]"),
        "/M/Base.inputs:roughness",
        "2 connections",
    ),
    "cycle of inputs": (
        "float inputs:a.connect = </M.inputs:b>\nfloat inputs:b.connect = </M.inputs:a>\n"
        + disney(body="float inputs:roughness.connect = </M.inputs:a>"),
        "/M.inputs:a",
        "cycle",
    ),
    "cycle of transforms": (
        textured("float2 inputs:st.connect = </M/T.outputs:result>")
        + shader("T", "UsdTransform2d", "float2 inputs:in.connect = </M/T.outputs:result>"),
        "/M/T.inputs:in",
        "cycle",
    ),
    "missing image": (textured(file="@./gone.png@"), "/M/Tex.inputs:file", "no such image file: ./gone.png"),
    "no image": (textured(file="@@"), "/M/Tex.inputs:file", "names no image file"),
    "not an image": (textured(file="@./look.usda@"), "/M/Tex.inputs:file", "cannot be read as an image"),
    "UDIM": (textured(file="@./gray.<UDIM>.png@"), "/M/Tex.inputs:file", "UDIM set, which is not supported"),
    "unknown texture input": (textured("float inputs:gamma = 1"), "/M/Tex.inputs:gamma", "unknown input"),
    "unknown wrap": (
        textured('token inputs:wrapS = "repeats"'),
        "/M/Tex.inputs:wrapS",
        "did you mean 'repeat'",
    ),
    "computed wrap": (
        textured("token inputs:wrapS.connect = </M/St.outputs:result>"),
        "/M/Tex.inputs:wrapS",
        "must be a constant",
    ),
    "st not connected": (textured("float2 inputs:st = (0, 0)"), "/M/Tex.inputs:st", "not connected"),
    "st from a texture": (
        textured("float2 inputs:st.connect = </M/Tex.outputs:rgb>"),
        "/M/Tex.inputs:st",
        "whose info:id is 'UsdUVTexture'",
    ),
    "colour into a float": (
        disney(body="float inputs:roughness.connect = </M/Tex.outputs:rgb>")
        + shader(
            "Tex",
            "UsdUVTexture",
            "asset inputs:file = @./gray.png@\nfloat2 inputs:st.connect = </M/St.outputs:result>",
        )
        + ST,
        "/M/Base.inputs:roughness",
        "use outputs:r or g or b or a",
    ),
    "reader of another type": (
        disney(body="float inputs:roughness.connect = </M/St.outputs:result>") + ST,
        "/M/Base.inputs:roughness",
        "use UsdUVTexture or UsdPrimvarReader_float",
    ),
    "reader without a name": (
        disney(body="float inputs:roughness.connect = </M/P.outputs:result>") + shader("P", "UsdPrimvarReader_float"),
        "/M/P.inputs:varname",
        "names no primvar",
    ),
    "fallback out of range": (
        disney(body="float inputs:roughness.connect = </M/P.outputs:result>")
        + shader("P", "UsdPrimvarReader_float", 'string inputs:varname = "x"\nfloat inputs:fallback = 2'),
        "/M/P.inputs:fallback",
        "within [0, 1]",
    ),
    "expression": (
        disney(body="float inputs:roughness.connect = </M/X.outputs:result>") + shader("X", "LookdevExpression"),
        "/M/Base.inputs:roughness",
        "LookdevExpression, which is not supported in this version",
    ),
    "Pixar layer": (
        shader("Base", "LookdevPixar"),
        "/M.outputs:lookdev:surface",
        "LookdevPixar layer, which is not supported in this version",
    ),
    "unknown shader": (
        shader("Base", "LookdevDisnei"),
        "/M.outputs:lookdev:surface",
        "did you mean 'LookdevDisney'",
    ),
}

STACK_FAULTS = {
    "no base": (LAYER1, "/M/Layers.inputs:base", "the stack has no base"),
    "base not connected": ('token inputs:base = "Base"', "/M/Layers.inputs:base", "not connected to a layer"),
    "base is a stack": (
        "token inputs:base.connect = </M/Layers.outputs:surface>",
        "/M/Layers.inputs:base",
        "unknown info:id 'LookdevLayers'",
    ),
    "gap": (
        BASE + "token inputs:layer2.connect = </M/Coat.outputs:layer>",
        "/M/Layers.inputs:layer2",
        "there is no layer1",
    ),
    "mask without a layer": (
        BASE + "float inputs:layer1Mask = 1",
        "/M/Layers.inputs:layer1",
        "is not connected",
    ),
    "mask out of range": (
        BASE + LAYER1 + "float inputs:layer1Mask = -0.25",
        "/M/Layers.inputs:layer1Mask",
        "within [0, 1]",
    ),
    "mask of a wrong type": (
        BASE + LAYER1 + "color3f inputs:layer1Mask = (1, 1, 1)",
        "/M/Layers.inputs:layer1Mask",
        "must be float",
    ),
    "computed switch": (
        BASE + LAYER1 + "bool inputs:layer1Enabled.connect = </M/Coat.outputs:layer>",
        "/M/Layers.inputs:layer1Enabled",
        "must be a constant",
    ),
    "transmit": (
        BASE + LAYER1 + 'token inputs:layer1Mode = "transmit"',
        "/M/Layers.inputs:layer1Mode",
        "'transmit' is not supported in this version",
    ),
    "unknown mode": (
        BASE + LAYER1 + 'token inputs:layer1Mode = "under"',
        "/M/Layers.inputs:layer1Mode",
        "use 'over'",
    ),
    "unknown input": (
        BASE + LAYER1 + "float inputs:layer1Msk = 1",
        "/M/Layers.inputs:layer1Msk",
        "did you mean 'layer1Mask'",
    ),
    "layer zero": (
        BASE + "token inputs:layer0.connect = </M/Coat.outputs:layer>",
        "/M/Layers.inputs:layer0",
        "unknown",
    ),
}


@pytest.mark.parametrize(("body", "where", "says"), FAULTS.values(), ids=FAULTS)
def test_fault(write, body: str, where: str, says: str) -> None:
    [(place, what, hint)] = faults_of(write(body))
    assert place == where
    assert says in f"{what} ({hint})"


@pytest.mark.parametrize(("inputs", "where", "says"), STACK_FAULTS.values(), ids=STACK_FAULTS)
def test_stack_fault(write, inputs: str, where: str, says: str) -> None:
    [(place, what, hint)] = faults_of(write(stack(inputs, disney(), disney("Coat")), STACK))
    assert place == where
    assert says in f"{what} ({hint})"


def test_all_faults_are_told_at_once_and_shared_nodes_only_once(write) -> None:
    body = stack(
        BASE + LAYER1 + "float inputs:layer1Mask.connect = </M/Tex.outputs:r>\nfloat inputs:layer1Blur = 1",
        disney(body="float inputs:metalic = 1\nfloat inputs:sheen = 7"),
        disney("Coat", "float inputs:roughness.connect = </M/Tex.outputs:g>"),
        shader("Tex", "UsdUVTexture", "asset inputs:file = @./gone.png@\nfloat inputs:gamma = 1"),
    )
    assert [where for where, _, _ in faults_of(write(body, STACK))] == [
        "/M/Layers.inputs:layer1Blur",
        "/M/Base.inputs:metalic",
        "/M/Base.inputs:sheen",
        "/M/Tex.inputs:gamma",
        "/M/Tex.inputs:file",
        "/M/Tex.inputs:st",
    ]


def test_unsupported_material_names_its_terminal(write) -> None:
    [(where, what, hint)] = faults_of(write(disney(), terminal=""))
    assert (where, what) == ("/M.outputs:lookdev:surface", "is not connected")
    assert "LookdevDisney" in hint


@pytest.mark.parametrize(
    ("options", "where", "says"),
    [
        ({"prim": "/N"}, "/N", "no such prim"),
        ({"prim": "/M/Base"}, "/M/Base", "is not a material"),
        ({"prim": "M"}, "M", "is not a prim path"),
        ({"prim": "/M.inputs:x"}, "/M.inputs:x", "is not a prim path"),
        ({"variants": {"wear": "x"}}, "/M", "has no variant set 'wear'"),
    ],
)
def test_wrong_request(write, options: dict[str, object], where: str, says: str) -> None:
    [(place, what, _)] = faults_of(write(disney()), **options)
    assert (place, says) == (where, what)


def test_wrong_variant_names_the_nearest(write) -> None:
    file = write(
        disney() + 'variantSet "wear" = { "clean" { }\n "dusty" { } }',
        material='(prepend variantSets = "wear")',
    )
    assert faults_of(file, variants={"wear": "dust"}) == [
        ("/M", "variant set 'wear' has no variant 'dust'", "did you mean 'dusty'?")
    ]


def test_broken_reference_is_a_fault(write) -> None:
    file = write('def "Base" (references = @./gone.usda@</Gold>) { }')
    faults = faults_of(file)
    assert any(where == "/M/Base" and "gone.usda" in what for where, what, _ in faults)


def test_several_materials_and_no_default(tmp_path: Path) -> None:
    file = tmp_path / "two.usda"
    file.write_text('#usda 1.0\ndef Material "A" { }\ndef Material "B" { }\n')
    assert faults_of(file) == [
        ("", "holds 2 materials and none is the default prim", "name one with prim: /A, /B"),
    ]


@pytest.mark.parametrize("text", [None, "#usda 1.0\ndef nonsense", ""])
def test_unreadable_file(tmp_path: Path, text: str | None) -> None:
    file = tmp_path / "look.usda"
    if text is not None:
        file.write_text(text)
    [(where, what, _)] = faults_of(file)
    assert where == ""
    assert what == "no such file" if text is None else what.startswith("USD cannot open it: ")
