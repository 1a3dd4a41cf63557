"""Every fault of a look is reported with its place and what would be right."""

from __future__ import annotations

import pytest
from look_files import BASE, LAYER1, ST, STACK, disney, faults_of, pixar, rough, shader, stack, texture


def textured(node: str = "", file: str = "@./gray.png@") -> str:
    return rough("Tex.outputs:r") + texture(node, file)


def normal_map(file: str, node: str = "", output: str = "rgb") -> str:
    return pixar(body=f"normal3f inputs:diffuseNormal.connect = </M/Tex.outputs:{output}>") + texture(node, file)


RAW = 'token inputs:sourceColorSpace = "raw"\n'
CENTRED = "float4 inputs:scale = (2, 2, 2, 1)\nfloat4 inputs:bias = (-1, -1, -1, 0)\n"
HEIGHT = "float inputs:height.connect = </M/Tex.outputs:r>\n"


ROUGH, NORMAL = "/M/Base.inputs:roughness", "/M/Base.inputs:diffuseNormal"


def bump(inputs: str) -> str:
    """Return a normal from a bump, beside a texture for its height."""
    normal = pixar(body="normal3f inputs:highlightNormal.connect = </M/Bump.outputs:normal>")
    return normal + shader("Bump", "LookdevBump", inputs) + texture()


