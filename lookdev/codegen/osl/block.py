"""Expression graphs as OSL text, by scopes.

A table is a parameter that is an array if `fits_array`, else a texture.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping

import numpy as np

from lookdev.brdf.table import NumberTable
from lookdev.codegen.operators import BOOLEAN_OPERATIONS, CODE, strip_parentheses
from lookdev.codegen.trace.graph import GraphNode, Scalar, Symbol, TableCell, Uniform, post_order, reachable_nodes
from lookdev.errors import CodegenError

# Cycles loads this number of values in four seconds.
_MAX_ARRAY_SIZE = 10_000_000

# Longer expressions get a name, so that the generated shader can be read.
_MAX_INLINE = 70


def literal(value: float | bool) -> str:
    """Return the literal of a constant; a number that is not finite has none in OSL and raises CodegenError."""
    if isinstance(value, bool | np.bool_):
        return "1" if value else "0"
    if not np.isfinite(value):
        raise CodegenError(f"a constant folded to {value}; the model leaves its domain")
    return repr(float(value))


SymbolText = Callable[["str | Uniform"], str]
"""A function from a symbol or a uniform to its text; it is called in the order in which the code is written."""


def plain_symbol_text(value: str | Uniform) -> str:
    """Return the name of a symbol, or the literal of a uniform."""
    return literal(value) if isinstance(value, Uniform) else value


def fits_array(table: NumberTable) -> bool:
    """Return whether a table is small enough for an array.

    A look-up in an array takes a fortieth of the time of one in a texture, but Cycles loads the array as text.
    """
    return table.values.size <= _MAX_ARRAY_SIZE


def table_name(table: NumberTable) -> str:
    """Return the name of the shader's parameter for a table, or for the path of its texture."""
    return f"table_{table.digest[:16]}{'' if fits_array(table) else '_file'}"


def texture_size(table: NumberTable) -> tuple[int, int]:
    """Return width and height of a table's texture, powers of two, so that texel centres are exact in float32."""
    rows, columns = (1 << (size - 1).bit_length() for size in table.values.shape[:2])
    return columns, rows


class Block:
    """One scope of emitted code: nodes used more than once become variables, others are inline.

    `variables` are the names of variables by node, also those of the scopes around.
    """

    def __init__(
        self,
        prefix: str,
        indent: int,
        variables: Mapping[GraphNode, str] | None = None,
        symbol_text: SymbolText = plain_symbol_text,
    ) -> None:
        self.lines: list[str] = []
        self.variables = dict(variables or {})
        self._prefix = prefix
        self._pad = "    " * indent
        self._symbol_text = symbol_text
        self._uses: Counter[GraphNode] = Counter()
        self._preset_names: dict[GraphNode, str] = {}
        self._cells: dict[tuple[str, str, str], str] = {}

    def inner_block(self, prefix: str, indent: int) -> Block:
        """Return a scope inside this one, which starts with the variables that this one has now."""
        inner = Block(prefix, indent, self.variables, self._symbol_text)
        inner._cells = dict(self._cells)
        return inner

    def write(self, text: str) -> None:
        """Append one line of code, indented."""
        self.lines.append(self._pad + text)

    def define(self, name: str, value: Scalar, comment: str = "") -> None:
        """Compute a number into a variable of that name."""
        if isinstance(value, GraphNode) and value.op != "symbol" and value not in self.variables:
            self._preset_names[value] = name
            self.name(value)
        else:
            self.write(f"float {name} = {self.expression(value)};")
        self.lines[-1] += f"  // {comment}" if comment else ""

    def prepare(self, roots: Iterable[Scalar]) -> None:
        """Count uses of nodes under `roots`, all expressions of this block, so that shared nodes become variables."""
        roots = list(roots)
        for node in reachable_nodes(roots, stop=self.variables):
            if node not in self.variables:
                self._uses.update(node.operands())
        self._uses.update(root for root in roots if isinstance(root, GraphNode))

    def name(self, value: Scalar) -> str:
        """Write a variable for `value` unless it has one; return the variable's name, or the literal of a constant."""
        code = self.expression(value)
        if isinstance(value, GraphNode) and value.op != "symbol" and value not in self.variables:
            self._define(value, code)
            return self.variables[value]
        return code

    def expression(self, value: Scalar) -> str:
        """Return code for `value`; the variables that it needs are written first."""
        inline: dict[GraphNode, str] = {}

        def code_of(part: Scalar) -> str:
            if isinstance(part, Uniform):
                return self._symbol_text(part)
            if not isinstance(part, GraphNode):
                return literal(part)
            return self.variables.get(part) or inline[part]

        for node in post_order([value], stop=lambda node: node in self.variables):
            if isinstance(node, Symbol):
                inline[node] = self._symbol_text(node.name)
                continue
            if isinstance(node, TableCell):
                inline[node] = self._look_up_code(node.table, node.channel, *map(code_of, node.args))
                continue
            code = CODE[node.op].format(*(code_of(arg) for arg in node.args))
            if self._uses[node] > 1 or len(code) > _MAX_INLINE:
                self._define(node, code)
            else:
                inline[node] = code
        return code_of(value)

    def _look_up_code(self, table: NumberTable, channel: int | None, row: str, column: str) -> str:
        """Return code for a number of a table; the cell's index or colour, which channels share, is written first."""
        name, key = table_name(table), (table.digest, row, column)
        cell = self._cells.get(key)
        if cell is None:
            cell = self._cells[key] = f"{self._prefix}cell{len(self._cells)}"
            if fits_array(table):
                factor = 1 if channel is None else 3
                self.write(f"int {cell} = {factor} * (int({row}) * {table.values.shape[1]} + int({column}));")
            else:
                width, height = texture_size(table)
                self.write(f"color {cell} = lookdev_texel({name}, {column}, {row}, {width}, {height});")
        if fits_array(table):
            return f"{name}[{cell}{f' + {channel}' if channel else ''}]"
        return f"{cell}[{channel or 0}]"

    def _define(self, node: GraphNode, code: str) -> None:
        """Write a variable that has the value of a node."""
        name = self._preset_names.get(node, f"{self._prefix}{len(self.variables)}")
        kind = "int" if node.op in BOOLEAN_OPERATIONS else "float"
        self.write(f"{kind} {name} = {strip_parentheses(code)};")
        self.variables[node] = name
