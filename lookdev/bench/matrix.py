"""The benchmark of time against error: renders every cell (a scene, a light and a look) with several backends.

A second benchmark, the table of docs/bench.md, adds the growth of cost with the size of a scene.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from lookdev.bench import report
from lookdev.bench.benchmark import Benchmark, TextTable, bullets, open_process, write_csv
from lookdev.bench.growth import QUANTITIES, Growth
from lookdev.bench.measure import Candidate, CellRun, Measurement, Series
from lookdev.bench.mitsuba_worker import check_mitsuba
from lookdev.bench.options import BenchOptions, Cell
from lookdev.bench.reference import picture_renderer
from lookdev.bench.subjects import LOOKS, SCENES, bench_asset, bench_lights, bench_scene, picture_key
from lookdev.errors import LookdevError, RenderError
from lookdev.plan.skips import Skip, scene_skips
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.task import SceneTask
from lookdev.scene import Sampling

OpenCandidates = Callable[[Cell, BenchOptions], AbstractContextManager[list[Candidate]]]
"""A function that returns a context manager. It yields the backends that can render a cell, and ends them."""

BACKEND_CHECKS: dict[str, Callable[[], object]] = dict.fromkeys(("mitsuba", "mitsuba-principled"), check_mitsuba)
"""Functions that raise RenderError if this machine lacks a backend, by the name of the backend.

