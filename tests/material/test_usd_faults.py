"""Every fault of a look is reported with its place and what would be right."""

from pathlib import Path

import pytest
from look_files import BASE, LAYER1, ST, STACK, disney, expression, faults_of, pixar, rough, shader, stack, texture

RAW = 'token sourceColorSpace = "raw"\n'
CENTRED = "float4 scale = (2, 2, 2, 1)\nfloat4 bias = (-1, -1, -1, 0)\n"
HEIGHT = "float height <- Tex.r\n"
CLEAR = "token base <- Clear.layer\ntoken layer1 <- {}.layer\ntoken layer2 <- {}.layer\n"
TWO = BASE + LAYER1
MOVED = "token outputs:lookdev:displacement.connect = </M/Moved.outputs:displacement>\n"
TERMINAL = "/M.outputs:lookdev:displacement"


def textured_look(node: str = "", file: str = "gray.png") -> str:
    return rough("Tex.r") + texture(node, f"@./{file}@")


def base(body: str) -> str:
    return disney(body=body)


def wood(body: str, more: str = "") -> str:
    return pixar(body=body) + more


def reader(kind: str, body: str) -> str:
    return shader("P", f"UsdPrimvarReader_{kind}", body)


def normal_map(file: str, node: str = "", output: str = "rgb") -> str:
    return wood(f"normal3f diffuseNormal <- Tex.{output}", texture(node, f"@./{file}@"))


def bump(inputs: str, more: str = "") -> str:
    """Return a normal from a bump, beside a texture for its height."""
    return wood("normal3f highlightNormal <- Bump.normal", shader("Bump", "LookdevBump", inputs) + texture() + more)


def displaced_look(inputs: str, more: str = "") -> str:
    return MOVED + disney() + shader("Moved", "LookdevDisplacement", inputs) + more


