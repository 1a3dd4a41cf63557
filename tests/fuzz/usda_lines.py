"""Changes of a line of a USD layer in text that has an attribute."""

import random
from pathlib import Path

from cases import REFUSED
from text_changes import odd, spoil

_VALUES = {
    "int": "3",
    "double": "nan",
    "half": "-1",
    "float": "nan",
    "float2": "(nan, 1)",
    "float3": "(inf, 1, 1)",
    "float4": "(1, 1, 1, -inf)",
    "color3f": "(nan, 1, 1)",
    "matrix4d": "((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))",
    "string": '"ODD"',
    "token": '"ODD"',
    "bool": "1",
    "float[]": "[0.5, 1]",
    "token[]": '["ODD"]',
    "asset": "@nothing.png@",
    "dictionary": "{}",
}
TYPES = tuple(_VALUES)


def odd_text(rng: random.Random) -> str:
    """Return a text that spoils a message, as the syntax of USD has it."""
    return odd(rng).replace("\x1b", "\\x1b").replace("\x07", "\\x07")


def declaration(line: str) -> tuple[str, str]:
    """Return type and name of the attribute of a line."""
    *_, kind, name = line.partition(" = ")[0].split()
    return kind, name.removesuffix(".connect")


def retyped(line: str, kind: str, rng: random.Random) -> str:
    """Return a line with a value of another type."""
    return f"{kind} {declaration(line)[1]} = {_VALUES[kind].replace('ODD', odd_text(rng))}"


def animated(line: str) -> str:
    """Return a line with its value at two times."""
    before, _, value = line.partition(" = ")
    return f"{before}.timeSamples = {{ 0: {value}, 5: {value} }}"


def spoil_layer(planned: tuple[str, ...], rng: random.Random, file: Path, text: str) -> frozenset[str]:
    """Write the file of a case of `text_plan`; return what must become of it."""
    expected, _ = spoil(planned, rng, file, text)
    # USD refuses a text with a mark at its start.
    return expected | REFUSED if planned[1] == "a mark at its start" else expected
