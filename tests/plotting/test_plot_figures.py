"""Every command of docs/figures.md and docs/plot.md is parsed; one of each kind is drawn at a small size."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from lookdev.cli import app
from lookdev.plotting import PlotOptions, PlotSubject, draw, read_subject

ROOT = Path(__file__).parents[2]
COMMANDS = [
    line
    for page in ("figures", "plot")
    for block in re.findall(r"^```sh\n(.*?)^```", (ROOT / "docs" / f"{page}.md").read_text(), re.DOTALL | re.MULTILINE)
    for line in block.splitlines()
]
PLOT = get_command(app).commands["plot"]
SIZES = {"albedo": 4, "sphere": 12}


@pytest.fixture(autouse=True)
def library(monkeypatch: pytest.MonkeyPatch) -> None:
    folders = ":".join(str(ROOT / "materials" / name) for name in ("presets", "metals", "classic"))
    monkeypatch.setenv("LOOKDEV_LIBRARY", folders)
    monkeypatch.setattr("lookdev.plotting.solid._SAMPLES", 4)


def parse(command: str) -> dict[str, Any]:
    """Return the arguments and options of a command, as the command line reads them."""
    program, verb, *words = shlex.split(command)
    assert (program, verb) == ("lookdev", "plot")
    return PLOT.make_context("plot", words).params


def read(words: list[str]) -> list[PlotSubject]:
    return [read_subject(word) for word in words]


# Of the commands of one kind with the same options, the first is drawn by default, the others in tier `proof`.
SORTS = {command: (parse(command)["kind"], *re.findall(" --[a-z]+", command)) for command in COMMANDS}
FIRST = {sort: command for command, sort in reversed(SORTS.items())}.values()
DRAWN = [pytest.param(command, marks=() if command in FIRST else pytest.mark.proof) for command in COMMANDS]


def test_all_commands_are_read() -> None:
    assert all(read(parse(command)["subjects"]) for command in COMMANDS)


@pytest.mark.parametrize("command", DRAWN)
def test_a_command_draws_its_figure(command: str, tmp_path: Path) -> None:
    options = parse(command)
    kind, subjects, output, _ = (options.pop(name) for name in ("kind", "subjects", "output", "library"))
    options["size"] = SIZES.get(kind, 24)
    draw(kind, read(subjects), PlotOptions(**options)).write(tmp_path / output, dpi=40)
    assert (tmp_path / output).stat().st_size > 1000
