"""Lines of `lookdev eval` with one thing wrong."""

import json
import random
from functools import cache
from pathlib import Path
from typing import Any

from cases import REFUSED, Case, Reading, planned_kind
from text_changes import CHANGES, odd

from lookdev.brdf import MODELS
from lookdev.checks.evaluate import evaluate_lines
from lookdev.safe_text import decode

_SINGLES: list[dict[str, Any]] = [
    {
        "model": name,
        "params": {each.name: each.choices[0] if each.file else each.default for each in model.parameters.values()},
        "wo": [0.6, 0.0, 0.8],
        "wi": [0.0, 0.6, 0.8],
    }
    for name, model in MODELS.items()
]
_STACK: dict[str, Any] = {
    "model": "stack",
    "layers": [
        {"model": "disney", "params": {"roughness": 0.25}},
        {"model": "disney", "params": {"metallic": 1.0}, "mask": 0.5, "mode": "over"},
    ],
    "wo": [0.0, 0.0, 1.0],
    "wi": [0.6, 0.0, 0.8],
}
_LINES = [*_SINGLES, _STACK]
_HUGE = object()
_NOTHING = (None, True, "", "1", "ODD", ["ODD"], {"ODD": 1}, [], {}, [[1.0]], {"a": {"b": []}}, float("nan"))
_NOTHING += (float("inf"), -1e30, 1e30, 10**400, [True, False, True], ["0", "0", "1"], [0.0, 0.0, float("nan")], _HUGE)


def _places(value: Any, within: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [place for key, part in parts for place in ((*within, key), *_places(part, (*within, key)))]


_PLAN: tuple[tuple[Any, ...], ...] = (
    *(
        ("value", line, place, number)
        for line, case in enumerate(_LINES)
        for place in _places(case)
        for number, value in enumerate(_NOTHING)
        if (place[-1], value) != ("params", {})
    ),
    *(("missing", line, key) for line, case in enumerate(_LINES) for key in case),
    *(("unknown", line) for line in range(len(_LINES))),
    *(("text", name, line) for name in CHANGES if name != "empty" for line in range(len(_LINES))),
    *(("nested", "[" * deep + "]" * deep, "line 1") for deep in (40, 900, 100_000)),
    ("nested", "9" * 5000, "digits"),
)


def _read(data: bytes) -> Reading:
    lines = (decode(line, f"line {number}") for number, line in enumerate(data.splitlines(keepends=True), start=1))
    answers = [json.loads(line) for line in evaluate_lines(lines, "numpy") if line]
    return Reading({str(number): (each["f"], each["pdf"]) for number, each in enumerate(answers)})


@cache
def _sound() -> Reading:
    return _read(_text(_LINES))


def _text(cases: list[dict[str, Any]]) -> bytes:
    return "".join(json.dumps(case, ensure_ascii=False) + "\n" for case in cases).encode()


def make(rng: random.Random, planned: tuple[Any, ...], folder: Path) -> Case:
    """Make the lines of a case."""
    cases = json.loads(json.dumps(_LINES))
    expected, names, data = REFUSED, ("line",), b""
    match planned:
        case ("value", line, place, which):
            inner = cases[line]
            for key in place[:-1]:
                inner = inner[key]
            text = odd(rng)
            value = [text] if _NOTHING[which] is _HUGE else _NOTHING[which]
            inner[place[-1]] = json.loads(json.dumps(value).replace('"ODD"', json.dumps(text)))
            names = (f"line {line + 1}",)
        case ("missing", line, key):
            del cases[line][key]
            names = (f"line {line + 1}", key)
        case ("unknown", line):
            inner = cases[line].get("params") or cases[line]["layers"][0]
            inner[odd(rng)] = 1.0
            names = (f"line {line + 1}", "unknown")
        case ("text", name, line):
            one = CHANGES[name].make(_text([cases[line]]), rng)
            data = _text(cases[:line]) + one + b"\n" + _text(cases[line + 1 :])
            expected = CHANGES[name].expected
            # JSON has no line to name but that of the case.
            names = (f"line {line + 1}|line", *(each for each in CHANGES[name].names if each == "UTF-8"))
        case ("nested", value, word):
            cases[0]["params"] = "DEEP"
            data = _text(cases).replace(b'"DEEP"', value.encode())
            names = ("line 1", word)
    data = data or _text(cases)
    return Case(" ".join(map(str, planned))[:120], expected, lambda: _read(data), _sound, names)


EVAL = planned_kind("eval", _PLAN, make)
