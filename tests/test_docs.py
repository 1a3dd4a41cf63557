"""What the documentation says is so: examples, commands, links, and tables made from the code.

``python tests/test_docs.py`` writes those tables anew.
"""

import csv
import json
import re
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
import typer.main

from lookdev.brdf import MODELS, Parameter
from lookdev.brdf.conductor import METALS
from lookdev.brdf.metal import METAL_COLORS, metal_table
from lookdev.cli import app
from lookdev.inspect.doctor import SYSTEM_LIBRARIES
from lookdev.job import json_schema, load_job, parse_job
from lookdev.light.rig import load_rig
from lookdev.light.rig.attributes import LOOKDEV_ATTRIBUTES
from lookdev.light.rig.find import USD_LIGHTS
from lookdev.material.library import SHIPPED_FOLDERS, read_library
from lookdev.material.usd import read_look

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PAGES = [README, *sorted((ROOT / "docs").glob("*.md"))]
LIGHTS = ROOT / "docs" / "lights.md"
JOBS = sorted((ROOT / "jobs").glob("*.toml"))

_TABLE = re.compile(r"(?<=<!-- table: )(?P<name>\S+)(?P<open> -->\n)(?P<rows>.*?)(?=<!-- end -->)", re.DOTALL)
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_CODE = re.compile(r"```\w*\n(.*?)```|`([^`\n]+)`", re.DOTALL)
_COMMAND = re.compile(r"(?<![\w./-])(?:\.venv/bin/)?lookdev +(?P<verb>\w+)(?P<rest>[^\n|#]*)")
_PATH = re.compile(r"(?:lookdev|jobs|materials|rigs|tests|docs|\.ci)/[\w./-]*")

# A whole job, piece by piece: an example that shows some tables stands for the pieces of the same name.
_JOB = {
    "output": 'output = "../out/docs"\n',
    "asset": '[asset]\nbuiltin = "sphere"\n',
    "look": '[[look]]\nname = "metal"\nmaterial = "../materials/brushed_metal.usda"\n',
    "ibl": '[[ibl]]\nname = "studio"\nbuiltin = "studio"\n',
    "turntable": '[[turntable]]\nkind = "element"\nframes = 4\n',
}


def blocks(language: str, pages: Sequence[Path] = PAGES) -> list[Any]:
    """Return every fenced block of a language, named by its page and line."""
    fence = re.compile(rf"^```{language}\n(.*?)^```", re.DOTALL | re.MULTILINE)
    return [
        pytest.param(match[1], id=f"{page.name}:{page.read_text()[: match.start()].count(chr(10)) + 1}")
        for page in pages
        for match in fence.finditer(page.read_text())
    ]


def code(page: Path) -> Iterator[str]:
    for block, span in _CODE.findall(page.read_text()):
        yield block or span


def tables() -> dict[str, str]:
    """Return every generated table by its name."""
    schema = json_schema()
    made = dict(_job_tables("job", schema, schema))
    made["presets"] = _preset_table()
    made["nodes.gaps"] = _gap_table()
    made["metals"] = _metal_table()
    return made | {f"models.{model}": _model_table(MODELS[model].parameters.values()) for model in MODELS}


def _preset_table() -> str:
    presets = read_library([ROOT / folder for folder in SHIPPED_FOLDERS]).presets
    rows = [(f"[{p.name}](../{p.file.relative_to(ROOT)})", p.category, p.model, p.doc) for p in presets]
    return _markdown([("preset", "category", "model", "what it is"), *rows])


def _metal_table() -> str:
    def row(name: str, source: str) -> tuple[str, ...]:
        entry = metal_table()[name]
        eta, k = (", ".join(f"{value:.3g}" for value in entry["nearest"][key]) for key in ("eta", "k"))
        worst = (f"{max(entry[color]['deviation']):.5f}" for color in METAL_COLORS)
        below, above = entry["outside"]
        outside = f"{above:.3f} above 1" * (above > 0.0) + f"{below:.3f} below 0" * (below > 0.0)
        return f"`{name}`", source, eta, k, *worst, outside

    heads = "metal", "eta and k by", "eta", "k", "deviation", "of `bands`", "outside"
    return _markdown([heads, *(row(*each) for each in METALS.items())])