FAULTS = [
    (base("float roughnes = 1"), "Base.roughnes", "did you mean 'roughness'"),
    (base("double roughness = 1"), "Base.roughness", "must be float"),
    (base("float baseColor = 1"), "Base.baseColor", "must be color3f"),
    ("int r = 1\n" + base("float roughness <- .r"), "Base.roughness", "int at </M.inputs:r>"),
    (base("float roughness = 1.5"), "Base.roughness", "within [0, 1]"),
    (base("color3f baseColor = (0, 1.5, 0)"), "Base.baseColor", "0, 1.5, 0 is out of range"),
    (base("float roughness = nan"), "Base.roughness", "not finite"),
    (base("color3f baseColor = (0, inf, 0)"), "Base.baseColor", "not finite"),
    (base("float roughness.timeSamples = { 1: 0.5 }"), "Base.roughness", "animated"),
    (base('token variant = "2013"'), "Base.variant", "did you mean '201"),
    (base("token variant <- St.result") + ST, "Base.variant", "choose one of 2014, 2012"),
    (rough("Gone.r"), "Base.roughness", "</M/Gone.outputs:r>, which is neither an output"),
    (base("float roughness <- .gone"), "Base.roughness", "nor an interface input"),
    (base("float inputs:roughness.connect = [</M.inputs:a>, </M.inputs:b>]"), "Base.roughness", "2 connections"),
    ("float a <- .b\nfloat b <- .a\n" + base("float roughness <- .a"), "/M.inputs:a", "cycle"),
    (textured_look("float2 st <- T.result") + shader("T", "UsdTransform2d", "float2 in <- T.result"), "T.in", "cycle"),
    (textured_look(file="gone.png"), "Tex.file", "no such image file: ./gone.png"),
    (rough("Tex.r") + texture(file="@@"), "Tex.file", "names no image file"),
    (textured_look(file="look.usda"), "Tex.file", "cannot be read as an image"),
    (textured_look(file="gray.<UDIM>.png"), "Tex.file", "no tile of this set: ./gray.<UDIM>.png"),
    (textured_look("float gamma = 1"), "Tex.gamma", "unknown input"),
    (textured_look('token wrapS = "repeats"'), "Tex.wrapS", "did you mean 'repeat'"),
    (textured_look("token wrapS <- St.result"), "Tex.wrapS", "must be a constant"),
    (textured_look("float2 st = (0, 0)"), "Tex.st", "not connected"),
    (textured_look("float2 st <- Tex.rgb"), "Tex.st", "whose info:id is 'UsdUVTexture'"),
    (rough("Tex.rgb") + texture(), "Base.roughness", "use outputs:r or g or b or a"),
    (rough("St.result") + ST, "Base.roughness", "use UsdUVTexture, UsdPrimvarReader_float or LookdevExpression"),
    (rough("P.result") + reader("float", ""), "P.varname", "names no primvar"),
    (rough("P.result") + reader("float", 'string varname = "x"\nfloat fallback = 2'), "P.fallback", "within [0, 1]"),
    (rough("X.result") + shader("X", "LookdevExpression"), "X.expression", "holds no expression"),
    (wood("normal3f diffuseNormal = (0, 0, 0)"), "Base.diffuseNormal", "cannot be the zero vector"),
    (wood("normal3f diffuseNormal = (0, 0, 2)"), "Base.diffuseNormal", "within [-1, 1]"),
    (wood("float diffuseNormal = 1"), "Base.diffuseNormal", "must be normal3f"),
    (wood("normal3f diffuseNormal <- P.result", reader("float3", "")), "Base.diffuseNormal", "UsdUVTexture, LookdevB"),
    (normal_map("rgb.exr", output="r"), "Base.diffuseNormal", "use outputs:rgb"),
    (normal_map("rgb.png", CENTRED), "Tex.sourceColorSpace", "a normal map is data (set it to 'raw')"),
    (normal_map("rgb.png", RAW), "Tex.bias", "set scale to (2, 2, 2, 1) and bias to (-1, -1, -1, 0)"),
    (normal_map("rgb16.png", "float4 scale = (2, 2, 2, 1)"), "Tex.bias", "no normal has a negative component"),
    (
        wood("color3f surfaceColor <- B.normal", shader("B", "LookdevBump")),
        "Base.surfaceColor",
        "use UsdUVTexture, Usd",
    ),
    (bump(""), "Bump.height", "is not connected (only a UsdUVTexture has a slope"),
    ("float h = 1\n" + bump("float height <- .h"), "Bump.height", "is not connected"),
    (bump("float height <- P.result", reader("float", 'string varname = "h"')), "Bump.height", "comes from </M/P>"),
    (bump("float height <- Tex.rgb"), "Bump.height", "outputs:r"),
    (bump("color3f height <- Tex.r"), "Bump.height", "must be float"),
    (bump("float height <- Gone.r"), "Bump.height", "which is neither an output"),
    (bump(HEIGHT + "float scale <- Tex.g"), "Bump.scale", "must be a constant"),
    (bump(HEIGHT + "float scale = inf"), "Bump.scale", "not finite"),
    (bump(HEIGHT + "float scal = 1"), "Bump.scal", "mean 'scale'"),
    (shader("Base", "LookdevDisnei"), "/M.outputs:lookdev:surface", "did you mean 'LookdevDisney'"),
    (f"{MOVED.split('.')[0]}\n" + disney(), TERMINAL, "is not connected"),
    (MOVED.replace("Moved", "Base") + disney(), TERMINAL, "has the unknown info:id 'LookdevDisney'"),
    (MOVED + disney(), TERMINAL, "is neither an output of a shader"),
    (displaced_look(""), "Moved.height", "is neither set nor connected"),
    (displaced_look("color3f height = (1, 1, 1)"), "Moved.height", "has type color3f"),
    (displaced_look("float height = nan"), "Moved.height", "nan is not finite"),
    (displaced_look("float height = 1\nfloat scale = inf"), "Moved.scale", "inf is not finite"),
    (displaced_look("float height = 1\nfloat sacle = 1"), "Moved.sacle", "unknown input"),
    (displaced_look('float height = 1\ntoken units = "feet"'), "Moved.units", "unknown value"),
    (displaced_look("float height <- Tex.rgb", texture()), "Moved.height", "</M/Tex.outputs:rgb>"),
    (
        displaced_look("float inputs:height.connect = </M/Moved.inputs:height>"),
        "Moved.height",
        "which is neither an output of a",
    ),
    (displaced_look("float height = 1\nfloat scale <- Tex.r", texture()), "Moved.scale", "it must be a constant"),
    (
        displaced_look("float height <- X.result", expression("0.1 * view", name="X")),
        "Moved.height",
        "depends on the view",
    ),
]

