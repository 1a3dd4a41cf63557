"""Expression graphs as OSL text, by scopes.

A table is an array of the shader's parameters where `fits`, else a texture."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from lookdev.brdf.table import Table
from lookdev.codegen.trace.graph import Node, Scalar, Uniform, post_order, reachable
from lookdev.errors import CodegenError

CODE: dict[str, str] = {
    "add": "({} + {})",
    "subtract": "({} - {})",
    "multiply": "({} * {})",
    "divide": "({} / {})",
    "negative": "(-{})",
    "absolute": "fabs({})",
    "sqrt": "sqrt({})",
    "exp": "exp({})",
    "expm1": "expm1({})",
    "log": "log({})",
    "sin": "sin({})",
    "cos": "cos({})",
    "tan": "tan({})",
    "arctan2": "atan2({}, {})",
    "floor": "floor({})",
    "power": "pow({}, {})",
    "maximum": "max({}, {})",
    "minimum": "min({}, {})",
    "greater": "({} > {})",
    "greater_equal": "({} >= {})",
    "less": "({} < {})",
    "less_equal": "({} <= {})",
    "equal": "({} == {})",
    "logical_and": "({} && {})",
    "logical_or": "({} || {})",
    "logical_not": "(!{})",
    "where": "({} ? {} : {})",
}

_BOOLEAN = {"greater", "greater_equal", "less", "less_equal", "equal", "logical_and", "logical_or", "logical_not"}

# Ten million numbers are loaded in four seconds.
_LARGEST_ARRAY = 10_000_000

# Longer expressions get a name, so that the generated shader can be read.
_MAX_INLINE = 70


def literal(value: float | bool) -> str:
    """Write a constant; a CodegenError if it is not finite, which has no literal in OSL."""
    if isinstance(value, bool | np.bool_):
        return "1" if value else "0"
    if not np.isfinite(value):
        raise CodegenError(f"a constant folded to {value}; the model leaves its domain")
    return repr(float(value))


def bare(code: str) -> str:
    """Return the code of an expression without parentheses around all of it."""
    return code[1:-1] if code.startswith("(") and code.endswith(")") else code


Spell = Callable[["str | Uniform"], str]
"""Returns the text of a symbol, or of a uniform; it is called when that is written."""


def by_name(value: str | Uniform) -> str:
    """Spell a symbol by its name, a uniform as the number that it is."""
    return literal(value) if isinstance(value, Uniform) else value


def fits(table: Table) -> bool:
    """Return whether a table is an array: a look-up takes a fortieth of one in a texture, but its text is loaded."""
    return table.values.size <= _LARGEST_ARRAY


def table_name(table: Table) -> str:
    """Return the name of a shader's parameter that has a table, or the path of its texture."""
    return f"table_{table.digest[:16]}{'' if fits(table) else '_file'}"


def texture_size(table: Table) -> tuple[int, int]:
    """Return width and height of a table's texture, powers of two, so that texel centres are exact in float32."""
    rows, columns = (1 << (each - 1).bit_length() for each in table.values.shape[:2])
    return columns, rows


class Block:
    """One scope of emitted code: nodes used more than once become variables, which are `named`, others are inline."""

    def __init__(
        self, prefix: str, indent: int, named: Mapping[Node, str] | None = None, spell: Spell = by_name
    ) -> None:
        self.lines: list[str] = []
        self.named = dict(named or {})
        self._prefix = prefix
        self._pad = "    " * indent
        self._spell = spell
        self._uses: Counter[Node] = Counter()
        self._chosen: dict[Node, str] = {}
        self._cells: dict[tuple[Any, ...], str] = {}

    def inner(self, prefix: str, indent: int) -> Block:
        """Return a scope inside this one, with the names that this one has now."""
        inner = Block(prefix, indent, self.named, self._spell)
        inner._cells = dict(self._cells)
        return inner

    def write(self, text: str) -> None:
        """Append one line of code as it is."""
        self.lines.append(self._pad + text)

    def define(self, name: str, value: Scalar, comment: str = "") -> None:
        """Compute a number into a variable of that name."""
        if isinstance(value, Node) and value.op != "symbol" and value not in self.named:
            self._chosen[value] = name
            self.name(value)
        else:
            self.write(f"float {name} = {self.expression(value)};")
        self.lines[-1] += f"  // {comment}" if comment else ""

    def prepare(self, roots: Iterable[Any]) -> None:
        """Count uses under `roots`, all the expressions of this block, so that shared nodes get a name."""
        roots = list(roots)
        for node in reachable(roots, stop=self.named):
            if node not in self.named:
                self._uses.update(node.operands())
        self._uses.update(root for root in roots if isinstance(root, Node))

    def name(self, value: Scalar) -> str:
        """Compute `value` into a variable of its own; return the variable's name, or the literal of a constant."""
        code = self.expression(value)
        if isinstance(value, Node) and value.op != "symbol" and value not in self.named:
            self._define(value, code)
            return self.named[value]
        return code

    def expression(self, value: Scalar) -> str:
        """Return code for `value`, writing the variables it needs first."""
        inline: dict[Any, str] = {}

        def shown(part: Any) -> str:
            if isinstance(part, Uniform):
                return self._spell(part)
            if not isinstance(part, Node):
                return literal(part)
            return self.named.get(part) or inline[part]

        for node in post_order([value], stop=lambda node: node in self.named):
            if node.op == "symbol":
                inline[node] = self._spell(str(node.args[0]))
                continue
            if node.op == "look_up":
                table, channel, *place = node.args
                inline[node] = self._looked_up(table, channel, *map(shown, place))
                continue
            code = CODE[node.op].format(*(shown(arg) for arg in node.args))
            if self._uses[node] > 1 or len(code) > _MAX_INLINE:
                self._define(node, code)
            else:
                inline[node] = code
        return shown(value)

    def _looked_up(self, table: Table, channel: int | None, row: str, column: str) -> str:
        """Return code for a number of a table, writing the place, or the look-up, that all channels of it share."""
        name, key = table_name(table), (table.digest, row, column)
        cell = self._cells.get(key)
        if cell is None:
            cell = self._cells[key] = f"{self._prefix}cell{len(self._cells)}"
            if fits(table):
                factor = 1 if channel is None else 3
                self.write(f"int {cell} = {factor} * (int({row}) * {table.values.shape[1]} + int({column}));")
            else:
                width, height = texture_size(table)
                self.write(f"color {cell} = lookdev_texel({name}, {column}, {row}, {width}, {height});")
        if fits(table):
            return f"{name}[{cell}{f' + {channel}' if channel else ''}]"
        return f"{cell}[{channel or 0}]"

    def _define(self, node: Node, code: str) -> None:
        name = self._chosen.get(node, f"{self._prefix}{len(self.named)}")
        kind = "int" if node.op in _BOOLEAN else "float"
        self.write(f"{kind} {name} = {bare(code)};")
        self.named[node] = name
