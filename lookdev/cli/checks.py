"""The commands that compare the renderer with the models, and measure its speed: check, eval, bench."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer
from typer import Argument, Option

from lookdev.cli.options import Prim, VariantOptions, say

app = typer.Typer()
_PANEL = "Accuracy and speed"
# These make options of bench: for another kind of benchmark, and for the selection of its cases.
_kind_option = partial(Option, rich_help_panel="Other benchmarks")
_selection_option = partial(Option, rich_help_panel="Selection")


@app.command(rich_help_panel=_PANEL)
def check(
    file: Annotated[Path | None, Argument(metavar="[JOB|LOOK]", help="A job, or a USD file with a look.")] = None,
    html: Annotated[Path | None, Option(metavar="FILE", help="Also write a page with plots to FILE.")] = None,
    only: Annotated[
        str, Option(metavar="CHECKS", help="Some of points,albedo,image,stability; default: all but stability.")
    ] = "",
    stress: Annotated[
        bool, Option("--stress", help="Check extreme values only ('--only stability'); without a file, of all models.")
    ] = False,
    depth: Annotated[Literal["quick", "default", "full"], Option(help="The number of cases to compare.")] = "default",
    seed: Annotated[int, Option(min=0, help="Seed of cases, positions and samples.")] = 0,
    prim: Prim = None,
    variants: VariantOptions = None,
    backend: Annotated[
        str | None, Option(metavar="NAME", help="The backend that renders a look, as in a job; default: exact.")
    ] = None,
) -> None:
    """Compare Cycles with the models in float64; exit code 1 if they disagree."""
    from rich.console import Console

    from lookdev.checks.check import check_file, parse_check_names
    from lookdev.checks.report import print_findings, verdict, write_html
    from lookdev.material.variants import parse_variants

    findings = []
    checks = ["stability"] if stress else parse_check_names(only)
    selected = parse_variants(variants or ())
    for finding in check_file(file, only=checks, depth=depth, seed=seed, prim=prim, variants=selected, backend=backend):
        say(finding.headline, err=True)
        findings.append(finding)
    print_findings(findings, Console())
    if html is not None:
        write_html(findings, html, f"lookdev check {file.name if file else '--stress'}")
    say(verdict(findings))
    raise typer.Exit(0 if all(finding.passed for finding in findings) else 1)


@app.command("eval", rich_help_panel=_PANEL)
def evaluate(
    backend: Annotated[
        Literal["numpy", "cycles"], Option(help="numpy: the float64 models; cycles: the generated OSL.")
    ] = "numpy",
) -> None:
    """Evaluate models: JSON lines with model, params, wo, wi on stdin; the same with f and pdf on stdout.

    Lines of the model "fresnel" have cosTheta instead of wo and wi; the answers add F.
    """
    from lookdev.checks.evaluate import evaluate_lines
    from lookdev.safe_text import decode

    lines = (decode(line, f"line {number}") for number, line in enumerate(sys.stdin.buffer, start=1))
    for line in evaluate_lines(lines, backend):
        say(line)


@app.command(rich_help_panel=_PANEL)
def bench(
    table: Annotated[
        Path | None,
        _kind_option(
            metavar="FILE", help="Compare the time to an error with other renderers, and plot it, for docs/bench.md."
        ),
    ] = None,
    profile: Annotated[
        Path | None, _kind_option(metavar="FILE", help="Measure where the time of rendering goes, for docs/bench.md.")
    ] = None,
    setup: Annotated[
        Path | None,
        _kind_option(metavar="FILE", help="Time whole commands, first frames and changes of scene, for docs/bench.md."),
    ] = None,
    sequence: Annotated[
        bool, _kind_option("--sequence", help="Compare turntables with a plain Blender script.")
    ] = False,
    scale: Annotated[bool, _kind_option("--scale", help="Compare large assets with Blender's own import.")] = False,
    denoise_trial: Annotated[
        bool,
        _kind_option(
            "--denoise-trial", help="Compare the estimated error of random denoised frames with the true one."
        ),
    ] = False,
    scenes: Annotated[str, _selection_option(metavar="NAMES", help="Names of scenes, separated by commas.")] = "",
    ibls: Annotated[str, _selection_option(metavar="NAMES", help="Names of lights, separated by commas.")] = "",
    looks: Annotated[str, _selection_option(metavar="NAMES", help="Names of looks, separated by commas.")] = "",
    backends: Annotated[str, _selection_option(metavar="NAMES", help="Names of backends, separated by commas.")] = "",
    samples: Annotated[
        str, _selection_option(metavar="COUNTS", help="Numbers of samples, increasing powers of two: 4,16,64.")
    ] = "",
    resolution: Annotated[int | None, _selection_option(metavar="N", help="Side of the frame, pixels.")] = None,
    repeats: Annotated[int | None, _selection_option(metavar="N", help="Renders with each number of samples.")] = None,
    reference: Annotated[
        int | None, _selection_option(metavar="N", help="Samples of a reference, as a multiple of the largest count.")
    ] = None,
    seed: Annotated[int | None, _selection_option(metavar="N", help="Seed of the samples.")] = None,
    frames: Annotated[
        int | None,
        _selection_option(
            metavar="N", help="Number of frames: of a sequence whose growth is measured, or of the denoise trial."
        ),
    ] = None,
    everything: Annotated[
        bool, _selection_option("--all", help="Take all names where none are given, instead of a few.")
    ] = False,
    fresh: Annotated[bool, Option("--fresh", help="Render references anew.")] = False,
    out: Annotated[Path, Option(metavar="DIR", help="Folder of the results.")] = Path("out/bench"),
    show: Annotated[bool, Option("--list", help="Only list the names.")] = False,
) -> None:
    """Measure time against error, beside other renderers; Ctrl-C keeps the results so far (exit code 130)."""
    from lookdev.bench.kinds import KINDS
    from lookdev.bench.options import list_names, parse_options
    from lookdev.errors import LookdevError

    if show:
        say(list_names())
        return
    files = {"table": table, "profile": profile, "setup": setup}
    kinds: dict[str, Path | None] = {name: file for name, file in files.items() if file}
    flags = {"sequence": sequence, "denoise-trial": denoise_trial, "scale": scale}
    kinds |= {name: None for name, is_set in flags.items() if is_set}
    if len(kinds) > 1:
        raise LookdevError(f"one kind of benchmark at a time, not {' and '.join(f'--{name}' for name in kinds)}")
    name, document = next(iter(kinds.items()), ("matrix", None))
    options = parse_options(
        {"scenes": scenes, "ibls": ibls, "looks": looks, "backends": backends, "samples": samples},
        defaults=KINDS[name].DEFAULTS, everything=everything, resolution=resolution, repeats=repeats,
        reference=reference, seed=seed, frames=frames, fresh=fresh,
    )  # fmt: skip
    benchmark = KINDS[name](options=options, report=partial(say, err=True))
    benchmark.run(out, document)
    say(benchmark.summary())
    raise typer.Exit(benchmark.exit_code)
