"""The text of each operation of a traced graph, for the emitters of OSL and GLSL, which have the same operators."""

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
"""Format strings of OSL by the operation's name in a graph; text with an operator is in parentheses."""

BOOLEAN_OPERATIONS = {
    "greater", "greater_equal", "less", "less_equal", "equal", "logical_and", "logical_or", "logical_not",
}  # fmt: skip
"""The operations whose results are booleans."""


def strip_parentheses(code: str) -> str:
    """Return the code of an expression without the parentheses that enclose all of it."""
    return code[1:-1] if code.startswith("(") and code.endswith(")") else code
