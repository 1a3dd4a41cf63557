"""Derivatives of programs with respect to live inputs, against differences of the models, for every model."""

from typing import Any

import numpy as np
import pytest
from random_parameters import VARIANTS, directions, near_the_mirror_image, random_parameters
from test_codegen_symbolic import compute

from lookdev.brdf import MODELS, StackLayer, complete_parameters, evaluate_cosine, stack_bsdf
from lookdev.codegen.program.look import derivative_name, generate_program
from lookdev.codegen.source import ProgramSource
from lookdev.codegen.trace.derivatives import derivatives
from lookdev.codegen.trace.graph import OPERATIONS, Graph
from lookdev.errors import CodegenError, ModelError
from lookdev.material import Layer, Look
from lookdev.material.change import constant_named, is_live, look_with_live_inputs

COUNT = 200
STEP = 1e-5


@np.errstate(all="ignore")  # of branches that are not taken
def run(source: ProgramSource, symbols: dict[str, Any]) -> dict[str, Any]:
    """Return the elements (..., n) of each output: a program's operations have NumPy's names."""
    tables = [np.load(table.path).astype(np.float64) for table in source.tables]
    values: list[Any] = []
    for operation in source.operations:
        operands = [values[n] for n in operation.operands]
        match operation.op:
            case "constant" | "truth":
                values.append(bool(operation.value) if operation.op == "truth" else operation.value)
            case "uniform":
                values.append(source.constants[operation.index])
            case "symbol":
                values.append(symbols.get(operation.name, 0.5))  # symbols of other outputs
            case "look_up":
                cell = (operands[0] * int(operation.value) + operands[1]).astype(int)
                values.append(tables[operation.index][3 * cell + int(operation.name) if operation.name else cell])
            case op:
                values.append(getattr(np, op)(*operands))
    return {
        name: np.stack([np.broadcast_to(values[n], COUNT) for n in elements], axis=-1).astype(float)
        for name, elements in source.outputs.items()
    }


def _quick(number: int) -> bool:
    """Return whether a variant is the last of its model, whose optional parts are there, and fast."""
    return number + 1 == len(VARIANTS) or VARIANTS[number][0] != VARIANTS[number + 1][0]


