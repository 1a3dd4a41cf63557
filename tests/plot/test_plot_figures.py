"""Every command of docs/figures.md and docs/plot.md is run, at a small size."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from lookdev.plot import Options, draw, read_subject

ROOT = Path(__file__).parents[2]
COMMANDS = [
    line
    for page in ("figures", "plot")
    for block in re.findall(r"^```sh\n(.*?)^```", (ROOT / "docs" / f"{page}.md").read_text(), re.DOTALL | re.MULTILINE)
    for line in block.splitlines()
]
FLAGS = ("--chroma", "--cosine")
SIZES = {"albedo": 4, "sphere": 12}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_draws_its_figure(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders = ":".join(str(ROOT / "materials" / name) for name in ("presets", "metals", "classic"))
    monkeypatch.setenv("LOOKDEV_LIBRARY", folders)
    monkeypatch.setattr("lookdev.plot.solid._SAMPLES", 4)
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
    plot = draw(kind, subjects, Options(**options))  # type: ignore[arg-type]
    plot.write(tmp_path / output, dpi=40)
    assert (tmp_path / output).stat().st_size > 1000
