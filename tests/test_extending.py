"""Every recipe of docs/extending.md, carried out on a copy of the package."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
SECTIONS = {text.partition("\n")[0]: text for text in PAGE.split("\n## ")[1:]}
LIMITS = {
    "A model": 2,
    "A lobe's stand-in": 1,
    "A job option": 3,
    "A light": 3,
    "A backend": 2,
    "An output": 3,
    "A command": 2,
}
"""The largest number of files that a recipe may touch."""

IN_CYCLES = "# in Cycles\n"
NEW_FILE = re.compile(r"(?:#|//) (lookdev/\S+)\n")


def blocks(title: str, *languages: str) -> Iterator[tuple[str, str]]:
    """Yield language and text of the fenced blocks of a section."""
    for language, text in re.findall(r"^```(\w+)\n(.*?)^```", SECTIONS[title], re.DOTALL | re.MULTILINE):
        if language in languages:
            yield language, text


def new_files(title: str) -> dict[str, str]:
    """Return the text of each file that a recipe adds."""
    found = [NEW_FILE.match(text) for _, text in blocks(title, "python", "c")]
    return {match[1]: match.string[match.end() :] for match in found if match}


def changes(title: str) -> dict[str, list[tuple[str, str]]]:
    """Return what a recipe replaces in each file, old and new lines."""
    made = {}
    for _, text in blocks(title, "diff"):
        head, _, hunks = text.partition("\n")
        lines = [hunk.splitlines(keepends=True) for hunk in hunks.split("@@\n")]
        old, new = (["".join(line[1:] for line in hunk if line[0] != sign) for hunk in lines] for sign in "+-")
        made[head.removeprefix("--- ")] = list(zip(old, new, strict=True))
    return made


def trials(title: str, in_cycles: bool) -> Iterator[list[str]]:
    """Yield the commands of a recipe's trials, those in Cycles among them only if wanted."""
    for language, text in blocks(title, "python", "sh"):
        if not NEW_FILE.match(text) and text.startswith(IN_CYCLES) <= in_cycles:
            yield [sys.executable, "-c", text] if language == "python" else ["bash", "-euo", "pipefail", "-c", text]


def carry_out(title: str, folder: Path, in_cycles: bool = False) -> None:
    """Change the package in a folder by a recipe and those it needs, and run their trials."""
    if before := re.search(r" After: (.*)\.", SECTIONS[title]):
        carry_out(before[1].capitalize(), folder)
    for name, text in new_files(title).items():
        assert not (ROOT / name).exists()
        (folder / name).write_text(text, encoding="utf-8")
    for name, hunks in changes(title).items():
        text = (folder / name).read_text(encoding="utf-8")
        for old, new in hunks:
            assert text.count(old) == 1, f"{name} has these lines {text.count(old)} times, not once:\n{old}"
            text = text.replace(old, new)
        (folder / name).write_text(text, encoding="utf-8")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = os.environ | {"PATH": path, "PYTHONPATH": str(folder)}
    for command in trials(title, in_cycles):
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{command[-1]}\n{done.stdout}\n{done.stderr}"


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Return a checkout whose package can be changed."""
    shutil.copytree(ROOT / "lookdev", tmp_path / "lookdev")
    for name in ("tests", "materials", "jobs", "pyproject.toml"):
        (tmp_path / name).symlink_to(ROOT / name)
    return tmp_path


def test_a_recipe_lists_its_files_and_they_are_few() -> None:
    assert SECTIONS.keys() == LIMITS.keys()
    for title, limit in LIMITS.items():
        listed = re.search(r"^Files: (.*?)\.(?: After: .*)?$", SECTIONS[title], re.MULTILINE)
        assert listed, title
        files = {f"lookdev/{name}": bool(new) for name, new in re.findall(r"`([^`]+)`( \(new\))?", listed[1])}
        assert files == dict.fromkeys(new_files(title), True) | dict.fromkeys(changes(title), False), title
        assert len(files) <= limit, title


@pytest.mark.parametrize("title", LIMITS)
def test_a_recipe_works(title: str, checkout: Path) -> None:
    carry_out(title, checkout)


@pytest.mark.cycles
@pytest.mark.parametrize("title", [title for title in LIMITS if IN_CYCLES in SECTIONS[title]])
def test_a_recipe_works_in_cycles(title: str, checkout: Path) -> None:
    carry_out(title, checkout, in_cycles=True)
