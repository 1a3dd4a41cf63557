"""Expressions: their values, their faults, their traces, and shaping functions.

Shaping functions have SeExpr's formulas, values where these are undefined, and noise that is equal in float32.
"""

import math
import re
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lookdev.codegen.trace.graph import Graph, GraphNode, Symbol, reachable_nodes
from lookdev.codegen.trace.symbolic import SymbolicArray, elements_of, symbol, symbols
from lookdev.material.expression import ExpressionError, ExpressionKind, parse, shaping
from lookdev.material.expression.shaping import CONSTANTS, FUNCTIONS, OPERATORS
from lookdev.material.expression.syntax import MAX_LENGTH

PAGE = (Path(__file__).parents[2] / "docs" / "expressions.md").read_text(encoding="utf-8")

_TYPES: dict[str, ExpressionKind] = {"dirt": "float", "edge": "float", "tint": "color"}
_VALUES = {"dirt": np.array(0.75), "edge": np.array(0.25), "tint": np.array([0.2, 0.4, 0.6])}


def value(text: str) -> Any:
    return parse(text).evaluate(_VALUES, _TYPES)


@pytest.mark.parametrize(
    ("text", "reference"),
    [
        *((text, 1.0) for text in ("1", "1 + 1 < 3", "2 <= 2", "1 < 2 == 3 < 4", "1 || 0 && 0", "5 && .1")),
        *((text, 0.0) for text in ("!(1 + 1)", "-!2", "2 > 2", "2 >= 3", "0 || 0", "exp(1e18) * 0")),
        (".5", 0.5),
        ("2.", 2.0),
        ("2e-3", 0.002),
        ("1.5E+2", 150.0),
        ("1 + 2 * 3", 7.0),
        ("(1 + 2) * 3", 9.0),
        ("8 / 4 / 2", 1.0),
        ("7 % 4 * 2", 6.0),
        ("2 ^ -1", 0.5),
        ("--3", 3.0),
        ("!0 + 1", 2.0),
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
    ],
)
def test_values(text: str, reference: Any) -> None:
    result = value(text)
    assert parse(text).check(_TYPES) == ("color" if isinstance(reference, list) else "float")
    np.testing.assert_allclose(result, reference, rtol=1e-15, atol=1e-16)


def test_names_are_the_inputs_in_order_of_appearance() -> None:
    assert parse("mix(wear, dirt * PI, wear) + _a1 + noise(B, smooth)").names == ("wear", "dirt", "_a1", "B")


def test_arrays_broadcast() -> None:
    values = {"dirt": np.linspace(0.0, 1.0, 4), "edge": np.array(0.5), "tint": np.full((2, 4, 3), 0.25)}
    assert parse("dirt * edge").evaluate(values, _TYPES).shape == (4,)
    colors = parse("tint * dirt + [0, 0, 1]").evaluate(values, _TYPES)
    np.testing.assert_allclose(colors, np.expand_dims(values["dirt"] * 0.25, -1) + np.array([0, 0, 1.0]) + 0 * colors)
    assert colors.shape == (2, 4, 3)
    assert parse("[dirt, 0, 1]").evaluate(values, _TYPES).shape == (4, 3)


@pytest.mark.parametrize(
    ("text", "column", "summary"),
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
def test_faults_have_their_place(text: str, column: str, summary: str) -> None:
    with pytest.raises(ExpressionError) as caught:
        parse(text).check(_TYPES)
    error = caught.value
    position = text.index(column) if column else len(text)
    message, line, caret = str(error).split("\n")
    assert summary in message
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
    "parentheses": "(" * MAX_LENGTH,
    "signs": "-" * MAX_LENGTH,
    "powers": "x^" * 30_000 + "x",
    "a sum": "x+" * 30_000 + "x",
    "choices": "x?" * 30_000,
    "brackets": "[" * MAX_LENGTH,
    "channels": "x" + "[0]" * 20_000,
    "calls": "abs(" * 16_000,
    "all levels": "1||1&&1==1<1+1*1^(" * 3_000,
    "arguments": "noise(" + "x," * 30_000 + "x)",
    "a name": "q" * MAX_LENGTH,
    "a number": "9" * MAX_LENGTH,
    "spaces": " " * MAX_LENGTH,
    "zeros": "\0" * MAX_LENGTH,
}


