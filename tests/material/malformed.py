"""Malformed look files, made from good ones: always the same, each with its state by construction.

``python tests/material/malformed.py FOLDER`` writes them, to look at.
"""

from __future__ import annotations

import random
import sys
from collections.abc import Iterator
from pathlib import Path

from look_files import BASE, LAYER1, STACK, disney, look, pixar, rough, shader, stack, texture
from malformed_files import BAD_IMAGES, BAD_LAYERS, Case, Expected, write_images, write_layers

MEGABYTE = 1_000_000


LAYERS = BASE + LAYER1


def textured(file: str = "@./gray.png@", more: str = "", parameter: str = "float inputs:roughness") -> str:
    """Return a look with a textured input."""
    output = "rgb" if "3f" in parameter else "r"
    return look(disney(body=f"{parameter}.connect = </M/Tex.outputs:{output}>") + texture(more, file))


GOOD = {
    "disney": textured(),
    "stack": look(
        stack(LAYERS + "float inputs:layer1Mask = 0.5\n", disney(), disney("Coat", "float inputs:roughness = 0.2"))
        + 'variantSet "wear" = {\n"worn" {\nover "Base" {\nfloat inputs:metallic = 1\n}\n}\n"new" { }\n}\n',
        STACK,
        '(\nprepend variantSets = "wear"\nvariants = { string wear = "worn" }\n)',
    ),
    "pixar": look(
        pixar(body="normal3f inputs:diffuseNormal.connect = </M/Bump.outputs:normal>\nfloat inputs:clear = 0.5")
        + shader("Bump", "LookdevBump", "float inputs:height.connect = </M/Tex.outputs:r>\nfloat inputs:scale = 0.1")
        + texture()
    ),
}
"""Looks that are right, of every kind of node."""


def malformed_looks(folder: Path) -> list[Case]:
    """Write the files into an empty folder and return them, with a few that are valid in odd ways."""
    write_images(folder)
    chance = random.Random(4)
    cases: list[Case] = []
    for number, (name, content, expected) in enumerate(_texts(chance)):
        file = folder / f"{number:03}.usda"
        data = content if isinstance(content, bytes) else content.replace("SELF", file.name).encode()
        file.write_bytes(data)
        cases.append(Case(name, file, expected))
    return [*cases, *write_layers(folder, GOOD, look(disney(), material="(\nreferences = @./OTHER@</M>\n)"), chance)]


Given = tuple[str, str | bytes] | tuple[str, str | bytes, Expected]
"""A name, a file's content and, where it is not simply faulty, what it is."""


def _texts(chance: random.Random) -> Iterator[tuple[str, str | bytes, Expected]]:
    for family in (_good, _damaged, _wrong_types, _numbers, _cycles, _nested, _long, _many, _outside, _images):
        for name, content, *expected in family(chance):
            yield f"{family.__name__[1:]}: {name}", content, expected[0] if expected else "faulty"


def _good(_: random.Random) -> Iterator[Given]:
    for name, text in GOOD.items():
        yield name, text, "valid"


