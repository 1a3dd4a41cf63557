"""The table of `lookdev bench --table`, as text of a document: times to an error, estimates, growth."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Sequence
from pathlib import Path

from lookdev.bench.curves import Reached
from lookdev.bench.document import markdown
from lookdev.bench.growth import Growth
from lookdev.bench.measure import EXACT, PICTURES, CellResult, CurvePoint, Measurement, Ratio, Series, Times, Way
from lookdev.bench.report import MEGABYTE, warnings
from lookdev.bench.results import Results, machine_line

NAME = "table"
"""Of the section of the document, and the prefix of its plots."""

_TITLES = {"mitsuba": "`mitsuba`", "principled": "Blender's Principled", "mitsuba-principled": "Mitsuba's principled"}
_LEGEND = (
    "Seconds of a frame to the relMSE; in brackets the least and the most of the repeats. *takes*: the time of `exact` "
    "over that of the backend before it. *by samples*: the samples that `exact` needs over those of the backend, times "
    "what a sample of `exact` costs more in renders that followed each other. `~`: beyond the most samples, which did "
    "not suffice; `<`: the fewest samples suffice; `-`: not reached. Geometric means are of all ratios but bounds."
)


def table_text(results: Results, plots: Sequence[Path]) -> str:
    """Return the section: the machine, tables of times, of errors, of estimates and of growth, and the plots."""
    return "\n\n".join(_blocks(results, plots))


def _blocks(results: Results, plots: Sequence[Path]) -> Iterator[str]:
    options = results.options
    yield f"{machine_line(results.machine)}."
    yield (
        f"{options.resolution} x {options.resolution} pixels, {options.samples[0]} to {options.samples[-1]} samples, "
        f"medians of {options.repeats} interleaved runs."
    )
    if results.restricted:
        yield f"A part of the table: {', '.join(results.restricted)} are not the defaults."
    if not results.complete:
        yield "Not complete: this is what was measured until it ended."
    for backend, why in results.missing.items():
        yield f"Without `{backend}`: {why}."
    if results.cells:
        yield _LEGEND
    for way in PICTURES:
        for target in options.targets:
            if rows := list(_times(results.cells, way, target)):
                yield f"#### {way.capitalize()}, to {target:g}"
                yield markdown(_head(results.cells), rows)
    if results.cells:
        yield "#### At the most samples"
        yield _most(results.cells)
    if rows := list(_estimates(results.cells)):
        yield f"#### Estimates, and frames that end at {options.aim:g}"
        yield (
            "The relMSE that `exact` estimates of a frame, over that against the reference: the median of all frames, "
            "the least and the most. Then frames that are rendered until they estimate "
            f"{options.aim:g}, with at most {options.samples[-1]} samples: seconds, samples, true relMSE."
        )
        head = ("", "raw: estimate over truth", "denoised", "raw: s", "samples", "relMSE")
        yield markdown((*head, "denoised: s", "samples", "relMSE"), rows)
    for of in dict.fromkeys(each.of for each in results.growth):
        yield f"#### Growth with {of}"
        yield _growth([each for each in results.growth if each.of == of])
    notes = [*results.failures, *warnings(results.cells)]
    if notes:
        yield "\n".join(f"- {' '.join(note.split())}" for note in notes)
    yield from (f"![{plot.stem}]({plot.name})" for plot in plots)


def _others(cells: Sequence[CellResult]) -> list[str]:
    """Return the backends besides ``exact``, in order."""
    return list(dict.fromkeys(each.backend for cell in cells for each in cell.curves if each.backend != EXACT))


def _head(cells: Sequence[CellResult]) -> list[str]:
    names = (_TITLES.get(backend, backend) for backend in _others(cells))
    return ["", "exact, s", *(column for name in names for column in (f"{name}, s", "takes", "by samples"))]


def _times(cells: Sequence[CellResult], way: Way, target: float) -> Iterator[list[str]]:
    """Yield a row for each cell, then geometric means for each scene, and of all."""
    mine = [cell for cell in cells if cell.reached.get(Series(EXACT, way))]
    if not mine:
        return
    ratios: dict[str, dict[str, Ratio]] = {}
    for cell in mine:
        ratios[str(cell.cell)] = {
            each.backend: each for each in cell.ratios if (each.way, each.target) == (way, target)
        }
        row = [str(cell.cell), _seconds(cell.reached[Series(EXACT, way)].get(target))]
        for backend in _others(cells):
            times = cell.reached.get(Series(backend, way), {}).get(target)
            row += [_seconds(times), *_takes(ratios[str(cell.cell)].get(backend))]
        yield row
    scenes = list(dict.fromkeys(cell.cell.scene for cell in mine))
    for name, among in [*((scene, [scene]) for scene in scenes if len(scenes) > 1), ("all", scenes)]:
        row = [f"geometric mean, {name}", ""]
        chosen = [cell for cell in mine if cell.cell.scene in among]
        for backend in _others(cells):
            found = [each for cell in chosen if (each := ratios[str(cell.cell)].get(backend))]
            row += ["", _mean([each.value for each in found], len(chosen))]
            row.append(_mean([each.by_samples for each in found], len(chosen)))
        yield row


def _mean(values: Sequence[Reached | None], of: int) -> str:
    known = [each.value for each in values if each is not None and each.mark in ("", "~")]
    if not known:
        return "-"
    return f"{statistics.geometric_mean(known):.2f}" + (f" ({len(known)} of {of})" if len(known) < of else "")


def _seconds(times: Times | None) -> str:
    if times is None or times.value is None:
        return "-"
    return f"{times.value.mark}{_short(times.value.value)}{_spread(times.low, times.high)}"


def _takes(found: Ratio | None) -> tuple[str, str]:
    if found is None or found.value is None:
        return "-", "-"
    by_samples = "-" if found.by_samples is None else f"{found.by_samples.mark}{found.by_samples.value:.2f}"
    return f"{found.value.mark}{found.value.value:.2f}{_spread(found.low, found.high)}", by_samples


def _most(cells: Sequence[CellResult]) -> str:
    """Return a table of the last point of each curve: samples, seconds, relMSE."""
    every = list(dict.fromkeys(series for cell in cells for series in cell.curves))
    rows = []
    for cell in cells:
        points = (cell.curves.get(series, ()) for series in every)
        rows.append([str(cell.cell), *(_point(curve[-1]) if curve else "-" for curve in points)])
    return markdown(["", *(f"{series}: samples, s, relMSE" for series in every)], rows)


def _point(point: CurvePoint) -> str:
    error = "uncertain" if point.relmse is None else f"{point.relmse:.2e}"
    return f"{point.samples}, {_short(point.seconds)}, {error}"


def _estimates(cells: Sequence[CellResult]) -> Iterator[list[str]]:
    """Yield a row for each cell whose frames estimate their errors, then one of all."""
    everything: dict[Way, list[Measurement]] = {way: [] for way in PICTURES}
    for cell in cells:
        if cell.of(Series(EXACT)):
            for way in PICTURES:
                everything[way] += cell.of(Series(EXACT, way))
            aimed = (_aimed(cell.of(Series(EXACT, way))) for way in ("aimed", "aimed, denoised"))
            estimates = (_over_truth(cell.of(Series(EXACT, way))) for way in PICTURES)
            yield [str(cell.cell), *estimates, *(column for columns in aimed for column in columns)]
    if any(everything.values()):
        yield ["all", *map(_over_truth, everything.values()), *[""] * 6]


def _over_truth(rows: Sequence[Measurement]) -> str:
    ratios = [row.estimate / row.relmse for row in rows if row.estimate is not None and row.relmse]
    return f"{statistics.median(ratios):.2f} ({min(ratios):.2f}..{max(ratios):.2f})" if ratios else "-"


def _aimed(rows: Sequence[Measurement]) -> tuple[str, str, str]:
    if not rows:
        return "-", "-", "-"
    seconds = [row.seconds for row in rows]
    known = [row.relmse for row in rows if row.relmse is not None]
    error = f"{statistics.median(known):.2e}" if known else "uncertain"
    samples = f"{statistics.median(row.samples for row in rows):.0f}"
    return f"{_short(statistics.median(seconds))}{_spread(min(seconds), max(seconds))}", samples, error


def _growth(growth: Sequence[Growth]) -> str:
    sizes = sorted({row.size for each in growth for row in each.rows})
    rows = []
    for size in sizes:
        line = [f"{size:,}"]
        for each in growth:
            found = next((row for row in each.rows if row.size == size), None)
            line += (
                [f"{_short(found.seconds)}{_spread(found.low, found.high)}", f"{found.memory / MEGABYTE:.0f}"]
                if found
                else ["-", "-"]
            )
        rows.append(line)
    of = growth[0].of
    return markdown([of, *(column for each in growth for column in (f"{each.backend}, s a frame", "MB"))], rows)


def _spread(low: float | None, high: float | None) -> str:
    """Return the extremes in brackets, where there are two."""
    return "" if low is None or high is None or low == high else f" ({_short(low)}..{_short(high)})"


def _short(value: float) -> str:
    """Return a number with three digits, not in powers of ten."""
    digits = max(0, 2 - math.floor(math.log10(value))) if value > 0.0 else 0
    return f"{value:.{min(digits, 4)}f}"
