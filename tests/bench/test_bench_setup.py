"""The benchmark of set-up: its section, also of one that was interrupted, and what it times."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from lookdev.bench import setup
from lookdev.bench.options import BenchOptions
from lookdev.bench.setup import SetupBenchmark, StepTimes
from lookdev.errors import LookdevError

DOCUMENT = "# Title\n<!-- bench: setup -->\nold\n<!-- end -->\nafter\n"


def test_what_was_measured_is_written_also_after_ctrl_c(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def measured(scratch: Path, repeats: int) -> Iterator[StepTimes]:
        assert repeats == 3
        yield StepTimes("`lookdev --help`", (0.3, 0.1, 0.2), (0.25, 0.15, 0.2))
        yield StepTimes("start", (1.0,))
        raise KeyboardInterrupt

    monkeypatch.setattr(setup, "measure_setup", measured)
    (tmp_path / "bench.md").write_text(DOCUMENT)
    said: list[str] = []
    benchmark = SetupBenchmark(options=BenchOptions(repeats=3), report=said.append)
    benchmark.run(tmp_path / "out", tmp_path / "bench.md")
    assert not benchmark.complete
    assert said == ["`lookdev --help`: 0.20 (0.10..0.30) s", "start: 1.00 s", "interrupted"]
    text = (tmp_path / "bench.md").read_text()
    assert (
        "| `lookdev --help` | 0.20 (0.10..0.30) | 0.20 (0.15..0.25) |\n| start | 1.00 |  |\n<!-- end -->\nafter" in text
    )
    assert "Not complete" in text
    assert json.loads((tmp_path / "out" / "setup.json").read_text())["steps"][1]["seconds"] == [1.0]


def test_a_command_that_fails_is_an_error() -> None:
    with pytest.raises(LookdevError, match=r"lookdev plan missing\.toml ended with 2: .*missing\.toml"):
        setup._run_command("plan", "missing.toml")


def test_a_document_without_a_place_is_refused_before_anything_is_measured(tmp_path: Path) -> None:
    (tmp_path / "bench.md").write_text("# Title\n")
    with pytest.raises(LookdevError, match="bench: setup"):
        SetupBenchmark(options=BenchOptions(), report=print).run(tmp_path, tmp_path / "bench.md")
