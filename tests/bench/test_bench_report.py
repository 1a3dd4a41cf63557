"""The files that a run leaves, and what it prints."""

import csv
import json
from dataclasses import fields, replace
from pathlib import Path

import pytest
from bench_fakes import FakeRenderer, quiet, run_matrix, store_references

from lookdev.bench import report
from lookdev.bench.growth import Growth, GrowthRow
from lookdev.bench.matrix import MatrixBenchmark
from lookdev.bench.measure import Candidate, CellRun, CurveEffort, Measurement, Ratio, Series
from lookdev.bench.options import BenchOptions, Cell
from lookdev.bench.sequence import SequenceBenchmark, SequenceResult, SequenceRun, SequenceSubject

OPTIONS = BenchOptions(
    scenes=("sphere",), ibls=("city", "studio"), looks=("plastic", "stack"), samples=(4, 16), repeats=2
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("report")


@pytest.fixture(scope="module")
def results(folder: Path) -> MatrixBenchmark:
    with pytest.MonkeyPatch.context() as patch:
        store_references(folder, patch)
        return run_matrix(OPTIONS, folder / "out")


def table_row(text: str, name: str, heading: str) -> list[str]:
    """Return the cells of the first row with a name below a heading."""
    below = text.partition(f"#### {heading}\n")[2].splitlines()
    rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in below)
    return next(row for row in rows if row[0] == name)


