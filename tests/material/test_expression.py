"""Mask expressions: their values, their faults, and their traces."""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lookdev.codegen.osl.block import Block
from lookdev.codegen.trace.graph import Graph, Node, reachable
from lookdev.codegen.trace.symbolic import SymbolicArray, elements_of, symbol, symbols
from lookdev.material.expression import ExpressionError, Kind, parse
from lookdev.material.expression.shaping import CONSTANTS, FUNCTIONS, OPERATORS, Function
from lookdev.material.expression.syntax import LONGEST

PAGE = (Path(__file__).parents[2] / "docs" / "expressions.md").read_text(encoding="utf-8")

_TYPES: dict[str, Kind] = {"dirt": "float", "edge": "float", "tint": "color"}
_VALUES = {"dirt": np.array(0.75), "edge": np.array(0.25), "tint": np.array([0.2, 0.4, 0.6])}


def value(text: str) -> Any:
    return parse(text).evaluate(_VALUES, _TYPES)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("1", 1.0),
        (".5", 0.5),
        ("2.", 2.0),
        ("2e-3", 0.002),
        ("1.5E+2", 150.0),
        ("1 + 2 * 3", 7.0),
        ("(1 + 2) * 3", 9.0),
        ("7 - 2 - 1", 4.0),
        ("8 / 4 / 2", 1.0),
        ("7 % 4 * 2", 6.0),
        ("2 ^ 3 ^ 2", 512.0),
        ("-2 ^ 2", -4.0),
        ("2 ^ -1", 0.5),
        ("--3", 3.0),
        ("!0 + 1", 2.0),
        ("!(1 + 1)", 0.0),
        ("-!2", 0.0),
        ("1 + 1 < 3", 1.0),
        ("2 <= 2", 1.0),
        ("2 > 2", 0.0),
        ("2 >= 3", 0.0),
        ("1 < 2 == 3 < 4", 1.0),
        ("2 != 2", 0.0),
        ("1 || 0 && 0", 1.0),
        ("5 && .1", 1.0),
        ("0 || 0", 0.0),
        ("(1 < 2) * 10 + 1", 11.0),
        ("0 ? 1 : 0 ? 2 : 3", 3.0),
        ("1 ? 0 ? 1 : 2 : 3", 2.0),
        ("PI", np.pi),
        ("E", np.e),
        ("dirt # the rest is a comment )", 0.75),
        ("\n dirt\n\t* edge ", 0.1875),
        ("clamp(dirt * (1 - edge), 0, 1)", 0.5625),
        ("tint", [0.2, 0.4, 0.6]),
        ("tint[1]", 0.4),
        ("[1, 2, 3][2] ^ 2", 9.0),
        ("-tint", [-0.2, -0.4, -0.6]),
        ("[dirt, edge, 1] * 2", [1.5, 0.5, 2.0]),
        ("tint + dirt", [0.95, 1.15, 1.35]),
        ("max(tint, .3)", [0.3, 0.4, 0.6]),
        ("mix([1, 0, 0], 1, tint)", [1.0, 0.4, 0.6]),
        ("dirt > .5 ? tint : 1", [0.2, 0.4, 0.6]),
        ("dirt < .5 ? tint : 1", [1.0, 1.0, 1.0]),
        ("saturate(edge, 2)", [0.25, 0.25, 0.25]),
        ("remap(dirt, .5, .1, .3, smooth)", 0.5),
        ("1e18 * 1e18 * 1e18", 1e18),
        ("-1e18 * 1e18", -1e18),
        ("exp(1e18) * 0", 0.0),
        ("1 / 0 == 0", 1.0),
    ],
)
def test_values(text: str, wanted: Any) -> None:
    result = value(text)
    assert parse(text).check(_TYPES) == ("color" if isinstance(wanted, list) else "float")
    np.testing.assert_allclose(result, wanted, rtol=1e-15, atol=1e-16)


