"""Write a program, a list of `ProgramOperation`, as functions of GLSL ES 3.00, for `look` and `rig` of this package.

Each operation becomes a line, and the browser's compiler optimizes the lines further.

Numbers are float32. For `sin`, `cos` and `atan`, GLSL requires only three or four digits, and implementations do not
give more. `pow` and `atan` are undefined for some arguments for which NumPy has values. GLSL has no `expm1`.
``PRELUDE`` therefore defines replacements. The replacements of the angle functions reduce the argument to an eighth of
a turn or less, and then sum a series that is accurate to the last place of float32.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from lookdev.codegen.operators import BOOLEAN_OPERATIONS, CODE, strip_parentheses
from lookdev.codegen.program.writer import ProgramWriter
from lookdev.codegen.source import ProgramOperation, ProgramSource
from lookdev.errors import CodegenError

TABLE_WIDTH = 2048
"""The width in texels of the texture that holds a table's numbers, one per texel (R32F), row after row."""

PRELUDE = """
float look_expm1(float x) {
    // Below 0.1, the omitted terms of the series are smaller than 1e-9 x.
    return abs(x) < 0.1 ? x * (1.0 + x * (0.5 + x * (1.0 / 6.0 + x * (1.0 / 24.0 + x * (1.0 / 120.0 + x / 720.0)))))
                        : exp(x) - 1.0;
}
float look_power(float x, float y) { return y == 0.0 ? 1.0 : x == 0.0 ? 0.0 : pow(x, y); }
// sin and cos of x: by the nearest quarter turn, which is subtracted in three parts (Cody and Waite 1980).
vec2 look_turn(float x) {
    float quarters = floor(x * 0.6366197723675814 + 0.5);
    float r = ((x - quarters * 1.5703125) - quarters * 4.837512969970703e-4) - quarters * 7.549789948768648e-8;
    float z = r * r;
    float s = r * (1.0 + z * (-1.0 / 6.0 + z * (1.0 / 120.0 + z * (-1.0 / 5040.0 + z / 362880.0))));
    float c = 1.0 + z * (-0.5 + z * (1.0 / 24.0 + z * (-1.0 / 720.0 + z / 40320.0)));
    int place = int(quarters) & 3;
    return place == 0 ? vec2(s, c) : place == 1 ? vec2(c, -s) : place == 2 ? vec2(-s, -c) : vec2(-c, s);
}
float look_sin(float x) { return look_turn(x).x; }
float look_cos(float x) { return look_turn(x).y; }
float look_tan(float x) { vec2 turn = look_turn(x); return turn.x / turn.y; }
float look_atan2(float y, float x) {
    float a = abs(x), b = abs(y), most = max(a, b);
    if (most == 0.0) return 0.0;
    // The quotient is at most 1. Above tan(22.5 degrees), the series is expanded around 45 degrees instead of 0.
    float q = min(a, b) / most;
    bool far = q > 0.41421356;
    float t = far ? (q - 1.0) / (q + 1.0) : q;
    float z = t * t;
    float series = 1.0 / 7.0 - z * (1.0 / 9.0 - z * (1.0 / 11.0 - z * (1.0 / 13.0 - z * (1.0 / 15.0 - z / 17.0))));
    float angle = t * (1.0 - z * (1.0 / 3.0 - z * (1.0 / 5.0 - z * series)));
    angle = far ? angle + 0.7853981633974483 : angle;
    angle = b > a ? 1.5707963267948966 - angle : angle;
    angle = x < 0.0 ? 3.141592653589793 - angle : angle;
    return y < 0.0 ? -angle : angle;
}
float look_up(highp sampler2D table, float cell) {
    int number = int(cell);
    return texelFetch(table, ivec2(number % 2048, number / 2048), 0).r;
}
"""
"""The functions that generated code calls. A shader contains this text once, before the generated code."""

# Format strings of GLSL, by the operation's name. They are those of `operators.CODE`, except where GLSL has another
# name or too few digits.
_CODE = {operation: strip_parentheses(code) for operation, code in CODE.items()} | {
    "absolute": "abs({})",
    "expm1": "look_expm1({})",
    "sin": "look_sin({})",
    "cos": "look_cos({})",
    "tan": "look_tan({})",
    "arctan2": "look_atan2({}, {})",
    "power": "look_power({}, {})",
}
# The operations whose GLSL type is bool; "truth" is a boolean constant.
_BOOLEAN_OR_TRUTH = BOOLEAN_OPERATIONS | {"truth"}
_FLOAT32_MAX = float(np.finfo(np.float32).max)


def function_lines(program: ProgramWriter | ProgramSource, head: str) -> list[str]:
    """Return the lines of a GLSL function that computes outputs of a program.

    `head` is the function's name and its parameters. Each ``out`` parameter is named like an output of the program, a
    float or a vec3. The program's operations ``"uniform"`` become literals.
    """
    outputs = re.findall(r"out \w+ (\w+)", head)
    needed: set[int] = set()
    pending = [number for name in outputs for number in program.outputs[name]]
    while pending:
        if (number := pending.pop()) not in needed:
            needed.add(number)
            pending += program.operations[number].operands
    names: dict[int, str] = {}
    boolean_numbers: set[int] = set()
    lines = [f"void {head} {{"]
    for number in sorted(needed):
        operation = program.operations[number]
        code = _operation_code(operation, names, program.constants)
        if operation.op in _BOOLEAN_OR_TRUTH or (operation.op == "where" and operation.operands[1] in boolean_numbers):
            boolean_numbers.add(number)
        if operation.operands:
            names[number] = f"v{number}"
            lines.append(f"    {'bool' if number in boolean_numbers else 'float'} v{number} = {code};")
        else:
            names[number] = code
    for name in outputs:
        values = [names[number] for number in program.outputs[name]]
        code = f"vec3({', '.join(values)})" if len(values) == 3 else values[0]
        lines.append(f"    {name} = {code};")
    return [*lines, "}"]


def _operation_code(operation: ProgramOperation, names: Mapping[int, str], constants: Sequence[float]) -> str:
    """Return the GLSL expression of an operation; `names` has the variable or literal of each earlier operation."""
    match operation.op:
        case "constant":
            return _literal(operation.value)
        case "truth":
            return "true" if operation.value else "false"
        case "uniform":
            return _literal(constants[operation.index])
        case "symbol":
            return operation.name
        case "look_up":
            row, column = (names[number] for number in operation.operands)
            cell = f"{row} * {_literal(operation.value)} + {column}"
            if operation.name:  # the table's cells are colours, and the name is a channel: 0, 1 or 2
                cell = f"3.0 * ({cell}) + {operation.name}.0"
            return f"look_up(look_table{operation.index}, {cell})"
    return _CODE[operation.op].format(*(names[number] for number in operation.operands))


def _literal(value: float) -> str:
    """Return a number as a GLSL literal; raise CodegenError if it exceeds the range of float32."""
    if abs(value) > _FLOAT32_MAX:
        raise CodegenError(f"a constant folded to {value:g}, which no float32 has; the model leaves its domain")
    text = repr(float(value))
    return f"({text})" if value < 0.0 else text