@pytest.mark.parametrize(
    ("model", "tokens"),
    [pytest.param(*variant, marks=[] if _quick(n) else pytest.mark.proof) for n, variant in enumerate(VARIANTS)],
    ids=str,
)
def test_derivatives_are_those_of_differences(model: str, tokens: dict[str, str]) -> None:
    rng = np.random.default_rng(5)
    parameters = MODELS[model].parameters
    parameter_values = {name: value if isinstance(value, str) else value[0] for name, value in
             random_parameters(rng, model, tokens, 1, leaning=0.0).items()}  # fmt: skip
    numbers = {}
    for name, value in parameter_values.items():
        low, high = parameters[name].hard
        left_out = parameters[name].optional and bool(np.all(value == np.asarray(parameters[name].default)))
        if parameters[name].kind in ("float", "color") and not left_out:
            # Away from the ends, where pictures are not differentiable.
            numbers[name] = np.clip(value, low + 0.07 * (high - low), high - 0.07 * (high - low))
    tokens_of = {name: value for name, value in parameter_values.items() if isinstance(value, str)}
    plain = {n: float(v) if v.ndim == 0 else tuple(map(float, v)) for n, v in numbers.items()}
    look = Look("look", (Layer("Layer", model, {**tokens_of, **plain}),))
    live = {name: constant_named(look, name) for name in plain}
    source = generate_program(look_with_live_inputs(look, live), lambda texture: pytest.fail("no texture is read"))
    live_bindings = [binding for binding in source.attributes if is_live(binding.attribute)]
    bindings = {binding.attribute.rpartition(":")[2]: binding for binding in live_bindings}
    wo = directions(rng, COUNT)
    wi = near_the_mirror_image(rng, wo)
    symbols = {f"{w}_{axis}": vectors[:, i] for w, vectors in (("wo", wo), ("wi", wi)) for i, axis in enumerate("xyz")}
    symbols |= {s: x for n, binding in bindings.items() for s, x in zip(binding.symbols, live[n].value, strict=True)}
    symbols |= {"handed": 1.0}
    assert bindings.keys() <= live.keys()

    def values(name: str, channel: int, change: float) -> Any:
        changed = {n: np.array(v, float) for n, v in numbers.items()}
        changed[name][... if changed[name].ndim == 0 else channel] += change
        return evaluate_cosine(stack_bsdf([StackLayer(model, complete_parameters(model, tokens_of | changed))]), wo, wi)

    outputs, checked = run(source, symbols), 0
    for name, binding in bindings.items():
        for channel, symbol in enumerate(binding.symbols):
            derivatives = outputs[derivative_name("value", symbol)]
            assert np.isfinite(derivatives).all()
            size = max(abs(float(np.atleast_1d(numbers[name])[channel])), 1.0)
            # Richardson's extrapolation: the error of the difference is of the fourth order, 1e-20, and its rounding
            # 1e-16 / 1e-5; tables are pieces of planes, whose edges a few pairs straddle.
            wide, narrow = (
                (values(name, channel, h) - values(name, channel, -h)) / (2.0 * h)
                for h in (2 * STEP * size, STEP * size)
            )
            expected = (4.0 * narrow - wide) / 3.0
            scale = np.abs(expected) + np.abs(values(name, channel, 0.0)) + 1e-6 * np.abs(expected).max() + 1e-12
            assert np.quantile(np.abs(derivatives - expected) / scale, 0.98) < 2e-6, name
            checked += bool(derivatives.any())
    assert checked or model == "measured"


@pytest.mark.parametrize("op", sorted(OPERATIONS))
def test_each_operation_has_its_derivative(op: str) -> None:
    graph = Graph()
    a, b = graph.symbol("a"), graph.symbol("b")
    arity = getattr(getattr(np, op), "nin", 3)  # where is not a ufunc, and has three
    arguments = [graph.apply("greater", a, b), a, b][3 - arity :] if arity == 3 else [a, b][:arity]
    if op.startswith("logical"):
        return  # of conditions
    root = graph.apply(op, *arguments)
    x, y, h = 0.7, 0.4, 1e-6
    for name, (dx, dy) in {"a": (h, 0.0), "b": (0.0, h)}.items():
        (slope,) = derivatives(graph, [root], name)
        slope_value = compute(slope, {"a": x, "b": y}, {})
        above, below = (compute(root, {"a": x + k * dx, "b": y + k * dy}, {}) for k in (1.0, -1.0))
        assert float(slope_value) == pytest.approx((float(above) - float(below)) / (2.0 * h), abs=1e-8)


def test_an_angle_has_no_derivative_at_the_origin_but_0() -> None:
    graph = Graph()
    a, b = graph.symbol("a"), graph.symbol("b")
    (slope,) = derivatives(graph, [graph.apply("arctan2", a, b)], "a")
    with np.errstate(invalid="ignore"):  # of the branch that is not taken
        assert compute(slope, {"a": 0.0, "b": 0.0}, {}) == 0.0


def test_a_direction_that_turns_is_refused() -> None:
    look = Look("lens", (Layer("Lens", "glass", {"eta": 1.5}),))
    live = look_with_live_inputs(look, {"eta": constant_named(look, "eta")})
    with pytest.raises(CodegenError, match="changes the direction of a delta lobe"):
        generate_program(live, lambda texture: pytest.fail("no texture is read"))


@pytest.mark.parametrize(
    ("name", "words"), [("rougness", "did you mean"), ("normal", "is a normal"), ("variant", "is a token")]
)
def test_what_is_no_constant_is_refused(name: str, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        constant_named(Look("look", (Layer("Layer", "disney", {}),)), name)