def test_names_are_the_inputs_in_order_of_appearance() -> None:
    expression = parse("mix(wear, dirt * PI, wear) + _a1 + noise(B, smooth)")
    assert expression.names == ("wear", "dirt", "_a1", "B")


def test_arrays_broadcast() -> None:
    values = {"dirt": np.linspace(0.0, 1.0, 4), "edge": np.array(0.5), "tint": np.full((2, 4, 3), 0.25)}
    assert parse("dirt * edge").evaluate(values, _TYPES).shape == (4,)
    colors = parse("tint * dirt + [0, 0, 1]").evaluate(values, _TYPES)
    np.testing.assert_allclose(colors, np.expand_dims(values["dirt"] * 0.25, -1) + np.array([0, 0, 1.0]) + 0 * colors)
    assert colors.shape == (2, 4, 3)
    assert parse("[dirt, 0, 1]").evaluate(values, _TYPES).shape == (4, 3)


@pytest.mark.parametrize(
    ("text", "place", "what"),
    [
        ("", "", "a number, a name or '(' should stand here, not the end"),
        ("dirt +", "", "should stand here, not the end"),
        ("dirt edge", "edge", "an operator should stand here, not 'edge'"),
        ("(dirt", "", "')' should stand here, not the end"),
        ("dirt)", ")", "an operator should stand here, not ')'"),
        ("2x", "x", "an operator should stand here, not 'x'"),
        ("dirt * * edge", "* edge", "should stand here, not '*'"),
        ("dirt ? 1", "", "':' should stand here, not the end"),
        ("mix(dirt, edge,)", ")", "should stand here, not ')'"),
        ("dirt = 2", "=", "unexpected '=' ('==' compares)"),
        ("dirt & edge", "&", "'&&' is the logical and"),
        ("$dirt", "$", "names stand without '$'"),
        ("dirt.r", ".r", "unexpected '.'"),
        ("__import__('os')", "__import__", "unknown function '__import__'"),
        ("1 + smothstep(dirt, 0, 1)", "smoth", "did you mean 'smoothstep'?"),
        ("mix(dirt, edge)", "mix", "mix takes 3 arguments, not 2 (mix(a, b, alpha))"),
        ("noise(1, 2, 3, 4)", "noise", "noise takes 1 to 3 arguments, not 4 (noise(x[, y][, z]))"),
        ("abs()", "abs", "abs takes 1 argument, not 0 (abs(x))"),
        ("[1, 2]", "[", "a color of 2 numbers (it is [r, g, b])"),
        ("tint[3]", "3", "0, 1 or 2 should stand here, not '3'"),
        ("tint[dirt]", "dirt]", "0, 1 or 2 should stand here, not 'dirt'"),
        ("1 + 1e19", "1e19", "a number above 1e+18"),
        ("1e999", "1e999", "a number above 1e+18"),
        ("dirt * ²", "²", "unexpected '²'"),
        ("drit + edge", "drit", "unknown name 'drit' (did you mean 'dirt'?)"),
        ("noise + edge", "noise", "unknown name 'noise' (a function: noise(x[, y][, z]))"),
        ("xyzzy", "xyzzy", "(known: dirt, edge, tint, PI, E, linear, smooth, gaussian)"),
        ("dirt[0]", "[", "a channel of a float; only colors have channels"),
        ("noise(tint)", "tint", "'noise' needs a float, this is a color (take luminance(color)"),
        ("saturate(tint, tint)", "tint)", "'saturate' needs a float"),
        ("1 < tint", "tint", "'<' needs a float"),
        ("dirt && tint + 1", "+", "'&&' needs a float"),
        ("!tint", "tint", "'!' needs a float"),
        ("tint ? 1 : 0", "tint", "the condition of '?' needs a float"),
        ("[tint, 0, 0]", "tint", "a channel of a color needs a float"),
    ],
)
def test_faults_have_their_place(text: str, place: str, what: str) -> None:
    with pytest.raises(ExpressionError) as caught:
        parse(text).check(_TYPES)
    error = caught.value
    position = text.index(place) if place else len(text)
    message, line, caret = str(error).split("\n")
    assert what in message
    assert (error.text, error.position) == (text, position)
    assert line == f"    {text}"
    assert caret == " " * (4 + position) + "^"


