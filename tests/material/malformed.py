"""Malformed look files, made from good ones, always the same, and what became of reading each.

``python tests/material/malformed.py FOLDER [STEP]`` writes them into a new folder and prints a JSON line for each, or
for each STEP-th of every family. A forked process of bounded memory reads one after the other; when a file kills it,
the next one continues after that file.
"""

import json
import os
import random
import resource
import signal
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from look_files import BASE, LAYER1, STACK, disney, expression, look, pixar, rough, shader, stack, texture, write_gray
from pxr import Sdf
from variant_sets import over, selecting, variants

from lookdev.errors import LookError
from lookdev.material.usd import read_look
from lookdev.material.validate.examine import examine

MEGABYTE = 1_000_000
SECONDS = 20
"""The time limit of a file."""
MEMORY = 8 << 30
"""Bytes of address space of the process that reads."""

LAYERS = BASE + LAYER1
IMAGES = ("folder.png", "pipe.png", "empty.png")
FILES = ("folder.usda", "pipe.usda", "empty.usda", "noise.usda", "noise.usdc", "noise.usdz", "deep.usda", "gone.usda")


class Case(NamedTuple):
    """A look file; `expected` is its state by construction: faulty, valid, or any where it depends on chance."""

    name: str
    file: Path
    expected: str = "faulty"


def base(body: str) -> str:
    return look(disney(body=body))


def stacked(inputs: str) -> str:
    return look(stack(LAYERS + inputs, disney(), disney("Coat")), STACK)


def with_metadata(metadata: str) -> str:
    return look(disney(), material=f"(\n{metadata}\n)")


def sublayered(file: str) -> str:
    return textured().replace("(\n", f"(\nsubLayers = [@{file}@]\n", 1)


def textured(file: str = "@./gray.png@", more: str = "", parameter: str = "float roughness") -> str:
    """Return a look with a textured input."""
    output = "rgb" if "3f" in parameter else "r"
    return look(disney(body=f"{parameter} <- Tex.{output}") + texture(more, file))


GOOD = {
    "disney": textured(),
    "stack": look(
        stack(LAYERS + "float layer1Mask = 0.5\n", disney(), disney("Coat", "float roughness = 0.2"))
        + variants("wear", worn=over("Base", "float metallic = 1"), new=""),
        STACK,
        selecting(wear="worn"),
    ),
    "pixar": look(
        pixar(body="normal3f diffuseNormal <- Bump.normal\nfloat clear = 0.5")
        + shader("Bump", "LookdevBump", "float height <- Tex.r\nfloat scale = 0.1")
        + texture()
    ),
}
"""Looks that are right, of every kind of node."""


Given = tuple[str, str | bytes] | tuple[str, str | bytes, str]
"""A name, a file's content and, where it is not simply faulty, what it is."""


def malformed_looks(folder: Path) -> list[Case]:
    """Write the files into an empty folder and return them, with a few that are valid in odd ways."""
    _write_images(folder)
    chance = random.Random(4)
    cases: list[Case] = []
    for family in (_good, _damaged, _odd_types, _numbers, _cycles, _nested, _long, _many, _outside, _images):
        for name, content, *expected in family(chance):
            file = folder / f"{len(cases):03}.usda"
            file.write_bytes(content if isinstance(content, bytes) else content.replace("SELF", file.name).encode())
            cases.append(Case(f"{family.__name__[1:]}: {name}", file, *expected))
    return [*cases, *_files(folder, chance), *_binary(folder, chance)]


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
    yield "a name that is not UTF-8", base("float inputs:rough\udcff = 1").encode(errors="surrogateescape")
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


def _odd_types(_: random.Random) -> Iterator[Given]:
    yield ("a relationship for an input", base("rel inputs:roughness = </M>"), "any")
    yield "a text for a number", base('float roughness = "a"')
    yield "a number for a connection", base("float inputs:roughness.connect = 1")
    yield "an id that is a number", look('def Shader "Base" {\nuniform int info:id = 1\n}\n')
    yield (
        "a material that is a scope",
        GOOD["disney"].replace("def Material", "def Scope").replace("LookdevDisney", "X"),
    )
    yield "a layer that is a material", GOOD["stack"].replace('def Shader "Coat"', 'def Material "Coat"')


