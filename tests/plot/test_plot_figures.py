"""Every command of docs/figures.md and docs/plot.md is read, and one of each sort drawn, at a small size."""

import re
import shlex
from pathlib import Path

import pytest

from lookdev.plot import Options, Subject, draw, read_subject

ROOT = Path(__file__).parents[2]
COMMANDS = [
    line
    for page in ("figures", "plot")
    for block in re.findall(r"^```sh\n(.*?)^```", (ROOT / "docs" / f"{page}.md").read_text(), re.DOTALL | re.MULTILINE)
    for line in block.splitlines()
]
FLAGS = ("--chroma", "--cosine")
TEXTS = ("--scale", "--axis", "--channels", "--angles")
SIZES = {"albedo": 4, "sphere": 12}


@pytest.fixture(autouse=True)
def library(monkeypatch: pytest.MonkeyPatch) -> None:
    folders = ":".join(str(ROOT / "materials" / name) for name in ("presets", "metals", "classic"))
    monkeypatch.setenv("LOOKDEV_LIBRARY", folders)
    monkeypatch.setattr("lookdev.plot.solid._SAMPLES", 4)


def parse(command: str) -> tuple[str, list[str], dict[str, object], str]:
    """Return the kind, the words of the subjects, the options and the file of a command."""
    program, verb, kind, *words = shlex.split(command)
    assert (program, verb) == ("lookdev", "plot")
    options: dict[str, object] = {"size": SIZES.get(kind, 24)}
    subjects, output, rest = [], "", iter(words)
    for word in rest:
        if word in FLAGS:
            options[word[2:]] = True
        elif word == "-o":
            output = next(rest)
        elif word.startswith("--"):
            options[word[2:]] = next(rest) if word in TEXTS else float(next(rest))
        else:
            subjects.append(word)
    return kind, subjects, options, output


def read(words: list[str]) -> list[Subject]:
    return [read_subject(word) for word in words]


# Commands of one kind with the same options are alike: the first is drawn, the others in `proof`.
SORTS = {command: (kind, *options) for command in COMMANDS for kind, _, options, _ in [parse(command)]}
FIRST = {sort: command for command, sort in reversed(SORTS.items())}.values()
DRAWN = [pytest.param(command, marks=() if command in FIRST else pytest.mark.proof) for command in COMMANDS]


def test_all_commands_are_read() -> None:
    assert all(read(subjects) for _, subjects, _, _ in map(parse, COMMANDS))


@pytest.mark.parametrize("command", DRAWN)
def test_a_command_draws_its_figure(command: str, tmp_path: Path) -> None:
    kind, subjects, options, output = parse(command)
    draw(kind, read(subjects), Options(**options)).write(tmp_path / output, dpi=40)  # type: ignore[arg-type]
    assert (tmp_path / output).stat().st_size > 1000
