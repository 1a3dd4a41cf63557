"""Large, deep and cyclic looks are errors that name the file, read and examined; large ones that are right are read."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from look_files import BASE, LAYER1, STACK, disney, expression, look, rough, shader, stack, texture, write_gray
from variant_sets import variants

from lookdev.errors import LookError
from lookdev.material.usd import read_look
from lookdev.material.validate.examine import examine_file

MEGABYTE = 1_000_000
NAME = "a" * MEGABYTE


def base(body: str) -> str:
    return look(disney(body=body))


def linked(target: str) -> str:
    return base(f"float inputs:roughness.connect = {target}")


def textured(file: str = "gray.png") -> str:
    return look(rough("Tex.r") + texture(file=f"@./{file}@"))


def layers(count: int, more: str = "") -> str:
    more += "".join(f"token layer{i} <- Coat.layer\n" for i in range(2, count + 1))
    return look(stack(BASE + LAYER1 + more, disney(), disney("Coat")), STACK)


def ring(count: int, node: Callable[[int, int], str]) -> str:
    """Return nodes that each read the next, and the last the first."""
    return "".join(node(i, (i + 1) % count) for i in range(count))


def graph(number: int, source: int) -> str:
    return f'def NodeGraph "G{number}" {{\nfloat outputs:o.connect = </M/G{source}.outputs:o>\n}}\n'


def transform(number: int, source: int) -> str:
    return shader(f"T{number}", "UsdTransform2d", f"float2 in <- T{source}.result")


def sets(body: str) -> str:
    """Return a look of 20 sets of 10 variants."""
    names = ", ".join(f'"s{i}"' for i in range(20))
    exploding = "".join(variants(f"s{i}", **{f"v{j}": "" for j in range(10)}) for i in range(20))
    return look(disney(body=body) + exploding, material=f"(\nprepend variantSets = [{names}]\n)")


DEEP: dict[str, Callable[[int], str]] = {
    "prims": lambda deep: "#usda 1.0\n" + 'def "a" {\n' * deep + "}\n" * deep,
    "prims, open": lambda deep: look('def "a" {\n' * deep),
    "dictionaries": lambda deep: "#usda 1.0\n(customLayerData = {" + "dictionary a = {" * deep + "}" * deep + "})\n",
    "tuples": lambda deep: base("color3f baseColor = " + "(" * deep + "1" + ")" * deep),
    "lists": lambda deep: base("float[] roughness = " + "[" * deep + "1" + "]" * deep),
    "targets": lambda deep: linked("</M.a" + "[/M.a" * deep + "]" * deep + ">"),
    "dictionaries with false ends": lambda deep: (
        "#usda 1.0\n(customLayerData = " + '{ string a = "}" dictionary b = ' * deep + "1" + "}" * deep + ")\n"
    ),
}
FAULTY: dict[str, Callable[[], str]] = {
    "a ring of 1000 inputs": lambda: look(ring(1000, "float a{} <- .a{}\n".format) + rough(".a0")),
    "a ring of node graphs": lambda: look(ring(2, graph) + rough("G0.o")),
    "a node graph with itself": lambda: look(ring(1, graph) + rough("G0.o")),
    "a ring of 50 transforms": lambda: look(rough("Tex.r") + texture("float2 st <- T0.result") + ring(50, transform)),
    "an input with itself": lambda: linked("</M/Base.inputs:roughness>"),
    "the terminal with itself": lambda: look(disney(), "</M.outputs:lookdev:surface>"),
    "a stack with itself": lambda: look(stack("token base <- Layers.surface"), STACK),
    **{f"{deep} {name}": partial(text, deep) for deep in (1000, 120_000) for name, text in DEEP.items()},
    "a deep path": lambda: linked("<" + "/a" * 200_000 + ".outputs:r>"),
    "a path far up": lambda: linked("<" + "../" * 200_000 + "a.outputs:r>"),
    "a path of variants": lambda: linked("</M" + "{a=b}" * 9999 + "a.outputs:r>"),
    "a long name of an input": lambda: base(f"float {NAME} = 1"),
    "a long name of a shader": lambda: look(shader(NAME, "LookdevDisney")),
    "a long id": lambda: look(shader("Base", NAME)),
    "a long token": lambda: base(f'token variant = "{NAME}"'),
    "a long texture": lambda: textured(f"{NAME}.png"),
    "a texture of many folders": lambda: textured(f"{'a/' * (MEGABYTE // 2)}b.png"),
    "a long reference": lambda: look(disney(), material=f"(\nreferences = @./{NAME}.usda@\n)"),
    "a long connection": lambda: base(f"float roughness <- {NAME}.r"),
    "a long number": lambda: base(f"float roughness = {'9' * MEGABYTE}"),
    "a long array": lambda: base(f"float[] roughness = [{'0.5, ' * MEGABYTE}0.5]"),
    "a long expression": lambda: look(rough("X.result") + expression("1" + "+1" * (MEGABYTE // 2), name="X")),
    "100000 layers": lambda: layers(100_000),
    "a layer of a large number": lambda: layers(1, f"token layer{'9' * 5000} <- Coat.layer\n"),
    "20000 unknown inputs": lambda: base("".join(f"float a{i} = 1\n" for i in range(20_000))),
    "10000 connections": lambda: linked(f"[{', '.join(f'</M.a{i}>' for i in range(10_000))}]"),
    "20 sets of 10 variants": lambda: sets("float roughness = 2"),
    "20000 shaders that nobody reads": lambda: look(
        disney(body="float roughness = 2") + "".join(f'def Shader "S{i}" {{\n}}\n' for i in range(20_000))
    ),
    "1000 materials": lambda: (
        textured().replace('defaultPrim = "M"', "") + "".join(f'def Material "M{i}" {{\n}}\n' for i in range(1000))
    ),
}
VALID: dict[str, Callable[[], str]] = {
    "a long comment": lambda: textured() + f"# {NAME}\n",
    "a long documentation": lambda: textured().replace("(\n", f'(\ndoc = "{NAME}"\n', 1),
    "100 layers": lambda: layers(100),
    "20 sets of 10 variants": lambda: sets(""),
}


# Every fifth; the others in `proof`.
@pytest.mark.both_pythons
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.proof if i % 5 else ()) for i, name in enumerate(FAULTY)]
)
def test_a_large_look_at_fault_is_an_error_that_names_the_file(tmp_path: Path, name: str, capfd) -> None:
    file = tmp_path / "look.usda"
    file.write_text(FAULTY[name]())
    with pytest.raises(LookError) as caught:
        read_look(file)
    assert str(file) in str(caught.value)
    report = examine_file(file)
    assert report.has_errors
    assert max(map(len, report.text().splitlines())) <= 2000
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("name", VALID)
def test_a_large_look_that_is_right_is_read(tmp_path: Path, name: str) -> None:
    write_gray(tmp_path / "gray.png")
    file = tmp_path / "look.usda"
    file.write_text(VALID[name]())
    assert read_look(file).layers
    assert not examine_file(file).has_errors
