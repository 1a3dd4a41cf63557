"""Functions of lamps as operations: the shapes of `lookdev.light`, traced, by the numbers of a lamp's row."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cache
from typing import Any

import numpy as np

from lookdev.codegen.program.written import Written
from lookdev.codegen.source import Operation
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols
from lookdev.light.emission import cone_factor, falloff_factor, focus_factor, off_axis
from lookdev.light.lamps import SHAPES, weight


@cache
def lamp_operations(kind: str, *, shaped: bool, falling: bool) -> tuple[list[Operation], Mapping[str, tuple[int, ...]]]:
    """Return the operations of the functions of a kind of lamp, and the results of each function.

    ``weight`` is `lookdev.light.lamps.weight` times the mean radiance, of a place p and a normal n; ``meet`` distance
    and density of a direction w from p; ``draw`` a direction by u1 and u2, its distance and density; ``sent`` the
    radiance that arrives at p along -w. Symbols are `lookdev.light.lamps.FIELDS` by their names, and components of p,
    w and n. A lamp that is not `shaped` sends alike in all directions; one that is not `falling` has no falloff.
    """
    graph, written = Graph(), Written()
    falling = falling and kind != "distant"  # which is infinitely far

    def numbers(*names: str) -> tuple[Any, ...]:
        return tuple(symbol(graph, name) for name in names)

    def vector(name: str) -> Any:
        return symbols(graph, [f"{name}[{i}]" for i in range(3)])

    shape = SHAPES[kind](*numbers(*("a", "b")[: len(fields(SHAPES[kind]))]))
    p, w, n = map(vector, "pwn")
    cone, fall = numbers("cone", "start", "rise", "focus"), numbers("virtual", "power", "fade", "fade_rise")
    tint, (mean,) = symbols(graph, ["tint0", "tint1", "tint2"]), numbers("mean")
    beam = (*cone, tint.sum(axis=-1) / 3.0) if shaped else None
    sent: Any = symbols(graph, ["red", "green", "blue"])
    if shaped:
        within = cone_factor(off_axis(w), *cone[:3])
        sent = sent * np.expand_dims(within, -1) * focus_factor(w[..., 2], cone[3], tint)
    if falling:
        sent = sent * np.expand_dims(falloff_factor(np.sqrt((p * p).sum(axis=-1)), *fall), -1)
    drawn = shape.sample(p, symbols(graph, ["u1", "u2"]))
    outputs: dict[str, Callable[[], list[Any]]] = {
        "weight": lambda: elements_of(mean * weight(shape, beam, fall if falling else None, p, n)),
        "meet": lambda: [*elements_of(shape.distance(p, w)), *elements_of(shape.pdf(p, w))],
        "draw": lambda: [
            *elements_of(drawn),
            *elements_of(shape.distance(p, drawn)),
            *elements_of(shape.pdf(p, drawn)),
        ],
        "sent": lambda: elements_of(sent),
    }
    for name, traced in outputs.items():
        written.add(name, traced())
    assert not written.constants, "lamps have no uniforms"
    return written.operations, written.outputs
