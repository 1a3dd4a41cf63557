"""Runs the programs of looks and lights on Dr.Jit's arrays, which traces and compiles them as parts of a kernel.

A program is a list of operations on numbers (`lookdev.codegen.source.ProgramSource`). An operation reads the results of
earlier operations, by their numbers in the list. Inputs are symbols with names; outputs are groups of results with
names.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import drjit as dr

from lookdev.codegen.source import ProgramOperation
from lookdev.mitsuba.types import AnyArray, Float

VARYING = frozenset(("wi_x", "wi_y", "wi_z", "u1", "u2"))
"""The symbols whose values vary between the directions at one point: light directions, and random numbers."""


def _expm1(x: Float) -> Float:
    """Return exp(x) - 1 without cancellation, by Higham 2002, "Accuracy and Stability", section 1.14.1."""
    e = dr.exp(x)
    power = dr.log(e)
    return dr.select(e == 1.0, x, dr.select(e - 1.0 == -1.0, -1.0, (e - 1.0) * x / power))


OPERATIONS: Mapping[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a / b,
    "negative": lambda a: -a,
    "absolute": dr.abs,
    "sqrt": dr.sqrt,
    "exp": dr.exp,
    "expm1": _expm1,
    "log": dr.log,
    "sin": dr.sin,
    "cos": dr.cos,
    "tan": dr.tan,
    "arctan2": dr.atan2,
    "floor": dr.floor,
    "power": dr.power,
    "maximum": dr.maximum,
    "minimum": dr.minimum,
    "greater": lambda a, b: a > b,
    "greater_equal": lambda a, b: a >= b,
    "less": lambda a, b: a < b,
    "less_equal": lambda a, b: a <= b,
    "equal": lambda a, b: a == b,
    "logical_and": lambda a, b: a & b,
    "logical_or": lambda a, b: a | b,
    "logical_not": lambda a: ~a,
    "where": dr.select,
}
"""The functions of the operations that `lookdev.codegen.trace` traces, by the names that NumPy has for them."""


@dataclass(frozen=True, eq=False)
class Program:
    """A program, with its constants and tables as arrays of Dr.Jit."""

    operations: Sequence[ProgramOperation]
    outputs: Mapping[str, tuple[int, ...]]  # the operations that compute the elements of each output, by its name
    number: type[Float]  # the type of all numbers, a float type of Dr.Jit
    constants: Sequence[Float] = ()
    tables: Sequence[Float] = ()
    needs: Mapping[str, tuple[int, ...]] = field(init=False)  # all operations that each output depends on, in order
    varying: frozenset[int] = field(init=False)  # the operations that depend on a symbol in `VARYING`

    def __post_init__(self) -> None:
        varying: set[int] = set()
        for number, operation in enumerate(self.operations):
            if operation.name in VARYING or varying.intersection(operation.operands):
                varying.add(number)
        object.__setattr__(self, "varying", frozenset(varying))
        needs = {name: _dependencies(self.operations, roots) for name, roots in self.outputs.items()}
        object.__setattr__(self, "needs", needs)


def _dependencies(operations: Sequence[ProgramOperation], roots: Sequence[int]) -> tuple[int, ...]:
    """Return the numbers of the operations that the `roots` depend on, roots included, in ascending order."""
    reached: set[int] = set()
    pending = list(roots)
    while pending:
        if (number := pending.pop()) not in reached:
            reached.add(number)
            pending += operations[number].operands
    return tuple(sorted(reached))


class Evaluation:
    """A program at points of a surface. It stores computed results, except those that vary between directions.

    `symbol` returns the value of a symbol, by name.
    """

    def __init__(self, program: Program, symbol: Callable[[str], AnyArray | float]) -> None:
        self._program = program
        self._symbol = symbol
        self._values: dict[int, Any] = {}

    def has(self, name: str) -> bool:
        """Return whether the program has an output of this name."""
        return name in self._program.needs

    def values(self, name: str, **inputs: AnyArray) -> tuple[Float, ...]:
        """Return the elements of an output. `inputs` has the values of the symbols that vary between directions."""
        program = self._program
        local: dict[int, Any] = {}
        for number in program.needs[name]:
            store = local if number in program.varying else self._values
            if number not in store:
                store[number] = self._compute(program.operations[number], local, inputs)
        return tuple(local[n] if n in local else self._values[n] for n in program.outputs[name])

    def prepare(self, *names: str) -> None:
        """Compute and store all results that the named outputs need and that do not vary between directions."""
        for name in names:
            for number in self._program.needs[name]:
                if number not in self._program.varying and number not in self._values:
                    self._values[number] = self._compute(self._program.operations[number], {}, {})

    def _compute(self, operation: ProgramOperation, local: Mapping[int, Any], inputs: Mapping[str, AnyArray]) -> object:
        """Return the result of an operation; `local` has the results that vary between directions."""
        program = self._program
        match operation.op:
            case "constant":
                return program.number(operation.value)
            case "truth":
                return dr.mask_t(program.number)(bool(operation.value))
            case "uniform":
                return program.constants[operation.index]
            case "symbol":
                return inputs[operation.name] if operation.name in inputs else self._symbol(operation.name)
        operands = [local[n] if n in local else self._values[n] for n in operation.operands]
        if operation.op != "look_up":
            return OPERATIONS[operation.op](*operands)
        whole = dr.uint32_array_t(program.number)
        cell = whole(operands[0]) * int(operation.value) + whole(operands[1])
        if operation.name:
            cell = 3 * cell + int(operation.name)
        return dr.gather(program.number, program.tables[operation.index], cell)
