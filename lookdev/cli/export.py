"""The commands of ``lookdev export``, which write a job for another program: blend, mitsuba, openjd."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Option

from lookdev.cli.options import JobFile, say, say_notes

if TYPE_CHECKING:
    from lookdev.export import ExportResult

app = typer.Typer(help="Write a job for another program.", no_args_is_help=True)


@app.command("blend")
def export_blend(
    job: JobFile,
    out: Annotated[Path, Option("-o", "--out", metavar="FILE.blend", help="The file to write.")],
    pack: Annotated[
        bool, Option("--pack", help="Put images into the file, instead of a folder <FILE>_files beside it.")
    ] = False,
) -> None:
    """Write the job's scenes for Blender: looks as native nodes, lights as worlds, turntables as keyframes."""
    from lookdev.export.blend import export_blend as export

    _say_result(export(job, out, pack=pack))


@app.command("mitsuba")
def export_mitsuba(
    job: JobFile, out: Annotated[Path, Option("-o", "--out", metavar="FOLDER", help="The folder of the scenes.")]
) -> None:
    """Write the job's looks under its lights as scenes of Mitsuba 3, with their first pose."""
    from lookdev.export.mitsuba import export_mitsuba as export

    _say_result(export(job, out))


@app.command("openjd")
def export_openjd(
    job: JobFile,
    out: Annotated[
        Path,
        Option(
            "-o",
            "--out",
            metavar="FILE",
            help="The template to write, YAML or JSON. A name without suffix is the folder of a job bundle for AWS "
            "Deadline Cloud.",
        ),
    ],
    chunks: Annotated[
        str | None,
        Option(
            metavar="N[@M]",
            help="Number of render tasks. With @M, they suit M hosts that take them in turn: the last ones are small. "
            "Default: tasks of about five minutes.",
        ),
    ] = None,
    cores: Annotated[int, Option(metavar="N", min=1, help="Cores that a host must have.")] = 2,
    memory: Annotated[int, Option(metavar="MIB", min=1, help="Memory that a host must have.")] = 4096,
    command: Annotated[
        str, Option(metavar="PROGRAM", help="The command that starts this program on the hosts.")
    ] = "lookdev",
) -> None:
    """Write the job for a render farm, as a template of Open Job Description 2023-09."""
    from lookdev.export.openjd import HostRequirements
    from lookdev.export.openjd import export_openjd as export
    from lookdev.plan.chunks import Division

    division = None if chunks is None else Division.parse(chunks)
    _say_result(export(job, out, division, HostRequirements(cores, memory, command)))


def _say_result(result: ExportResult) -> None:
    say_notes(result.notes)
    say(result.text)