@pytest.mark.parametrize("text", [pytest.param(text, id=name) for name, text in _HOSTILE.items()])
def test_hostile_text_ends_in_a_short_error_at_once(text: str) -> None:
    start = time.process_time()
    with pytest.raises(ExpressionError) as caught:
        parse(text).check({"x": "float"})
    assert time.process_time() - start < 1.0
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
    return {node.name for node in reachable_nodes(elements_of(trace(Graph(), text))) if isinstance(node, Symbol)}


@pytest.mark.parametrize(
    ("text", "reference"),
    [
        *((text, set()) for text in ("dirt * 0", "dirt * (edge - edge) + .5", "!1 && dirt", "dirt > .5 || 2")),
        *((text, {"dirt"}) for text in ("mix(dirt, edge, 0)", "1 < 2 ? dirt : edge", "noise(.3, .5) * dirt")),
        ("pow(dirt, 0 * edge)", {"dirt"}),
        *((text, {"edge"}) for text in ("mix(dirt, edge, 1)", "[dirt, edge, 0][1]")),
        *((text, {"g"}) for text in ("0 ? dirt : tint[1]", "tint * [0, 1, 0]")),
        ("luminance([tint[0], 0, 0])", {"r"}),
        ("remap(dirt, edge, .1, 0, noise(tint[0]))", {"dirt", "edge"}),
        ("saturate(tint, 1)", {"r", "g", "b"}),
    ],
)
def test_what_a_constant_decides_is_not_read(text: str, reference: set[str]) -> None:
    assert reads(text) == reference


def test_a_constant_expression_is_a_number() -> None:
    for text in ("smoothstep(.3, 0, 1) + noise(.1, .2, .3)", "[1, 2, 3] * .5", "0 * dirt"):
        assert not isinstance(trace(Graph(), text), SymbolicArray), text


def compute(value: Any, symbols: dict[str, Any], kind: Any) -> Any:
    """Evaluate nodes with NumPy's functions in one floating-point type, as a shader does in its own."""
    done: dict[Any, Any] = {}

    def visit(item: Any) -> Any:
        if not isinstance(item, GraphNode):
            return item if isinstance(item, bool) else kind(item)
        if item not in done:
            if isinstance(item, Symbol):
                done[item] = symbols[item.name].astype(kind)
            else:
                done[item] = getattr(np, item.op)(*(visit(arg) for arg in item.args))
        return done[item]

    with np.errstate(all="ignore"):
        return visit(value)


_CALLS = {**FUNCTIONS, **OPERATORS}


def _call(name: str, arguments: list[str]) -> str:
    if name in FUNCTIONS:
        return f"{name}({', '.join(arguments)})"
    return {"negative": "-a", "!": "!a"}.get(name) or f" {name} ".join(arguments)


def _trace_call(name: str, **arguments_given: Any) -> tuple[list[str], Any, list[Any]]:
    """Return the arguments of a function, the expression that calls it, and its trace, with some arguments given."""
    names, graph = list("abcde")[: len(_CALLS[name].parameters)], Graph()
    expression = parse(_call(name, names))
    values = {argument: arguments_given.get(argument, symbol(graph, argument)) for argument in names}
    return names, expression, elements_of(expression.evaluate(values, dict.fromkeys(names, "float")))


@pytest.mark.parametrize("name", _CALLS)
def test_every_function_computes_the_same_when_traced(name: str) -> None:
    rng, (names, expression, elements) = np.random.default_rng(7), _trace_call(name)
    values = {argument: rng.uniform(0.05, 1.95, 400).astype(np.float32).astype(float) for argument in names}
    direct = expression.evaluate(values, dict.fromkeys(names, "float"))
    for element, component in zip(elements, direct.reshape(len(direct), -1).T, strict=True):
        np.testing.assert_allclose(compute(element, values, np.float64), component, rtol=1e-13)
        # Float32 rounds by 6e-8; pow and divisions magnify this error as they magnify arguments, at worst 1e3 here.
        single = compute(element, values, np.float32)
        assert single.dtype == np.float32
        close = np.isclose(single, component, rtol=1e-4, atol=1e-4)
        # Next to a jump or a pole, rounding decides: one place in a hundred, and none of the noises.
        assert close.mean() >= (1.0 if "noise" in name else 0.99)


