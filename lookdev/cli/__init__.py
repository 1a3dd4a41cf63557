"""The command line: verbs and their options, no logic.

What a verb needs is imported when it runs, so that ``lookdev --help`` answers at once.
"""

from __future__ import annotations

import json
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

import lookdev
from lookdev.cli import materials as cli_materials
from lookdev.errors import FaultsError, LookdevError, OutputError, RenderError, WorkerError

app = typer.Typer(
    help="Batch look-dev turntables: film reflectance models, rendered exactly as published, on Cycles.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

app.add_typer(cli_materials.app, name="materials")

export_app = typer.Typer(help="Hand a job over to another program.", no_args_is_help=True)
app.add_typer(export_app, name="export")

JobFile = Annotated[Path, typer.Argument(metavar="JOB", help="The job file, TOML.", show_default=False)]


class Backend(StrEnum):
    """Who evaluates the models."""

    numpy = "numpy"
    cycles = "cycles"


class Depth(StrEnum):
    """How much a check compares."""

    quick = "quick"
    default = "default"
    full = "full"


def main() -> None:
    """Run the command line; errors raised on purpose become a message and an exit code.

    1: frames failed, or output, disk or renderer did; 2: the input is wrong; 130: interrupted.
    """
    try:
        app()
    except (OutputError, RenderError, WorkerError) as error:
        _leave(str(error), 1)
    except FaultsError as error:
        count = len(error.faults)
        _leave(str(error) if count == 1 else f"{count} faults:\n{error}", 2)
    except LookdevError as error:
        _leave(str(error), 2)
    except OSError as error:  # the machine's fault, as a full disk is, not the program's
        place = f"{error.filename}: " if error.filename else ""
        _leave(f"{place}{error.strerror or error}; 'lookdev doctor' looks at the cache folder and its disk", 1)
    except KeyboardInterrupt:
        _leave("interrupted", 130)


def _leave(message: str, code: int) -> None:
    typer.echo(f"lookdev: {message}", err=True)
    sys.exit(code)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"lookdev {lookdev.__version__}")
        raise typer.Exit


def _variants(options: list[str] | None) -> dict[str, str]:
    pairs = [pair.partition("=") for pair in options or ()]
    if not all(name and choice for name, _, choice in pairs):
        raise typer.BadParameter("SET=VARIANT is needed, for instance wear=dusty", param_hint="--variants")
    return {name: choice for name, _, choice in pairs}


@app.callback()
def _root(
    version: Annotated[
        bool,
        typer.Option("--version", help="Show the version and leave.", callback=_show_version, is_eager=True),
    ] = False,
) -> None:
    pass


@app.command()
def render(
    job: JobFile,
    force: Annotated[bool, typer.Option("--force", help="Render every frame again, done or not.")] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only say what would be rendered, as 'lookdev plan' does.")
    ] = False,
) -> None:
    """Render every frame of a job that is new or stale, then pictures and contact sheets."""
    if dry_run:
        plan(job)
        return
    from lookdev.batch.prepare import prepare_job
    from lookdev.batch.progress import show_progress
    from lookdev.batch.run import render_job

    with show_progress(sys.stdout) as report:
        result = render_job(job, prepare_job, force=force, report=report)
    typer.echo(result.summary(), err=result.exit_code != 0)
    raise typer.Exit(result.exit_code)


@app.command()
def plan(
    job: JobFile,
    as_json: Annotated[bool, typer.Option("--json", help="Write one JSON document instead of a table.")] = False,
) -> None:
    """Say what would be rendered and why: new, stale or done."""
    from lookdev.batch.listing import plan_data, plan_text
    from lookdev.batch.prepare import prepare_job

    prepared = prepare_job(job)
    for note in prepared.notes:
        typer.echo(f"note: {note}", err=True)
    if as_json:
        typer.echo(json.dumps(plan_data(prepared.plan, prepared.job.output), indent=2))
    else:
        typer.echo(plan_text(prepared.plan, prepared.job.output))


