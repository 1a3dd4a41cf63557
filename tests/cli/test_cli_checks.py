"""`lookdev check` and `lookdev eval`: options, exit codes, the page."""

import sys
from collections.abc import Iterator
from io import BytesIO, TextIOWrapper
from pathlib import Path
from typing import Any

import pytest

from lookdev.checks.finding import CheckFinding
from lookdev.errors import ModelError

ROOT = Path(__file__).parents[2]

GOOD = CheckFinding("points", "gold", True, "40000 cases", {}, ("case 1",))
BAD = CheckFinding("albedo", "gold", False, "far off", {}, ("case 2",))


@pytest.fixture
def call(monkeypatch):
    """Replace the checks by a fake that yields the test's findings; return them, and the arguments of the call."""
    call: dict[str, Any] = {"findings": [GOOD]}

    def check_file(file: Path, **options: Any) -> Iterator[CheckFinding]:
        call.update(file=file, **options)
        yield from call["findings"]

    monkeypatch.setattr("lookdev.checks.check.check_file", check_file)
    return call


def test_agreement_leaves_with_0(run_cli, call):
    code, output, errors = run_cli("check", "gold.usda")
    assert (code, errors) == (0, "points: gold: agrees\n")
    assert "all 1 checks agree" in output
    assert call["file"] == Path("gold.usda")
    assert (call["only"], call["depth"], call["seed"], call["backend"]) == ((), "default", 0, None)


def test_disagreement_leaves_with_1_and_lists_the_cases(run_cli, call):
    call["findings"] = [GOOD, BAD]
    code, output, errors = run_cli("check", "gold.usda")
    assert (code, errors) == (1, "points: gold: agrees\nalbedo: gold: DISAGREES\n")
    words = ("case 2", "case 1", "1 of 2 checks disagree")
    assert [word in output for word in words] == [True, False, True]


def test_options_reach_the_checks_and_a_page_is_written(run_cli, call, tmp_path):
    page = tmp_path / "report.html"
    options = ("--only", "points, image", "--depth", "quick", "--seed", 7, "--prim", "/Gold", "--variants", "wear=old")
    assert run_cli("check", "gold.usda", *options, "--backend", "nodes-exact", "--html", page)[0] == 0
    expected = {"only": ("points", "image"), "depth": "quick", "seed": 7, "prim": "/Gold", "variants": {"wear": "old"}}
    assert {**call, **expected, "backend": "nodes-exact"} == call
    assert "40000 cases" in page.read_text(encoding="utf-8")


def test_stress_needs_no_file(run_cli, call, tmp_path):
    assert run_cli("check", "--stress", "--html", tmp_path / "report.html")[0] == 0
    assert (call["file"], call["only"]) == (None, ["stability"])
    assert "<title>lookdev check --stress</title>" in (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.mark.cycles
@pytest.mark.parametrize(
    ("options", "count", "pictures", "row"),
    [
        (("--only", "points"), 1, 1, "error at most"),
        pytest.param((), 3, 6, "no light passes through", marks=pytest.mark.proof),
    ],
)
def test_a_shipped_look_agrees(run_cli, tmp_path, options, count, pictures, row):
    page = tmp_path / "report.html"
    look = ROOT / "materials" / "brushed_metal.usda"
    code, output, _ = run_cli("check", look, "--depth", "quick", "--html", page, *options)
    assert code == 0
    assert f"all {count} checks agree" in output
    assert row in " ".join(output.split())
    assert page.read_text(encoding="utf-8").count("<img") == pictures


@pytest.mark.parametrize(("options", "backend"), [((), "numpy"), (("--backend", "cycles"), "cycles")])
def test_eval_maps_lines_to_lines(run_cli, provide, monkeypatch, options, backend):
    def evaluate_lines(lines: Iterator[str], backend: str) -> Iterator[str]:
        return (f"{backend} {line.strip()}" for line in lines)

    provide("lookdev.checks.evaluate", evaluate_lines=evaluate_lines)
    monkeypatch.setattr(sys, "stdin", TextIOWrapper(BytesIO(b"a\nb\n")))
    assert run_cli("eval", *options) == (0, f"{backend} a\n{backend} b\n", "")


def test_eval_of_bytes_that_are_no_text_names_the_line(run_cli, monkeypatch):
    monkeypatch.setattr(sys, "stdin", TextIOWrapper(BytesIO(b"\n\xff\n")))
    assert run_cli("eval") == (2, "", "lookdev: line 2: line 1, column 1: not UTF-8 text (save it as UTF-8)\n")


def test_eval_of_a_bad_line_is_exit_code_2(run_cli, provide):
    def evaluate_lines(lines: Iterator[str], backend: str) -> Iterator[str]:
        yield "first"
        raise ModelError("line 2: no model 'dysney'")

    provide("lookdev.checks.evaluate", evaluate_lines=evaluate_lines)
    assert run_cli("eval") == (2, "first\n", "lookdev: line 2: no model 'dysney'\n")
