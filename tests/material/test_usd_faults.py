"""Every fault of a look is reported with its place and what would be right."""

from __future__ import annotations

import pytest
from look_files import BASE, LAYER1, ST, STACK, disney, faults_of, pixar, rough, shader, stack, texture


def textured(node: str = "", file: str = "@./gray.png@") -> str:
    return rough("Tex.r") + texture(node, file)


def normal_map(file: str, node: str = "", output: str = "rgb") -> str:
    return pixar(body=f"normal3f diffuseNormal <- Tex.{output}") + texture(node, file)


RAW = 'token sourceColorSpace = "raw"\n'
CENTRED = "float4 scale = (2, 2, 2, 1)\nfloat4 bias = (-1, -1, -1, 0)\n"
HEIGHT = "float height <- Tex.r\n"


ROUGH, NORMAL = "/M/Base.inputs:roughness", "/M/Base.inputs:diffuseNormal"


def bump(inputs: str) -> str:
    """Return a normal from a bump, beside a texture for its height."""
    normal = pixar(body="normal3f highlightNormal <- Bump.normal")
    return normal + shader("Bump", "LookdevBump", inputs) + texture()


FAULTS = {
    "misspelt input": (disney(body="float roughnes = 1"), "/M/Base.inputs:roughnes", "did you mean 'roughness'"),
    "wrong type": (disney(body="double roughness = 1"), ROUGH, "must be float"),
    "float for a colour": (disney(body="float baseColor = 1"), "/M/Base.inputs:baseColor", "must be color3f"),
    "wrong type behind the interface": (
        "int r = 1\n" + disney(body="float roughness <- .r"),
        ROUGH,
        "has type int at </M.inputs:r>",
    ),
    "out of range": (disney(body="float roughness = 1.5"), ROUGH, "within [0, 1]"),
    "one channel out of range": (
        disney(body="color3f baseColor = (0, 1.5, 0)"),
        "/M/Base.inputs:baseColor",
        "0, 1.5, 0 is out of range",
    ),
    "NaN": (disney(body="float roughness = nan"), ROUGH, "not finite"),
    "infinite": (disney(body="color3f baseColor = (0, inf, 0)"), "/M/Base.inputs:baseColor", "not finite"),
    "animated": (disney(body="float inputs:roughness.timeSamples = { 1: 0.5 }"), ROUGH, "animated"),
    "unknown token": (disney(body='token variant = "2013"'), "/M/Base.inputs:variant", "did you mean '201"),
    "computed token": (
        disney(body="token variant <- St.result") + ST,
        "/M/Base.inputs:variant",
        "choose one of 2014, 2012",
    ),
    "dangling": (rough("Gone.r"), ROUGH, "</M/Gone.outputs:r>, which is no output"),
    "dangling interface": (disney(body="float roughness <- .gone"), ROUGH, "no interface input"),
    "two connections": (
        disney(body="float inputs:roughness.connect = [</M.inputs:a>, </M.inputs:b>]"),
        ROUGH,
        "2 connections",
    ),
    "cycle of inputs": (
        "float a <- .b\nfloat b <- .a\n" + disney(body="float roughness <- .a"),
        "/M.inputs:a",
        "cycle",
    ),
    "cycle of transforms": (
        textured("float2 st <- T.result") + shader("T", "UsdTransform2d", "float2 in <- T.result"),
        "/M/T.inputs:in",
        "cycle",
    ),
    "missing image": (textured(file="@./gone.png@"), "/M/Tex.inputs:file", "no such image file: ./gone.png"),
    "no image": (textured(file="@@"), "/M/Tex.inputs:file", "names no image file"),
    "not an image": (textured(file="@./look.usda@"), "/M/Tex.inputs:file", "cannot be read as an image"),
    "UDIM": (textured(file="@./gray.<UDIM>.png@"), "/M/Tex.inputs:file", "no tile of this set: ./gray.<UDIM>.png"),
    "unknown texture input": (textured("float gamma = 1"), "/M/Tex.inputs:gamma", "unknown input"),
    "unknown wrap": (textured('token wrapS = "repeats"'), "/M/Tex.inputs:wrapS", "did you mean 'repeat'"),
    "computed wrap": (textured("token wrapS <- St.result"), "/M/Tex.inputs:wrapS", "must be a constant"),
    "st not connected": (textured("float2 st = (0, 0)"), "/M/Tex.inputs:st", "not connected"),
    "st from a texture": (textured("float2 st <- Tex.rgb"), "/M/Tex.inputs:st", "whose info:id is 'UsdUVTexture'"),
    "colour into a float": (rough("Tex.rgb") + texture(), ROUGH, "use outputs:r or g or b or a"),
    "reader of another type": (
        rough("St.result") + ST,
        ROUGH,
        "use UsdUVTexture, UsdPrimvarReader_float or LookdevExpression",
    ),
    "reader without a name": (
        rough("P.result") + shader("P", "UsdPrimvarReader_float"),
        "/M/P.inputs:varname",
        "names no primvar",
    ),
    "fallback out of range": (
        rough("P.result") + shader("P", "UsdPrimvarReader_float", 'string varname = "x"\nfloat fallback = 2'),
        "/M/P.inputs:fallback",
        "within [0, 1]",
    ),
    "expression": (
        rough("X.result") + shader("X", "LookdevExpression"),
        "/M/X.inputs:expression",
        "holds no expression",
    ),
    "zero normal": (pixar(body="normal3f diffuseNormal = (0, 0, 0)"), NORMAL, "cannot be the zero vector"),
    "normal out of range": (pixar(body="normal3f diffuseNormal = (0, 0, 2)"), NORMAL, "within [-1, 1]"),
    "float for a normal": (pixar(body="float diffuseNormal = 1"), NORMAL, "must be normal3f"),
    "normal from a primvar": (
        pixar(body="normal3f diffuseNormal <- N.result")
        + shader("N", "UsdPrimvarReader_float3", 'string varname = "n"'),
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
        normal_map("@./rgb16.png@", "float4 scale = (2, 2, 2, 1)"),
        "/M/Tex.inputs:bias",
        "no normal has a negative component",
    ),
    "bump into a colour": (
        pixar(body="color3f surfaceColor <- Bump.normal") + shader("Bump", "LookdevBump"),
        "/M/Base.inputs:surfaceColor",
        "use UsdUVTexture, UsdPrimvarReader_float3",
    ),
    "bump without a height": (bump(""), "/M/Bump.inputs:height", "is not connected (only a UsdUVTexture has a slope"),
    "constant height": ("float h = 1\n" + bump("float height <- .h"), "/M/Bump.inputs:height", "is not connected"),
    "height from a primvar": (
        bump("float height <- P.result") + shader("P", "UsdPrimvarReader_float", 'string varname = "h"'),
        "/M/Bump.inputs:height",
        "comes from </M/P>",
    ),
    "height of three channels": (
        bump(HEIGHT.replace(".r", ".rgb")),
        "/M/Bump.inputs:height",
        "outputs:r",
    ),
    "height of a wrong type": (bump(HEIGHT.replace("float", "color3f")), "/M/Bump.inputs:height", "must be float"),
    "dangling height": (bump("float height <- Gone.r"), "/M/Bump.inputs:height", "which is no output"),
    "computed scale of a bump": (bump(HEIGHT + "float scale <- Tex.g"), "/M/Bump.inputs:scale", "must be a constant"),
    "infinite scale of a bump": (bump(HEIGHT + "float scale = inf"), "/M/Bump.inputs:scale", "not finite"),
    "unknown input of a bump": (bump(HEIGHT + "float scal = 1"), "/M/Bump.inputs:scal", "mean 'scale'"),
    "unknown shader": (shader("Base", "LookdevDisnei"), "/M.outputs:lookdev:surface", "did you mean 'LookdevDisney'"),
}