def test_the_caret_stands_under_the_line_at_fault() -> None:
    with pytest.raises(ExpressionError) as caught:
        parse("dirt *\n\t(edge *)\n+ 1")
    assert str(caught.value).split("\n")[1:] == ["     (edge *)", "    " + " " * 8 + "^"]


def test_of_a_long_line_the_part_at_fault_is_shown() -> None:
    with pytest.raises(ExpressionError) as caught:
        parse("1 + " * 20 + "@" + " + 1" * 20)
    _, line, caret = str(caught.value).split("\n")
    assert len(line) < 100
    assert line[caret.index("^")] == "@"
    assert line.strip().startswith("…")
    assert line.endswith("…")


_HOSTILE = {
    "a megabyte": "x+" * 500_000 + "x",
    "parentheses": "(" * LONGEST,
    "closed parentheses": "(" * 30_000 + "x" + ")" * 30_000,
    "signs": "-" * LONGEST,
    "powers": "x^" * 30_000 + "x",
    "a sum": "x+" * 30_000 + "x",
    "choices": "x?" * 30_000,
    "brackets": "[" * LONGEST,
    "channels": "x" + "[0]" * 20_000,
    "calls": "abs(" * 16_000,
    "all levels": "1||1&&1==1<1+1*1^(" * 3_000,
    "arguments": "noise(" + "x," * 30_000 + "x)",
    "a name": "q" * LONGEST,
    "a function's name": "q" * (LONGEST - 2) + "()",
    "a number": "9" * LONGEST,
    "an exponent": "1e" + "9" * 60_000,
    "spaces": " " * LONGEST,
    "comments": "#\n" * 32_000,
    "zeros": "\0" * LONGEST,
}


@pytest.mark.parametrize("text", [pytest.param(text, id=name) for name, text in _HOSTILE.items()])
def test_hostile_text_ends_in_a_short_error_at_once(text: str) -> None:
    start = time.perf_counter()
    with pytest.raises(ExpressionError) as caught:
        parse(text).check({"x": "float"})
    assert time.perf_counter() - start < 1.0
    assert len(str(caught.value)) < 700


def test_depth_is_limited_and_size_is_not() -> None:
    parse("(" * 64 + "x" + ")" * 64)
    parse("abs(" * 63 + "x" + ")" * 63)
    wide = "[" + ", ".join(["+".join(["x*x"] * 60)] * 3) + "]"
    np.testing.assert_array_equal(parse(wide).evaluate({"x": np.array(2.0)}, {"x": "float"}), [240.0] * 3)
    with pytest.raises(ExpressionError, match="more than 64 operations one inside the other"):
        parse("abs(" * 64 + "x" + ")" * 64)


def trace(graph: Graph, text: str) -> Any:
    values = {"dirt": symbol(graph, "dirt"), "edge": symbol(graph, "edge"), "tint": symbols(graph, list("rgb"))}
    return parse(text).evaluate(values, _TYPES)


def reads(text: str) -> set[str]:
    nodes = reachable(elements_of(trace(Graph(), text)))
    return {str(node.args[0]) for node in nodes if node.op == "symbol"}


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("dirt * 0", set()),
        ("dirt * (edge - edge) + .5", set()),
        ("mix(dirt, edge, 0)", {"dirt"}),
        ("mix(dirt, edge, 1)", {"edge"}),
        ("1 < 2 ? dirt : edge", {"dirt"}),
        ("0 ? dirt : tint[1]", {"g"}),
        ("!1 && dirt", set()),
        ("dirt > .5 || 2", set()),
        ("tint * [0, 1, 0]", {"g"}),
        ("[dirt, edge, 0][1]", {"edge"}),
        ("luminance([tint[0], 0, 0])", {"r"}),
        ("remap(dirt, edge, .1, 0, noise(tint[0]))", {"dirt", "edge"}),
        ("saturate(tint, 1)", {"r", "g", "b"}),
        ("noise(.3, .5) * dirt", {"dirt"}),
        ("pow(dirt, 0 * edge)", {"dirt"}),
    ],
)
def test_what_a_constant_decides_is_not_read(text: str, wanted: set[str]) -> None:
    assert reads(text) == wanted


