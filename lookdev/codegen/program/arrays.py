"""Evaluate the f of a stack of layers fast on NumPy's arrays, in float64, for plots and the explorer.

The stack is traced and compiled to a program, which is faster than the models themselves. Constants are folded, and
equal expressions are computed once. Expressions that do not depend on the directions are computed once in a call. A
parameter that a user edits can stay a symbol. The same program then serves all values of the parameter.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf import Array, Real, StackLayer, stack_bsdf
from lookdev.brdf.mixture import Mixture
from lookdev.brdf.table import NumberTable, look_up
from lookdev.brdf.vectors import TINY, scale
from lookdev.codegen.program.writer import ProgramWriter
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.lobes import WI, WO, assume_positive, continuous_lobes
from lookdev.codegen.trace.symbolic import elements_of, symbols

PART_SIZE = 4096
"""The number of direction pairs in a part: the pairs of a part are computed together.

An array of 4096 numbers has 32 KiB, so the arrays of a program stay in the processor's cache.
"""


_ZENITH = np.array([[0.0], [0.0], [1.0]])


@cache
def _threads() -> ThreadPoolExecutor:
    """Return the pool of threads that compute the parts, one thread for each core."""
    return ThreadPoolExecutor(os.cpu_count(), thread_name_prefix="parts")


def run_in_parts(fill: Callable[[slice], None], count: int) -> None:
    """Divide `count` pairs of directions into parts, and call `fill` with the slice of each part.

    If there are several parts, they are computed on all cores.
    """
    parts = [slice(start, start + PART_SIZE) for start in range(0, count, PART_SIZE)]
    for _ in map(fill, parts) if len(parts) == 1 else _threads().map(fill, parts):
        pass


@dataclass(frozen=True)
class _Step:
    """One operation of a compiled program, the function `run`.

    `operands` are the numbers of the values that the step reads, and `result` is the number of the value that it
    computes. `dead` are the numbers of values that no later step reads. Their arrays can be freed after this step.
    """

    run: Callable[..., Array]
    operands: tuple[int, ...]
    result: int
    dead: tuple[int, ...] = ()


@dataclass(frozen=True)
class CompiledProgram:
    """The f of a stack of layers, compiled to steps.

    A value of the program is a constant, a symbol or the result of a step. Values are numbered.

    Attributes
    ----------
    shared_steps
        The steps that do not depend on the directions, which run once in a call.
    pair_steps
        The steps that run for each pair of directions.
    constants
        The constants, by the number of the value.
    symbols
        The numbers of the symbols, by the symbol's name.
    result
        The numbers of the three values that are the channels of f.
    two_sided
        Whether f is mirrored to a viewer below the surface. If not, f is 0 there.
    """

    shared_steps: tuple[_Step, ...]
    pair_steps: tuple[_Step, ...]
    constants: Mapping[int, float]
    symbols: Mapping[str, int]
    result: tuple[int, ...]
    two_sided: bool

    def f(self, wo: Floats, wi: Floats, symbol_values: Mapping[str, float]) -> Floats:
        """Return f (n, 3) for unit directions (n, 3) to viewer and light, as `lookdev.brdf.evaluate` does.

        `symbol_values` has the values of the symbols other than the directions, by name.
        """
        values_once: dict[int, Real] = {
            **self.constants,
            **{number: symbol_values[name] for name, number in self.symbols.items() if name in symbol_values},
        }
        for step in self.shared_steps:
            values_once[step.result] = step.run(*(values_once[number] for number in step.operands))
        # The numbers of the six components of wo and wi; negative for a component that the program does not read.
        symbol_numbers = [self.symbols.get(name, -1 - number) for number, name in enumerate((*WO, *WI))]
        out = np.empty((len(wo), 3))

        def fill(part: slice) -> None:
            columns = np.concatenate([wo[part].T, wi[part].T])  # (6, n): the components of wo, then those of wi
            if self.two_sided:
                columns *= np.where(columns[2] < 0.0, -1.0, 1.0)
            above = columns[2] > 0.0
            all_above = bool(above.all())
            if not all_above:
                columns[:3, ~above] = _ZENITH
            values = {**values_once, **dict(zip(symbol_numbers, columns, strict=True))}
            for step in self.pair_steps:
                values[step.result] = step.run(*(values[number] for number in step.operands))
                for number in step.dead:
                    del values[number]
            for channel, number in enumerate(self.result):
                out[part, channel] = values[number]
            if not all_above:
                out[part][~above] = 0.0

        run_in_parts(fill, len(wo))
        return out


def compile_layers(make_layers: Callable[[Graph], Sequence[StackLayer]]) -> CompiledProgram:
    """Trace and compile a stack of layers.

    `make_layers` gets a graph, and returns the layers, base first. Their parameters are constants, or symbols of this
    graph.

    Raises
    ------
    CodegenError
        The layers cannot be traced.
    """
    graph = Graph()
    bsdf = stack_bsdf(make_layers(graph))
    mixture = Mixture(continuous_lobes(graph, bsdf), symbols(graph, WO))
    assume_positive(graph, mixture.wo[..., 2])
    wi = symbols(graph, WI)
    cosine, total = np.abs(wi[..., 2]), np.zeros(3)
    for term in mixture.terms(wi):
        # A lobe's f is multiplied by the light's cosine to the lobe's own normal, but the result by the light's cosine
        # to the shading normal. The ratio of these cosines converts f. As in `lookdev.brdf.evaluate`, the ratio is
        # computed first.
        ratio = term.cosine / np.maximum(cosine, TINY * term.cosine)
        total = total + scale(term.f, np.where(term.valid, ratio, 0.0))
    writer = ProgramWriter()
    writer.add("f", elements_of(total))
    return _compile_program(writer, bsdf.two_sided)


def _compile_program(writer: ProgramWriter, two_sided: bool) -> CompiledProgram:
    """Return the compiled program of the output ``"f"`` of a writer."""
    varying: set[int] = set()  # the numbers of the values that depend on a direction
    constants: dict[int, float] = {}
    names: dict[str, int] = {}
    once: list[_Step] = []
    per_pair: list[_Step] = []
    for number, operation in enumerate(writer.operations):
        match operation.op:
            case "symbol":
                names[operation.name] = number
                varying |= {number} if operation.name in (*WO, *WI) else set()
            case "constant":
                constants[number] = operation.value
            case "truth":
                constants[number] = bool(operation.value)
            case "uniform":
                constants[number] = writer.constants[operation.index]
            case _:
                if is_varying := bool(varying.intersection(operation.operands)):
                    varying.add(number)
                run = (
                    _look_up_function(writer.tables[operation.index], operation.name)
                    if operation.op == "look_up"
                    else getattr(np, operation.op)
                )
                (per_pair if is_varying else once).append(_Step(run, operation.operands, number))
    result = writer.outputs["f"]
    return CompiledProgram(
        tuple(once), _mark_dead(per_pair, {*result, *constants, *names.values()}), constants, names, result, two_sided
    )


def _mark_dead(steps: Sequence[_Step], live: set[int]) -> tuple[_Step, ...]:
    """Return the steps with their `_Step.dead` values; the values numbered in `live` are never dead."""
    unread = {step.result for step in steps} - live
    steps_from_last: list[_Step] = []
    for step in reversed(steps):
        dead = unread.intersection((*step.operands, step.result))
        unread -= dead
        steps_from_last.append(_Step(step.run, step.operands, step.result, tuple(dead)))
    return tuple(reversed(steps_from_last))


def _look_up_function(table: NumberTable, channel: str) -> Callable[[Floats, Floats], Array]:
    """Return a function that looks up cells of a table by row and column.

    If the cells are colours, `channel` is the channel, ``"0"`` to ``"2"``, else ``""``.
    """
    channel_table = table if channel == "" else NumberTable(table.values[..., int(channel)])
    return lambda row, column: look_up(channel_table, np.asarray(row), np.asarray(column))
