"""The verb of look files: validate. The verbs of the library are in `lookdev.cli.materials`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lookdev.cli.options import AsJson, Prim, Variants, say, say_json, stdout_to_stderr

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
    """List all faults of the looks in a file, in all variants that --variants leaves open; exit code 1 for errors."""
    from lookdev.material.validate.examine import examine_file
    from lookdev.material.variants import parse_variants

    with stdout_to_stderr():
        report = examine_file(file, prim, parse_variants(variants or ()))
    if as_json:
        say_json(report.data())
    else:
        say(report.text())
    raise typer.Exit(1 if report.has_errors else 0)