def _numbers(_: random.Random) -> Iterator[Given]:
    for number in ("nan", "inf", "-inf", "1e39", "-1", "1" + "0" * 400, "-1e-3"):
        yield f"roughness {number[:8]}", base(f"float roughness = {number}")
        yield f"a channel {number[:8]}", base(f"color3f baseColor = (0, {number}, 0)")
    for name in ("scale", "bias"):
        yield f"{name} nan", textured(more=f"float4 {name} = (1, nan, 1, 1)")
    yield "a bump inf high", GOOD["pixar"].replace("inputs:scale = 0.1", "inputs:scale = inf")
    yield "animated", base("float inputs:roughness.timeSamples = { 0: 0.1, 1: nan }")


def _cycles(_: random.Random) -> Iterator[Given]:
    ring = "".join(f"float a{i} <- .a{(i + 1) % 1000}\n" for i in range(1000))
    yield "1000 interface inputs", look(ring + disney(body="float roughness <- .a0"))
    graphs = "".join(
        f'def NodeGraph "G{i}" {{\nfloat outputs:o.connect = </M/G{1 - i}.outputs:o>\n}}\n' for i in (0, 1)
    )
    yield "node graphs", look(graphs + rough("G0.o"))
    inward = 'def NodeGraph "G" {\nfloat outputs:o.connect = </M/G.outputs:o>\n}\n'
    yield "a node graph with itself", look(inward + rough("G.o"))
    yield "an input with itself", base("float inputs:roughness.connect = </M/Base.inputs:roughness>")
    yield "the terminal with itself", look(disney(), "</M.outputs:lookdev:surface>")
    chain = "".join(shader(f"T{i}", "UsdTransform2d", f"float2 in <- T{(i + 1) % 50}.result") for i in range(50))
    yield "50 transforms", look(rough("Tex.r") + texture("float2 st <- T0.result") + chain)
    yield "a stack with itself", look(stack("token base <- Layers.surface"), STACK)
    for arc in ("references", "inherits", "specializes", "payload"):
        yield f"{arc} of itself", with_metadata(f"prepend {arc} = </M>")
    classes = 'class "A" (\ninherits = </B>\n)\n{\n}\nclass "B" (\ninherits = </A>\n)\n{\n}\n'
    yield "inherits of two classes", look(disney(), material="(\ninherits = </A>\n)", before=classes)
    yield "references of a child to its parent", look(disney() + 'def "In" (\nreferences = </M>\n)\n{\n}\n')
    yield "an instance of itself", with_metadata("instanceable = true\nreferences = </M>")
    yield "a sublayer of itself", sublayered("./SELF")
    yield "references of two files", with_metadata("references = @./ring_a.usda@</M>")
    yield "sublayers of two files", sublayered("./ring_c.usda")


def _nested(_: random.Random) -> Iterator[Given]:
    for deep in (1000, 120_000):
        yield f"{deep} prims", "#usda 1.0\n" + 'def "a" {\n' * deep + "}\n" * deep
        yield f"{deep} prims, open", look('def "a" {\n' * deep)
        yield (
            f"{deep} dictionaries",
            "#usda 1.0\n(customLayerData = {" + "dictionary a = {" * deep + "}" * deep + "})\n",
        )
        yield f"{deep} tuples", base("color3f baseColor = " + "(" * deep + "1" + ")" * deep)
        yield f"{deep} lists", base("float[] roughness = " + "[" * deep + "1" + "]" * deep)
        yield (f"{deep} targets", base("float inputs:roughness.connect = </M.a" + "[/M.a" * deep + "]" * deep + ">"))
        hidden = '{ string a = "}" dictionary b = '
        yield f"{deep} dictionaries with false ends", f"#usda 1.0\n(customLayerData = {hidden * deep}1{'}' * deep})\n"
    yield "a deep path", base("float inputs:roughness.connect = <" + "/a" * 200_000 + ".outputs:r>")
    yield "a path far up", base("float inputs:roughness.connect = <" + "../" * 200_000 + "a.outputs:r>")
    yield ("a path of variants", base("float inputs:roughness.connect = </M" + "{a=b}" * 9999 + "a.outputs:r>"))


