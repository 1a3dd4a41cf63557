"""Convert an expression graph into a list of `ProgramOperation`, with the constants and tables that they read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from lookdev.brdf.table import NumberTable
from lookdev.codegen.source import ProgramOperation
from lookdev.codegen.trace.graph import GraphNode, Scalar, Symbol, TableCell, Uniform, post_order
from lookdev.errors import CodegenError


@dataclass
class ProgramWriter:
    """Writes the nodes of a graph as operations, each node once, and collects what the operations read.

    `outputs` has the indices of the operations whose results are an output's components, by the output's name. Several
    outputs can depend on the operation of one node. `constants` are the values of uniforms, `tables` the tables that
    are looked up, `symbols` the names of symbols.
    """

    operations: list[ProgramOperation] = field(default_factory=list)
    outputs: dict[str, tuple[int, ...]] = field(default_factory=dict)
    constants: list[float] = field(default_factory=list)
    tables: list[NumberTable] = field(default_factory=list)
    symbols: set[str] = field(default_factory=set)
    # The indices of operations: by the node, or by the key of a constant that `_number` makes.
    _numbers: dict[object, int] = field(default_factory=dict)

    def add(self, name: str, roots: Sequence[Scalar]) -> None:
        """Write the nodes that `roots` depend on, and record `roots` as the components of the output `name`."""
        for node in post_order(roots):
            if node not in self._numbers:
                self._numbers[node] = self._append(self._operation(node))
        self.outputs[name] = tuple(map(self._number, roots))

    def _append(self, operation: ProgramOperation) -> int:
        """Append an operation, and return its index."""
        self.operations.append(operation)
        return len(self.operations) - 1

    def _operation(self, node: GraphNode) -> ProgramOperation:
        """Return the operation of a node whose operands have been written."""
        match node:
            case Symbol(name=name):
                self.symbols.add(name)
                return ProgramOperation("symbol", name=name)
            case TableCell(table=table, channel=channel, args=(row, column)):
                if table not in self.tables:
                    self.tables.append(table)
                table_number, columns = self.tables.index(table), table.values.shape[1]
                cell = (self._number(row), self._number(column))
                name = "" if channel is None else str(channel)
                return ProgramOperation("look_up", cell, value=float(columns), index=table_number, name=name)
            case _:
                return ProgramOperation(node.op, tuple(map(self._number, node.args)))

    def _number(self, value: Scalar) -> int:
        """Return the index of the operation of a node or a constant; the operation of a new constant is appended."""
        if isinstance(value, GraphNode):
            return self._numbers[value]
        # The key contains the type, as True == 1.0 in Python, and the text, as 0.0 == -0.0.
        key = (isinstance(value, Uniform), type(value).__name__, str(value))
        if key not in self._numbers:
            if not np.isfinite(value):
                raise CodegenError(f"a constant folded to {value}; the model leaves its domain")
            if isinstance(value, Uniform):
                self.constants.append(float(value))
                operation = ProgramOperation("uniform", index=len(self.constants) - 1)
            else:
                operation = ProgramOperation(
                    "truth" if isinstance(value, bool | np.bool_) else "constant", value=float(value)
                )
            self._numbers[key] = self._append(operation)
        return self._numbers[key]
