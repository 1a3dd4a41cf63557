"""`lookdev bench`: everything in order; measurements so far are on disk, however a run ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path

from lookdev.bench import mitsuba_worker, sequence, table
from lookdev.bench.backends import open_candidates
from lookdev.bench.document import check_document, write_section
from lookdev.bench.growth import OpenRenderer, measure_growth, open_process
from lookdev.bench.matrix import Cell, Options
from lookdev.bench.measure import Candidate, CellRun, Series
from lookdev.bench.plots import draw_curves, draw_growth
from lookdev.bench.results import Results, this_machine
from lookdev.bench.sequence import Produce, Subject, choose_samples, measure_sequence, producers
from lookdev.errors import LookdevError, RenderError

Open = Callable[[Cell, Options], AbstractContextManager[list[Candidate]]]
Report = Callable[[str], None]

NEEDS: dict[str, Callable[[], object]] = dict.fromkeys(("mitsuba", "mitsuba-principled"), mitsuba_worker.check_mitsuba)
"""Of a backend that is not on every machine: raises RenderError where it is not."""


def run_matrix(options: Options, folder: Path, report: Report, *, opened: Open = open_candidates) -> Results:
    """Measure every cell, with the backends of a cell that `opened` yields.

    ``results.csv``, ``results.json`` and the curves are written to `folder` after every cell and at the end, also after
    an error or Ctrl-C; then `Results.complete` is false. A backend that fails is left out of its cell, and one that is
    not on this machine of all; both are in the results, with the reason.
    """
    results = Results(options, this_machine())
    with _kept(results, folder):
        _measure_cells(results, folder, report, opened)
        results.complete = True
    draw_curves(results.cells, options.targets, folder, "curves_")
    return results


def run_table(
    options: Options,
    folder: Path,
    report: Report,
    *,
    document: Path,
    restricted: tuple[str, ...] = (),
    opened: Open = open_candidates,
    growth: OpenRenderer = open_process,
) -> Results:
    """Measure the table and growth; write them to the document, with plots beside it, also after Ctrl-C.

    `restricted` are the options that make it a part of the table. Files and failures as of `run_matrix`; raises
    LookdevError, before anything is measured, where the document has no place for the table.
    """
    check_document(document, table.NAME)
    results = Results(options, this_machine(), restricted)
    try:
        with _kept(results, folder):
            # Plots take seconds: they are drawn at the end.
            backends = _measure_cells(results, folder, report, opened, lambda: _write_table(results, document))
            for each in measure_growth(backends, options, report, growth):
                if isinstance(each, str):
                    results.failures.append(each)
                else:
                    results.growth.append(each)
                results.write(folder)
            results.complete = True
    finally:
        _write_table(results, document, _draw(results, document))
    return results


def _write_table(results: Results, document: Path, plots: Sequence[Path] = ()) -> None:
    if results.cells:
        write_section(document, table.NAME, table.table_text(results, plots))


def _draw(results: Results, document: Path) -> list[Path]:
    plots = draw_curves(results.cells, results.options.targets, document.parent, "bench_")
    if results.growth:
        plots.append(draw_growth(results.growth, document.parent / "bench_growth.svg"))
    return plots


def run_sequence(
    options: Options,
    folder: Path,
    report: Report,
    *,
    opened: Open = open_candidates,
    produce: Callable[[Subject], Mapping[str, Produce]] = producers,
) -> Results:
    """Measure turntables against the plain script; files and errors as `run_matrix`.

    The curves of ``exact`` and ``principled`` give the samples that make their errors equal. Raises LookdevError for
    more than one scene or look, or one without a plain script, or where one of these backends fails.
    """
    if len(options.scenes) != 1 or len(options.looks) != 1:
        raise LookdevError("the sequence is of one scene and one look: give --scenes and --looks one name each")
    subject = Subject(options.scenes[0], options.looks[0], options.ibls, options.resolution)
    options = replace(options, backends=("exact", "principled"))
    results = Results(options, this_machine())
    with _kept(results, folder):
        _measure_cells(results, folder, report, opened)
        if results.failures:
            raise RenderError(results.failures[0])
        curves = {backend: [result.curves[Series(backend)] for result in results.cells] for backend in options.backends}
        results.sequence = measure_sequence(
            subject,
            choose_samples(curves["exact"], curves["principled"], sequence.TARGET),
            produce(subject),
            repeats=options.repeats,
            seed=options.seed,
            report=report,
        )
        results.complete = True
    draw_curves(results.cells, options.targets, folder, "curves_")
    return results


def _measure_cells(
    results: Results, folder: Path, report: Report, opened: Open, after: Callable[[], None] = lambda: None
) -> tuple[str, ...]:
    """Measure all cells, with `after` each; return the backends that are on this machine."""
    options = results.options
    for backend in options.backends:
        try:
            NEEDS.get(backend, lambda: None)()
        except RenderError as error:
            results.missing[backend] = str(error)
            report(f"without {backend}: {error}")
    backends = tuple(backend for backend in options.backends if backend not in results.missing)
    if not backends:
        raise LookdevError("; ".join(f"{backend}: {why}" for backend, why in results.missing.items()))
    options = replace(options, backends=backends)
    for cell in options.cells():
        try:
            with opened(cell, options) as candidates:
                run = CellRun(cell, candidates, options)
                try:
                    run.run(report)
                finally:
                    result = run.result()
                    if result.measurements:
                        results.cells.append(result)
                    results.failures += [f"{cell}: {backend}: {why}" for backend, why in result.failures.items()]
        except (LookdevError, OSError) as error:
            results.failures.append(f"{cell}: {error}")
            report(f"{cell} fails: {error}")
        results.write(folder)
        after()
    return backends


@contextmanager
def _kept(results: Results, folder: Path) -> Iterator[None]:
    """Write the results at the end, also after an error; Ctrl-C ends the block without one."""
    folder.mkdir(parents=True, exist_ok=True)  # where it cannot be made, nothing is measured in vain
    try:
        yield
    except KeyboardInterrupt:
        pass
    finally:
        results.write(folder)
