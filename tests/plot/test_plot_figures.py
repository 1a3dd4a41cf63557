"""Every command of docs/figures.md and docs/plot.md is read, and each kind of them drawn, at a small size."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
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
SIZES = {"albedo": 4, "sphere": 12}


Plotted = tuple[str, list[Subject], dict[str, object], str]


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Plotted]:
    """Return a function that reads the kind, the subjects, the options and the file of a command."""
    folders = ":".join(str(ROOT / "materials" / name) for name in ("presets", "metals", "classic"))
    monkeypatch.setenv("LOOKDEV_LIBRARY", folders)

    def parse(command: str) -> Plotted:
        program, verb, kind, *words = shlex.split(command)
        assert (program, verb) == ("lookdev", "plot")
        options: dict[str, object] = {"size": SIZES.get(kind, 24)}
        subjects, output = [], ""
        rest = iter(words)
        for word in rest:
            if word in FLAGS:
                options[word[2:]] = True
            elif word == "-o":
                output = next(rest)
            elif word.startswith("--"):
                text = next(rest)
                options[word[2:]] = text if word in ("--scale", "--axis", "--channels", "--angles") else float(text)
            else:
                subjects.append(read_subject(word))
        return kind, subjects, options, output

    return parse


def alike(command: str) -> tuple[str, ...]:
    """Return the kind and the names of the options of a command."""
    _, _, kind, *words = shlex.split(command)
    return kind, *sorted(word for word in words if word.startswith("--"))


# The first of those that are alike is drawn, the others in `proof`.
FIRST = set({alike(command): command for command in reversed(COMMANDS)}.values())
DRAWN = [pytest.param(command, marks=() if command in FIRST else pytest.mark.proof) for command in COMMANDS]


def test_all_commands_are_read(read: Callable[[str], Plotted]) -> None:
    for command in COMMANDS:
        _, subjects, options, _ = read(command)
        assert subjects, command
        Options(**options)  # type: ignore[arg-type]


@pytest.mark.parametrize("command", DRAWN)
def test_a_command_draws_its_figure(
    command: str, read: Callable[[str], Plotted], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lookdev.plot.solid._SAMPLES", 4)
    kind, subjects, options, output = read(command)
    plot = draw(kind, subjects, Options(**options))  # type: ignore[arg-type]
    plot.write(tmp_path / output, dpi=40)
    assert (tmp_path / output).stat().st_size > 1000