ONLY_PIXAR = "Base is a disney layer (only a LookdevPixar layer over nothing but LookdevPixar layers can transmit"
# The places are inputs of the stack.
STACK_FAULTS = [
    (LAYER1, "base", "the stack has no base"),
    ('token base = "Base"', "base", "not connected to a layer"),
    ("token base <- Layers.surface", "base", "unknown info:id 'LookdevLayers'"),
    ("token base <- Base.out", "base", "cannot use </M/Base.outputs:out> (use outputs:layer)"),
    (BASE + "token layer2 <- Coat.layer", "layer2", "there is no layer1"),
    (BASE + "float layer1Mask = 1", "layer1", "is not connected"),
    (TWO + "float layer1Mask = -0.25", "layer1Mask", "within [0, 1]"),
    (TWO + "color3f layer1Mask = (1, 1, 1)", "layer1Mask", "must be float"),
    (TWO + "bool layer1Enabled <- Coat.layer", "layer1Enabled", "must be a constant"),
    (TWO + 'token layer1Mode = "transmit"', "layer1Mode", "Coat is a disney layer"),
    (BASE + 'token layer1 <- Clear.layer\ntoken layer1Mode = "transmit"', "layer1Mode", ONLY_PIXAR),
    (CLEAR.format("Coat", "Clear") + 'token layer2Mode = "transmit"', "layer2Mode", "Coat is a disney layer"),
    (CLEAR.format("Clear", "Saved"), "layer2", "energy of Saved is 'conserving', but that of Clear beneath is 'p"),
    (TWO + 'token layer1Mode = "under"', "layer1Mode", "known: over, transmit"),
    (TWO + "float layer1Msk = 1", "layer1Msk", "did you mean 'layer1Mask'"),
    (BASE + "token layer0 <- Coat.layer", "layer0", "unknown"),
]
LAYERS = disney(), disney("Coat"), pixar("Clear"), pixar("Saved", 'token energy = "conserving"')

# Of a mask that is the result of Expr.
EXPRESSION_FAULTS = [
    (expression(""), "Expr.expression", "holds no expression"),
    (expression("1 +"), "Expr.expression", "^"),
    (expression("dirt * 2"), "Expr.dirt", "which is not an input of its node"),
    (expression("smothstep(1, 0, 1)"), "Expr.expression", "smoothstep"),
    (expression("1", "float dirt = 1"), "Expr.dirt", "unknown input"),
    (expression("dirt", "float dirt"), "Expr.dirt", "neither set nor connected"),
    (expression("view", "color3f view"), "Expr.view", "it must be float"),
    (expression("dirt", "int dirt = 1"), "Expr.dirt", "has type int"),
    (expression("[1, 0, 0]"), "Expr.expression", "luminance"),
    (expression("noise(c)", "color3f c = (1, 0, 0)"), "Expr.expression", "needs a float, this is a color"),
    (expression("a", "float a <- Expr.result"), "Expr.a", "reads its own result"),
    (expression("a", "float a <- Other.value") + expression("1", name="Other"), "Expr.a", "use outputs:result"),
]
MASKED = stack(TWO + "float layer1Mask <- Expr.result", *LAYERS[:2])
CASES = [(body, "</M/Base.outputs:layer>", where, summary) for body, where, summary in FAULTS]
CASES += [(stack(inputs, *LAYERS), STACK, f"Layers.{name}", summary) for inputs, name, summary in STACK_FAULTS]
CASES += [(MASKED + nodes, STACK, where, summary) for nodes, where, summary in EXPRESSION_FAULTS]


