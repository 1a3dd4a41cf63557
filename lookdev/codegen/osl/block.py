"""Write expression graphs as OSL text; a `Block` is one scope of braces, with its variables.

A table of numbers that the code looks up is a parameter of the shader: an array if `fits_array`, else the path of a
texture.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping

import numpy as np

from lookdev.brdf.table import NumberTable
from lookdev.codegen.operators import BOOLEAN_OPERATIONS, CODE, strip_parentheses
from lookdev.codegen.trace.graph import GraphNode, Scalar, Symbol, TableCell, Uniform, post_order, reachable_nodes
from lookdev.errors import CodegenError

# The largest number of values in an array. Cycles loads an array of this size in four seconds.
_MAX_ARRAY_SIZE = 10_000_000

# The largest number of characters of an inline expression. A longer one becomes a variable, so that people can read the
# generated shader.
_MAX_INLINE = 70


def literal(value: float | bool) -> str:
    """Return the OSL literal of a constant; raise CodegenError if the constant is not finite."""
    if isinstance(value, bool | np.bool_):
        return "1" if value else "0"
    if not np.isfinite(value):
        raise CodegenError(f"a constant folded to {value}; the model leaves its domain")
    return repr(float(value))


SymbolText = Callable[["str | Uniform"], str]
"""A function that returns the text of a symbol, given by its name, or of a uniform.

It is called in the order in which the code is written.
"""


def plain_symbol_text(value: str | Uniform) -> str:
    """Return the name of a symbol, or the literal of a uniform."""
    return literal(value) if isinstance(value, Uniform) else value


def fits_array(table: NumberTable) -> bool:
    """Return whether a table is small enough for an array.

    A look-up in an array takes a fortieth of the time of a look-up in a texture, but Cycles loads arrays as text.
    """
    return table.values.size <= _MAX_ARRAY_SIZE


def table_name(table: NumberTable) -> str:
    """Return the name of the shader's parameter for a table: the array, or the path of the texture."""
    return f"table_{table.digest[:16]}{'' if fits_array(table) else '_file'}"


def texture_size(table: NumberTable) -> tuple[int, int]:
    """Return the width and the height of a table's texture in texels.

    They are powers of two, so that texel centres are exact in float32.
    """
    rows, columns = (1 << (size - 1).bit_length() for size in table.values.shape[:2])
    return columns, rows


class Block:
    """One scope of emitted code. Nodes of the graph that are used more than once become variables, others are inline.

    `lines` is the code. `variables` has the names of this scope's variables and of the variables of the enclosing
    scopes, by the node whose value they have. The names of this scope's own variables begin with `prefix`.
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
        # How often the code uses each node; the names that `define` gives to nodes; and the names of variables for a
        # table's cell, by the table's digest and the code of the row and the column.
        self._uses: Counter[GraphNode] = Counter()
        self._preset_names: dict[GraphNode, str] = {}
        self._cells: dict[tuple[str, str, str], str] = {}

    def inner_block(self, prefix: str, indent: int) -> Block:
        """Return a scope inside this one. It can read the variables that this scope has now."""
        inner = Block(prefix, indent, self.variables, self._symbol_text)
        inner._cells = dict(self._cells)
        return inner

    def write(self, text: str) -> None:
        """Append one line of code, indented."""
        self.lines.append(self._pad + text)

    def define(self, name: str, value: Scalar, comment: str = "") -> None:
        """Write a float variable `name` that has a number's value."""
        if isinstance(value, GraphNode) and value.op != "symbol" and value not in self.variables:
            self._preset_names[value] = name
            self.name(value)
        else:
            self.write(f"float {name} = {self.expression(value)};")
        self.lines[-1] += f"  // {comment}" if comment else ""

    def prepare(self, roots: Iterable[Scalar]) -> None:
        """Count how often this block uses each node, so that nodes used more than once become variables.

        `roots` are all expressions that the block will write.
        """
        roots = list(roots)
        for node in reachable_nodes(roots, stop=self.variables):
            if node not in self.variables:
                self._uses.update(node.operands())
        self._uses.update(root for root in roots if isinstance(root, GraphNode))

    def name(self, value: Scalar) -> str:
        """Return the name of the variable that has `value`; write the variable if there is none.

        Constants and symbols need no variable: for them, return their text.
        """
        code = self.expression(value)
        if isinstance(value, GraphNode) and value.op != "symbol" and value not in self.variables:
            self._define(value, code)
            return self.variables[value]
        return code

    def expression(self, value: Scalar) -> str:
        """Return the OSL expression of `value`, and write the variables that the expression reads."""
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
        """Return the OSL expression of a number in a table's cell, or of one channel of the colour there.

        A variable with the cell's index in the array, or with the texel's colour, is written first: the channels of a
        cell share it. `row` and `column` are OSL expressions.
        """
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
