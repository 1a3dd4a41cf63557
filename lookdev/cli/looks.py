"""The verb of look files: validate. Those of the library are in `lookdev.cli.materials`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from lookdev.cli.options import AsJson, Prim, Variants

app = typer.Typer()


@app.command(rich_help_panel="Looks")
def validate(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A USD or MaterialX file with looks.", show_default=False)
    ],
    prim: Prim = None,
    variants: Variants = None,
    as_json: AsJson = False,
) -> None:
    """List all faults of the looks of a file, in every variant that is not given; exit code 1 if there are errors."""
    from lookdev.material.validate.examine import examine
    from lookdev.material.variants import parse_variants

    report = examine(file, prim, parse_variants(variants or ()))
    typer.echo(json.dumps(report.data(), indent=2) if as_json else report.text())
    raise typer.Exit(1 if report.has_errors else 0)
