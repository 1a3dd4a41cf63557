"""The verbs of what was rendered: review."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lookdev.cli.options import say

app = typer.Typer()
_PANEL = "Jobs"

OutputFolder = Annotated[
    Path, typer.Argument(metavar="OUT", help="The output folder of a job.", show_default=False, file_okay=False)
]


@app.command(rich_help_panel=_PANEL)
def review(
    out: OutputFolder,
    against: Annotated[
        Path | None,
        typer.Option(
            "--against", metavar="OLD", help="The output folder of an earlier version, to compare with.",
            show_default=False,
        ),
    ] = None,
    to: Annotated[
        Path | None,
        typer.Option(
            "-o", "--to", metavar="FOLDER", help="The folder of the page; default: review in OUT.", show_default=False
        ),
    ] = None,
    view: Annotated[
        str | None,
        typer.Option("--view", metavar="VIEW", help="The OCIO view; default: as pictures have it.", show_default=False),
    ] = None,
) -> None:  # fmt: skip
    """Write a page that shows turntables, compares looks and versions, and opens without server or network."""
    from rich.console import Console
    from rich.progress import Progress

    from lookdev.batch.review import review

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("frames", total=None)
        page, written, notes = review(
            out, against, to, view, lambda done, of: progress.update(task, completed=done, total=of)
        )
    for note in notes:
        say(f"note: {note}", err=True)
    say(f"{page}: {written.made} files made, {written.kept} kept, {written.size / 1e6:.1f} MB in all")