@app.command()
def validate(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A USD file with looks.", show_default=False)],
    prim: Annotated[
        str | None, typer.Option("--prim", metavar="PATH", help="The only material to look at.", show_default=False)
    ] = None,
    variants: Annotated[
        list[str] | None,
        typer.Option(
            "--variants",
            metavar="SET=VARIANT",
            help="The only variant of a set to look at; all are by default. Once for each set.",
            show_default=False,
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Write one JSON document instead of a list.")] = False,
) -> None:
    """Say everything that is wrong with the looks of a file, in every variant; exit code 1 if there are errors."""
    from lookdev.material.validate import validate as validate_looks

    report = validate_looks(file, prim, _variants(variants))
    typer.echo(json.dumps(report.data(), indent=2) if as_json else report.text())
    raise typer.Exit(1 if report.has_errors else 0)


@app.command()
def check(
    file: Annotated[
        Path | None,
        typer.Argument(metavar="[JOB|LOOK]", help="A job, or a USD file with a look.", show_default=False),
    ] = None,
    html: Annotated[
        Path | None, typer.Option("--html", metavar="FILE", help="Write a page with plots too.", show_default=False)
    ] = None,
    only: Annotated[
        str,
        typer.Option(
            "--only",
            metavar="CHECKS",
            help="Of points,albedo,image,stability; default: all but stability.",
            show_default=False,
        ),
    ] = "",
    stress: Annotated[
        bool, typer.Option("--stress", help="As '--only stability': extremes of everything; without FILE, all models.")
    ] = False,
    depth: Annotated[Depth, typer.Option("--depth", help="How much is compared.")] = Depth.default,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Chooses cases, places and samples.")] = 0,
    prim: Annotated[
        str | None,
        typer.Option("--prim", metavar="PATH", help="The material, where the file has several.", show_default=False),
    ] = None,
    variants: Annotated[
        list[str] | None,
        typer.Option(
            "--variants", metavar="SET=VARIANT", help="A variant of the look. Once for each set.", show_default=False
        ),
    ] = None,
    backend: Annotated[
        str | None,
        typer.Option(
            "--backend",
            metavar="NAME",
            help="The backend of a look, as jobs name it; default exact. A job names its own.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Compare Cycles with the mathematics in float64; exit code 1 where they disagree."""
    from rich.console import Console

    from lookdev.batch.check import check_file
    from lookdev.checks.report import print_findings, verdict, write_html

    names = ["stability"] if stress else [name.strip() for name in only.split(",") if name.strip()]
    findings = []
    for finding in check_file(
        file,
        only=names,
        depth=depth.value,
        seed=seed,
        prim=prim,
        variants=_variants(variants),
        backend=backend,
    ):
        typer.echo(f"{finding.check}: {finding.subject}: {'agrees' if finding.passed else 'DISAGREES'}", err=True)
        findings.append(finding)
    print_findings(findings, Console())
    if html is not None:
        write_html(findings, html, f"lookdev check {file.name if file else '--stress'}")
    typer.echo(verdict(findings))
    raise typer.Exit(0 if all(finding.passed for finding in findings) else 1)


@app.command()
def bench(
    scenes: Annotated[str, typer.Option("--scenes", metavar="NAMES", help="Scenes, with commas between.")] = "",
    ibls: Annotated[str, typer.Option("--ibls", metavar="NAMES", help="Lights.")] = "",
    looks: Annotated[str, typer.Option("--looks", metavar="NAMES", help="Looks.")] = "",
    backends: Annotated[str, typer.Option("--backends", metavar="NAMES", help="What renders them.")] = "",
    samples: Annotated[str, typer.Option("--samples", metavar="COUNTS", help="Rising powers of two.")] = "4,16,64",
    resolution: Annotated[int, typer.Option("--resolution", metavar="PIXELS", help="Side of the frame.")] = 256,
    repeats: Annotated[
        int | None,
        typer.Option("--repeats", metavar="N", help="Renders of each count; 3, of a sequence 1.", show_default=False),
    ] = None,
    reference: Annotated[
        int, typer.Option("--reference", metavar="N", help="Samples of a reference, in largest counts.")
    ] = 8,
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Chooses the samples.")] = 0,
    everything: Annotated[bool, typer.Option("--all", help="All that is not named, instead of a few.")] = False,
    sequence: Annotated[
        bool, typer.Option("--sequence", help="Turntables against a plain Blender script, and how cost grows.")
    ] = False,
    frames: Annotated[
        int, typer.Option("--frames", metavar="N", min=4, help="With --sequence: frames that cost may grow over.")
    ] = 100,
    fresh: Annotated[bool, typer.Option("--fresh", help="Render references anew.")] = False,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Takes results and curves.")] = Path("out/bench"),
    show: Annotated[bool, typer.Option("--list", help="Only say what there is.")] = False,
) -> None:
    """Measure time against error, beside other renderers; results so far are kept on Ctrl-C (exit code 130)."""
    from lookdev.bench.matrix import listing

    if show:
        typer.echo(listing())
        return
    from rich.console import Console

    from lookdev.bench.matrix import parse_options
    from lookdev.bench.report import print_results
    from lookdev.bench.run import run_matrix, run_sequence

    options = parse_options(
        {"scenes": scenes, "ibls": ibls, "looks": looks, "backends": backends, "samples": samples},
        everything=everything,
        sequence=sequence,
        resolution=resolution,
        repeats=repeats,
        reference=reference,
        seed=seed,
        fresh=fresh,
    )

    def tell(text: str) -> None:
        typer.echo(text, err=True)

    results = run_sequence(options, out, tell, frames=frames) if sequence else run_matrix(options, out, tell)
    print_results(results, Console())
    raise typer.Exit(0 if results.complete else 130)


@export_app.command("blend")
def export_blend(
    job: JobFile,
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="FILE.blend", help="The file to write.", show_default=False)
    ],
    pack: Annotated[
        bool, typer.Option("--pack", help="Put images into the file, instead of a folder <FILE>_files beside it.")
    ] = False,
) -> None:
    """Write the job's scenes for Blender: looks as native nodes, lights as worlds, turntables as keyframes."""
    from lookdev.batch.export import export_blend as export

    exported = export(job, out, pack=pack)
    for note in exported.notes:
        typer.echo(f"note: {note}", err=True)
    typer.echo(exported.summary())


@app.command()
def schema(
    out: Annotated[
        typer.FileTextWrite | None, typer.Option("--out", help="Write to this file instead of stdout.")
    ] = None,
) -> None:
    """Write the JSON Schema of job files, for editors."""
    from lookdev.job import json_schema

    typer.echo(json.dumps(json_schema(), indent=2), file=out)


@app.command("eval")
def evaluate(
    backend: Annotated[
        Backend, typer.Option("--backend", help="numpy: the float64 models; cycles: the generated OSL.")
    ] = Backend.numpy,
) -> None:
    """Evaluate models: JSON lines with model, params, wo, wi on stdin; the same with f and pdf on stdout."""
    from lookdev.checks.evaluate import evaluate_lines

    for line in evaluate_lines(sys.stdin, backend.value):
        sys.stdout.write(line.rstrip("\n") + "\n")


@app.command()
def doctor() -> None:
    """Say what this machine lacks to render, and how to get it."""
    from lookdev.batch.doctor import describe, examine

    findings = list(examine())
    typer.echo(describe(findings))
    raise typer.Exit(0 if all(finding.good for finding in findings) else 1)