_EXTREME = np.array([0.0, -0.0, 1e-40, 1e-19, 1e-9, 0.3, 0.5, 1.0, 2.0, 7.5, 100.0, 1e7, 1e18, 3e38])
_EXTREMES = np.concatenate([_EXTREME, -_EXTREME])


@pytest.mark.parametrize("name", _CALLS)
def test_every_result_is_finite(name: str) -> None:
    rng, (names, expression, elements) = np.random.default_rng(8), _trace_call(name)
    values = {argument: rng.choice(_EXTREMES, 3000) for argument in names}
    direct = expression.evaluate(values, dict.fromkeys(names, "float"))
    computed = [compute(element, values, kind) for element in elements for kind in (np.float64, np.float32)]
    for result in (direct, *computed):
        assert np.isfinite(result).all()
        assert np.abs(result).max() <= 1e18 * (1.0 + 1e-7)


@pytest.mark.parametrize("name", [name for name, function in _CALLS.items() if len(function.parameters) > 1])
def test_every_constant_that_is_left_is_a_float32(name: str) -> None:
    rng, (names, _, _) = np.random.default_rng(9), _trace_call(name)
    for varying in names:
        for _ in range(10):
            others = (argument for argument in names if argument != varying)
            values = {argument: np.array(rng.choice(np.clip(_EXTREMES, -1e18, 1e18))) for argument in others}
            nodes = reachable_nodes(_trace_call(name, **values)[2])
            constants = [arg for node in nodes for arg in node.args if isinstance(arg, float)]
            assert all(abs(constant) <= 3.4e38 for constant in constants)


def test_noise_is_the_same_in_float32_far_from_the_origin() -> None:
    rng, (names, noise, (element,)) = np.random.default_rng(10), _trace_call("noise")
    for size in (10.0, 1e3, 1e5):
        places = {name: rng.uniform(-size, size, 5000).astype(np.float32).astype(float) for name in names}
        expected = noise.evaluate(places, dict.fromkeys(names, "float"))
        # Places that float32 can hold leave an exact remainder: what is left are a hundred operations near 1.
        np.testing.assert_allclose(compute(element, places, np.float32), expected, atol=5e-6)


_ROW = re.compile(r"^\| `(?P<call>[^`]+)` \|[^\n]*\| `(?P<example>[^`]+)` = (?P<value>[^|]+?) \|$", re.MULTILINE)


def test_the_page_has_every_function() -> None:
    calls = [match["call"].replace("\\|", "|") for match in _ROW.finditer(PAGE)]
    assert sorted(call for call in calls if "(" in call) == sorted(f.signature(name) for name, f in FUNCTIONS.items())
    operators = [call for call in calls if "(" not in call]
    binary = [f"a {name} b" for name, f in OPERATORS.items() if len(f.parameters) == 2]
    assert sorted(operators) == sorted(["-x", "!x", "c[n]", "a ? b : c", *binary])
    assert all(f"`{name}`" in PAGE for name in CONSTANTS)


@pytest.mark.parametrize("row", [pytest.param(match, id=match["example"]) for match in _ROW.finditer(PAGE)])
def test_the_examples_of_the_page_are_true(row: re.Match[str]) -> None:
    expected = [float(number) for number in row["value"].strip("[]").split(",")]
    example = row["example"].replace("\\|", "|")
    # As many digits as the page shows.
    np.testing.assert_allclose(np.ravel(parse(example).evaluate({}, {})), expected, atol=5e-5)


def test_the_fault_on_the_page_is_the_one_told() -> None:
    (quoted_fault,) = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
    with pytest.raises(ExpressionError) as caught:
        parse("clamp(smothstep(dirt, .2, .6) * (1 - edge), 0, 1)")
    assert quoted_fault.rstrip() == str(caught.value)


# A dozen operations at 2^-53 each, some of which lose a digit by cancellation.
_RTOL = 1e-13


