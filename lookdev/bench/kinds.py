"""The kinds of benchmark of `lookdev bench`: what each is called, what it measures by default, what runs it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console

from lookdev.bench import denoise_trial, run
from lookdev.bench.matrix import Options, restricted
from lookdev.bench.profile import run_profile
from lookdev.bench.report import print_profile, print_results, print_scale
from lookdev.bench.results import Results
from lookdev.bench.scale import run_scale
from lookdev.bench.setup import run_setup, setup_text

Report = Callable[[str], None]


@dataclass(frozen=True)
class Order:
    """What a command line asks for: options, the folder of the results, and the document that gets a section."""

    options: Options
    folder: Path
    report: Report
    document: Path | None = None


@dataclass(frozen=True)
class Outcome:
    """How a benchmark ended, and a function that prints what it measured."""

    show: Callable[[Console], None]
    complete: bool = True
    failed: bool = False

    @property
    def exit_code(self) -> int:
        """Return 130 after Ctrl-C, 1 where something could not be measured, else 0."""
        return 130 if not self.complete else int(self.failed)


@dataclass(frozen=True)
class Kind:
    """A kind of benchmark: its fields of `Options` that have other defaults, and whether it writes to a document."""

    help: str
    run: Callable[[Order], Outcome]
    defaults: Mapping[str, Any] = field(default_factory=dict)
    document: bool = False


def _matrix(order: Order) -> Outcome:
    return _outcome(run.run_matrix(order.options, order.folder, order.report))


def _table(order: Order) -> Outcome:
    assert order.document is not None
    part = restricted(order.options, KINDS["table"].defaults)
    given = order.options, order.folder, order.report
    return _outcome(run.run_table(*given, document=order.document, restricted=part))


def _sequence(order: Order) -> Outcome:
    return _outcome(run.run_sequence(order.options, order.folder, order.report))


def _scale(order: Order) -> Outcome:
    return Outcome(partial(print_scale, run_scale(order.folder, order.report, repeats=order.options.repeats)))


def _profile(order: Order) -> Outcome:
    assert order.document is not None
    part = restricted(order.options, KINDS["profile"].defaults)
    given = order.options, order.folder, order.report
    made = run_profile(*given, document=order.document, restricted=part)
    return Outcome(partial(print_profile, made, order.options), made.complete, bool(made.failures))


def _setup(order: Order) -> Outcome:
    assert order.document is not None
    made = run_setup(order.folder, order.report, document=order.document, repeats=order.options.repeats)
    return Outcome(lambda console: console.print(setup_text(made), markup=False, soft_wrap=True), made.complete)


def _denoise_trial(order: Order) -> Outcome:
    options = order.options
    chosen = {name: getattr(options, name) for name in ("seed", "resolution", "reference", "fresh")}
    trials = denoise_trial.run_trial(options.frames, order.folder, order.report, **chosen)
    text = denoise_trial.summary(trials)
    return Outcome(lambda console: console.print(text, markup=False, highlight=False), len(trials) == options.frames)


def _outcome(results: Results) -> Outcome:
    return Outcome(partial(print_results, results), results.complete, bool(results.failures))


KINDS: dict[str, Kind] = {
    "matrix": Kind("time against error of any scenes, lights, looks and backends", _matrix),
    "table": Kind(
        "time to an error, raw and denoised, beside Blender's and Mitsuba's principled; growth; plots",
        _table,
        {
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
            "aim": 1e-3,
            "until": 1e-3,
            "enough": 1.25e-4,
            "frames": 48,
            "independent": True,
        },
        document=True,
    ),
    "profile": Kind(
        "where a second of rendering goes, by parts of the shader that are switched off",
        _profile,
        {
            "scenes": ("sphere", "shaderball"),
            "ibls": ("studio",),
            "looks": ("plastic", "metal", "copper"),
            "backends": ("exact",),
            "samples": (64,),
            "resolution": 96,
            "repeats": 5,
        },
        document=True,
    ),
    "setup": Kind("commands, a first frame, changes of scene", _setup, {"repeats": 5}, document=True),
    "sequence": Kind("turntables against a plain Blender script", _sequence, {"scenes": ("shaderball",), "repeats": 1}),
    "denoise-trial": Kind(
        "denoised frames at random: is their error as measured?",
        _denoise_trial,
        {"resolution": denoise_trial.SIDE, "frames": 200},
    ),
    "scale": Kind("large assets up to the first sample, against Blender's own import", _scale),
}
"""By the name of the option; the first is measured without one."""
