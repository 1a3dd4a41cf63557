"""The verbs that compare the renderer with the models: check, eval."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from lookdev.cli.options import Prim, Variants, say

app = typer.Typer()
_PANEL = "Accuracy and speed"


class Evaluator(StrEnum):
    """The implementation that evaluates the models."""

    numpy = "numpy"
    cycles = "cycles"


class Depth(StrEnum):
    """The number of cases that a check compares."""

    quick = "quick"
    default = "default"
    full = "full"


@app.command(rich_help_panel=_PANEL)
def check(
    file: Annotated[
        Path | None, typer.Argument(metavar="[JOB|LOOK]", help="A job, or a USD file with a look.", show_default=False)
    ] = None,
    html: Annotated[
        Path | None, typer.Option("--html", metavar="FILE", help="Write a page with plots too.", show_default=False)
    ] = None,
    only: Annotated[
        str,
        typer.Option(
            "--only",
            metavar="CHECKS",
            help="Some of points,albedo,image,stability; default: all but stability.",
            show_default=False,
        ),
    ] = "",
    stress: Annotated[
        bool, typer.Option("--stress", help="As '--only stability': extreme values; without FILE, all models.")
    ] = False,
    depth: Annotated[Depth, typer.Option("--depth", help="The number of cases to compare.")] = Depth.default,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of cases, positions and samples.")] = 0,
    prim: Prim = None,
    variants: Variants = None,
    backend: Annotated[
        str | None,
        typer.Option(
            "--backend",
            metavar="NAME",
            help="The backend that renders a look, as in a job; default: exact.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Compare Cycles with the models in float64; exit code 1 if they disagree."""
    from rich.console import Console

    from lookdev.checks.check import check_file, parse_only
    from lookdev.checks.report import print_findings, verdict, write_html
    from lookdev.material.variants import parse_variants

    findings = []
    for finding in check_file(
        file,
        only=["stability"] if stress else parse_only(only),
        depth=depth.value,
        seed=seed,
        prim=prim,
        variants=parse_variants(variants or ()),
        backend=backend,
    ):
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
        Evaluator, typer.Option("--backend", help="numpy: the float64 models; cycles: the generated OSL.")
    ] = Evaluator.numpy,
) -> None:
    """Evaluate models: JSON lines with model, params, wo, wi on stdin; the same with f and pdf on stdout.

    Lines of the model "fresnel" have cosTheta instead of wo and wi; the answers add F.
    """
    from lookdev.checks.evaluate import evaluate_lines
    from lookdev.text import decode

    lines = (decode(line, f"line {number}") for number, line in enumerate(sys.stdin.buffer, start=1))
    for line in evaluate_lines(lines, backend.value):
        say(line)