def _long(_: random.Random) -> Iterator[Given]:
    name = "a" * MEGABYTE
    yield "the name of an input", base(f"float {name} = 1")
    yield "the name of a shader", look(shader(name, "LookdevDisney"))
    yield "the id", look(shader("Base", name))
    yield "a token", base(f'token variant = "{name}"')
    yield "a texture", textured(f"@./{name}.png@")
    yield "a texture of many folders", textured(f"@./{'a/' * (MEGABYTE // 2)}b.png@")
    yield "a reference", with_metadata(f"references = @./{name}.usda@")
    yield "a connection", base(f"float roughness <- {name}.r")
    yield "a number", base(f"float roughness = {'9' * MEGABYTE}")
    yield "a variant", look(disney(), material=f'(\nvariantSets = "{name}"\n)'), "any"
    yield "a comment", GOOD["disney"] + f"# {name}\n", "valid"
    yield "a documentation", GOOD["disney"].replace("(\n", f'(\ndoc = "{name}"\n', 1), "valid"
    yield "an array", base(f"float[] roughness = [{'0.5, ' * MEGABYTE}0.5]")
    yield "an array of names", base(f"token[] variant = [{chr(34) * 2}{', ' + chr(34) * 2} ]")
    yield "an expression", look(rough("X.result") + expression("1" + "+1" * (MEGABYTE // 2), name="X"))


def _many(_: random.Random) -> Iterator[Given]:
    def layers(count: int) -> str:
        return "".join(f"token layer{i} <- Coat.layer\n" for i in range(2, count + 1))

    yield "100 layers", stacked(layers(100)), "valid"
    yield "100000 layers", stacked(layers(100_000))
    yield "a layer of a large number", stacked(f"token layer{'9' * 5000} <- Coat.layer")
    unknown = "".join(f"float a{i} = 1\n" for i in range(20_000))
    yield "20000 unknown inputs", base(unknown)
    targets = ", ".join(f"</M.a{i}>" for i in range(10_000))
    yield "10000 connections", base(f"float inputs:roughness.connect = [{targets}]")
    sets = "".join(variants(f"s{i}", **{f"v{j}": "" for j in range(10)}) for i in range(20))
    names, rough_too = ", ".join(f'"s{i}"' for i in range(20)), disney(body="float roughness = 2")
    exploding = f"(\nprepend variantSets = [{names}]\n)"
    yield "20 sets of 10 variants", look(disney() + sets, material=exploding), "valid"
    yield "20 sets of 10 variants at fault", look(rough_too + sets, material=exploding)
    shaders = "".join(f'def Shader "S{i}" {{\n}}\n' for i in range(20_000))
    yield "20000 shaders that nobody reads", look(rough_too + shaders)
    materials = "".join(f'def Material "M{i}" {{\n}}\n' for i in range(1000))
    yield "1000 materials", textured().replace('defaultPrim = "M"', "") + materials
    yield "no material", "#usda 1.0\n" + 'def Xform "X" {\n}\n'


def _outside(_: random.Random) -> Iterator[Given]:
    files = "/etc/passwd", "../" * 40 + "etc/passwd", "http://0.0.0.0:9/a.png", "file:///etc/passwd", "/dev/zero"
    files += "/dev/stdin", "/proc/self/mem", "..", ".", "~", "a\\\\b", "%n%s", "con", "a.usdz[b.png]"
    for path in (*files, "a.png:SDF_FORMAT_ARGS:b=c", "anon:0x1:a", "$HOME", "`id`"):
        yield f"the texture {path[:20]}", textured(f"@{path}@")
        yield f"the reference {path[:20]}", with_metadata(f"references = @{path}@</M>")
        yield f"the sublayer {path[:20]}", sublayered(f"{path}"), "any"


def _images(_: random.Random) -> Iterator[Given]:
    for name in IMAGES:
        yield f"the texture {name}", textured(f"@./{name}@")
    for name in FILES:
        for arc in ("references", "payload"):
            yield f"{arc} of {name}", with_metadata(f"{arc} = @./{name}@</M>")
        yield f"the sublayer {name}", sublayered(f"./{name}"), "any"


def _files(folder: Path, chance: random.Random) -> Iterator[Case]:
    """Write layers that others refer to, and what only looks like a layer."""
    referring = look(disney(), material="(\nreferences = @./OTHER@</M>\n)")
    contents: dict[str, str | bytes | None] = {
        **{f"ring_{a}.usda": referring.replace("OTHER", f"ring_{b}.usda") for a, b in ("ab", "ba")},
        **{f"ring_{a}.usda": sublayered(f"./ring_{b}.usda") for a, b in ("cd", "dc")},
        **dict.fromkeys(("folder.usda", "pipe.usda", "loop.usda", "gone.usda")),
        "deep.usda": "#usda 1.0\n" + 'def "a" {\n' * 100_000 + "}\n" * 100_000,
    }
    (folder / "folder.usda").mkdir()
    os.mkfifo(folder / "pipe.usda")
    (folder / "loop.usda").symlink_to("loop.usda")
    magics = {"usd": b"PXR-USDC", "usda": b"#usda 1.0\n", "usdc": b"PXR-USDC", "usdz": b"PK\x03\x04"}
    for ending, magic in magics.items():
        contents |= {f"empty.{ending}": b"", f"noise.{ending}": chance.randbytes(10_000)}
        contents |= {f"magic{size}.{ending}": magic + chance.randbytes(size) for size in (10, 1000, 100_000)}
    for name, content in contents.items():
        if content is not None:
            (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
        yield Case(f"files: {name}", folder / name)


def _binary(folder: Path, chance: random.Random) -> Iterator[Case]:
    """Write binary layers, cut and with bytes changed."""

    def write(name: str, data: bytes, expected: str = "faulty") -> Case:
        (folder / f"{name}.usdc").write_bytes(data)
        return Case(f"binary: {name}", folder / f"{name}.usdc", expected)

    for name, text in GOOD.items():
        layer = Sdf.Layer.CreateAnonymous(".usda")
        layer.ImportFromString(text)
        layer.Export(str(folder / f"{name}.usdc"))
        data = (folder / f"{name}.usdc").read_bytes()
        yield write(name, data, "valid")
        # The table of contents is the last thing in the file.
        for size in chance.sample(range(len(data) - 8), 6):
            yield write(f"{name}_{size}", data[:size])
        for number in range(12):
            changed = bytearray(data)
            for place in chance.sample(range(len(data)), chance.choice((1, 2, 8))):
                changed[place] = chance.randrange(256)
            yield write(f"{name}_changed{number}", bytes(changed), "any")
        yield write(f"{name}_text", text.encode())


def _write_images(folder: Path) -> None:
    """Write an image that is right, and `IMAGES`."""
    write_gray(folder / "gray.png", size=64)
    (folder / "folder.png").mkdir()
    os.mkfifo(folder / "pipe.png")
    (folder / "empty.png").touch()


def outcome(file: Path) -> dict[str, object]:
    """Read and examine a look: `read` is what `read_look` raised."""
    try:
        read_look(file)
        read = ""
    except LookError as error:
        read = str(error)
    report = examine(file)
    return {"status": 0, "read": read, "errors": report.has_errors, "text": report.text()}


def read_all(cases: Sequence[Case], writer: int, log: Path) -> None:
    """Write the outcome of each case, with its text on stderr."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.dup2(os.open(log, os.O_RDWR | os.O_CREAT | os.O_APPEND), 2)
    for case in cases:
        os.ftruncate(2, 0)
        signal.alarm(SECONDS)
        found = outcome(case.file) | {"stderr": log.read_text(errors="replace")}
        os.write(writer, (json.dumps(found) + "\n").encode())


def run(cases: Sequence[Case], log: Path) -> list[dict[str, object]]:
    """Return the outcome of cases up to one that killed its reader, and of that its exit status."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        read_all(cases, writer, log)
        sys.stderr.flush()
        os._exit(0)  # USD, damaged by the files, must not crash at exit
    os.close(writer)
    with os.fdopen(reader) as stream:
        found = [json.loads(line) for line in stream]
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if len(found) < len(cases):
        stderr = log.read_text(errors="replace")
        found.append({"status": status, "read": "", "errors": False, "text": "", "stderr": stderr})
    return found


def main(folder: Path, step: int = 1) -> None:
    folder.mkdir()
    families: dict[str, list[Case]] = {}
    for case in malformed_looks(folder):
        families.setdefault(case.name.partition(":")[0] + case.expected, []).append(case)
    remaining = [case for family in families.values() for case in family[::step]]
    while remaining:
        ended = run(remaining, folder / "stderr.txt")
        for case, found in zip(remaining, ended, strict=False):
            sys.stdout.write(json.dumps(case._asdict() | {"file": str(case.file)} | found) + "\n")
        remaining = remaining[len(ended) :]


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