def _damaged(chance: random.Random) -> Iterator[Given]:
    for name, text in GOOD.items():
        data = text.encode()
        # The last brace closes the material: whatever is cut before it leaves it open.
        for _ in range(12):
            size = chance.randrange(data.rindex(b"}"))
            yield f"{name} cut at {size}", data[:size]
        # A byte that no syntax has, in place of one that holds the syntax together.
        syntax = [place for place, byte in enumerate(data) if byte in b"{}=<>()"]
        for byte in (0x00, 0xFF, 0x80, 0x60):
            for place in chance.sample(syntax, 3):
                yield f"{name} with {byte:#x} at {place}", data[:place] + bytes([byte]) + data[place + 1 :]
        for _ in range(6):
            flipped = bytearray(data)
            flipped[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
            yield f"{name} with a bit flipped", bytes(flipped), "any"
    yield "a name that is not UTF-8", look(disney(body="float inputs:rough\udcff = 1")).encode(errors="surrogateescape")
    yield (
        "a token that is not UTF-8",
        GOOD["disney"].replace("LookdevDisney", "\udcc3(").encode(errors="surrogateescape"),
    )
    yield "a path that is not UTF-8", textured("@./\udcfe.png@").encode(errors="surrogateescape")
    yield "UTF-16", GOOD["disney"].encode("utf-16")
    yield "latin-1 where USD expects a name", look(disney("B\xe4se")).encode("latin-1")
    yield "empty", b""
    yield "only the header", b"#usda 1.0\n"
    yield "another version", GOOD["disney"].replace("1.0", "9.9", 1)
    yield "a header twice", "#usda 1.0\n" + GOOD["disney"][9:] + GOOD["disney"]
    yield "zeros", bytes(4096)
    for size in (16, 1000, 100_000):
        yield f"{size} bytes of noise", chance.randbytes(size)
        yield f"{size} bytes of noise with a header", b"#usda 1.0\n" + chance.randbytes(size)


_LITERALS = {
    "int": "1",
    "double": "0.5",
    "half": "0.5",
    "bool": "1",
    "string": '"0.5"',
    "asset": "@./gray.png@",
    "float2": "(1, 1)",
    "float4": "(1, 1, 1, 1)",
    "matrix4d": "((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))",
    "float[]": "[0.5]",
    "color3f[]": "[(1, 1, 1)]",
    "token[]": '["2014"]',
    "quatf": "(1, 0, 0, 0)",
    "timecode": "1",
    "nosuchtype": "1",
}


def _wrong_types(_: random.Random) -> Iterator[Given]:
    for written, literal in _LITERALS.items():
        for name in ("roughness", "baseColor", "variant"):
            yield f"{name} as {written}", look(disney(body=f"{written} inputs:{name} = {literal}"))
        yield (
            f"the mask as {written}",
            look(stack(LAYERS + f"{written} inputs:layer1Mask = {literal}", disney(), disney("Coat")), STACK),
        )
    for written, literal in (("int", "1"), ("float2", "(1, 1)"), ("string", '"a.png"')):
        for name in ("file", "st", "wrapS", "scale", "sourceColorSpace"):
            if (written, name) == ("string", "wrapS") or (written, name) == ("string", "sourceColorSpace"):
                continue  # a string does for a token
            text = textured(more=f"{written} inputs:{name} = {literal}")
            given = {
                "file": "asset inputs:file = @./gray.png@\n",
                "st": "float2 inputs:st.connect = </M/St.outputs:result>\n",
            }
            yield f"{name} of a texture as {written}", text.replace(given.get(name, "\0"), "")
    yield ("a relationship for an input", look(disney(body="rel inputs:roughness = </M>")), "any")
    yield "a text for a number", look(disney(body='float inputs:roughness = "a"'))
    yield "a number for a connection", look(disney(body="float inputs:roughness.connect = 1"))
    yield "an id that is a number", look('def Shader "Base" {\nuniform int info:id = 1\n}\n')
    yield (
        "a material that is a scope",
        GOOD["disney"].replace("def Material", "def Scope").replace("LookdevDisney", "X"),
    )
    yield "a layer that is a material", GOOD["stack"].replace('def Shader "Coat"', 'def Material "Coat"')


def _numbers(_: random.Random) -> Iterator[Given]:
    for number in ("nan", "inf", "-inf", "1e39", "-1", "1" + "0" * 400, "-1e-3"):
        yield f"roughness {number[:8]}", look(disney(body=f"float inputs:roughness = {number}"))
        yield f"a channel {number[:8]}", look(disney(body=f"color3f inputs:baseColor = (0, {number}, 0)"))
    for name in ("scale", "bias"):
        yield f"{name} nan", textured(more=f"float4 inputs:{name} = (1, nan, 1, 1)")
    yield "a bump inf high", GOOD["pixar"].replace("inputs:scale = 0.1", "inputs:scale = inf")
    yield "animated", look(disney(body="float inputs:roughness.timeSamples = { 0: 0.1, 1: nan }"))


def _cycles(_: random.Random) -> Iterator[Given]:
    ring = "".join(f"float inputs:a{i}.connect = </M.inputs:a{(i + 1) % 1000}>\n" for i in range(1000))
    yield "1000 interface inputs", look(ring + disney(body="float inputs:roughness.connect = </M.inputs:a0>"))
    graphs = "".join(
        f'def NodeGraph "G{i}" {{\nfloat outputs:o.connect = </M/G{1 - i}.outputs:o>\n}}\n' for i in (0, 1)
    )
    yield "node graphs", look(graphs + rough("G0.outputs:o"))
    inward = 'def NodeGraph "G" {\nfloat outputs:o.connect = </M/G.outputs:o>\n}\n'
    yield "a node graph with itself", look(inward + rough("G.outputs:o"))
    yield "an input with itself", look(rough("Base.inputs:roughness"))
    yield "the terminal with itself", look(disney(), "</M.outputs:lookdev:surface>")
    transforms = "".join(
        shader(f"T{i}", "UsdTransform2d", f"float2 inputs:in.connect = </M/T{(i + 1) % 50}.outputs:result>\n")
        for i in range(50)
    )
    yield (
        "50 transforms",
        look(rough("Tex.outputs:r") + texture("float2 inputs:st.connect = </M/T0.outputs:result>") + transforms),
    )
    nested = stack("token inputs:base.connect = </M/Layers.outputs:surface>\n")
    yield "a stack with itself", look(nested, STACK)
    for arc in ("references", "inherits", "specializes", "payload"):
        yield f"{arc} of itself", look(disney(), material=f"(\nprepend {arc} = </M>\n)")
    yield (
        "inherits of two classes",
        look(
            disney(),
            material="(\ninherits = </A>\n)",
            before='class "A" (\ninherits = </B>\n)\n{\n}\nclass "B" (\ninherits = </A>\n)\n{\n}\n',
        ),
    )
    yield "references of a child to its parent", look(disney() + 'def "In" (\nreferences = </M>\n)\n{\n}\n')
    yield "an instance of itself", look(disney(), material="(\ninstanceable = true\nreferences = </M>\n)")
    yield "a sublayer of itself", GOOD["disney"].replace("(\n", "(\nsubLayers = [@./SELF@]\n", 1)
    yield "references of two files", look(disney(), material="(\nreferences = @./ring_a.usda@</M>\n)")
    yield "sublayers of two files", GOOD["disney"].replace("(\n", "(\nsubLayers = [@./ring_c.usda@]\n", 1)


def _nested(_: random.Random) -> Iterator[Given]:
    for deep in (1000, 120_000):
        yield f"{deep} prims", "#usda 1.0\n" + 'def "a" {\n' * deep + "}\n" * deep
        yield f"{deep} prims, open", look('def "a" {\n' * deep)
        yield (
            f"{deep} dictionaries",
            "#usda 1.0\n(customLayerData = {" + "dictionary a = {" * deep + "}" * deep + "})\n",
        )
        yield f"{deep} tuples", look(disney(body="color3f inputs:baseColor = " + "(" * deep + "1" + ")" * deep))
        yield f"{deep} lists", look(disney(body="float[] inputs:roughness = " + "[" * deep + "1" + "]" * deep))
        yield (
            f"{deep} targets",
            look(disney(body="float inputs:roughness.connect = </M.a" + "[/M.a" * deep + "]" * deep + ">")),
        )
        hidden = '{ string a = "}" dictionary b = '
        yield f"{deep} dictionaries with false ends", f"#usda 1.0\n(customLayerData = {hidden * deep}1{'}' * deep})\n"
    yield "a deep path", look(disney(body="float inputs:roughness.connect = <" + "/a" * 200_000 + ".outputs:r>"))
    yield "a path far up", look(disney(body="float inputs:roughness.connect = <" + "../" * 200_000 + "a.outputs:r>"))
    yield (
        "a path of variants",
        look(disney(body="float inputs:roughness.connect = </M" + "{a=b}" * 9999 + "a.outputs:r>")),
    )


def _long(_: random.Random) -> Iterator[Given]:
    name = "a" * MEGABYTE
    yield "the name of an input", look(disney(body=f"float inputs:{name} = 1"))
    yield "the name of a shader", look(shader(name, "LookdevDisney"))
    yield "the id", look(shader("Base", name))
    yield "a token", look(disney(body=f'token inputs:variant = "{name}"'))
    yield "a texture", textured(f"@./{name}.png@")
    yield "a texture of many folders", textured(f"@./{'a/' * (MEGABYTE // 2)}b.png@")
    yield "a reference", look(disney(), material=f"(\nreferences = @./{name}.usda@\n)")
    yield "a connection", look(disney(body=f"float inputs:roughness.connect = </M/{name}.outputs:r>"))
    yield "a number", look(disney(body=f"float inputs:roughness = {'9' * MEGABYTE}"))
    yield "a variant", look(disney(), material=f'(\nvariantSets = "{name}"\n)'), "any"
    yield "a comment", GOOD["disney"] + f"# {name}\n", "valid"
    yield "a documentation", GOOD["disney"].replace("(\n", f'(\ndoc = "{name}"\n', 1), "valid"
    yield "an array", look(disney(body=f"float[] inputs:roughness = [{'0.5, ' * MEGABYTE}0.5]"))
    yield "an array of names", look(disney(body=f"token[] inputs:variant = [{chr(34) * 2}{', ' + chr(34) * 2} ]"))
    expressions = {
        "parentheses": "(" * MEGABYTE,
        "balanced parentheses": "(" * (MEGABYTE // 2) + "1" + ")" * (MEGABYTE // 2),
        "a sum": "1" + "+1" * (MEGABYTE // 2),
        "minus signs": "-" * MEGABYTE + "1",
        "a name": "a" * MEGABYTE,
        "calls": "sin(" * (MEGABYTE // 4),
        "choices": "1?" * (MEGABYTE // 2),
        "powers": "9^" * (MEGABYTE // 2) + "9",
        "digits": "9" * MEGABYTE,
        "python": "__import__('os').system('true')#" * (MEGABYTE // 32),
        "nothing but space": " " * MEGABYTE,
        "letters of no alphabet": "𝔘" * (MEGABYTE // 4),
    }
    named = {f"an expression of {what}": text for what, text in expressions.items()}
    short = "1 +", "a b", "f(", "import os", "clamp(1)", "1 ? 2", "[1, 2]", "", "\\0", "a.__class__", "lambda: 1"
    for what, text in (named | {f"the expression {text}": text for text in short}).items():
        given = f'string inputs:expression = "{text}"\nfloat outputs:result\n'
        yield what, look(rough("X.outputs:result") + shader("X", "LookdevExpression", given))


def _many(_: random.Random) -> Iterator[Given]:
    def layers(count: int) -> str:
        return "".join(f"token inputs:layer{i}.connect = </M/Coat.outputs:layer>\n" for i in range(1, count + 1))

    yield "100 layers", look(stack(BASE + layers(100), disney(), disney("Coat")), STACK), "valid"
    yield "100000 layers", look(stack(BASE + layers(100_000), disney(), disney("Coat")), STACK)
    yield (
        "a layer of a large number",
        look(
            stack(BASE + f"token inputs:layer{'9' * 5000}.connect = </M/Coat.outputs:layer>", disney(), disney("Coat")),
            STACK,
        ),
    )
    unknown = "".join(f"float inputs:a{i} = 1\n" for i in range(20_000))
    yield "20000 unknown inputs", look(disney(body=unknown))
    targets = ", ".join(f"</M.a{i}>" for i in range(10_000))
    yield "10000 connections", look(disney(body=f"float inputs:roughness.connect = [{targets}]"))
    sets = "".join(
        f'variantSet "s{i}" = {{\n' + "".join(f'"v{j}" {{ }}\n' for j in range(10)) + "}\n" for i in range(20)
    )
    names = ", ".join(f'"s{i}"' for i in range(20))
    exploding = f"(\nprepend variantSets = [{names}]\n)"
    yield "20 sets of 10 variants", look(disney() + sets, material=exploding), "valid"
    yield "20 sets of 10 variants at fault", look(disney(body="float inputs:roughness = 2") + sets, material=exploding)
    yield (
        "20000 shaders that nobody reads",
        look(disney(body="float inputs:roughness = 2") + "".join(f'def Shader "S{i}" {{\n}}\n' for i in range(20_000))),
    )
    yield (
        "1000 materials",
        GOOD["disney"].replace('defaultPrim = "M"', "") + "".join(f'def Material "M{i}" {{\n}}\n' for i in range(1000)),
    )
    yield "no material", "#usda 1.0\n" + 'def Xform "X" {\n}\n'


def _outside(_: random.Random) -> Iterator[Given]:
    for path in (
        "/etc/passwd",
        "../" * 40 + "etc/passwd",
        "http://0.0.0.0:9/a.png",
        "file:///etc/passwd",
        "/dev/zero",
        "/dev/stdin",
        "/proc/self/mem",
        "..",
        ".",
        "~",
        "a\\\\b",
        "%n%s",
        "con",
        "a.usdz[b.png]",
        "a.png:SDF_FORMAT_ARGS:b=c",
        "anon:0x1:a",
        "$HOME",
        "`id`",
    ):
        yield f"the texture {path[:20]}", textured(f"@{path}@")
        yield f"the reference {path[:20]}", look(disney(), material=f"(\nreferences = @{path}@</M>\n)")
        yield f"the sublayer {path[:20]}", GOOD["disney"].replace("(\n", f"(\nsubLayers = [@{path}@]\n", 1), "any"


def _images(_: random.Random) -> Iterator[Given]:
    for name in BAD_IMAGES:
        # A cut image may have a whole header: what is missing shows when its pixels are read.
        yield f"the texture {name}", textured(f"@./{name}@"), "any" if name.startswith("cut") else "faulty"
    for name in BAD_LAYERS:
        for arc in ("references", "payload"):
            yield f"{arc} of {name}", look(disney(), material=f"(\n{arc} = @./{name}@</M>\n)")
        yield f"the sublayer {name}", GOOD["disney"].replace("(\n", f"(\nsubLayers = [@./{name}@]\n", 1), "any"


if __name__ == "__main__":
    target = Path(sys.argv[1])
    target.mkdir(parents=True)
    for made in malformed_looks(target):
        sys.stdout.write(f"{made.expected:<7} {made.file.name:<28} {made.name}\n")
