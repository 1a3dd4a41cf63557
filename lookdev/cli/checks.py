"""The verbs that compare the renderer with the models: check, eval."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer
from typer import Argument, Option

from lookdev.cli.options import Prim, Variants, say

app = typer.Typer()
_PANEL = "Accuracy and speed"


@app.command(rich_help_panel=_PANEL)
def check(
    file: Annotated[Path | None, Argument(metavar="[JOB|LOOK]", help="A job, or a USD file with a look.")] = None,
    html: Annotated[Path | None, Option(metavar="FILE", help="Write a page with plots too.")] = None,
    only: Annotated[
        str, Option(metavar="CHECKS", help="Some of points,albedo,image,stability; default: all but stability.")
    ] = "",
    stress: Annotated[
        bool, Option("--stress", help="As '--only stability': extreme values; without FILE, all models.")
    ] = False,
    depth: Annotated[Literal["quick", "default", "full"], Option(help="The number of cases to compare.")] = "default",
    seed: Annotated[int, Option(min=0, help="Seed of cases, positions and samples.")] = 0,
    prim: Prim = None,
    variants: Variants = None,
    backend: Annotated[
        str | None, Option(metavar="NAME", help="The backend that renders a look, as in a job; default: exact.")
    ] = None,
) -> None:
    """Compare Cycles with the models in float64; exit code 1 if they disagree."""
    from rich.console import Console

    from lookdev.checks.check import check_file, parse_only
    from lookdev.checks.report import print_findings, verdict, write_html
    from lookdev.material.variants import parse_variants

    findings = []
    checks = ["stability"] if stress else parse_only(only)
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
    from lookdev.text import decode

    lines = (decode(line, f"line {number}") for number, line in enumerate(sys.stdin.buffer, start=1))
    for line in evaluate_lines(lines, backend):
        say(line)
