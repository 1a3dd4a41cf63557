"""The files that a run leaves, and what it prints."""

import csv
import json
from dataclasses import fields, replace
from pathlib import Path

import pytest
from bench_fakes import FakeBackends, FakeRenderer, quiet, store_references
from rich.console import Console

from lookdev.bench.curves import Reached
from lookdev.bench.growth import Growth, GrowthRow
from lookdev.bench.matrix import Cell, Options
from lookdev.bench.measure import Candidate, CellResult, CellRun, Measurement, Ratio, Series, Times
from lookdev.bench.report import print_results, warnings
from lookdev.bench.results import Results
from lookdev.bench.run import run_matrix
from lookdev.bench.sequence import SequenceResult, SequenceRun, Subject

OPTIONS = Options(scenes=("sphere",), ibls=("city", "studio"), looks=("plastic", "stack"), samples=(4, 16), repeats=2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("report")


@pytest.fixture(scope="module")
def results(folder: Path) -> Results:
    with pytest.MonkeyPatch.context() as patch:
        store_references(folder, patch)
        return run_matrix(OPTIONS, folder / "out", quiet, opened=FakeBackends())


def printed(results: Results, width: int = 200) -> str:
    console = Console(width=width, record=True, file=open("/dev/null", "w"))  # noqa: SIM115, PTH123
    with console.file:
        print_results(results, console)
        return console.export_text()


def test_csv_has_a_row_for_each_measurement(results: Results, folder: Path) -> None:
    with (folder / "out" / "results.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    # Two backends for plastic, one for the stack, under two lights; two counts, two repeats.
    assert len(rows) == (2 + 1) * 2 * 2 * 2
    assert list(rows[0]) == [field.name for field in fields(Measurement)]
    first = results.cells[0].measurements[0]
    assert (rows[0]["backend"], rows[0]["way"]) == ("exact", "raw")
    assert float(rows[0]["seconds"]) == first.seconds
    assert float(rows[0]["relmse"]) == first.relmse


def test_json_has_curves_machine_and_versions(results: Results, folder: Path) -> None:
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
    assert [each["backend"] for each in cell["exact_over"]] == ["principled", "principled"]
    assert stored["cells"][1]["exact_over"] == []


def test_a_figure_for_each_look_with_a_panel_for_each_light(results: Results, folder: Path) -> None:
    files = sorted(path.name for path in (folder / "out").iterdir())
    assert files == ["curves_plastic.svg", "curves_stack.svg", "results.csv", "results.json"]
    for look in ("plastic", "stack"):
        drawn = (folder / "out" / f"curves_{look}.svg").read_text()
        assert drawn.startswith("<?xml")
        assert drawn.count('<g id="axes_') == 2


def test_the_table(results: Results) -> None:
    cell = results.cells[0]
    times = {
        "exact": {1e-3: Times(Reached(1.5), 1.4, 1.6), 1e-4: Times(Reached(9.0, "~"), 8.0, 9.5)},
        "principled": {1e-3: Times(Reached(2.0), 1.9, 2.2), 1e-4: Times(None, None, None)},
    }
    ratios = (
        Ratio("principled", "raw", 1e-3, Reached(0.75), 0.7, 0.81, Reached(0.8)),
        Ratio("principled", "raw", 1e-4, None, None, None, None),
    )
    made = replace(cell, reached={Series(name): each for name, each in times.items()}, ratios=ratios)
    lines = printed(Results(results.options, results.machine, cells=[made], complete=True)).splitlines()
    named = next(number for number, line in enumerate(lines) if line.strip() == "sphere, city, plastic")
    exact, principled = (line.split() for line in lines[named + 1 : named + 3])
    assert exact[:3] == ["exact", "1.5", "~9"]
    assert principled[:5] == ["principled", "2", "x0.75", "(0.70..0.81)", "-"]
    assert exact[-1] == "1"
    assert any(results.machine.cpu in line for line in lines)
    assert not any("Not complete" in line for line in lines)
    assert "Not complete" in printed(replace(results, complete=False))


def test_80_columns_cut_no_number_off(results: Results) -> None:
    wide, narrow = (set(printed(results, width).split()) for width in (200, 80))
    assert {word for word in wide if any(letter.isdigit() for letter in word)} <= narrow


def test_skips_are_printed_once_for_all_cells_that_have_them(results: Results) -> None:
    assert [line.strip() for line in printed(results).splitlines() if "skips" in line] == [
        "exact skips bounces (convex asset), light samples (for show): sphere, city, plastic; sphere, city, stack",
        "exact skips bounces (convex asset): sphere, studio, plastic; sphere, studio, stack",
    ]
    cell = json.loads(json.dumps(results.data()))["cells"][0]
    assert cell["series"]["exact"]["skipped"] == ["bounces (convex asset)", "light samples (for show)"]
    assert cell["series"]["principled"]["skipped"] == []


def test_a_biased_picture_is_reported() -> None:
    def measured(renderer: FakeRenderer) -> CellResult:
        run = CellRun(Cell("sphere", "city", "plastic"), [Candidate("exact", "key", renderer)], OPTIONS)
        run.run(quiet)
        return run.result()

    assert warnings([measured(FakeRenderer())]) == []
    # The reference is in the cache: what renders now is 5 % brighter.
    lines = warnings([measured(FakeRenderer(gain=1.05))])
    assert len(lines) == 2
    assert "exact with 16 samples is off by +5." in lines[1] or "off by +4.9" in lines[1]
    assert "--fresh" in lines[1]


def test_sequence_and_growth_are_printed(results: Results) -> None:
    runs = (SequenceRun("exact", 0, 60.0, 144.0), SequenceRun("plain", 0, 240.0, 36.0))
    samples, relmse = {"exact": 64, "plain": 150}, {"exact": 9.5e-4, "plain": 9.7e-4}
    skips = ("23 of 47 frames (same all around)", "bounces (convex asset)")
    subject = Subject("shaderball", "plastic", ("city", "studio"), 256)
    sequence = SequenceResult(subject, 144, samples, relmse, runs, 4.0, 4.0, 4.0, skips)
    rows = GrowthRow(4096, 0.1, 0.09, 0.12, 400_000_000), GrowthRow(16384, 0.4, 0.4, 0.5, 410_000_000)
    results = replace(results, sequence=sequence, growth=[Growth("pixels", "exact", rows)])
    text = printed(results)
    assert "4.00 times" in text
    assert "9.50e-04" in text
    assert "16,384" in text
    assert "exact skips 23 of 47 frames (same all around), bounces (convex asset)" in text
    stored = json.loads(json.dumps(results.data()))
    assert stored["sequence"]["runs"][1]["frames_per_minute"] == 36.0
    row = {"size": 16384, "seconds": 0.4, "low": 0.4, "high": 0.5, "memory": 410_000_000}
    assert stored["growth"][0]["rows"][1] == row
