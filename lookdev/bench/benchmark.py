"""The base of benchmarks: a run with its measurements so far, its files, its section of a document, its report."""

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

Subject = TypeVar("Subject")

ANSWER_TIMEOUT = 3600.0
"""Seconds: a part of a reference is one long frame, for which some backends report no progress."""

MEGABYTE = 1e6
SECTION_END = "<!-- end -->"

OpenRenderer = Callable[[], AbstractContextManager[RenderFrame]]
open_process: OpenRenderer = partial(open_renderer, ANSWER_TIMEOUT)


@dataclass(frozen=True)
class Machine:
    """The machine of a run; `load` is its load average over 1, 5 and 15 minutes before the start."""

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
    """Return this machine, as it is now."""
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
    """A middle value, mostly the median, and the extremes where there are any."""

    middle: float
    low: float | None
    high: float | None

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        return cls(statistics.median(values), min(values), max(values))

    def text(self, form: Callable[[float], str] = "{:.2f}".format, middle: str | None = None) -> str:
        """Return the middle, whose text can be of another form, and the extremes in brackets where they differ."""
        low, high = ("" if extreme is None else form(extreme) for extreme in (self.low, self.high))
        return (middle or form(self.middle)) + (f" ({low}..{high})" if low != high else "")


@dataclass(frozen=True)
class TextTable:
    """A table of text, in a section or a report; all columns but the first are numbers."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    def text(self, *, aligned: bool = False) -> str:
        """Return it in Markdown, whose columns can be aligned, as for a terminal."""
        rows = [self.head, ["---", *["---:"] * (len(self.head) - 1)], *self.rows]
        widths = [max(map(len, column)) if aligned else 0 for column in zip(*rows, strict=True)]
        return "\n".join(f"| {' | '.join(map(str.ljust, row, widths))} |" for row in rows)


def join_blocks(blocks: Iterable[str | TextTable], *, aligned: bool = False) -> str:
    """Return texts and tables as one text."""
    return "\n\n".join(block if isinstance(block, str) else block.text(aligned=aligned) for block in blocks)


def section_marker(name: str) -> str:
    """Return the line before the section of a benchmark in a document."""
    return f"<!-- bench: {name} -->"


def split_document(file: Path, name: str) -> tuple[str, str]:
    """Return the text before and after a section; raises LookdevError unless its markers are there once, in order."""
    parts = read_text(file).split(f"{section_marker(name)}\n")
    section, end, after = parts[-1].partition(SECTION_END)
    if len(parts) != 2 or not end or "<!-- bench:" in section:
        raise LookdevError(
            f"{file}: measured text goes between the lines '{section_marker(name)}' and '{SECTION_END}', once"
        )
    return f"{parts[0]}{section_marker(name)}\n", f"{end}{after}"


def write_section(file: Path, name: str, text: str) -> None:
    """Replace the text between markers, and nothing else; the file is written whole or not at all."""
    before, after = split_document(file, name)
    with atomic_path(file) as path:
        path.write_text(f"{before}\n{text.strip()}\n{after}", encoding="utf-8")


def write_csv(file: Path, kind: type[Any], rows: Sequence[Any]) -> None:
    """Write a row for each instance of a dataclass, whole or not at all."""
    with atomic_path(file) as path, path.open("w", newline="", encoding="utf-8") as stream:
        table = csv.DictWriter(stream, [column.name for column in fields(kind)])
        table.writeheader()
        table.writerows(map(asdict, rows))


@dataclass(kw_only=True)
class Benchmark:
    """A kind of benchmark; an instance is a run, with what was measured so far.

    A subclass measures step by step, and appends to the list that `ROWS` names. Its `DEFAULTS` are fields of
    `BenchOptions`.
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
        """Raise LookdevError where the options are not those of this benchmark."""

    def measure(self) -> Iterator[None]:
        """Measure, and yield after each step, when files can be written."""
        raise NotImplementedError

    def blocks(self) -> Iterator[str | TextTable]:
        """Yield the text of the section and of the report, and its tables."""
        raise NotImplementedError

    def draw(self, folder: Path, prefix: str) -> list[Path]:
        """Draw plots, and return their files."""
        return []

    def run(self, folder: Path, document: Path | None = None) -> None:
        """Measure; write files to a folder and the section of a document after each step, and however it ends.

        Ctrl-C ends it without an error; `complete` is false then. Raises LookdevError before anything is measured
        where options are wrong, or where the document has no place for the section.
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
        """The options that restrict it to a part of its kind of benchmark."""
        return restrictions(self.options, self.DEFAULTS)

    @property
    def exit_code(self) -> int:
        """130 after Ctrl-C, 1 where something could not be measured, else 0."""
        return 130 if not self.complete else int(bool(self.failures))

    def _write(self, folder: Path, document: Path | None) -> None:
        self.write(folder)
        if document and self.rows:
            write_section(document, self.NAME, self.section())

    def write(self, folder: Path) -> None:
        """Write the files of the measurements, each whole or not at all."""
        with atomic_path(folder / self.FILE) as path:
            path.write_text(json.dumps(self.data(), indent=1, allow_nan=False) + "\n", encoding="utf-8")

    def data(self) -> dict[str, Any]:
        """Return the measurements as plain data."""
        return {
            "complete": self.complete,
            "machine": asdict(self.machine),
            "options": asdict(self.options),
            "restricted": self.restricting_options,
            "failures": self.failures,
            self.ROWS: [self.row_data(row) for row in self.rows],
        }

    def row_data(self, row: Any) -> dict[str, Any]:
        """Return a measurement as plain data."""
        return asdict(row)

    def header(self, settings: str = "") -> Iterator[str]:
        """Yield the machine, a line of settings, and whether this is only a part of the benchmark."""
        yield f"{self.machine}."
        if settings:
            yield settings
        if self.restricting_options:
            yield f"A part of the {self.NAME}: {', '.join(self.restricting_options)} are not the defaults."
        if not self.complete:
            yield "Not complete: this is what was measured until it ended."

    def section(self) -> str:
        """Return the section of a document."""
        plots = (f"![{plot.stem}]({plot.name})" for plot in self.plots)
        return join_blocks((*self.blocks(), *plots))

    def details(self) -> Iterator[str | TextTable]:
        """Yield the texts and tables that only the report has."""
        yield from ()

    def summary(self) -> str:
        """Return the report for a terminal."""
        return join_blocks((*self.blocks(), *self.details()), aligned=True)


def bullets(notes: Sequence[str]) -> str:
    """Return notes as a list of Markdown."""
    return "\n".join(f"- {' '.join(note.split())}" for note in notes)


def render_in_turn(
    scenes: Sequence[Subject], task: Callable[[Subject, int], FrameTask], repeats: int, open_process: OpenRenderer
) -> Iterator[list[WorkerFrame]]:
    """Yield the frames of each repeat, interleaved, each scene in a process of its own.

    `task` takes a scene and the number of the repeat, from 1; number 0 warms up.
    """
    with ExitStack() as stack:
        renders = [stack.enter_context(open_process()) for _ in scenes]
        for repeat in range(1 + repeats):
            frames = [render(task(scene, repeat)) for scene, render in zip(scenes, renders, strict=True)]
            if repeat > 0:
                yield frames
