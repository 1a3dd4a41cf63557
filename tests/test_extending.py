"""Every recipe of docs/extending.md, carried out on one copy of the package."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from looks import quick_among

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
SECTIONS = {text.partition("\n")[0]: text for text in PAGE.split("\n## ")[1:]}
LIMITS = {
    "A model": 2,
    "A parameter": 1,
    "A lobe's stand-in": 1,
    "A job option": 3,
    "An option of both renderers": 4,
    "A light": 3,
    "A lamp": 2,
    "A backend": 2,
    "A node of MaterialX": 1,
    "An output": 2,
    "The names of frames": 1,
    "A Designer panel": 3,
    "A command": 1,
}
"""The largest number of files that a recipe may touch."""

ALONE = "The names of frames"
"""The recipe that has a copy of its own, since it changes what others show."""

IN_CYCLES, IN_CHROMIUM = "# in Cycles\n", "# in Chromium\n"
HEAVY_IN_CYCLES = ("An option of both renderers", "A light", "A lamp", "A model", "A parameter")
NEW_FILE = re.compile(r"(?:#|//) (lookdev/\S+)\n")


def blocks(title: str, *languages: str) -> Iterator[tuple[str, str]]:
    """Yield language and text of the fenced blocks of a section."""
    for language, text in re.findall(r"^```(\w+)\n(.*?)^```", SECTIONS[title], re.DOTALL | re.MULTILINE):
        if language in languages:
            yield language, text


def new_files(title: str) -> dict[str, str]:
    """Return the text of each file that a recipe adds."""
    found = [NEW_FILE.match(text) for _, text in blocks(title, "python", "c", "js")]
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


def apply_recipe(title: str, package: Path) -> None:
    """Change the package in a folder by a recipe."""
    for name, text in new_files(title).items():
        assert not (ROOT / name).exists()
        (package / name).write_text(text, encoding="utf-8")
    for name, hunks in changes(title).items():
        text = (package / name).read_text(encoding="utf-8")
        for old, new in hunks:
            assert text.count(old) == 1, f"{name} has these lines {text.count(old)} times, not once:\n{old}"
            text = text.replace(old, new)
        (package / name).write_text(text, encoding="utf-8")


@dataclass
class Checkout:
    """A checkout with the changes of all recipes, and the folders in which their trials run."""

    folder: Path
    tried: dict[str, Path] = field(default_factory=dict)

    def try_recipe(self, title: str) -> Path:
        """Run the trials of a recipe, once, in the folder of the recipe before it, if any, or in one of its own."""
        if title not in self.tried:
            before = re.search(r" After: (.*)\.", SECTIONS[title])
            folder = self.try_recipe(before[1].capitalize()) if before else self._new_folder(title)
            self.tried[title] = folder
            self.run(folder, title)
        return self.tried[title]

    def run(self, folder: Path, title: str, mark: str = "") -> None:
        """Run the trials of a recipe that begin with a mark, or those without one."""
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        # A folder in one of this run's would be too long a path for the sockets of a browser.
        temporary = os.environ["PYTEST_DEBUG_TEMPROOT"]
        environment = os.environ | {"PATH": path, "PYTHONPATH": str(self.folder), "TMPDIR": temporary}
        for language, text in blocks(title, "python", "sh"):
            mark_of_block = next((known for known in (IN_CYCLES, IN_CHROMIUM) if text.startswith(known)), "")
            if NEW_FILE.match(text) or mark_of_block != mark:
                continue
            command = [sys.executable, "-c"] if language == "python" else ["bash", "-euo", "pipefail", "-c"]
            done = subprocess.run([*command, text], cwd=folder, env=environment, capture_output=True, text=True)
            assert done.returncode == 0, f"{text}\n{done.stdout}\n{done.stderr}"

    def _new_folder(self, title: str) -> Path:
        folder = self.folder / title.replace(" ", "_")
        folder.mkdir()
        for name in ("tests", "materials", "jobs", "pyproject.toml"):
            (folder / name).symlink_to(ROOT / name)
        (folder / "lookdev").symlink_to(self.folder / "lookdev")
        return folder


def copy_with_recipes(folder: Path, titles: Iterable[str]) -> Checkout:
    shutil.copytree(ROOT / "lookdev", folder / "lookdev")  # with what is compiled, but for files that recipes change
    for title in titles:
        apply_recipe(title, folder)
    return Checkout(folder)


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Checkout:
    return copy_with_recipes(tmp_path_factory.mktemp("checkout"), [title for title in LIMITS if title != ALONE])


def test_a_recipe_lists_its_files_and_they_are_few() -> None:
    assert SECTIONS.keys() == LIMITS.keys()
    for title, limit in LIMITS.items():
        listed = re.search(r"^Files: (.*?)\.(?: After: .*)?$", SECTIONS[title], re.MULTILINE)
        assert listed, title
        files = {f"lookdev/{name}": bool(new) for name, new in re.findall(r"`([^`]+)`( \(new\))?", listed[1])}
        assert files == dict.fromkeys(new_files(title), True) | dict.fromkeys(changes(title), False), title
        assert len(files) <= limit, title


# A backend of a few lines renders in rendering/test_backends.py, a kind of light that is not shipped in
# light/test_light_kind.py; that every recipe applies is seen by each of these.
@pytest.mark.parametrize(
    "title",
    quick_among(
        [(title,) for title in LIMITS if title != ALONE],
        [(title,) for title in ("A model", "A lobe's stand-in", "A job option", "A command")],
    ),
)
def test_a_recipe_works(title: str, checkout: Checkout) -> None:
    checkout.try_recipe(title)


@pytest.mark.cycles
@pytest.mark.parametrize(
    "title",
    # In the default tier a kind of light that is not shipped renders in light/test_light_kind.py.
    ["A job option", *(pytest.param(title, marks=pytest.mark.proof) for title in HEAVY_IN_CYCLES)],
)
def test_a_recipe_works_in_cycles(title: str, checkout: Checkout) -> None:
    in_cycles = {title for title in LIMITS if IN_CYCLES in SECTIONS[title]}
    assert in_cycles == {"A job option", ALONE, *HEAVY_IN_CYCLES}
    checkout.run(checkout.try_recipe(title), title, IN_CYCLES)


@pytest.mark.proof
@pytest.mark.cycles
def test_frames_have_other_names(tmp_path: Path) -> None:
    checkout = copy_with_recipes(tmp_path, [ALONE])
    checkout.run(checkout.try_recipe(ALONE), ALONE, IN_CYCLES)


@pytest.mark.proof
@pytest.mark.browser
def test_a_panel_works_in_chromium(checkout: Checkout) -> None:
    assert [title for title in LIMITS if IN_CHROMIUM in SECTIONS[title]] == ["A Designer panel"]
    checkout.run(checkout.try_recipe("A Designer panel"), "A Designer panel", IN_CHROMIUM)
