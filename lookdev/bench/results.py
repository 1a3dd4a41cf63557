"""All measurements, and the machine, as files."""

from __future__ import annotations

import csv
import json
import os
import platform
from dataclasses import asdict, dataclass, field, fields
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import lookdev
from lookdev.bench.growth import Growth
from lookdev.bench.matrix import Options
from lookdev.bench.measure import CellResult, Measurement
from lookdev.bench.sequence import SequenceResult
from lookdev.cache import atomic_path, write_file
from lookdev.rendering.backends import blender_version

CSV_FILE, JSON_FILE = "results.csv", "results.json"


@dataclass(frozen=True)
class Machine:
    """The machine of a run; `load` is its load average over 1, 5 and 15 minutes before the start."""

    cpu: str
    cores: int
    load: tuple[float, float, float]
    system: str
    versions: dict[str, str]
    date: str


@dataclass
class Results:
    """The measurements so far."""

    options: Options
    machine: Machine
    restricted: tuple[str, ...] = ()  # the options that make it a part of its kind of benchmark
    missing: dict[str, str] = field(default_factory=dict)  # backends that are not on this machine, and why
    failures: list[str] = field(default_factory=list)
    cells: list[CellResult] = field(default_factory=list)
    sequence: SequenceResult | None = None
    growth: list[Growth] = field(default_factory=list)
    complete: bool = False

    def write(self, folder: Path) -> None:
        """Write ``results.csv``, a row a measurement, and ``results.json``, each whole or not at all."""
        with atomic_path(folder / CSV_FILE) as path, path.open("w", newline="", encoding="utf-8") as stream:
            table = csv.DictWriter(stream, [each.name for each in fields(Measurement)])
            table.writeheader()
            table.writerows(asdict(row) for cell in self.cells for row in cell.measurements)
        write_file(folder / JSON_FILE, json.dumps(self.data(), indent=1, allow_nan=False) + "\n")

    def data(self) -> dict[str, Any]:
        """Return the results as plain data."""
        return {
            "complete": self.complete,
            "machine": asdict(self.machine),
            "options": asdict(self.options),
            "restricted": self.restricted,
            "missing": self.missing,
            "failures": self.failures,
            "cells": [_cell_data(cell) for cell in self.cells],
            "sequence": asdict(self.sequence) if self.sequence else None,
            "growth": [asdict(each) for each in self.growth],
        }


def this_machine() -> Machine:
    """Return this machine, as it is now."""
    versions = {
        "lookdev": lookdev.__version__,
        "blender": blender_version(),
        "python": platform.python_version(),
        "numpy": metadata.version("numpy"),
    }
    try:
        versions["mitsuba"] = metadata.version("mitsuba")
    except metadata.PackageNotFoundError:
        versions["mitsuba"] = "not installed"
    return Machine(
        cpu=_cpu_model(),
        cores=len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1,
        load=os.getloadavg(),
        system=platform.platform(),
        versions=versions,
        date=datetime.now(UTC).isoformat(timespec="seconds"),
    )


def machine_line(machine: Machine) -> str:
    """Return the machine in one line."""
    versions = ", ".join(f"{name} {version}" for name, version in machine.versions.items())
    return f"{machine.cpu}, {machine.cores} cores, load {machine.load[0]:.1f} before; {versions}; {machine.date}"


def _cpu_model() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text(errors="replace").splitlines() if info.exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


def _cell_data(result: CellResult) -> dict[str, Any]:
    return {
        **asdict(result.cell),
        "series": {
            str(series): {
                "curve": [asdict(point) for point in curve],
                "seconds_to_relmse": {f"{target:g}": asdict(times) for target, times in result.reached[series].items()},
                "renderer": next((row.renderer for row in result.of(series)), None),
                "memory": max((row.memory for row in result.of(series)), default=None),
                "reference": _reference_data(result, series.backend),
                "skipped": result.skips[series.backend],
            }
            for series, curve in result.curves.items()
        },
        "exact_over": [asdict(each) for each in result.ratios],
        "failures": result.failures,
    }


def _reference_data(result: CellResult, backend: str) -> dict[str, Any] | None:
    reference = result.references.get(backend)
    if reference is None:
        return None
    return {"samples": reference.samples, "parts": reference.parts, "own_relmse": reference.own_relmse}