def _gap_table() -> str:
    with (ROOT / "tests" / "end_to_end" / "gaps.csv").open(newline="", encoding="utf-8") as stream:
        gaps = list(csv.DictReader(stream))
    rows = [
        (g["preset"], g["flip"], g["flip_noise"], g["relmse"], f"{float(g['albedo']):.2%}")
        for g in sorted(gaps, key=lambda gap: -float(gap["flip"]))
    ]
    return _markdown([("preset", "FLIP", "of noise", "relMSE", "albedo"), *rows])


def _job_tables(name: str, table: dict[str, Any], schema: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield a table of the job file, and the tables in it, each by its name."""
    yield name, _job_table(table)
    for key, field in table["properties"].items():
        # Of a job itself, a table that may be absent has a table of its own too.
        given = field.get("anyOf", [{}])[0] if name == "job" else {}
        reference = field.get("$ref") or field.get("items", {}).get("$ref") or given.get("$ref")
        if reference:
            yield from _job_tables(f"{name}.{key}", schema["$defs"][reference.rpartition("/")[2]], schema)


def _job_table(table: dict[str, Any]) -> str:
    required = table.get("required", [])
    rows = [("key", "value", "default", "meaning")]
    for name, field in table["properties"].items():
        default = field.get("default")
        shown = "required" if name in required else "" if default is None else f"`{_toml(default)}`"
        rows.append((f"`{name}`", _kind(field), shown, field["description"].replace("<", "&lt;")))
    return _markdown(rows)


def _kind(field: dict[str, Any]) -> str:
    choices = field.get("anyOf") or field.get("oneOf")
    if choices:
        return ", or ".join(_kind(choice) for choice in choices if choice.get("type") != "null")
    if "$ref" in field:
        return "table"
    if "enum" in field or "const" in field:
        return ", ".join(f"`{_toml(choice)}`" for choice in field.get("enum", [field.get("const")]))
    if field["type"] == "array":
        if "prefixItems" in field:
            return f"{len(field['prefixItems'])} of: {_kind(field['prefixItems'][0])}"
        if "enum" in field["items"]:
            return f"list of {_kind(field['items'])}"
        if "oneOf" in field["items"]:
            return f"list, each {_kind(field['items'])}"
        return "tables" if "$ref" in field["items"] else "list of strings"
    kinds = {"boolean": "`true`, `false`", "object": "table of strings", "string": "string"}
    if field["type"] in kinds:
        return "path" if field.get("format") == "path" else kinds[field["type"]]
    low = f"above {field['exclusiveMinimum']:g}" if "exclusiveMinimum" in field else f"{field['minimum']:.10g}"
    kind = "whole number" if field["type"] == "integer" else "number"
    even = "even " if field.get("multipleOf") == 2 else ""
    return f"{even}{kind}, {low} to {field['maximum']:.10g}"


def _toml(value: Any) -> str:
    return json.dumps(value)


def _model_table(parameters: Iterable[Parameter]) -> str:
    head = ("parameter", "type", "default", "hard range", "meaning")
    rows = [(f"`{p.name}`", p.kind, _default(p), _range(p), p.help) for p in parameters]
    return _markdown([head, *rows])


def _default(parameter: Parameter) -> str:
    default = parameter.default
    shown = ", ".join(map(str, default)) if isinstance(default, tuple) else str(default)
    return f"that of `{parameter.follows}`" if parameter.follows else f"`{shown}`"


def _range(parameter: Parameter) -> str:
    low, high = parameter.hard
    return ", ".join(f"`{each}`" for each in parameter.choices) or f"{low:g} to {high:g}"


def _markdown(rows: Sequence[tuple[str, ...]]) -> str:
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([lines[0], "|---" * len(rows[0]) + "|", *lines[1:]]) + "\n"


def slugs(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("text", blocks("toml"))
def test_an_example_job_is_valid(text):
    given = tomllib.loads(text)
    pieces = [piece for name, piece in _JOB.items() if name not in given]
    # An example's own top-level keys come first: behind a table they would be that table's.
    whole = text + "".join(pieces) if "output" in given else "".join(pieces) + text
    parse_job(whole, ROOT / "jobs" / "docs.toml")


@pytest.mark.parametrize("file", JOBS, ids=lambda file: file.stem)
def test_a_shipped_job_is_valid(file):
    assert load_job(file).output == ROOT / "out" / file.stem


@pytest.mark.parametrize("text", blocks("usda", [page for page in PAGES if page != LIGHTS]))
def test_an_example_look_is_valid(text, tmp_path):
    for folder in ("presets", "textures"):
        (tmp_path / folder).symlink_to(ROOT / "materials" / folder)
    (tmp_path / "look.usda").write_text(text)
    assert read_look(tmp_path / "look.usda").layers


@pytest.mark.parametrize("text", blocks("usda", [LIGHTS]))
def test_an_example_rig_is_valid(text, tmp_path):
    (tmp_path / "rig.usda").write_text(text)
    rig = load_rig(tmp_path / "rig.usda", sampled=False)
    assert len(rig.lights) == 2
    assert rig.notes == ()


def test_every_attribute_of_ours_is_documented():
    rows = re.findall(r"^\| `lookdev:([\w:]+)` \| (\w+) \|", LIGHTS.read_text(), re.MULTILINE)
    assert dict(rows) == LOOKDEV_ATTRIBUTES
    assert {name for kind in USD_LIGHTS.values() for name in kind.attributes} == set(LOOKDEV_ATTRIBUTES)


def test_tables_are_what_the_code_says():
    found = {match["name"]: match["rows"] for page in PAGES for match in _TABLE.finditer(page.read_text())}
    assert found == tables(), "run: python tests/test_docs.py"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_exist(page):
    verbs = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    for text in code(page):
        for match in _COMMAND.finditer(text):
            assert match["verb"] in verbs, match[0]
            command, words = verbs[match["verb"]], match["rest"].split()
            while words and words[0] in getattr(command, "commands", {}):
                command = command.commands[words.pop(0)]
            known = {option for parameter in command.params for option in parameter.opts}
            assert {word for word in words if word.startswith("--")} <= known, match[0]


def test_every_verb_is_in_the_readme():
    shown = {match["verb"] for text in code(README) for match in _COMMAND.finditer(text)}
    assert shown == set(typer.main.get_command(app).commands)  # type: ignore[attr-defined]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in _LINK.findall(page.read_text()):
        if target.startswith("https://"):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), target
        assert not anchor or anchor in slugs(file), target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_named_are_there(page):
    for text in code(page):
        for path in _PATH.findall(text if re.fullmatch(_PATH, text) else ""):
            assert (ROOT / path).exists(), path


def test_every_room_of_the_house_is_told():
    rooms = {file.parent.name for file in (ROOT / "lookdev").glob("*/__init__.py")}
    told = set(re.findall(r"^ +(\w+)/ ", (ROOT / "docs" / "architecture.md").read_text(), re.MULTILINE))
    assert rooms <= told


def test_the_order_of_imports_is_the_contract():
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (layers,) = (contract["layers"] for contract in contracts if contract["type"] == "layers")
    order = " > ".join(layers).replace("lookdev.", "").replace(" |", ",")
    assert f"\n    {order}\n" in (ROOT / "docs" / "architecture.md").read_text()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_marks_exist(page, pytestconfig):
    known = {line.partition(":")[0] for line in pytestconfig.getini("markers")}
    for marks in re.findall(r"pytest -m (\w+|\"[^\"]+\")", page.read_text()):
        assert set(re.findall(r"\w+", marks)) - {"and", "or", "not"} <= known, marks


def test_the_readme_installs_what_blender_needs():
    (line,) = re.findall(r"^sudo apt-get install (.*)$", README.read_text(), re.MULTILINE)
    assert set(line.split()) == {"python3-venv", *SYSTEM_LIBRARIES.values()}


def test_the_gate_runs_the_test_command_of_the_readme():
    (command,) = re.findall(r"\.venv/bin/python( -m pytest.*)$", README.read_text(), re.MULTILINE)
    assert f'"$venv/bin/python"{command} "$@"\n' in (ROOT / ".ci" / "run").read_text()


def test_pictures_stay_small():
    pictures = list((ROOT / "docs" / "images").iterdir())
    assert pictures
    assert all(picture.stat().st_size <= 150_000 for picture in pictures)


if __name__ == "__main__":
    made = tables()
    for page in PAGES:
        text = _TABLE.sub(lambda match: match["name"] + match["open"] + made[match["name"]], page.read_text())
        page.write_text(text)
