"""The commands of job files: render, plan, example, schema; and of their output: review, manifest, status."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from lookdev.cli.options import AsJson, JobFile, say, say_json, say_notes, stdout_to_stderr
from lookdev.errors import LookdevError
from lookdev.run.events import LogFormat

app = typer.Typer()
_PANEL = "Jobs"

OutputFolder = Annotated[Path, Argument(metavar="OUT", help="The output folder of a job.", file_okay=False)]


@app.command(rich_help_panel=_PANEL)
def render(
    job: JobFile,
    force: Annotated[bool, Option("--force", help="Render every frame again, done or not.")] = False,
    frame: Annotated[
        list[str] | None,
        Option(metavar="NAME", help="Render only this frame, for example gold/city/element.0001; repeatable."),
    ] = None,
    chunk: Annotated[
        str | None,
        Option(
            metavar="I/N[@M]",
            help="Render part I, from 1, of N parts of similar cost. With @M, the parts suit M machines that take them "
            "in turn: the last ones are small. After all parts, render the job without --chunk or with --outputs-only.",
        ),
    ] = None,
    outputs_only: Annotated[
        bool, Option("--outputs-only", help="Render nothing: make pictures, sheets, movies and the manifest.")
    ] = False,
    workers: Annotated[
        int | None,
        Option(
            metavar="N",
            min=1,
            help="Frames that are rendered at once; default: one, and more while cores and memory are unused.",
        ),
    ] = None,
    device: Annotated[
        str | None,
        Option(
            metavar="KIND[:N,...]",
            help="Render on this kind of device instead of the job's, for example cuda, or on some devices: cuda:0,1.",
        ),
    ] = None,
    executor: Annotated[
        str,
        Option(
            metavar="NAME[:ADDRESS]",
            help="The workers that render. local: of this machine; dask: of a Dask cluster on this machine, or of the "
            "scheduler at an address; warm:SOCKET: one that 'lookdev warm start' started.",
        ),
    ] = "local",
    shared: Annotated[
        bool, Option("--shared", help="Workers of Dask write frames themselves, to an output that all machines share.")
    ] = False,
    output: Annotated[Path | None, Option(metavar="DIR", help="Write here instead of the job's output.")] = None,
    path_mapping: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="Rules of Open Job Description (JSON), which map the absolute paths of the job to this machine.",
        ),
    ] = None,
    log_format: Annotated[
        LogFormat,
        Option(help="Write events as text, as lines of JSON, or in the format of sessions of Open Job Description."),
    ] = LogFormat.TEXT,
    dry_run: Annotated[
        bool, Option("--dry-run", help="Only list what would be rendered, as 'lookdev plan' does.")
    ] = False,
) -> None:
    """Render every frame of a job that is new or stale, then pictures and contact sheets.

    Several runs of one job, on machines that share its output folder, share its frames.
    """
    from lookdev.job.mapping import read_rules
    from lookdev.plan.chunks import Chunk
    from lookdev.rendering.executors.choice import choose_executor
    from lookdev.run.progress import show_progress
    from lookdev.run.render import load_mapped_job, mapped_files, render_job

    if outputs_only and (force or frame or chunk):
        raise LookdevError("--outputs-only renders nothing: it goes without --force, --frame and --chunk")
    part = None if chunk is None else Chunk.parse(chunk)
    choice = choose_executor(executor, workers=workers, device=device, shared_output=shared)
    rules = read_rules(path_mapping) if path_mapping is not None else ()
    if dry_run:
        if force or frame or outputs_only:
            raise LookdevError("--dry-run lists new and stale frames: it goes without --force, --frame, --outputs-only")
        from lookdev.plan.prepare import plan_job
        from lookdev.run.chunks import plan_of_chunk
        from lookdev.run.listing import plan_text

        with mapped_files(rules):
            with stdout_to_stderr():
                prepared = plan_job(load_mapped_job(job, rules, output, choice.device))
            say_notes(prepared.notes)
            say(plan_text(prepared.plan if part is None else plan_of_chunk(prepared.plan, part)))
        return
    with show_progress(sys.stdout, log_format) as report:
        result = render_job(
            job, rules=rules, output=output, force=force, only=frame or (), chunk=part, outputs_only=outputs_only,
            executor_options=choice, report=report,
        )  # fmt: skip
    if log_format is not LogFormat.JSON:
        say(result.summary(), err=result.exit_code != 0)
    raise typer.Exit(result.exit_code)


@app.command(rich_help_panel=_PANEL)
def plan(
    job: JobFile,
    chunks: Annotated[
        str | None,
        Option(
            metavar="N[@M]",
            help="List the N parts that 'lookdev render --chunk I/N' renders; with @M, the parts for M machines.",
        ),
    ] = None,
    measured: Annotated[
        bool,
        Option(
            "--measured",
            help="Divide the job by the render times of its finished frames, not by estimates, and store the "
            "chunks in the output folder. Use it before the first chunk is rendered.",
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """List the frames of a job with their states, new, stale or done, and the reasons."""
    from lookdev.plan.chunks import Division
    from lookdev.plan.prepare import prepare_job
    from lookdev.run.chunks import chunks_data, chunks_text, store_measured_chunks
    from lookdev.run.listing import plan_data, plan_text

    if measured and chunks is None:
        raise LookdevError("--measured divides a job into chunks: it goes with --chunks N")
    division = None if chunks is None else Division.parse(chunks)
    with stdout_to_stderr():
        prepared = prepare_job(job)
    say_notes(prepared.notes)
    if division is not None:
        if measured:
            store_measured_chunks(prepared.plan, division)
        say_json(chunks_data(prepared.plan, division)) if as_json else say(chunks_text(prepared.plan, division))
    else:
        say_json(plan_data(prepared.plan, prepared.job.output)) if as_json else say(plan_text(prepared.plan))


@app.command(rich_help_panel=_PANEL)
def example(
    name: Annotated[str | None, Argument(metavar="[NAME]", help="The example; default: list all.")] = None,
    to: Annotated[Path, Option(metavar="DIR", help="The folder to copy into.")] = Path(),
    force: Annotated[bool, Option("--force", help="Replace files that differ.")] = False,
) -> None:
    """List the example jobs, or copy one with the looks, presets and textures that it needs."""
    from lookdev.export.examples import copy_example, examples_text, list_examples

    say(copy_example(name, to, force=force).summary() if name else examples_text(list_examples()))


@app.command(rich_help_panel=_PANEL)
def schema(
    out: Annotated[Path | None, Option(metavar="FILE", help="Write to this file instead of stdout.")] = None,
) -> None:
    """Write the JSON Schema of job files, for editors."""
    from lookdev.cache import write_file
    from lookdev.job import json_schema

    if out is None:
        say_json(json_schema())
    else:
        write_file(out, json.dumps(json_schema(), indent=2) + "\n")


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
    say(f"{page}: {written.new_files} files made, {written.unchanged_files} kept, {written.size / 1e6:.1f} MB in all")


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
    from lookdev.run.manifest import manifest_text, verify_manifest

    document, deviations = verify_manifest(out) if check else (read_manifest(out), None)
    if as_json:
        rows = [{"file": str(row.file), "kind": row.kind, "state": row.state} for row in deviations or ()]
        say_json({**document, "deviations": rows} if check else document)
    else:
        say(manifest_text(out, document, deviations))
    raise typer.Exit(1 if any(row.is_failure for row in deviations or ()) else 0)


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
    from lookdev.cache import output_errors, write_file
    from lookdev.run.status import read_status, status_data, status_metrics, status_text

    job_status = read_status(out.absolute())
    if metrics is not None:
        metrics_text = status_metrics(job_status)
        with output_errors(metrics):
            write_file(metrics, metrics_text)
    say_json(status_data(job_status)) if as_json else say(status_text(job_status))
