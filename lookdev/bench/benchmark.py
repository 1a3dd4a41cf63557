"""The base class of all benchmarks of `lookdev bench`, and the tables, statistics and files that they share.

A run writes its measurements to a folder and, on request, to a section of a Markdown document. The terminal shows a
report of the run. A section of a document is the text between the line `section_marker(name)` and the line
`SECTION_END`.
"""

from __future__ import annotations

import csv
import json
import os
import platform
import statistics
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import asdict, dataclass, field, fields
from datetime import UTC, datetime
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, TypeVar

import lookdev
from lookdev.bench.options import BenchOptions, restrictions
from lookdev.bench.reference import RenderFrame, ReportProgress
from lookdev.cache import atomic_path
from lookdev.errors import LookdevError
from lookdev.rendering.backends import blender_version
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import FrameTask
from lookdev.rendering.threads import usable_cores
from lookdev.rendering.worker import open_renderer
from lookdev.safe_text import read_text

Subject = TypeVar("Subject")  # what `render_in_turn` renders

ANSWER_TIMEOUT = 3600.0
"""Seconds that a worker may be silent before it counts as failed.

The limit is long because a part of a reference is one long frame, for which some backends report no progress.
"""

MEGABYTE = 1e6  # bytes
SECTION_END = "<!-- end -->"

OpenRenderer = Callable[[], AbstractContextManager[RenderFrame]]
"""A function that starts a render process, and returns a context manager. The process ends with the context.

The context manager yields a function that renders frames in this process.
"""

open_process: OpenRenderer = partial(open_renderer, ANSWER_TIMEOUT)


@dataclass(frozen=True)
class Machine:
    """The machine of a run. `load` is its load average over 1, 5 and 15 minutes before the start.

    `cores` is the number of cores that this process may use. `versions` maps the name of a program or package to its
    version. `date` is the time of the start, in ISO format.
    """

    cpu: str
    cores: int
    load: tuple[float, float, float]
    system: str
    versions: dict[str, str]
    date: str

    def __str__(self) -> str:
        versions = ", ".join(f"{name} {version}" for name, version in self.versions.items())
        return f"{self.cpu}, {self.cores} cores, load {self.load[0]:.1f} before; {versions}; {self.date}"


def this_machine() -> Machine:
    """Return the description of this machine, with the load and the time of this call."""
    lines = Path("/proc/cpuinfo").read_text(errors="replace").splitlines()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    versions = {"lookdev": lookdev.__version__, "blender": blender_version(), "python": platform.python_version()}
    for package in ("numpy", "mitsuba"):
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = "not installed"
    cpu, date = models[0] if models else platform.machine(), datetime.now(UTC).isoformat(timespec="seconds")
    return Machine(cpu, usable_cores(), os.getloadavg(), platform.platform(), versions, date)


class Spread(NamedTuple):
    """The spread of several measurements.

    `middle` is a middle value, mostly the median. `low` and `high` are the smallest and the largest measurement, or
    None if there is no measurement to take them from.
    """

    middle: float
    low: float | None
    high: float | None

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """Return the median and the extremes of values."""
        return cls(statistics.median(values), min(values), max(values))

    def text(self, form: Callable[[float], str] = "{:.2f}".format, middle: str | None = None) -> str:
        """Return the middle, followed by the extremes in brackets if these differ.

        `form` formats a number. `middle`, if given, is the text of the middle in place of the formatted one.
        """
        low, high = ("" if extreme is None else form(extreme) for extreme in (self.low, self.high))
        return (middle or form(self.middle)) + (f" ({low}..{high})" if low != high else "")


