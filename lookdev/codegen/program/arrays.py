"""A traced BSDF run on NumPy's arrays: the folded graph in float64, faster than the model that it was traced from.

Constants are folded, equal expressions computed once, and what does not depend on the directions once a call. For an
editor, numbers stay symbols, and one trace serves all their values.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lookdev.brdf import StackLayer, stack_bsdf
from lookdev.brdf.mixture import Mixture
from lookdev.brdf.table import Table, look_up
from lookdev.brdf.vectors import TINY, scale
from lookdev.codegen.program.written import Written
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.lobes import WI, WO, assume_positive, continuous_lobes
from lookdev.codegen.trace.symbolic import elements_of, symbols

Floats = NDArray[np.float64]

PART = 4096
"""Pairs of directions at once: an array of so many numbers has 32 KiB, so that a program's arrays stay in a cache."""


_ZENITH = np.array([[0.0], [0.0], [1.0]])


@cache
def threads() -> ThreadPoolExecutor:
    """Return the threads that compute parts, one for each core."""
    return ThreadPoolExecutor(os.cpu_count(), thread_name_prefix="parts")


@dataclass(frozen=True)
class _Step:
    """An operation: the places of its operands and result, and the places that nothing after it reads."""

    run: Callable[..., Any]
    operands: tuple[int, ...]
    place: int
    dead: tuple[int, ...] = ()


@dataclass(frozen=True)
class Compiled:
    """f of a stack of layers as a program over directions, by the numbers that are its symbols."""

    once: tuple[_Step, ...]
    each: tuple[_Step, ...]
    constants: Mapping[int, Any]
    symbols: Mapping[str, int]
    result: tuple[int, ...]
    two_sided: bool

    def f(self, wo: Floats, wi: Floats, numbers: Mapping[str, float]) -> Floats:
        """Return f (n, 3) as `lookdev.brdf.evaluate` of the layers with these numbers, for directions (n, 3)."""
        held = {**self.constants, **{place: numbers[name] for name, place in self.symbols.items() if name in numbers}}
        for step in self.once:
            held[step.place] = step.run(*(held[each] for each in step.operands))
        # What is not read has a place of its own.
        places = [self.symbols.get(name, -1 - number) for number, name in enumerate((*WO, *WI))]
        out = np.empty((len(wo), 3))

        def fill(start: int) -> None:
            part = slice(start, start + PART)
            columns = np.concatenate([wo[part].T, wi[part].T])
            if self.two_sided:
                columns *= np.where(columns[2] < 0.0, -1.0, 1.0)
            above = columns[2] > 0.0
            seen = bool(above.all())
            if not seen:
                columns[:3, ~above] = _ZENITH
            values = {**held, **dict(zip(places, columns, strict=True))}
            for step in self.each:
                values[step.place] = step.run(*(values[each] for each in step.operands))
                for each in step.dead:
                    del values[each]
            for channel, place in enumerate(self.result):
                out[part, channel] = values[place]
            if not seen:
                out[part][~above] = 0.0

        starts = range(0, len(wo), PART)
        if len(starts) == 1:
            fill(0)
        else:
            for _ in threads().map(fill, starts):
                pass
        return out


def compile_layers(make: Callable[[Graph], Sequence[StackLayer]]) -> Compiled:
    """Trace layers of a graph, base first, whose numbers are constants or symbols; a CodegenError as of the trace."""
    graph = Graph()
    bsdf = stack_bsdf(make(graph))
    mixture = Mixture(continuous_lobes(graph, bsdf), symbols(graph, WO))
    assume_positive(graph, mixture.wo[..., 2])
    wi = symbols(graph, WI)
    cosine, total = np.abs(wi[..., 2]), np.zeros(3)
    for term in mixture.terms(wi):
        # As in `lookdev.brdf.evaluate`: the quotient first.
        ratio = term.cosine / np.maximum(cosine, TINY * term.cosine)
        total = total + scale(term.f, np.where(term.valid, ratio, 0.0))
    written = Written()
    written.add("f", elements_of(total))
    return _program(written, bsdf.two_sided)


def _program(written: Written, two_sided: bool) -> Compiled:
    directed: set[int] = set()
    constants: dict[int, Any] = {}
    names: dict[str, int] = {}
    once: list[_Step] = []
    each: list[_Step] = []
    for number, operation in enumerate(written.operations):
        match operation.op:
            case "symbol":
                names[operation.name] = number
                directed |= {number} if operation.name in (*WO, *WI) else set()
            case "constant":
                constants[number] = operation.value
            case "truth":
                constants[number] = bool(operation.value)
            case "uniform":
                constants[number] = written.constants[operation.place]
            case _:
                if varies := bool(directed.intersection(operation.operands)):
                    directed.add(number)
                run = (
                    _looked_up(written.tables[operation.place], operation.name)
                    if operation.op == "look_up"
                    else getattr(np, operation.op)
                )
                (each if varies else once).append(_Step(run, operation.operands, number))
    result = written.outputs["f"]
    return Compiled(
        tuple(once), _freeing(each, {*result, *constants, *names.values()}), constants, names, result, two_sided
    )


def _freeing(steps: Sequence[_Step], kept: set[int]) -> tuple[_Step, ...]:
    """Return the steps with the places of theirs that are dead after each."""
    mine = {step.place for step in steps} - kept
    found: list[_Step] = []
    for step in reversed(steps):
        dead = mine.intersection((*step.operands, step.place))
        mine -= dead
        found.append(_Step(step.run, step.operands, step.place, tuple(dead)))
    return tuple(reversed(found))


def _looked_up(table: Table, channel: str) -> Callable[[Any, Any], Any]:
    one = table if channel == "" else Table(table.values[..., int(channel)])
    return lambda row, column: look_up(one, np.asarray(row), np.asarray(column))