def test_a_constant_expression_is_a_number() -> None:
    for text in ("smoothstep(.3, 0, 1) + noise(.1, .2, .3)", "[1, 2, 3] * .5", "0 * dirt"):
        assert not isinstance(trace(Graph(), text), SymbolicArray), text


def compute(value: Any, symbols: dict[str, Any], kind: Any) -> Any:
    """Evaluate nodes with NumPy's functions in one floating-point type, as a shader does in its own."""
    done: dict[Any, Any] = {}

    def visit(item: Any) -> Any:
        if not isinstance(item, Node):
            return item if isinstance(item, bool) else kind(item)
        if item not in done:
            if item.op == "symbol":
                done[item] = symbols[item.args[0]].astype(kind)
            else:
                done[item] = getattr(np, item.op)(*(visit(arg) for arg in item.args))
        return done[item]

    with np.errstate(all="ignore"):
        return visit(value)


_CALLS = {**FUNCTIONS, **OPERATORS}


def _call(name: str, arguments: list[str]) -> str:
    if name in FUNCTIONS:
        return f"{name}({', '.join(arguments)})"
    return f"-{arguments[0]}" if name == "negative" else f" {name} ".join(arguments) if len(arguments) > 1 else "!a"


def _cases(rng: np.random.Generator, function: Function, count: int) -> tuple[list[str], dict[str, Any]]:
    names = list("abcde")[: len(function.parameters)]
    return names, {name: rng.uniform(0.05, 1.95, count).astype(np.float32).astype(float) for name in names}


@pytest.mark.parametrize("name", _CALLS)
def test_every_function_computes_the_same_when_traced(name: str) -> None:
    rng = np.random.default_rng(7)
    names, values = _cases(rng, _CALLS[name], 400)
    types: dict[str, Kind] = dict.fromkeys(names, "float")
    expression = parse(_call(name, names))
    direct = expression.evaluate(values, types)
    graph = Graph()
    traced = elements_of(expression.evaluate({name: symbol(graph, name) for name in names}, types))
    wanted = direct.reshape(len(direct), -1).T
    for element, component in zip(traced, wanted, strict=True):
        np.testing.assert_allclose(compute(element, values, np.float64), component, rtol=1e-13)
        # Float32 has 6e-8; pow and divisions magnify it by what they magnify their arguments, at worst 1e3 here.
        single = compute(element, values, np.float32)
        assert single.dtype == np.float32
        close = np.isclose(single, component, rtol=1e-4, atol=1e-4)
        # Next to a jump or a pole, rounding decides: one place in a hundred, and none of the noises.
        assert close.mean() >= (1.0 if "noise" in name else 0.99)


_EXTREME = np.array([0.0, -0.0, 1e-40, 1e-19, 1e-9, 0.3, 0.5, 1.0, 2.0, 7.5, 100.0, 1e7, 1e18, 3e38])
_EXTREMES = np.concatenate([_EXTREME, -_EXTREME])


@pytest.mark.parametrize("kind", [np.float64, np.float32])
@pytest.mark.parametrize("name", _CALLS)
def test_every_result_is_finite(name: str, kind: Any) -> None:
    names = list("abcde")[: len(_CALLS[name].parameters)]
    rng = np.random.default_rng(8)
    values = {given: rng.choice(_EXTREMES, 3000) for given in names}
    graph = Graph()
    types: dict[str, Kind] = dict.fromkeys(names, "float")
    expression = parse(_call(name, names))
    direct = expression.evaluate(values, types)
    traced = elements_of(expression.evaluate({name: symbol(graph, name) for name in names}, types))
    for result in (direct, *(compute(element, values, kind) for element in traced)):
        assert np.isfinite(result).all()
        assert np.abs(result).max() <= 1e18 * (1.0 + 1e-7)


