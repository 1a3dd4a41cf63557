"""The table of a document: its figures, what it states of how far it was measured, its plots."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import bench_fakes
import pytest
from bench_fakes import FakeBackends, FakeRenderer, quiet, store_references
from test_bench_growth import processes

from lookdev.bench import growth, matrix
from lookdev.bench.benchmark import SECTION_END, section_marker, split_document, write_section
from lookdev.bench.matrix import TableBenchmark
from lookdev.bench.measure import Series
from lookdev.bench.options import BenchOptions, parse_options
from lookdev.errors import LookdevError, RenderError

DEFAULTS = TableBenchmark.DEFAULTS
BEFORE, AFTER = "# Speed\n\nText before.\n\n", "\n\nText after.\n"
LOOKS = ("plastic", "metal")
TABLE = section_marker("table")


def small(**fields: object) -> BenchOptions:
    """Return the options of a table that takes a second."""
    defaults = {"scenes": ("sphere",), "looks": LOOKS, "repeats": 2, "frames": 4}
    return replace(parse_options({}, defaults=DEFAULTS), **(defaults | fields))


Measured = tuple[TableBenchmark, Path]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Measured]:
    """Measure a table once; return the results and the document."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("table")
        store_references(folder, patch)
        yield measuring(folder, patch)()


@pytest.fixture
def measure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Measured]:
    """Return a function that measures a table by fakes, and returns its results and the document."""
    return measuring(tmp_path, monkeypatch)


def measuring(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Measured]:
    document = folder / "docs" / "bench.md"
    document.parent.mkdir()
    document.write_text(f"{BEFORE}{section_marker('table')}\nold\n{SECTION_END}{AFTER}")
    monkeypatch.setattr(matrix, "QUANTITIES", {of: growth.QUANTITIES[of] for of in ("pixels", "frames")})
    monkeypatch.setattr(growth, "PIXELS", (16, 32))
    monkeypatch.setattr(bench_fakes, "SIDE", 32)
    for backend in matrix.BACKEND_CHECKS:
        monkeypatch.setitem(matrix.BACKEND_CHECKS, backend, lambda: None)

    def measure(options: BenchOptions | None = None, backends: FakeBackends | None = None) -> Measured:
        fakes = {"open_candidates": backends or FakeBackends(), "open_process": processes()}
        table = TableBenchmark(options=options or small(), report=quiet, **fakes)
        table.run(folder / "out", document)
        return table, document

    return measure


def rows_below(text: str, heading: str) -> list[list[str]]:
    """Return the cells of the table below a heading."""
    below = text.partition(f"#### {heading}\n")[2]
    table = below[below.index("\n|") + 1 :].partition("\n\n")[0]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[2:]]


def test_the_document_has_the_table_and_keeps_the_rest(whole: Measured) -> None:
    results, text = whole[0], whole[1].read_text()
    assert results.complete
    assert text.startswith(BEFORE)
    assert text.endswith(f"{SECTION_END}{AFTER}")
    assert "old" not in text
    for heading in ("Raw, to 0.01", "Raw, to 0.001", "Denoised, to 0.01", "Denoised, to 0.001"):
        names = [row[0] for row in rows_below(text, heading)]
        cells = [f"sphere, {ibl}, {look}" for ibl in ("studio", "city") for look in LOOKS]
        assert names == [*cells, "geometric mean, all"]
    # Half the cost; then twice as noisy at half the cost, and at the same.
    mean = rows_below(text, "Raw, to 0.001")[-1]
    noise = FakeRenderer("exact", 0.1, fixed=0.0).relmse(1) / 1e-3
    exact = 0.01 + 0.001 * noise
    assert float(mean[3]) == pytest.approx(exact / (0.01 + 0.0005 * noise), rel=0.1)
    assert float(mean[6]) == pytest.approx(exact / (0.01 + 0.0005 * 4.0 * noise), rel=0.1)
    assert float(mean[9]) == pytest.approx(exact / (0.01 + 0.001 * 4.0 * noise), rel=0.1)
    for of in ("pixels", "frames"):
        assert f"#### Growth with {of}" in text