@dataclass(frozen=True)
class TextTable:
    """A table of text, in a section or a report. All columns but the first contain numbers and are right-aligned."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    def text(self, *, aligned: bool = False) -> str:
        """Return the table in Markdown; with `aligned`, cells are padded to the width of their column."""
        rows = [self.head, ["---", *["---:"] * (len(self.head) - 1)], *self.rows]
        widths = [max(map(len, column)) if aligned else 0 for column in zip(*rows, strict=True)]
        return "\n".join(f"| {' | '.join(map(str.ljust, row, widths))} |" for row in rows)


def join_blocks(blocks: Iterable[str | TextTable], *, aligned: bool = False) -> str:
    """Return texts and tables as one text in Markdown, with blank lines between them."""
    return "\n\n".join(block if isinstance(block, str) else block.text(aligned=aligned) for block in blocks)


def section_marker(name: str) -> str:
    """Return the line that begins the section of a benchmark in a document."""
    return f"<!-- bench: {name} -->"


def split_document(file: Path, name: str) -> tuple[str, str]:
    """Return the text before the section of the benchmark `name`, and the text after it, both with their markers.

    Raises LookdevError unless the document has the two markers once and in order.
    """
    parts = read_text(file).split(f"{section_marker(name)}\n")
    section, end, after = parts[-1].partition(SECTION_END)
    if len(parts) != 2 or not end or "<!-- bench:" in section:
        raise LookdevError(
            f"{file}: measured text goes between the lines '{section_marker(name)}' and '{SECTION_END}', once"
        )
    return f"{parts[0]}{section_marker(name)}\n", f"{end}{after}"


def write_section(file: Path, name: str, text: str) -> None:
    """Replace the text between the markers of the benchmark `name`; the file is written whole or not at all."""
    before, after = split_document(file, name)
    with atomic_path(file) as path:
        path.write_text(f"{before}\n{text.strip()}\n{after}", encoding="utf-8")


def write_csv(file: Path, kind: type[Any], rows: Sequence[Any]) -> None:
    """Write a table with a row for each instance of the dataclass `kind`; the file is written whole or not at all."""
    with atomic_path(file) as path, path.open("w", newline="", encoding="utf-8") as stream:
        table = csv.DictWriter(stream, [column.name for column in fields(kind)])
        table.writeheader()
        table.writerows(map(asdict, rows))


@dataclass(kw_only=True)
class Benchmark:
    """The base class of benchmarks; an instance is one run, with the measurements so far.

    A subclass measures step by step, and appends each measurement to a list.

    Attributes
    ----------
    NAME
        The name of the benchmark, as in its option and in the markers of its section.
    FILE
        The name of the file with the measurements.
    ROWS
        The name of the attribute that is the list of measurements.
    DEFAULTS
        Default values that this benchmark has in place of the defaults of `BenchOptions`, by the name of the field.
    report
        Shows a line of progress.
    failures
        A message for each thing that could not be measured.
    complete
        Whether the run has ended without an interruption or error.
    plots
        The files that `draw` returned.
    """

    NAME: ClassVar[str]
    FILE: ClassVar[str]
    ROWS: ClassVar[str]
    DEFAULTS: ClassVar[Mapping[str, Any]] = {}

    options: BenchOptions
    report: ReportProgress
    open_process: OpenRenderer = open_process  # opens a renderer in a process of its own
    machine: Machine = field(default_factory=this_machine)
    failures: list[str] = field(default_factory=list)
    complete: bool = False
    plots: list[Path] = field(default_factory=list)

    def check(self) -> None:
        """Raise LookdevError if this benchmark cannot run with the options."""

    def measure(self) -> Iterator[None]:
        """Measure step by step, and yield after each step, so that the caller can write the files."""
        raise NotImplementedError

    def blocks(self) -> Iterator[str | TextTable]:
        """Yield the texts and tables that both the section and the report contain."""
        raise NotImplementedError

    def draw(self, folder: Path, prefix: str) -> list[Path]:
        """Draw plots into a folder, and return their files; `prefix` begins the names of the files."""
        return []

    def run(self, folder: Path, document: Path | None = None) -> None:
        """Measure; write files to a folder and the section to a document after each step and at the end.

        The files are written even if a step raises an error. Ctrl-C ends the run without an error; `complete` is then
        false. Raises LookdevError before anything is measured if options are wrong, or if the document lacks the
        markers of the section.
        """
        if document:
            split_document(document, self.NAME)
        self.check()
        folder.mkdir(parents=True, exist_ok=True)
        try:
            for _ in self.measure():
                self._write(folder, document)
            self.complete = True
        except KeyboardInterrupt:
            self.report("interrupted")
        finally:
            if self.rows:
                self.plots = self.draw(document.parent, "bench_") if document else self.draw(folder, "curves_")
            self._write(folder, document)

    @property
    def rows(self) -> list[Any]:
        """The measurements so far."""
        return getattr(self, self.ROWS)  # type: ignore[no-any-return]

    @property
    def restricting_options(self) -> tuple[str, ...]:
        """The names of the options that differ from the benchmark's defaults, so that only a part is measured."""
        return restrictions(self.options, self.DEFAULTS)

    @property
    def exit_code(self) -> int:
        """130 after Ctrl-C, 1 if something could not be measured, else 0."""
        return 130 if not self.complete else int(bool(self.failures))

    def _write(self, folder: Path, document: Path | None) -> None:
        """Write the files and, if anything is measured and a document is given, its section."""
        self.write(folder)
        if document and self.rows:
            write_section(document, self.NAME, self.section())

    def write(self, folder: Path) -> None:
        """Write the files of the measurements to a folder, each whole or not at all."""
        with atomic_path(folder / self.FILE) as path:
            path.write_text(json.dumps(self.data(), indent=1, allow_nan=False) + "\n", encoding="utf-8")

    def data(self) -> dict[str, Any]:
        """Return the run and its measurements as plain data for JSON."""
        return {
            "complete": self.complete,
            "machine": asdict(self.machine),
            "options": asdict(self.options),
            "restricted": self.restricting_options,
            "failures": self.failures,
            self.ROWS: [self.row_data(row) for row in self.rows],
        }

    def row_data(self, row: Any) -> dict[str, Any]:
        """Return a measurement as plain data for JSON."""
        return asdict(row)

    def header(self, settings: str = "") -> Iterator[str]:
        """Yield the machine, the text `settings`, and notes if options are not the defaults or the run is partial."""
        yield f"{self.machine}."
        if settings:
            yield settings
        if self.restricting_options:
            yield f"A part of the {self.NAME}: {', '.join(self.restricting_options)} are not the defaults."
        if not self.complete:
            yield "Not complete: this is what was measured until it ended."

    def section(self) -> str:
        """Return the section of a document in Markdown, with links to the plots."""
        plots = (f"![{plot.stem}]({plot.name})" for plot in self.plots)
        return join_blocks((*self.blocks(), *plots))

    def details(self) -> Iterator[str | TextTable]:
        """Yield the texts and tables that only the report has."""
        yield from ()

    def summary(self) -> str:
        """Return the report that the terminal shows."""
        return join_blocks((*self.blocks(), *self.details()), aligned=True)


def bullets(notes: Sequence[str]) -> str:
    """Return a list in Markdown with an item for each note."""
    return "\n".join(f"- {' '.join(note.split())}" for note in notes)


def render_in_turn(
    scenes: Sequence[Subject], task: Callable[[Subject, int], FrameTask], repeats: int, open_process: OpenRenderer
) -> Iterator[list[WorkerFrame]]:
    """Render all scenes in turn, once for each repeat; yield the frames of a repeat, in the order of the scenes.

    Each scene has a render process of its own. `task` takes a scene and the number of the repeat, and returns the task
    to render. Repeats are numbered from 1; the frames of number 0 warm up the processes and are not yielded.
    """
    with ExitStack() as stack:
        renders = [stack.enter_context(open_process()) for _ in scenes]
        for repeat in range(1 + repeats):
            frames = [render(task(scene, repeat)) for scene, render in zip(scenes, renders, strict=True)]
            if repeat > 0:
                yield frames