FAULTS = {
    "misspelt input": (disney(body="float inputs:roughnes = 1"), "/M/Base.inputs:roughnes", "did you mean 'roughness'"),
    "wrong type": (disney(body="double inputs:roughness = 1"), ROUGH, "must be float"),
    "float for a colour": (disney(body="float inputs:baseColor = 1"), "/M/Base.inputs:baseColor", "must be color3f"),
    "wrong type behind the interface": (
        "int inputs:r = 1\n" + disney(body="float inputs:roughness.connect = </M.inputs:r>"),
        ROUGH,
        "has type int at </M.inputs:r>",
    ),
    "out of range": (disney(body="float inputs:roughness = 1.5"), ROUGH, "within [0, 1]"),
    "one channel out of range": (
        disney(body="color3f inputs:baseColor = (0, 1.5, 0)"),
        "/M/Base.inputs:baseColor",
        "0, 1.5, 0 is out of range",
    ),
    "NaN": (disney(body="float inputs:roughness = nan"), ROUGH, "not finite"),
    "infinite": (disney(body="color3f inputs:baseColor = (0, inf, 0)"), "/M/Base.inputs:baseColor", "not finite"),
    "animated": (disney(body="float inputs:roughness.timeSamples = { 1: 0.5 }"), ROUGH, "animated"),
    "unknown token": (disney(body='token inputs:variant = "2013"'), "/M/Base.inputs:variant", "did you mean '201"),
    "computed token": (
        disney(body="token inputs:variant.connect = </M/St.outputs:result>") + ST,
        "/M/Base.inputs:variant",
        "choose one of 2014, 2012",
    ),
    "dangling": (rough("Gone.outputs:r"), ROUGH, "</M/Gone.outputs:r>, which is no output"),
    "dangling interface": (
        disney(body="float inputs:roughness.connect = </M.inputs:gone>"),
        ROUGH,
        "no interface input",
    ),
    "two connections": (
        disney(body="float inputs:roughness.connect = [</M.inputs:a>, </M.inputs:b>]"),
        ROUGH,
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
    "UDIM": (textured(file="@./gray.<UDIM>.png@"), "/M/Tex.inputs:file", "no tile of this set: ./gray.<UDIM>.png"),
    "unknown texture input": (textured("float inputs:gamma = 1"), "/M/Tex.inputs:gamma", "unknown input"),
    "unknown wrap": (textured('token inputs:wrapS = "repeats"'), "/M/Tex.inputs:wrapS", "did you mean 'repeat'"),
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
    "colour into a float": (rough("Tex.outputs:rgb") + texture(), ROUGH, "use outputs:r or g or b or a"),
    "reader of another type": (
        rough("St.outputs:result") + ST,
        ROUGH,
        "use UsdUVTexture, UsdPrimvarReader_float or LookdevExpression",
    ),
    "reader without a name": (
        rough("P.outputs:result") + shader("P", "UsdPrimvarReader_float"),
        "/M/P.inputs:varname",
        "names no primvar",
    ),
    "fallback out of range": (
        rough("P.outputs:result")
        + shader("P", "UsdPrimvarReader_float", 'string inputs:varname = "x"\nfloat inputs:fallback = 2'),
        "/M/P.inputs:fallback",
        "within [0, 1]",
    ),
    "expression": (
        rough("X.outputs:result") + shader("X", "LookdevExpression"),
        "/M/X.inputs:expression",
        "holds no expression",
    ),
    "zero normal": (pixar(body="normal3f inputs:diffuseNormal = (0, 0, 0)"), NORMAL, "cannot be the zero vector"),
    "normal out of range": (pixar(body="normal3f inputs:diffuseNormal = (0, 0, 2)"), NORMAL, "within [-1, 1]"),
    "float for a normal": (pixar(body="float inputs:diffuseNormal = 1"), NORMAL, "must be normal3f"),
    "normal from a primvar": (
        pixar(body="normal3f inputs:diffuseNormal.connect = </M/N.outputs:result>")
        + shader("N", "UsdPrimvarReader_float3", 'string inputs:varname = "n"'),
        NORMAL,
        "use UsdUVTexture, LookdevBump",
    ),
    "normal from one channel": (normal_map("@./rgb.exr@", output="r"), NORMAL, "use outputs:rgb"),
    "sRGB normal map": (
        normal_map("@./rgb.png@", CENTRED),
        "/M/Tex.inputs:sourceColorSpace",
        "a normal map is data (set it to 'raw')",
    ),
    "normal map of 8 bits without scale and bias": (
        normal_map("@./rgb.png@", RAW),
        "/M/Tex.inputs:bias",
        "set scale to (2, 2, 2, 1) and bias to (-1, -1, -1, 0)",
    ),
    "normal map of 16 bits without bias": (
        normal_map("@./rgb16.png@", "float4 inputs:scale = (2, 2, 2, 1)"),
        "/M/Tex.inputs:bias",
        "no normal has a negative component",
    ),
    "bump into a colour": (
        pixar(body="color3f inputs:surfaceColor.connect = </M/Bump.outputs:normal>") + shader("Bump", "LookdevBump"),
        "/M/Base.inputs:surfaceColor",
        "use UsdUVTexture, UsdPrimvarReader_float3",
    ),
    "bump without a height": (bump(""), "/M/Bump.inputs:height", "is not connected (only a UsdUVTexture has a slope"),
    "constant height": (
        "float inputs:h = 1\n" + bump("float inputs:height.connect = </M.inputs:h>"),
        "/M/Bump.inputs:height",
        "is not connected",
    ),
    "height from a primvar": (
        bump("float inputs:height.connect = </M/P.outputs:result>")
        + shader("P", "UsdPrimvarReader_float", 'string inputs:varname = "h"'),
        "/M/Bump.inputs:height",
        "comes from </M/P>",
    ),
    "height of three channels": (
        bump(HEIGHT.replace("outputs:r", "outputs:rgb")),
        "/M/Bump.inputs:height",
        "outputs:r",
    ),
    "height of a wrong type": (bump(HEIGHT.replace("float", "color3f")), "/M/Bump.inputs:height", "must be float"),
    "dangling height": (
        bump("float inputs:height.connect = </M/Gone.outputs:r>"),
        "/M/Bump.inputs:height",
        "which is no output",
    ),
    "computed scale of a bump": (
        bump(HEIGHT + "float inputs:scale.connect = </M/Tex.outputs:g>"),
        "/M/Bump.inputs:scale",
        "must be a constant",
    ),
    "infinite scale of a bump": (bump(HEIGHT + "float inputs:scale = inf"), "/M/Bump.inputs:scale", "not finite"),
    "unknown input of a bump": (bump(HEIGHT + "float inputs:scal = 1"), "/M/Bump.inputs:scal", "mean 'scale'"),
    "unknown shader": (shader("Base", "LookdevDisnei"), "/M.outputs:lookdev:surface", "did you mean 'LookdevDisney'"),
}

# The places are inputs of the stack.
STACK_FAULTS = {
    "no base": (LAYER1, "base", "the stack has no base"),
    "base not connected": ('token inputs:base = "Base"', "base", "not connected to a layer"),
    "base is a stack": (
        "token inputs:base.connect = </M/Layers.outputs:surface>",
        "base",
        "unknown info:id 'LookdevLayers'",
    ),
    "gap": (BASE + "token inputs:layer2.connect = </M/Coat.outputs:layer>", "layer2", "there is no layer1"),
    "mask without a layer": (BASE + "float inputs:layer1Mask = 1", "layer1", "is not connected"),
    "mask out of range": (BASE + LAYER1 + "float inputs:layer1Mask = -0.25", "layer1Mask", "within [0, 1]"),
    "mask of a wrong type": (BASE + LAYER1 + "color3f inputs:layer1Mask = (1, 1, 1)", "layer1Mask", "must be float"),
    "computed switch": (
        BASE + LAYER1 + "bool inputs:layer1Enabled.connect = </M/Coat.outputs:layer>",
        "layer1Enabled",
        "must be a constant",
    ),
    "transmit": (BASE + LAYER1 + 'token inputs:layer1Mode = "transmit"', "layer1Mode", "Coat is a disney layer"),
    "transmit over Disney": (
        BASE + 'token inputs:layer1.connect = </M/Clear.outputs:layer>\ntoken inputs:layer1Mode = "transmit"',
        "layer1Mode",
        "Base is a disney layer (only a LookdevPixar layer over nothing but LookdevPixar layers can transmit",
    ),
    "transmit over a stack that holds Disney": (
        """token inputs:base.connect = </M/Clear.outputs:layer>
        token inputs:layer1.connect = </M/Coat.outputs:layer>
        token inputs:layer2.connect = </M/Clear.outputs:layer>
        token inputs:layer2Mode = "transmit" """,
        "layer2Mode",
        "Coat is a disney layer",
    ),
    "tokens differ": (
        """token inputs:base.connect = </M/Clear.outputs:layer>
        token inputs:layer1.connect = </M/Clear.outputs:layer>
        token inputs:layer2.connect = </M/Saved.outputs:layer>""",
        "layer2",
        "energy of Saved is 'conserving', but that of Clear beneath is 'published'",
    ),
    "unknown mode": (BASE + LAYER1 + 'token inputs:layer1Mode = "under"', "layer1Mode", "known: over, transmit"),
    "unknown input": (BASE + LAYER1 + "float inputs:layer1Msk = 1", "layer1Msk", "did you mean 'layer1Mask'"),
    "layer zero": (BASE + "token inputs:layer0.connect = </M/Coat.outputs:layer>", "layer0", "unknown"),
}


LAYERS = disney(), disney("Coat"), pixar("Clear"), pixar("Saved", 'token inputs:energy = "conserving"')


@pytest.mark.parametrize(
    ("body", "terminal", "where", "message"),
    [
        *(pytest.param(body, "</M/Base.outputs:layer>", *fault, id=name) for name, (body, *fault) in FAULTS.items()),
        *(
            pytest.param(stack(inputs, *LAYERS), STACK, f"/M/Layers.inputs:{place}", message, id=name)
            for name, (inputs, place, message) in STACK_FAULTS.items()
        ),
    ],
)
def test_fault(write, body: str, terminal: str, where: str, message: str) -> None:
    [(place, what, hint)] = faults_of(write(body, terminal))
    assert place == where
    assert message in f"{what} ({hint})"


def test_all_faults_are_reported_at_once_and_shared_nodes_only_once(write) -> None:
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
