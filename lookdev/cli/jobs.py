"""The verbs of job files: render, plan, example, schema."""

from __future__ import annotations

import json
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from lookdev.cli.options import AsJson, JobFile, nothing_printed, say, say_json
from lookdev.errors import LookdevError

app = typer.Typer()
_PANEL = "Jobs"


class LogFormat(StrEnum):
    """How a run writes what happens."""

    TEXT = "text"
    JSON = "json"


@app.command(rich_help_panel=_PANEL)
def render(
    job: JobFile,
    force: Annotated[bool, typer.Option("--force", help="Render every frame again, done or not.")] = False,
    frame: Annotated[
        list[str] | None,
        typer.Option(
            "--frame",
            metavar="NAME",
            help="Render no frame but this, as gold/city/element.0001; repeatable.",
            show_default=False,
        ),
    ] = None,
    chunk: Annotated[
        str | None,
        typer.Option(
            "--chunk",
            metavar="I/N",
            help="Render the I-th of N parts of like cost, I from 1; render the job without it, or with "
            "--outputs-only, when all parts are done.",
            show_default=False,
        ),
    ] = None,
    outputs_only: Annotated[
        bool,
        typer.Option("--outputs-only", help="Render nothing: make pictures, sheets, movies and the manifest."),
    ] = False,
    log_format: Annotated[
        LogFormat, typer.Option("--log-format", help="Write events as text, or as lines of JSON.")
    ] = LogFormat.TEXT,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only list what would be rendered, as 'lookdev plan' does.")
    ] = False,
) -> None:
    """Render every frame of a job that is new or stale, then pictures and contact sheets.

    Several runs of one job, on machines that share its output folder, share its frames.
    """
    if dry_run:
        plan(job)
        return
    from lookdev.batch.progress import show_progress
    from lookdev.batch.run import render_job
    from lookdev.plan.chunks import Chunk

    if outputs_only and (force or frame or chunk):
        raise LookdevError("--outputs-only renders nothing: it goes without --force, --frame and --chunk")
    part = None if chunk is None else Chunk.parse(chunk)
    with show_progress(sys.stdout, as_json=log_format is LogFormat.JSON) as report:
        result = render_job(job, force=force, only=frame or (), chunk=part, outputs_only=outputs_only, report=report)
    if log_format is LogFormat.TEXT:
        say(result.summary(), err=result.exit_code != 0)
    raise typer.Exit(result.exit_code)


@app.command(rich_help_panel=_PANEL)
def plan(
    job: JobFile,
    chunks: Annotated[
        int | None,
        typer.Option(
            "--chunks",
            metavar="N",
            help="List the N parts that 'lookdev render --chunk I/N' renders.",
            min=1,
            max=100_000,
            show_default=False,
        ),
    ] = None,
    measured: Annotated[
        bool,
        typer.Option(
            "--measured",
            help="Divide by the times of frames on disk, and keep these chunks in the output folder; before the first "
            "is rendered.",
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """List what would be rendered and why: new, stale or done."""
    from lookdev.batch.chunks import chunks_data, chunks_text, keep_measured_chunks
    from lookdev.batch.listing import plan_data, plan_text
    from lookdev.batch.prepare import prepare_job

    if measured and chunks is None:
        raise LookdevError("--measured divides a job into chunks: it goes with --chunks N")
    with nothing_printed():
        prepared = prepare_job(job)
    for note in prepared.notes:
        say(f"note: {note}", err=True)
    if chunks is not None:
        if measured:
            keep_measured_chunks(prepared.plan, chunks)
        say_json(chunks_data(prepared.plan, chunks)) if as_json else say(chunks_text(prepared.plan, chunks))
    elif as_json:
        say_json(plan_data(prepared.plan, prepared.job.output))
    else:
        say(plan_text(prepared.plan, prepared.job.output))


@app.command(rich_help_panel=_PANEL)
def example(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="The example; default: list all.", show_default=False)
    ] = None,
    to: Annotated[Path, typer.Option("--to", metavar="DIR", help="The folder to copy into.")] = Path(),
    force: Annotated[bool, typer.Option("--force", help="Replace files that differ.")] = False,
) -> None:
    """List the example jobs, or copy one with the looks, presets and textures that it needs."""
    from lookdev.batch.examples import copy_example, examples_text, list_examples

    say(copy_example(name, to, force=force).summary() if name else examples_text(list_examples()))


@app.command(rich_help_panel=_PANEL)
def schema(
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write to this file instead of stdout.")
    ] = None,
) -> None:
    """Write the JSON Schema of job files, for editors."""
    from lookdev.cache import atomic_path
    from lookdev.job import json_schema

    if out is None:
        say_json(json_schema())
        return
    with atomic_path(out) as temporary:
        temporary.write_text(json.dumps(json_schema(), indent=2) + "\n")