@pytest.mark.parametrize("name", [name for name, function in _CALLS.items() if len(function.parameters) > 1])
def test_every_constant_that_is_left_is_a_float32(name: str) -> None:
    names = list("abcde")[: len(_CALLS[name].parameters)]
    rng = np.random.default_rng(9)
    for varying in range(len(names)):
        for _ in range(10):
            graph = Graph()
            values: dict[str, Any] = {given: np.array(rng.choice(np.clip(_EXTREMES, -1e18, 1e18))) for given in names}
            values[names[varying]] = symbol(graph, "x")
            result = parse(_call(name, names)).evaluate(values, dict.fromkeys(names, "float"))
            constants = [arg for node in reachable(elements_of(result)) for arg in node.args if isinstance(arg, float)]
            assert all(abs(constant) <= 3.4e38 for constant in constants)


def test_noise_is_the_same_in_float32_far_from_the_origin() -> None:
    rng = np.random.default_rng(10)
    graph = Graph()
    names = list("xyz")
    traced = parse("noise(x, y, z)").evaluate(
        {name: symbol(graph, name) for name in names}, dict.fromkeys(names, "float")
    )
    (element,) = elements_of(traced)
    for size in (10.0, 1e3, 1e5):
        places = {name: rng.uniform(-size, size, 5000).astype(np.float32).astype(float) for name in names}
        wanted = parse("noise(x, y, z)").evaluate(places, dict.fromkeys(names, "float"))
        # Places that float32 can hold leave an exact remainder: what is left are a hundred operations near 1.
        np.testing.assert_allclose(compute(element, places, np.float32), wanted, atol=5e-6)


def test_emitted_code_is_short() -> None:
    element = elements_of(trace(Graph(), "clamp(dirt * (1 - edge), 0, 1)"))
    block = Block("m", indent=0)
    block.prepare(element)
    block.name(element[0])
    assert block.lines[0] == "float m0 = min(max((dirt * (1.0 - edge)), 0.0), 1.0);"
    assert len(block.lines) == 2


_ROW = re.compile(r"^\| `(?P<call>[^`]+)` \|[^\n]*\| `(?P<example>[^`]+)` = (?P<value>[^|]+?) \|$", re.MULTILINE)


def test_the_page_has_every_function() -> None:
    calls = [match["call"].replace("\\|", "|") for match in _ROW.finditer(PAGE)]
    assert sorted(call for call in calls if "(" in call) == sorted(f.signature(name) for name, f in FUNCTIONS.items())
    operators = [call for call in calls if "(" not in call]
    wanted = {"-x", "!x", "c[n]", "a ? b : c"} | {
        f"a {name} b" for name, f in OPERATORS.items() if len(f.parameters) == 2
    }
    assert sorted(operators) == sorted(wanted)
    for name in CONSTANTS:
        assert f"`{name}`" in PAGE


@pytest.mark.parametrize("row", [pytest.param(match, id=match["example"]) for match in _ROW.finditer(PAGE)])
def test_the_examples_of_the_page_are_true(row: re.Match[str]) -> None:
    wanted = [float(number) for number in row["value"].strip("[]").split(",")]
    example = row["example"].replace("\\|", "|")
    # As many digits as the page shows.
    np.testing.assert_allclose(np.ravel(parse(example).evaluate({}, {})), wanted, atol=5e-5)


def test_the_fault_on_the_page_is_the_one_told() -> None:
    (shown,) = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
    with pytest.raises(ExpressionError) as caught:
        parse("clamp(smothstep(dirt, .2, .6) * (1 - edge), 0, 1)")
    assert shown.rstrip() == str(caught.value)
