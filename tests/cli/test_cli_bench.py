"""`lookdev bench` on the command line."""

from functools import partial

import pytest
from bench_fakes import FakeBackends

from lookdev.bench.kinds import KINDS
from lookdev.bench.matrix import MatrixBenchmark, TableBenchmark

SMALL = ("--scenes", "sphere", "--ibls", "city", "--samples", "4,16", "--repeats", "2")


@pytest.fixture
def bench(run_cli, monkeypatch, tmp_path):
    """Run ``lookdev bench`` with a cache of its own; return exit code, stdout and stderr."""
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    return partial(run_cli, "bench")


@pytest.fixture
def fake(monkeypatch):
    """Return a function that replaces the backends by fakes."""

    def use(**options: int) -> None:
        kind = partial(MatrixBenchmark, open_candidates=FakeBackends(**options))
        kind.DEFAULTS = {}
        monkeypatch.setitem(KINDS, "matrix", kind)

    return use


def test_a_run_prints_and_writes(bench, fake, tmp_path):
    fake()
    code, output, errors = bench(*SMALL, "--out", tmp_path / "out")
    assert code == 0
    assert "principled" in output
    assert "sphere, city, plastic: exact: 4 samples" in errors
    assert {file.name for file in (tmp_path / "out").iterdir()} == {"results.csv", "results.json", "curves_plastic.svg"}


def test_ctrl_c_leaves_with_130_and_results(bench, fake, tmp_path):
    fake(ends_after=20)
    code, output, _ = bench(*SMALL, "--out", tmp_path / "out")
    assert code == 130
    assert "Not complete" in output
    assert len((tmp_path / "out" / "results.csv").read_text().splitlines()) == 1 + 2


@pytest.mark.parametrize(
    ("options", "part"), [((), ()), (("--resolution", "32", "--looks", "metal"), ("looks", "resolution"))]
)
def test_the_plain_table_is_the_whole(options, part, bench, monkeypatch, tmp_path):
    tables = []

    def run(table, folder, document):
        assert (folder, document) == (tmp_path / "out", tmp_path / "bench.md")
        table.complete = True
        tables.append(table)

    monkeypatch.setattr(TableBenchmark, "run", run)
    code, _, _ = bench("--table", tmp_path / "bench.md", *options, "--out", tmp_path / "out")
    assert code == 0
    assert tables[0].restricting_options == part
    assert tables[0].options.scenes == ("sphere", "shaderball")
    assert tables[0].options.denoise


def test_every_kind_has_its_option(bench):
    code, output, _ = bench("--help")
    assert code == 0
    assert [name for name in KINDS if name != "matrix" and f"--{name}" not in output] == []


def test_list_measures_nothing(bench):
    code, output, _ = bench("--list")
    assert code == 0
    assert "shaderball" in output