def _ramp(x: float, a: float, b: float, curve: Callable[[float], float]) -> float:
    """Return a step with SeExpr's own branches; `curve` maps (0, 1) to (0, 1)."""
    if a < b:
        return 0.0 if x < a else 1.0 if x >= b else curve((x - a) / (b - a))
    if a > b:
        return 1.0 if x <= b else 0.0 if x > a else curve(1.0 - (x - b) / (a - b))
    return 0.0 if x < a else 1.0


_linear = partial(_ramp, curve=lambda t: t)
_smooth = partial(_ramp, curve=lambda t: t * t * (3.0 - 2.0 * t))
_gauss = partial(_ramp, curve=lambda t: 2.0 ** (-8.0 * (1.0 - t) ** 2))


def _remap(x: float, source: float, span: float, falloff: float, interp: float) -> float:
    if falloff == 0.0:
        return float(abs(x - source) < abs(span))
    side = 1.0 if x > source else -1.0
    a = source + side * abs(span)
    return (_linear, _smooth, _gauss)[min(int(interp), 2)](x, a + side * abs(falloff), a)


def _bias(x: float, b: float) -> float:
    return x ** (math.log(b) / math.log(0.5))


def _contrast(x: float, c: float) -> float:
    return 0.5 * _bias(1.0 - c, 2.0 * x) if x < 0.5 else 1.0 - 0.5 * _bias(1.0 - c, 2.0 - 2.0 * x)


@pytest.mark.parametrize(
    ("name", "reference", "count"),
    [
        ("bias", _bias, 2),
        ("boxstep", lambda x, a: 0.0 if x < a else 1.0, 2),
        ("contrast", _contrast, 2),
        ("fit", lambda x, a1, b1, a2, b2: (x * (b2 - a2) - a1 * b2 + b1 * a2) / (b1 - a1), 5),
        ("gamma", lambda x, g: x ** (1.0 / g), 2),
        ("gaussstep", _gauss, 3),
        ("linearstep", _linear, 3),
        ("mix", lambda a, b, alpha: a * (1.0 - alpha) + b * alpha, 3),
        ("remap", lambda x, s, r, f, i: _remap(x, s, r, f, 3.0 * i), 5),
        ("smoothstep", _smooth, 3),
    ],
)
def test_formulas_are_those_of_seexpr(name: str, reference: Callable[..., float], count: int) -> None:
    arguments = np.random.default_rng(4).uniform(0.01, 0.99, (count, 500))
    values = [*arguments[:4], 3.0 * arguments[4]] if name == "remap" else arguments
    expected = [reference(*column) for column in arguments.T]
    # Where a difference of arguments divides, its rounding counts as much as its value is small: fit, at worst 1000.
    np.testing.assert_allclose(FUNCTIONS[name].evaluate(*values), expected, rtol=_RTOL, atol=1e-11)


def test_saturate_is_that_of_seexpr() -> None:
    values = np.random.default_rng(5).uniform(0.0, 2.0, (4, 200))
    gray = values[:3].T @ [0.2126, 0.7152, 0.0722]
    expected = np.maximum(gray * (1.0 - values[3]) + values[:3] * values[3], 0.0)
    np.testing.assert_allclose(shaping.saturate(tuple(values[:3]), values[3]), expected, rtol=_RTOL, atol=1e-15)


UNDEFINED = {
    "%": {(3.5, 0.0): 0.0, (-1.0, 3.0): 2.0},
    "^": {(0.0, 0.0): 1.0, (0.0, -1.0): 0.0, (-8.0, 3.0): -512.0, (-8.0, -2.0): 1.0 / 64.0, (-8.0, 0.5): 0.0},
    "sqrt": {(-1.0,): 0.0},
    "log": {(0.0,): math.log(1e-18), (-5.0,): math.log(1e-18)},
    "fit": {(0.3, 1.0, 1.0, 4.0, 5.0): 4.0},
    "linearstep": {(1.0, 1.0, 1.0): 1.0},
    "smoothstep": {(0.9, 1.0, 1.0): 0.0},
    "gaussstep": {(1.0, 1.0, 2.0): 0.0},
    "remap": {(0.5, 0.5, 0.0, 0.0, 0.0): 0.0},
    "contrast": {(1.5, 0.7): 1.0, (-0.5, 0.7): 0.0},
    "gamma": {(-0.5, 2.2): 0.0},
    "round": {(-2.5,): -3.0, (2.5,): 3.0},
}


