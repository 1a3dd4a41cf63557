"""`lookdev bench`: everything in order; measurements so far are on disk, however a run ends."""

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
    """Measure every cell, with the backends of a cell that `opened` yields.

    ``results.csv``, ``results.json`` and the curves are written to `folder` after every cell and at the end, also after
    an error or Ctrl-C; then `Results.complete` is false. Raises WorkerError or RenderError where a backend fails.
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
    """Measure turntables against the plain script, then growth over `frames`; files and errors as `run_matrix`.

    The curves of ``exact`` and ``principled`` give the samples that make their errors equal. Raises LookdevError for
    more than one scene or look, or one without a plain script.
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
    """Write the results at the end, also after an error; Ctrl-C ends the block without one."""
    folder.mkdir(parents=True, exist_ok=True)  # where it cannot be made, nothing is measured in vain
    try:
        yield
    except KeyboardInterrupt:
        pass
    finally:
        results.write(folder)
        draw_curves(results, folder)