All other backends are on every machine."""


@contextmanager
def open_candidates(cell: Cell, options: BenchOptions) -> Iterator[list[Candidate]]:
    """Start a process for each backend that can render the cell; yield the backends, and end their processes."""
    look, lights = LOOKS[cell.look].make(), bench_lights(cell.ibl, bench_asset(cell.scene))
    with ExitStack() as stack:
        candidates = []
        for backend in options.backends_of(cell):
            scene = bench_scene(cell.scene, look, lights, options.resolution, backend, denoise=options.denoise)
            render = picture_renderer(stack.enter_context(open_process()), scene)
            key, denoises = picture_key(scene, look, cell.ibl), BACKENDS[backend].has_denoising_guides
            candidates.append(Candidate(backend, key, render, skips_of(cell, scene), denoises))
        yield candidates


def skips_of(cell: Cell, scene: SceneTask) -> tuple[str, ...]:
    """Return the work that a scene leaves out because it changes no pixel, each with the reason.

    There is none for a backend that jobs cannot name.
    """
    if not BACKENDS[scene.backend].in_jobs:
        return ()
    looks = [LOOKS[cell.look].make()] * len(scene.slot_shaders)
    skips = scene_skips(scene, looks, Sampling(bounces=SCENES[cell.scene].bounces))
    return tuple(str(Skip(cell.look, cell.ibl, skipped, reason)) for skipped, reason in skips)


@dataclass(kw_only=True)
class MatrixBenchmark(Benchmark):
    """The benchmark of time against error, for any scenes, lights, looks and backends.

    If a backend fails, the rest of its cell is measured without it. If the machine lacks a backend, all cells are
    measured without it. In both cases the results state the reason.
    """

    NAME = "matrix"
    FILE = "results.json"
    ROWS = "cells"

    open_candidates: OpenCandidates = open_candidates
    cells: list[CellRun] = field(default_factory=list)
    missing: dict[str, str] = field(default_factory=dict)  # backends that are not on this machine, and why
    growth: list[Growth] = field(default_factory=list)

    @property
    def backends(self) -> tuple[str, ...]:
        """The backends that are on this machine."""
        return tuple(backend for backend in self.options.backends if backend not in self.missing)

    def measure(self) -> Iterator[None]:
        for backend in self.options.backends:
            try:
                BACKEND_CHECKS.get(backend, lambda: None)()
            except RenderError as error:
                self.missing[backend] = str(error)
                self.report(f"without {backend}: {error}")
        if not self.backends:
            raise LookdevError("; ".join(f"{backend}: {reason}" for backend, reason in self.missing.items()))
        options = replace(self.options, backends=self.backends)
        for cell in options.cells():
            try:
                with self.open_candidates(cell, options) as candidates:
                    self._measure_cell(CellRun(cell, candidates, options, self.report))
            except (LookdevError, OSError) as error:
                self.failures.append(f"{cell}: {error}")
                self.report(f"{cell} fails: {error}")
            yield

    def _measure_cell(self, cell: CellRun) -> None:
        """Measure a cell; its measurements and failures are kept even if an error ends it."""
        try:
            cell.run()
        finally:
            if cell.measurements:
                self.cells.append(cell)
            self.failures += [f"{cell.cell}: {backend}: {reason}" for backend, reason in cell.failures.items()]

    def draw(self, folder: Path, prefix: str) -> list[Path]:
        plots = report.draw_curves(self.cells, self.options.targets, folder, prefix)
        return [*plots, report.draw_growth(self.growth, folder / f"{prefix}growth.svg")] if self.growth else plots

    def write(self, folder: Path) -> None:
        """Write ``results.csv``, with a row for each measurement, and ``results.json``."""
        write_csv(folder / "results.csv", Measurement, [row for cell in self.cells for row in cell.measurements])
        super().write(folder)

    def data(self) -> dict[str, Any]:
        rows = [asdict(result) for result in self.growth]
        return super().data() | {"missing": self.missing, "sequence": None, "growth": rows}

    def row_data(self, row: CellRun) -> dict[str, Any]:
        return {
            **asdict(row.cell),
            "series": {str(series): _series_data(row, series) for series in row.curves},
            "exact_over": [
                asdict(ratio)
                for series in row.curves
                for target in row.options.targets
                if (ratio := row.ratio(series, target))
            ],
            "failures": row.failures,
        }

    def blocks(self) -> Iterator[str | TextTable]:
        options = self.options
        yield from self.header(
            f"{options.resolution} x {options.resolution} pixels, {options.samples[0]} to {options.samples[-1]} "
            f"samples, medians of {options.repeats} interleaved runs."
        )
        yield from (f"Without `{backend}`: {reason}." for backend, reason in self.missing.items())
        yield from report.cell_blocks(self.cells, options)
        yield from report.growth_blocks(self.growth)
        if notes := [*self.failures, *report.bias_warnings(self.cells)]:
            yield bullets(notes)

    def details(self) -> Iterator[str | TextTable]:
        if self.cells:
            yield report.bias_and_memory(self.cells)
        yield from report.skip_lines(self.cells)


@dataclass(kw_only=True)
class TableBenchmark(MatrixBenchmark):
    """The benchmark of the table in docs/bench.md: fixed cells and backends, and the growth of cost.

    It measures the time to an error, raw and denoised, beside Blender's and Mitsuba's principled BSDFs.
    """

    NAME = "table"
    DEFAULTS = {  # noqa: RUF012
        "scenes": ("sphere", "shaderball"),
        "ibls": ("studio", "city"),
        "looks": ("plastic", "car_paint", "metal", "brushed_metal", "copper"),
        "backends": ("exact", "mitsuba", "principled", "mitsuba-principled"),
        "samples": (4, 16, 64, 256),
        "resolution": 96,
        "repeats": 5,
        "reference": 4,
        "targets": (1e-2, 1e-3),
        "denoise": True,
        "target_estimate": 1e-3,
        "stop_relmse": 1e-3,
        "reference_relmse": 1.25e-4,
        "frames": 48,
        "independent": True,
    }

    def measure(self) -> Iterator[None]:
        yield from super().measure()
        yield from self.measure_growth()

    def measure_growth(self) -> Iterator[None]:
        """Measure the growth of cost with each of `QUANTITIES`, for the backends that can render its scenes."""
        for name, quantity in QUANTITIES.items():
            self.report(f"growth: {name}: {quantity.help}")
            try:
                for backend in filter(quantity.can_show, self.backends):
                    rows = quantity.measure(backend, self.options, self.open_process)
                    self.growth.append(Growth(name, backend, tuple(rows)))
                    yield
            except (LookdevError, OSError) as error:
                self.failures.append(f"growth with {name}: {error}")


def _series_data(result: CellRun, series: Series) -> dict[str, Any]:
    """Return the curve of a series in a cell, its times to the target errors, and its reference, for JSON."""
    rows, reference = result.measurements_of(series), result.references.get(series.backend)
    return {
        "curve": [asdict(point) for point in result.curves[series]],
        "seconds_to_relmse": {f"{target:g}": asdict(result.times(series, target)) for target in result.options.targets},
        "renderer": rows[0].renderer if rows else None,
        "memory": max((row.memory for row in rows), default=None),
        "reference": reference and {name: getattr(reference, name) for name in ("samples", "parts", "own_relmse")},
        "skipped": result.skips[series.backend],
    }
