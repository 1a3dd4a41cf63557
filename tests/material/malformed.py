"""Large, deep and cyclic look files, and damaged binary ones, always the same, and what became of reading each.

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


class Case(NamedTuple):
    """A look file; `expected` is its state by construction: faulty, valid, or any where it depends on chance."""

    name: str
    file: Path
    expected: str = "faulty"


def base(body: str) -> str:
    return look(disney(body=body))


def stacked(inputs: str) -> str:
    return look(stack(LAYERS + inputs, disney(), disney("Coat")), STACK)


def textured(file: str = "@./gray.png@") -> str:
    """Return a look with a textured input."""
    return look(rough("Tex.r") + texture(file=file))


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


Given = tuple[str, str] | tuple[str, str, str]
"""A name, a file's text and, where it is not simply faulty, what it is."""


def malformed_looks(folder: Path) -> list[Case]:
    """Write the files into an empty folder and return them, with a few that are valid in odd ways."""
    write_gray(folder / "gray.png", size=64)
    cases: list[Case] = []
    for family in (_good, _cycles, _nested, _long, _many):
        for name, content, *expected in family():
            file = folder / f"{len(cases):03}.usda"
            file.write_text(content)
            cases.append(Case(f"{family.__name__[1:]}: {name}", file, *expected))
    return [*cases, *_binary(folder)]


def _good() -> Iterator[Given]:
    for name, text in GOOD.items():
        yield name, text, "valid"


def _cycles() -> Iterator[Given]:
    ring = "".join(f"float a{i} <- .a{(i + 1) % 1000}\n" for i in range(1000))
    yield "1000 interface inputs", look(ring + disney(body="float roughness <- .a0"))
    graph = 'def NodeGraph "{}" {{\nfloat outputs:o.connect = </M/{}.outputs:o>\n}}\n'
    yield "node graphs", look(graph.format("G0", "G1") + graph.format("G1", "G0") + rough("G0.o"))
    yield "a node graph with itself", look(graph.format("G", "G") + rough("G.o"))
    yield "an input with itself", base("float inputs:roughness.connect = </M/Base.inputs:roughness>")
    yield "the terminal with itself", look(disney(), "</M.outputs:lookdev:surface>")
    chain = "".join(shader(f"T{i}", "UsdTransform2d", f"float2 in <- T{(i + 1) % 50}.result") for i in range(50))
    yield "50 transforms", look(rough("Tex.r") + texture("float2 st <- T0.result") + chain)
    yield "a stack with itself", look(stack("token base <- Layers.surface"), STACK)


def _nested() -> Iterator[Given]:
    for deep in (1000, 120_000):
        yield f"{deep} prims", "#usda 1.0\n" + 'def "a" {\n' * deep + "}\n" * deep
        yield f"{deep} prims, open", look('def "a" {\n' * deep)
        yield f"{deep} dictionaries", f"#usda 1.0\n(customLayerData = {{{'dictionary a = {' * deep}{'}' * deep}}})\n"
        yield f"{deep} tuples", base("color3f baseColor = " + "(" * deep + "1" + ")" * deep)
        yield f"{deep} lists", base("float[] roughness = " + "[" * deep + "1" + "]" * deep)
        yield (f"{deep} targets", base("float inputs:roughness.connect = </M.a" + "[/M.a" * deep + "]" * deep + ">"))
        hidden = '{ string a = "}" dictionary b = '
        yield f"{deep} dictionaries with false ends", f"#usda 1.0\n(customLayerData = {hidden * deep}1{'}' * deep})\n"
    yield "a deep path", base("float inputs:roughness.connect = <" + "/a" * 200_000 + ".outputs:r>")
    yield "a path far up", base("float inputs:roughness.connect = <" + "../" * 200_000 + "a.outputs:r>")
    yield ("a path of variants", base("float inputs:roughness.connect = </M" + "{a=b}" * 9999 + "a.outputs:r>"))


def _long() -> Iterator[Given]:
    name = "a" * MEGABYTE
    yield "the name of an input", base(f"float {name} = 1")
    yield "the name of a shader", look(shader(name, "LookdevDisney"))
    yield "the id", look(shader("Base", name))
    yield "a token", base(f'token variant = "{name}"')
    yield "a texture", textured(f"@./{name}.png@")
    yield "a texture of many folders", textured(f"@./{'a/' * (MEGABYTE // 2)}b.png@")
    yield "a reference", look(disney(), material=f"(\nreferences = @./{name}.usda@\n)")
    yield "a connection", base(f"float roughness <- {name}.r")
    yield "a number", base(f"float roughness = {'9' * MEGABYTE}")
    yield "a variant", look(disney(), material=f'(\nvariantSets = "{name}"\n)'), "any"
    yield "a comment", GOOD["disney"] + f"# {name}\n", "valid"
    yield "a documentation", GOOD["disney"].replace("(\n", f'(\ndoc = "{name}"\n', 1), "valid"
    yield "an array", base(f"float[] roughness = [{'0.5, ' * MEGABYTE}0.5]")
    yield "an array of names", base(f"token[] variant = [{chr(34) * 2}{', ' + chr(34) * 2} ]")
    yield "an expression", look(rough("X.result") + expression("1" + "+1" * (MEGABYTE // 2), name="X"))


def _many() -> Iterator[Given]:
    def layers(count: int) -> str:
        return "".join(f"token layer{i} <- Coat.layer\n" for i in range(2, count + 1))

    yield "100 layers", stacked(layers(100)), "valid"
    yield "100000 layers", stacked(layers(100_000))
    yield "a layer of a large number", stacked(f"token layer{'9' * 5000} <- Coat.layer")
    yield "20000 unknown inputs", base("".join(f"float a{i} = 1\n" for i in range(20_000)))
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


def _binary(folder: Path) -> Iterator[Case]:
    """Write binary layers, cut and with bytes changed."""
    chance = random.Random(4)

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