# The places are inputs of the stack.
STACK_FAULTS = {
    "no base": (LAYER1, "base", "the stack has no base"),
    "base not connected": ('token base = "Base"', "base", "not connected to a layer"),
    "base is a stack": ("token base <- Layers.surface", "base", "unknown info:id 'LookdevLayers'"),
    "gap": (BASE + "token layer2 <- Coat.layer", "layer2", "there is no layer1"),
    "mask without a layer": (BASE + "float layer1Mask = 1", "layer1", "is not connected"),
    "mask out of range": (BASE + LAYER1 + "float layer1Mask = -0.25", "layer1Mask", "within [0, 1]"),
    "mask of a wrong type": (BASE + LAYER1 + "color3f layer1Mask = (1, 1, 1)", "layer1Mask", "must be float"),
    "computed switch": (BASE + LAYER1 + "bool layer1Enabled <- Coat.layer", "layer1Enabled", "must be a constant"),
    "transmit": (BASE + LAYER1 + 'token layer1Mode = "transmit"', "layer1Mode", "Coat is a disney layer"),
    "transmit over Disney": (
        BASE + 'token layer1 <- Clear.layer\ntoken layer1Mode = "transmit"',
        "layer1Mode",
        "Base is a disney layer (only a LookdevPixar layer over nothing but LookdevPixar layers can transmit",
    ),
    "transmit over a stack that holds Disney": (
        """token base <- Clear.layer
        token layer1 <- Coat.layer
        token layer2 <- Clear.layer
        token layer2Mode = "transmit" """,
        "layer2Mode",
        "Coat is a disney layer",
    ),
    "tokens differ": (
        """token base <- Clear.layer
        token layer1 <- Clear.layer
        token layer2 <- Saved.layer""",
        "layer2",
        "energy of Saved is 'conserving', but that of Clear beneath is 'published'",
    ),
    "unknown mode": (BASE + LAYER1 + 'token layer1Mode = "under"', "layer1Mode", "known: over, transmit"),
    "unknown input": (BASE + LAYER1 + "float layer1Msk = 1", "layer1Msk", "did you mean 'layer1Mask'"),
    "layer zero": (BASE + "token layer0 <- Coat.layer", "layer0", "unknown"),
}


LAYERS = disney(), disney("Coat"), pixar("Clear"), pixar("Saved", 'token energy = "conserving"')


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
        BASE + LAYER1 + "float layer1Mask <- Tex.r\nfloat layer1Blur = 1",
        disney(body="float metalic = 1\nfloat sheen = 7"),
        disney("Coat", "float roughness <- Tex.g"),
        shader("Tex", "UsdUVTexture", "asset file = @./gone.png@\nfloat gamma = 1"),
    )
    assert [where for where, _, _ in faults_of(write(body, STACK))] == [
        "/M/Layers.inputs:layer1Blur",
        "/M/Base.inputs:metalic",
        "/M/Base.inputs:sheen",
        "/M/Tex.inputs:gamma",
        "/M/Tex.inputs:file",
        "/M/Tex.inputs:st",
    ]
