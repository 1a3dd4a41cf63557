"""Job files with one thing wrong: a value of a key, the text, or what the file is."""

import random
import re
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from cases import REFUSED, SOUND, Case, Reading, planned_kind
from text_changes import NO_FILES, odd, spoil, text_plan

from lookdev.job import load_job

_TEXT = """output = "out"
[asset]
usd = "asset.usda"
prim = "/Root"
variants = { size = "big" }
time = 2.5
purposes = ["render"]
subdivision = 2
missing = "warn"
[[look]]
name = "paint"
material = "paint.usda"
prim = "/Paint"
variants = { wear = "old" }
parts = ["/Root/*"]
layer = "over.usda"
[[look.assign]]
prims = ["/Root/A"]
material = "paint.usda"
prim = "/Other"
variants = { wear = "new" }
[[ibl]]
name = "sky"
file = "sky.exr"
exposure = 1.5
rotation = 45.0
[[ibl]]
name = "studio"
builtin = "studio"
[camera]
focal_length = 50.0
sensor_width = 36.0
elevation = 10.0
azimuth = 20.0
fill = 0.5
framing = "each"
[render]
resolution = [64, 32]
backend = "exact"
device = "cpu"
error = 0.01
samples = 64
bounces = 2
brdf_samples = 2
ibl_samples = 2
seed = 7
background = [0.0, 0.5, 1.0]
[outputs]
exr = true
[[turntable]]
kind = "element"
name = "turn"
start = 5.0
degrees = 180.0
frames = 4
"""
_LINE = re.compile(r"(\w+) = (.*)")
_FILES = ("asset.usda", "paint.usda", "over.usda", "sky.exr")

_NONE = ("nan", "inf", "-inf", "1979-05-27", '""', "[[1]]", "{ a = { b = 1 } }", "[]", "9" * 400, "9" * 5000, "1e400")
_WRONG: dict[str, tuple[str, ...]] = {
    "text": (*_NONE, "1", "1.5", "true", "[1]", '"\\u0000"', '"ODD"', '["ODD"]'),
    "number": (*_NONE, "true", '"1"', '"ODD"', "[1, 2]", "-1e9", "1e9"),
    "truth": (*_NONE, "1", '"true"', "[true]", "false"),
    "list": (*_NONE, "1", "true", "{ ODDKEY = 1 }", "[1, 2, 3, 4, 5]", "[true, false]", '["ODD", "ODD"]'),
    "table": (*(each for each in _NONE if each != "{ a = { b = 1 } }"), "1", '"a"', "[1]", "{ a = 1 }", "{ a = [2] }"),
}
_FREE = {"variants", "prims", "parts"}  # any text is a name, which is looked for in the file
_PATHS = {"output", "usd", "material", "layer", "file"}


def _kind(value: str) -> str:
    if value.startswith('"'):
        return "text"
    return {"[": "list", "{": "table", "t": "truth", "f": "truth"}.get(value[0], "number")


def _keys() -> list[tuple[int, str, str]]:
    """Return the number of each line with a key, the key and its value."""
    found = ((number, _LINE.fullmatch(line)) for number, line in enumerate(_TEXT.splitlines()))
    return [(number, match[1], match[2]) for number, match in found if match]


def _is_wrong(key: str, value: str) -> bool:
    if key == "output" and value == '"ODD"':
        return False  # a folder may have any name
    if (key, value) in (("error", "1"), ("time", "1e9"), ("time", "-1e9")):
        return False
    return not (key in _FREE and "ODD" in value)


_OUTPUTS = ("full", "full/below", "/dev/null", "a" * 5000, "é\\n\\t", "\\u001b[31m", ".", "x/" * 3000)
_PLACES = [name for name in NO_FILES if name != "a sparse file"]
_PLAN: tuple[tuple[Any, ...], ...] = (
    *(
        ("value", number, key, value)
        for number, key, old in _keys()
        for value in _WRONG[_kind(old)]
        if _is_wrong(key, value)
    ),
    *(("unknown", number, key) for number, key, _ in _keys()),
    *(("twice", number) for number, _, _ in _keys()),
    *(("missing", key) for key in ("output", "kind", "frames")),
    # Lines in another order have many faults, each of them clear.
    *(planned for planned in text_plan(6) if planned != ("text", "lines in another order")),
    *(("named", name, file) for name in _PLACES for file in _FILES),
    *(("output", text) for text in _OUTPUTS),
    *(("nested", form) for form in ("a = {0}{1}", "{2}b = 1", "a = {3}", "a = {0}")),
    ("large",),
)


def _write(folder: Path, data: bytes) -> Path:
    for name in _FILES:
        (folder / name).touch()
    (folder / "job.toml").write_bytes(data)
    return folder / "job.toml"


def _read(file: Path, *without: str) -> Reading:
    job = load_job(file)
    text = repr(job.model_dump(exclude=set(without)))
    return Reading({"job": text.replace(str(file.parent), "FOLDER")})


@cache
def _sound(*without: str) -> Reading:
    with TemporaryDirectory() as folder:
        return _read(_write(Path(folder), _TEXT.encode()), *without)


def make(rng: random.Random, planned: tuple[Any, ...], folder: Path) -> Case:
    """Write the files of a case."""
    lines = _TEXT.splitlines(keepends=True)
    expected, names, without = REFUSED, ("job.toml",), ()
    match planned:
        case ("value", line, key, value):
            text = value.replace("ODDKEY", "a" * 3000).replace("ODD", odd(rng).replace("\x1b", "\\u001b"))
            lines[line] = f"{key} = {text}\n"
            # A control character, or too many digits, end the reading of the text.
            names += (f"{key}|line|not TOML",)
        case ("unknown", line, key):
            lines[line] += f'"{rng.choice((key + "s", key[:-1] + "y", "é" * 500, "x" * 5000))}" = 1\n'
            names += ("unknown key|should|not TOML",)
        case ("twice", line):
            lines[line] *= 2
            names += ("line",)
        case ("missing", key):
            lines = [line for line in lines if not line.startswith(f"{key} =")]
            names += (key,)
        case ("large",):
            lines[0] += "# " + "x" * 2_000_000 + "\n"
            names += ("at most",)
        case ("nested", form):
            deep = rng.choice((40, 900, 20_000))
            lines[0] += form.format("[" * deep, "]" * deep, "a." * deep, "{b=" * deep) + "\n"
            names += ("deep|not TOML|unknown key",)
        case ("output", text):
            (folder / "full").write_text("")
            lines[0] = f'output = "{text}"\n'
            names, without = (*names, "output"), ("output",)
            expected = SOUND | REFUSED if text in _OUTPUTS[4:7] else REFUSED
    file = _write(folder, "".join(lines).encode())
    match planned:
        case ("named", name, of):
            (folder / of).unlink()
            NO_FILES[name][0](folder / of)
            names += (of,)
        case ("text" | "place", _):
            expected, words = spoil(planned, rng, file, _TEXT)
            names += words
    title = " ".join(str(part)[:60] for part in planned)
    return Case(title, expected, lambda: _read(file, *without), lambda: _sound(*without), names)


JOBS = planned_kind("jobs", _PLAN, make)