def test_csv_has_a_row_for_each_measurement(results: MatrixBenchmark, folder: Path) -> None:
    with (folder / "out" / "results.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    # Two backends for plastic, one for the stack, under two lights; two counts, two repeats.
    assert len(rows) == (2 + 1) * 2 * 2 * 2
    assert list(rows[0]) == [field.name for field in fields(Measurement)]
    first = results.cells[0].measurements[0]
    assert (rows[0]["backend"], rows[0]["picture_kind"]) == ("exact", "raw")
    assert float(rows[0]["seconds"]) == first.seconds
    assert float(rows[0]["relmse"]) == first.relmse


def test_json_has_curves_machine_and_versions(results: MatrixBenchmark, folder: Path) -> None:
    stored = json.loads((folder / "out" / "results.json").read_text())
    assert stored == json.loads(json.dumps(results.data()))
    assert stored["complete"] is True
    assert set(stored["machine"]) == {"cpu", "cores", "load", "system", "versions", "date"}
    assert {"lookdev", "blender", "python", "numpy", "mitsuba"} == set(stored["machine"]["versions"])
    assert len(stored["machine"]["load"]) == 3
    assert stored["options"]["samples"] == [4, 16]
    cell = stored["cells"][0]
    assert (cell["scene"], cell["ibl"], cell["look"]) == ("sphere", "city", "plastic")
    exact = cell["series"]["exact"]
    assert [point["samples"] for point in exact["curve"]] == [4, 16]
    assert exact["memory"] == 1_000_000
    assert exact["renderer"] == "fake exact"
    assert exact["reference"]["samples"] == 16 * OPTIONS.reference
    assert 0.0 < exact["reference"]["own_relmse"] < exact["curve"][1]["relmse"]
    assert set(exact["seconds_to_relmse"]) == {"0.001", "0.0001"}
    assert [ratio["backend"] for ratio in cell["exact_over"]] == ["principled", "principled"]
    assert stored["cells"][1]["exact_over"] == []


def test_a_figure_for_each_look_with_a_panel_for_each_light(results: MatrixBenchmark, folder: Path) -> None:
    files = sorted(path.name for path in (folder / "out").iterdir())
    assert files == ["curves_plastic.svg", "curves_stack.svg", "results.csv", "results.json"]
    for look in ("plastic", "stack"):
        drawn = (folder / "out" / f"curves_{look}.svg").read_text()
        assert drawn.startswith("<?xml")
        assert drawn.count('<g id="axes_') == 2


def test_the_tables(results: MatrixBenchmark) -> None:
    text = results.summary()
    assert text.startswith(str(results.machine))
    assert "Not complete" not in text
    assert "Not complete" in replace(results, complete=False).summary()
    # At 1e-3 `exact` is measured, and takes as long as its samples.
    row = table_row(text, "sphere, city, plastic", "Raw, to 0.001")
    cell = results.cells[0]
    exact, ratio = cell.times(Series("exact"), 1e-3), cell.ratio(Series("principled"), 1e-3)
    assert row[1].startswith(f"{exact.value.mark}{exact.value.value:.4f}")
    assert float(row[3].split()[0].lstrip("~")) == pytest.approx(ratio.value.value, abs=0.005)
    # A cell that one backend can show has no ratio.
    assert table_row(text, "sphere, city, stack", "Raw, to 0.001")[2:] == ["-", "-", "-"]
    bias, memory = table_row(text, "sphere, city, plastic: exact", "At the most samples")[1:]
    assert "±" in bias
    assert memory == "1"


def test_text_of_times_and_ratios() -> None:
    values = CurveEffort(9.0, "~"), CurveEffort(0.75, "<"), None
    ratios = [Ratio(value, 0.7, 0.8124, "principled", "raw", 1e-3, value) for value in values]
    assert [report._ratio_texts(ratio) for ratio in ratios] == [
        ("~9.00 (0.700..0.812)", "~9.00"),
        ("<0.75 (0.700..0.812)", "<0.75"),
        ("-", "-"),
    ]
    assert report._mean_text(values) == "9.00 (1 of 3)"
    assert [report.format_short(value) for value in (0.01234, 1.234, 123.4, 1234.5)] == [
        "0.0123",
        "1.23",
        "123",
        "1234",
    ]


def test_skips_are_printed_once_for_all_cells_that_have_them(results: MatrixBenchmark) -> None:
    assert [line.strip() for line in results.summary().splitlines() if "skips" in line] == [
        "exact skips bounces (convex asset), light samples (for show): sphere, city, plastic; sphere, city, stack",
        "exact skips bounces (convex asset): sphere, studio, plastic; sphere, studio, stack",
    ]
    cell = json.loads(json.dumps(results.data()))["cells"][0]
    assert cell["series"]["exact"]["skipped"] == ["bounces (convex asset)", "light samples (for show)"]
    assert cell["series"]["principled"]["skipped"] == []


def test_a_biased_picture_is_reported() -> None:
    def measured(renderer: FakeRenderer) -> CellRun:
        run = CellRun(Cell("sphere", "city", "plastic"), [Candidate("exact", "key", renderer)], OPTIONS, quiet)
        run.run()
        return run

    assert report.bias_warnings([measured(FakeRenderer())]) == []
    # The reference is in the cache: what renders now is 5 % brighter.
    lines = report.bias_warnings([measured(FakeRenderer(gain=1.05))])
    assert len(lines) == 2
    assert "exact with 16 samples is off by +5." in lines[1] or "off by +4.9" in lines[1]
    assert "--fresh" in lines[1]


def test_sequence_and_growth_are_printed(results: MatrixBenchmark) -> None:
    runs = (SequenceRun("exact", 0, 60.0, 144.0), SequenceRun("plain", 0, 240.0, 36.0))
    samples, relmse = {"exact": 64, "plain": 150}, {"exact": 9.5e-4, "plain": 9.7e-4}
    skips = ("23 of 47 frames (same all around)", "bounces (convex asset)")
    subject = SequenceSubject("shaderball", "plastic", ("city", "studio"), 256)
    sequence = SequenceResult(subject, 144, samples, relmse, runs, 4.0, 4.0, 4.0, skips)
    rows = GrowthRow(4096, 0.1, 0.09, 0.12, 400_000_000), GrowthRow(16384, 0.4, 0.4, 0.5, 410_000_000)
    growth = [Growth("pixels", "exact", rows)]
    benchmark = SequenceBenchmark(options=OPTIONS, report=quiet, cells=results.cells, result=sequence, growth=growth)
    text = benchmark.summary()
    assert "4.00 times" in text
    assert "9.50e-04" in text
    assert "16,384" in text
    assert "exact skips 23 of 47 frames (same all around), bounces (convex asset)" in text
    stored = json.loads(json.dumps(benchmark.data()))
    assert stored["sequence"]["runs"][1]["frames_per_minute"] == 36.0
    row = {"size": 16384, "seconds": 0.4, "low": 0.4, "high": 0.5, "memory": 410_000_000}
    assert stored["growth"][0]["rows"][1] == row


def test_times_of_a_backend_that_is_measured_alone(results: MatrixBenchmark) -> None:
    both = replace(results.cells[0], options=replace(OPTIONS, independent=True))
    alone = replace(both, curves={Series("principled"): both.curves[Series("principled")]})
    texts = [replace(results, cells=[cell]).summary() for cell in (both, alone)]
    row, row_alone = (table_row(text, "sphere, city, plastic", "Raw, to 0.0001") for text in texts)
    assert row_alone == [row[0], "-", row[2], "-", "-"]
    assert row[2].startswith("~")
