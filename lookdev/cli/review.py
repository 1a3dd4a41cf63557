"""The verbs of a job's output: review, manifest, status."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from lookdev.cli.options import AsJson, say, say_json, say_notes

app = typer.Typer()
_PANEL = "Jobs"

OutputFolder = Annotated[Path, Argument(metavar="OUT", help="The output folder of a job.", file_okay=False)]


@app.command(rich_help_panel=_PANEL)
def review(
    out: OutputFolder,
    against: Annotated[
        Path | None, Option(metavar="OLD", help="The output folder of an earlier version, to compare with.")
    ] = None,
    to: Annotated[
        Path | None, Option("-o", "--to", metavar="FOLDER", help="The folder of the page; default: review in OUT.")
    ] = None,
    view: Annotated[str | None, Option(metavar="VIEW", help="The OCIO view; default: the pictures' own.")] = None,
) -> None:
    """Write a page that shows turntables and compares looks and versions; it needs no server and no network."""
    from rich.console import Console
    from rich.progress import Progress

    from lookdev.output.review.folder import review

    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as progress:
        task = progress.add_task("frames", total=None)
        page, written, notes = review(
            out, against, to, view, lambda done, total: progress.update(task, completed=done, total=total)
        )
    say_notes(notes)
    say(f"{page}: {written.made} files made, {written.kept} kept, {written.size / 1e6:.1f} MB in all")


@app.command(rich_help_panel=_PANEL)
def manifest(
    out: OutputFolder,
    check: Annotated[
        bool, Option("--verify", help="Compare all files with their hashes; exit code 1 if one differs.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Show the files of an output and the inputs of its render, from the manifest that 'render' wrote."""
    from lookdev.output.manifest import read_manifest
    from lookdev.run.manifest import manifest_text, verify

    listed, deviations = verify(out) if check else (read_manifest(out), None)
    if as_json:
        rows = [{"file": str(row.file), "kind": row.kind, "state": row.state} for row in deviations or ()]
        say_json({**listed, "deviations": rows} if check else listed)
    else:
        say(manifest_text(out, listed, deviations))
    raise typer.Exit(1 if any(row.fails for row in deviations or ()) else 0)


@app.command(rich_help_panel=_PANEL)
def status(
    out: OutputFolder,
    metrics: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="Also write the status to a file, in the text format of Prometheus that its node exporter collects.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Show the progress of a job: frames done and failed, runs that work, runs that have stalled, the time left."""
    from lookdev.cache import atomic_path
    from lookdev.errors import OutputError
    from lookdev.run.status import read_status, status_data, status_metrics, status_text

    job_status = read_status(out.absolute())
    if metrics is not None:
        metrics_text = status_metrics(job_status)
        try:
            with atomic_path(metrics) as temporary:
                temporary.write_text(metrics_text)
        except OSError as error:
            raise OutputError(f"{metrics}: cannot be written: {error.strerror}") from error
    say_json(status_data(job_status)) if as_json else say(status_text(job_status))