def test_estimates_stand_beside_what_they_estimate(whole: Measured) -> None:
    results, text = whole[0], whole[1].read_text()
    *cells, everything = rows_below(text, "Estimates, and frames that end at 0.001")
    assert everything[0] == "all"
    for estimate in everything[1:3]:
        # The fakes know their errors.
        assert float(estimate.split()[0]) == pytest.approx(1.0, abs=0.1)
    for row, cell in zip(cells, results.cells, strict=True):
        for seconds, samples, error in (row[3:6], row[6:9]):
            assert float(seconds.split()[0]) > 0.0
            assert int(samples) in {1 << power for power in range(10)}
            assert float(error) < 1.1e-3
        assert len(cell.measurements_of(Series("exact", "aimed"))) == 2


def test_only_options_make_it_a_part(whole: Measured) -> None:
    results, document = whole
    assert "A part of the table: scenes, looks, repeats, frames are not the defaults." in document.read_text()
    whole_table = TableBenchmark(options=parse_options({}, defaults=DEFAULTS), report=quiet, cells=results.cells)
    assert "A part of" not in whole_table.section()


def test_plots_are_beside_the_document_and_the_same_for_the_same_figures(whole: Measured) -> None:
    results, document = whole
    names = ["bench_growth.svg", *(f"bench_{look}.svg" for look in LOOKS)]
    assert sorted(file.name for file in document.parent.glob("*.svg")) == sorted(names)
    for name in names:
        assert f"]({name})" in document.read_text()
        drawn = (document.parent / name).read_text()
        assert len(drawn) < 100_000
        assert drawn.count(">mitsuba-principled<") == 1  # one legend, whose text is text
    first = {name: (document.parent / name).read_bytes() for name in names}
    results.draw(document.parent, "bench_")
    assert first == {name: (document.parent / name).read_bytes() for name in names}


def test_ctrl_c_leaves_a_document_that_says_so(measure: Callable[..., Measured]) -> None:
    results, document = measure(backends=FakeBackends(ends_after=200))
    text = document.read_text()
    assert not results.complete
    assert "Not complete" in text
    assert rows_below(text, "Raw, to 0.01")[0][0] == "sphere, studio, plastic"
    assert "Growth with" not in text
    # Before the first measurement nothing is written.
    results, document = measure(backends=FakeBackends(ends_after=0))
    assert not results.complete
    assert document.read_text() == text


def test_backends_that_fail_or_are_not_here_are_in_the_document_by_name(
    measure: Callable[..., Measured], monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_llvm() -> None:
        raise RenderError("no LLVM")

    monkeypatch.setitem(matrix.BACKEND_CHECKS, "mitsuba", no_llvm)
    results, document = measure(small(looks=("plastic",)), FakeBackends(principled=60))
    text = document.read_text()
    assert results.complete
    assert "principled has no more ink" in text
    assert rows_below(text, "Raw, to 0.01")[-1][-1] != "-"
    assert "Without `mitsuba`: no LLVM." in text
    # What is missing is not what options restrict.
    assert "backends" not in text.partition("A part of the table: ")[2].partition(" are not")[0]


@pytest.mark.parametrize(
    "text",
    [
        "",
        f"{TABLE}\n",
        f"{TABLE}\n{SECTION_END}\n" * 2,
        SECTION_END,
        f"{TABLE}\n{section_marker('profile')}\n{SECTION_END}",
    ],
)
def test_a_document_without_a_place_is_refused_before_anything_is_measured(text: str, tmp_path: Path) -> None:
    file = tmp_path / "bench.md"
    file.write_text(text)
    backends = FakeBackends()
    with pytest.raises(LookdevError, match="goes between the lines '<!-- bench: table -->' and"):
        TableBenchmark(options=small(), report=quiet, open_candidates=backends).run(tmp_path / "out", file)
    assert backends.calls == []
    assert file.read_text() == text


def test_a_section_is_replaced_and_no_other(tmp_path: Path) -> None:
    file = tmp_path / "bench.md"
    one, two = section_marker("one"), section_marker("two")
    file.write_text(f"a\n{one}\n1\n{SECTION_END}\nb\n{two}\n{SECTION_END}\nc\n")
    write_section(file, "two", "new\n")
    write_section(file, "two", "newer\n")
    write_section(file, "one", "first")
    assert file.read_text() == f"a\n{one}\n\nfirst\n{SECTION_END}\nb\n{two}\n\nnewer\n{SECTION_END}\nc\n"
    split_document(file, "one")
