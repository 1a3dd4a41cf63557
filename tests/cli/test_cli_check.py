"""`lookdev check` on the command line: options, exit codes, the page."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from lookdev.checks.finding import Finding
from lookdev.cli import main

ROOT = Path(__file__).parents[2]
Command = Callable[..., int]

GOOD = Finding("points", "gold", True, "40000 cases", {}, ("case 1",))
BAD = Finding("albedo", "gold", False, "far off", {}, ("case 2",))


@pytest.fixture
def run_cli(monkeypatch: pytest.MonkeyPatch) -> Command:
    """Return a function that runs the command line in this process and returns its exit code."""

    def run(*arguments: object) -> int:
        monkeypatch.setattr(sys, "argv", ["lookdev", "check", *map(str, arguments)])
        with pytest.raises(SystemExit) as left:
            main()
        return int(left.value.code or 0)

    return run


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Let the checks find what the test says; return what they were asked for."""
    asked: dict[str, Any] = {"findings": [GOOD]}

    def check_file(file: Path, **options: Any) -> Iterator[Finding]:
        asked.update(file=file, **options)
        yield from asked["findings"]

    monkeypatch.setattr("lookdev.batch.check.check_file", check_file)
    return asked


def test_agreement_leaves_with_0(run_cli: Command, found: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    assert run_cli("gold.usda") == 0
    assert found["file"] == Path("gold.usda")
    assert (found["only"], found["depth"], found["seed"], found["backend"]) == ([], "default", 0, None)
    assert "all 1 checks agree" in capsys.readouterr().out


def test_disagreement_leaves_with_1_and_tells_the_cases(
    run_cli: Command, found: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    found["findings"] = [GOOD, BAD]
    assert run_cli("gold.usda") == 1
    out = capsys.readouterr().out
    assert "case 2" in out
    assert "case 1" not in out
    assert "1 of 2 checks disagree" in out


def test_options_reach_the_checks_and_a_page_is_written(
    run_cli: Command, found: dict[str, Any], tmp_path: Path
) -> None:
    page = tmp_path / "report.html"
    options = ("--only", "points, image", "--depth", "quick", "--seed", 7, "--prim", "/Gold", "--variants", "wear=old")
    options += ("--backend", "nodes-exact")
    assert run_cli("gold.usda", *options, "--html", page) == 0
    assert found["only"] == ["points", "image"]
    assert (found["depth"], found["seed"], found["prim"], found["variants"]) == ("quick", 7, "/Gold", {"wear": "old"})
    assert found["backend"] == "nodes-exact"
    assert "40000 cases" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--only", "point"), "there is no check 'point' (did you mean 'points'?)"),
        (("--depth", "deep"), "'deep' is not one of 'quick', 'default', 'full'"),
        (("--variants", "wear"), "SET=VARIANT is needed"),
    ],
)
def test_what_does_not_exist_leaves_with_2(
    options: tuple[str, str], said: str, run_cli: Command, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_cli(ROOT / "materials" / "leaf.usda", *options) == 2
    assert said in " ".join(capsys.readouterr().err.replace("│", " ").split())


def test_stress_needs_no_file(
    run_cli: Command, found: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_cli("--stress", "--html", tmp_path / "report.html") == 0
    assert (found["file"], found["only"]) == (None, ["stability"])
    assert "<title>lookdev check --stress</title>" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_nothing_to_check_leaves_with_2(run_cli: Command, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_cli() == 2
    assert "a job or a look is needed" in capsys.readouterr().err


def test_a_file_that_is_missing_leaves_with_2(
    tmp_path: Path, run_cli: Command, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_cli(tmp_path / "none.usda") == 2
    assert "none.usda" in capsys.readouterr().err


@pytest.mark.cycles
def test_a_shipped_look_agrees(run_cli: Command, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "report.html"
    assert run_cli(ROOT / "materials" / "brushed_metal.usda", "--depth", "quick", "--html", page) == 0
    out = capsys.readouterr().out
    assert "all 3 checks agree" in out
    assert "no light passes through" in " ".join(out.split())
    assert page.read_text(encoding="utf-8").count("<img") == 6
