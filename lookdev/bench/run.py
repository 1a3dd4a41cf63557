"""`lookdev bench`: everything in order; what was measured is on disk, however it ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path

from lookdev.bench import sequence
from lookdev.bench.backends import open_candidates
from lookdev.bench.growth import OpenRenderer, measure_growth
from lookdev.bench.matrix import Cell, Options
from lookdev.bench.measure import Candidate, CellRun
from lookdev.bench.report import draw_curves
from lookdev.bench.results import Results, this_machine
from lookdev.bench.sequence import Produce, Subject, choose_samples, measure_sequence, producers
from lookdev.errors import LookdevError

Open = Callable[[Cell, Options], AbstractContextManager[list[Candidate]]]
Report = Callable[[str], None]


def run_matrix(options: Options, folder: Path, report: Report, *, opened: Open = open_candidates) -> Results:
    """Measure every cell.

    Parameters
    ----------
    folder
        Takes ``results.csv``, ``results.json`` and the curves, after every cell and at the end, also where an error or
        Ctrl-C is the end: then `Results.complete` is false.
    report
        Is called with what is measured.
    opened
        Gives a cell's backends, ready to render.

    Raises
    ------
    WorkerError, RenderError
        A backend failed.
    """
    results = Results(options, this_machine())
    with _kept(results, folder):
        _measure_cells(results, folder, report, opened)
        results.complete = True
    return results


def run_sequence(
    options: Options,
    folder: Path,
    report: Report,
    *,
    frames: int,
    opened: Open = open_candidates,
    produce: Callable[[Subject], Mapping[str, Produce]] = producers,
    growth: OpenRenderer | None = None,
) -> Results:
    """Measure turntables against the plain script, then how cost grows; files and errors as `run_matrix`.

    The curves of ``exact`` and ``principled`` give the samples that make their errors equal. `frames` is how many the
    growth with frames is measured over.

    Raises
    ------
    LookdevError
        More than one scene or look is asked for, or one that the script does not know.
    """
    if len(options.scenes) != 1 or len(options.looks) != 1:
        raise LookdevError("the sequence is of one scene and one look: give --scenes and --looks one name each")
    subject = Subject(options.scenes[0], options.looks[0], options.ibls, options.resolution)
    options = replace(options, backends=("exact", "principled"))
    results = Results(options, this_machine())
    with _kept(results, folder):
        _measure_cells(results, folder, report, opened)
        curves = {backend: [result.curves[backend] for result in results.cells] for backend in ("exact", "principled")}
        results.sequence = measure_sequence(
            subject,
            choose_samples(curves["exact"], curves["principled"], sequence.TARGET),
            produce(subject),
            repeats=options.repeats,
            seed=options.seed,
            report=report,
        )
        results.write(folder)
        for each in measure_growth(frames, report, *([growth] if growth else [])):
            results.growth.append(each)
            results.write(folder)
        results.complete = True
    return results


def _measure_cells(results: Results, folder: Path, report: Report, opened: Open) -> None:
    for cell in results.options.cells():
        with opened(cell, results.options) as candidates:
            run = CellRun(cell, candidates, results.options)
            try:
                run.run(report)
            finally:
                if (result := run.result()).measurements:
                    results.cells.append(result)
        results.write(folder)


@contextmanager
def _kept(results: Results, folder: Path) -> Iterator[None]:
    """Write what there is at the end, and let Ctrl-C be an end like any other."""
    try:
        yield
    except KeyboardInterrupt:
        pass
    finally:
        results.write(folder)
        draw_curves(results, folder)