@pytest.mark.parametrize("name", UNDEFINED)
def test_what_is_undefined_elsewhere_has_a_value(name: str) -> None:
    function = FUNCTIONS.get(name) or OPERATORS[name]
    for arguments, value in UNDEFINED[name].items():
        assert function.evaluate(*map(np.array, arguments)) == pytest.approx(value, rel=_RTOL), arguments


def test_whole_numbers_wrap_exactly_in_float32() -> None:
    # The largest that a hash makes is of 289, the lattice point beyond 288; coordinates can be negative.
    largest = (34 * 289 + 10) * 289
    numbers = np.arange(-largest, largest + 1)
    for period in (289, 12):
        wrapped = shaping._wrap_index(numbers.astype(np.float32), float(period))
        assert wrapped.dtype == np.float32
        np.testing.assert_array_equal(wrapped, numbers % period)


def test_every_lattice_point_of_a_line_has_a_hash_of_its_own() -> None:
    i = np.arange(289.0)
    for hashed in (shaping._hash(i, 5.0, 7.0), shaping._hash(5.0, i, 7.0), shaping._hash(5.0, 7.0, i)):
        np.testing.assert_array_equal(np.sort(hashed), i)


def _places(count: int, scale: float = 100.0) -> Any:
    return np.random.default_rng(6).uniform(-scale, scale, (3, count))


def test_noise_covers_its_range_evenly_around_the_middle() -> None:
    count = 100_000
    for dimensions in (1, 2, 3):
        values = shaping.noise(*_places(count)[:dimensions])
        deviation = values.std()
        assert 0.08 < deviation < 0.2
        # Six standard errors, were the values independent.
        assert abs(values.mean() - 0.5) < 6.0 * deviation / math.sqrt(count)
        # Along a line of one dimension, half a unit from two lattice points, it cannot go beyond a quarter.
        assert 0.0 <= values.min() < 0.26
        assert 0.74 < values.max() <= 1.0


def test_noise_of_fewer_coordinates_is_a_slice() -> None:
    x, y, _ = _places(100)
    np.testing.assert_array_equal(shaping.noise(x), shaping.noise(x, 0.0, 0.0))
    np.testing.assert_array_equal(shaping.noise(x, y), shaping.noise(x, y, 0.0))


def test_noise_is_smooth_across_the_lattice_and_periodic() -> None:
    np.testing.assert_array_equal(shaping.noise(*np.floor(_places(500))), 0.5)
    x, y, z = _places(500)
    step = 1e-4
    for function in (lambda s: shaping.noise(np.floor(x) + s, y, z), lambda s: shaping.noise(x, y, np.floor(z) + s)):
        below, at, above = function(-step), function(0.0), function(step)
        # The slope is below 2; the second derivative vanishes on the lattice from both sides, up to the step itself.
        assert np.abs(at - below).max() < 2.0 * step
        assert np.abs(above - 2.0 * at + below).max() < 100.0 * step**3 + 1e-15
    np.testing.assert_allclose(shaping.noise(x + 289.0, y - 289.0, z), shaping.noise(x, y, z), atol=1e-12)


def test_noise_looks_alike_along_every_axis() -> None:
    shift = 0.5
    places = _places(50_000)
    centered = shaping.noise(*places) - 0.5
    shifted = [shaping.noise(*(places + shift * axis[:, np.newaxis])) - 0.5 for axis in np.eye(3)]
    correlations = [np.mean(centered * other) / centered.var() for other in shifted]
    # A standard error of 1 / sqrt(count) each; six of them.
    assert np.ptp(correlations) < 6.0 / math.sqrt(50_000)


def test_cellnoise_is_flat_in_a_cell_and_even_over_many() -> None:
    x, y, z = _places(50_000)
    values = shaping.cellnoise(x, y, z)
    np.testing.assert_array_equal(values, shaping.cellnoise(np.floor(x), np.floor(y) + 0.75, z))
    counts = np.histogram(values, bins=17, range=(0.0, 1.0))[0]
    # 289 values in 17 bins: every bin 1/17, with six standard deviations.
    expected = 50_000 / 17
    assert np.abs(counts - expected).max() < 6.0 * math.sqrt(expected)
