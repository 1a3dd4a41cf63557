"""Measurements as tables on the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from lookdev.bench.growth import Growth
from lookdev.bench.matrix import Options
from lookdev.bench.measure import CellResult, Series
from lookdev.bench.profile import Profile, profile_text
from lookdev.bench.results import Results, machine_line
from lookdev.bench.scale import WAYS, ScaleResults
from lookdev.bench.sequence import SequenceResult

BIAS_LIMIT = 5.0
"""Standard errors of a bias beyond which it is reported."""

MEGABYTE = 1e6
_LEGEND = (
    "s to: seconds of a frame to that relMSE; - not reached; ~ extrapolated; < the fewest samples suffice. exact is: "
    "the time of exact over that of the backend (least..most of the repeats)."
)


def print_results(results: Results, console: Console) -> None:
    """Print the machine, the table of times, then sequence and growth if measured."""
    console.print(Text(machine_line(results.machine)))
    for backend, why in results.missing.items():
        console.print(Text(f"without {backend}: {why}", style="bold"), soft_wrap=True)
    if results.cells:
        console.print(_times(results.cells, results.options.targets))
        for line in skip_lines(results.cells):
            console.print(Text(line), soft_wrap=True)
        for line in warnings(results.cells):
            console.print(Text(line, style="bold"), soft_wrap=True)
    if results.sequence:
        console.print(_sequence(results.sequence))
        if results.sequence.skips:
            console.print(Text(f"exact skips {', '.join(results.sequence.skips)}"), soft_wrap=True)
    for growth in results.growth:
        console.print(_growth(growth))
    for failure in results.failures:
        console.print(Text(failure, style="bold"), soft_wrap=True)
    if not results.complete:
        console.print(Text("Not complete: this is what was measured until it ended.", style="bold"))


def skip_lines(cells: Sequence[CellResult]) -> list[str]:
    """Return the skips of backends, one line for all cells with the same skips."""
    where: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for result in cells:
        for backend, skips in result.skips.items():
            if skips:
                where.setdefault((backend, skips), []).append(str(result.cell))
    return [f"{backend} skips {', '.join(skips)}: {'; '.join(names)}" for (backend, skips), names in where.items()]


def warnings(cells: Sequence[CellResult]) -> list[str]:
    """Return a line for each biased picture."""
    return [
        f"{result.cell}: {series} with {point.samples} samples is off by {point.bias:+.2%}, "
        f"{abs(point.bias) / point.bias_error:.1f} standard errors: biased, or the cached reference is of another "
        "picture; --fresh makes a new one"
        for result in cells
        for series, curve in result.curves.items()
        # What a denoiser smooths is biased.
        if series.way == "raw"
        for point in curve
        if abs(point.bias) > BIAS_LIMIT * point.bias_error
    ]


def _times(cells: Sequence[CellResult], targets: Sequence[float]) -> Table:
    # Wrapped, it fits into 80 columns without cutting numbers.
    table = Table(box=box.SIMPLE_HEAD, caption=_LEGEND, caption_justify="left", pad_edge=False, collapse_padding=True)
    table.add_column("scene, ibl, look", min_width=12)
    for target in targets:
        table.add_column(f"s to\n{target:.0e}".replace("e-0", "e-"), justify="right", min_width=6)
        table.add_column("exact is", justify="right", min_width=12)
    table.add_column("bias, %", justify="right", no_wrap=True)
    table.add_column("MB", justify="right", min_width=4)
    for result in cells:
        table.add_row(str(result.cell))
        for series, curve in result.curves.items():
            memory = max((row.memory for row in result.of(series)), default=None)
            row = [f"  {series}"]
            for target in targets:
                row += [str(result.reached[series][target].value or "-"), _ratio(result, series, target)]
            row.append(f"{100.0 * curve[-1].bias:+.2f}±{100.0 * curve[-1].bias_error:.2f}" if curve else "")
            row.append(f"{memory / MEGABYTE:.0f}" if memory else "")
            table.add_row(*row)
    return table


def _ratio(result: CellResult, series: Series, target: float) -> str:
    """Return the time of ``exact`` over that of a series, with the extremes over the repeats."""
    for each in result.ratios:
        if (each.backend, each.way, each.target) == (*series, target) and each.value is not None:
            extremes = each.low is not None and each.high is not None
            return f"x{each.value}" + (f" ({each.low:.2f}..{each.high:.2f})" if extremes else "")
    return ""


def _sequence(sequence: SequenceResult) -> Table:
    subject = sequence.subject
    table = Table(
        box=box.SIMPLE_HEAD,
        title=f"{sequence.frames} frames of {subject.scene}, {subject.look}, under {', '.join(subject.ibls)}: "
        f"exact makes {sequence.ratio:.2f} times as many a minute ({sequence.low:.2f}..{sequence.high:.2f})",
    )
    for column in ("", "samples", "relMSE", "frames a minute"):
        table.add_column(column, justify="right")
    for backend, samples in sequence.samples.items():
        speeds = ", ".join(f"{run.frames_per_minute:.2f}" for run in sequence.runs if run.backend == backend)
        table.add_row(backend, str(samples), f"{sequence.relmse[backend]:.2e}", speeds)
    return table


def print_scale(results: ScaleResults, console: Console) -> None:
    """Print the machine, and a row for each case and way with the medians of its starts."""
    console.print(Text(machine_line(results.machine)))
    table = Table(box=box.SIMPLE_HEAD)
    for column in ("", "s to the plan", "s to the first sample", "MB", "lookdev takes", "of the memory"):
        table.add_column(column, justify="right")
    for case in dict.fromkeys(each.case for each in results.starts):
        rows = {way: results.median(case, way) for way in WAYS}
        for way, (planned, sample, memory) in rows.items():
            row = [f"{case}, {way}", f"{planned:.2f}", f"{sample:.2f}", f"{memory / MEGABYTE:.0f}"]
            if way != "lookdev":
                row += [f"x{rows['lookdev'][1] / sample:.2f}", f"x{rows['lookdev'][2] / memory:.2f}"]
            table.add_row(*row)
    console.print(table)


def print_profile(profile: Profile, options: Options, console: Console) -> None:
    """Print the text of the document."""
    console.print(Text(profile_text(profile, options)), soft_wrap=True)


def _growth(growth: Growth) -> Table:
    table = Table(box=box.SIMPLE_HEAD)
    for column in (f"{growth.of}, {growth.backend}", "s a frame", "MB"):
        table.add_column(column, justify="right")
    for row in growth.rows:
        table.add_row(f"{row.size:,}", f"{row.seconds:.3f}", f"{row.memory / MEGABYTE:.0f}")
    return table
