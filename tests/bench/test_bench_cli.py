"""`lookdev bench` on the command line."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from bench_fakes import FakeBackends

from lookdev.bench import run as bench_run
from lookdev.cli import main

Command = Callable[..., int]
SMALL = ("--scenes", "sphere", "--ibls", "city", "--samples", "4,16", "--repeats", "2")


@pytest.fixture
def run_cli(monkeypatch: pytest.MonkeyPatch) -> Command:
    """Return a function that runs the command line in this process and returns its exit code."""

    def run(*arguments: object) -> int:
        monkeypatch.setattr(sys, "argv", ["lookdev", "bench", *map(str, arguments)])
        with pytest.raises(SystemExit) as left:
            main()
        return int(left.value.code or 0)

    return run


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Callable[..., FakeBackends]:
    def use(**options: int) -> FakeBackends:
        backends = FakeBackends(**options)
        real = bench_run.run_matrix
        monkeypatch.setattr(
            bench_run, "run_matrix", lambda options, out, tell: real(options, out, tell, opened=backends)
        )
        return backends

    return use


def test_a_run_prints_and_writes(
    run_cli: Command, fake: Callable[..., FakeBackends], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fake()
    assert run_cli(*SMALL, "--out", tmp_path / "out") == 0
    shown = capsys.readouterr()
    assert "principled" in shown.out
    assert "sphere, city, plastic: exact: 4 samples" in shown.err
    assert {file.name for file in (tmp_path / "out").iterdir()} == {"results.csv", "results.json", "curves_plastic.svg"}


def test_ctrl_c_leaves_with_130_and_results(
    run_cli: Command, fake: Callable[..., FakeBackends], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fake(ends_after=20)
    assert run_cli(*SMALL, "--out", tmp_path / "out") == 130
    assert "Not complete" in capsys.readouterr().out
    assert len((tmp_path / "out" / "results.csv").read_text().splitlines()) == 1 + 2


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--scenes", "shaderbal"), "there is no scene 'shaderbal' (did you mean 'shaderball'?)"),
        (("--looks", "plastic,carpaint"), "there is no look 'carpaint' (did you mean 'car_paint'?)"),
        (("--samples", "4,5"), "5 samples: counts are powers of two"),
        (("--samples", "4;16"), "'4;16' is no whole number"),
        (("--repeats", "0"), "0 repeats"),
        (("--sequence", "--scenes", "sphere,suzanne"), "the sequence is of one scene and one look"),
        (("--sequence", "--looks", "stack"), "no plain script of stack"),
    ],
)
def test_what_is_wrong_leaves_with_2(
    options: tuple[str, ...], said: str, run_cli: Command, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_cli(*options, "--out", tmp_path / "out") == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_list_measures_nothing(run_cli: Command, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_cli("--list") == 0
    assert "shaderball" in capsys.readouterr().out