@pytest.mark.parametrize(("body", "terminal", "where", "message"), CASES, ids=[f"{c[2]}: {c[3]}" for c in CASES])
def test_fault(write, body: str, terminal: str, where: str, message: str) -> None:
    [(path, summary, hint)] = faults_of(write(body, terminal))
    assert path == where
    assert message in f"{summary} ({hint})"


def test_all_faults_are_reported_at_once_and_shared_nodes_only_once(write) -> None:
    body = stack(
        TWO + "float layer1Mask <- Tex.r\nfloat layer1Blur = 1",
        base("float metalic = 1\nfloat sheen = 7"),
        disney("Coat", "float roughness <- Tex.g"),
        shader("Tex", "UsdUVTexture", "asset file = @./gone.png@\nfloat gamma = 1"),
    )
    places = ["Layers.layer1Blur", "Base.metalic", "Base.sheen", "Tex.gamma", "Tex.file", "Tex.st"]
    assert [where for where, _, _ in faults_of(write(body, STACK))] == places


def test_expressions_do_not_nest_without_end(write) -> None:
    chain = "".join(expression("a", f"float a <- E{number + 1}.result", f"E{number}") for number in range(40))
    faults = faults_of(write(MASKED + expression("a", "float a <- E0.result") + chain, STACK))
    assert "more than 32 expressions" in faults[0][1]
    assert len(faults) == 1


@pytest.mark.parametrize(
    ("options", "where", "message"),
    [
        ({"prim": "/N"}, "/N", "no such prim"),
        ({"prim": "/M/Base"}, "/M/Base", "is not a material"),
        ({"prim": "M"}, "M", "is not a prim path"),
        ({"prim": "/M.inputs:x"}, "/M.inputs:x", "is not a prim path"),
        ({"variants": {"wear": "x"}}, "/M", "has no variant set 'wear'"),
    ],
)
def test_wrong_request(write, options: dict[str, object], where: str, message: str) -> None:
    [(path, summary, _)] = faults_of(write(disney()), **options)
    assert (path, summary) == (where, message)


def test_wrong_variant_names_the_nearest(write) -> None:
    sets = 'variantSet "wear" = { "clean" { }\n "dusty" { } }'
    file = write(disney() + sets, material='(prepend variantSets = "wear")')
    fault = "/M", "variant set 'wear' has no variant 'dust'", "did you mean 'dusty'?"
    assert faults_of(file, variants={"wear": "dust"}) == [fault]


def test_broken_reference_is_a_fault(write) -> None:
    faults = faults_of(write('def "Base" (references = @./gone.usda@</Gold>) { }'))
    assert any(where == "/M/Base" and "gone.usda" in summary for where, summary, _ in faults)


TWO_MATERIALS = '#usda 1.0\ndef Material "A" { }\ndef Material "B" { }\n'
PRESET = '#usda 1.0\n(\n    defaultPrim = "Gold"\n)\ndef Shader "Gold"\n{\n}\n'


@pytest.mark.parametrize(
    ("text", "where", "expected_summary", "hint"),
    [
        (None, "", "no such file", ""),
        ("#usda 1.0\ndef nonsense", "", "USD cannot open it: ", ""),
        ("", "", "USD cannot open it: ", ""),
        (TWO_MATERIALS, "", "holds 2 materials and none is the default prim", "name one with prim: /A, /B"),
        (PRESET, "/Gold", "is a preset: a layer, not a material", "make a look of it: lookdev materials new LOOK.usda"),
    ],
)
def test_a_file_without_a_look(tmp_path: Path, text: str | None, where: str, expected_summary: str, hint: str) -> None:
    file = tmp_path / "look.usda"
    if text is not None:
        file.write_text(text)
    [(path, said, right)] = faults_of(file)
    assert path == where
    assert said.startswith(expected_summary)
    assert right.startswith(hint)
