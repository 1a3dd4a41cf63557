"""The commands that check this machine, doctor, and that keep a render worker on it, ``lookdev warm``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from lookdev.cli.options import say

app = typer.Typer()
warm_app = typer.Typer(help="Keep a render worker from run to run, for 'lookdev render --executor warm:SOCKET'.")

Socket = Annotated[Path, Argument(metavar="SOCKET", help="The path of its socket, on a local disk.")]


@app.command(rich_help_panel="Installation")
def doctor() -> None:
    """Check that this machine can render; list what is missing, and how to get it."""
    from lookdev.inspect.doctor import examine_machine, findings_text

    findings = list(examine_machine())
    say(findings_text(findings))
    raise typer.Exit(0 if all(finding.good for finding in findings) else 1)


@warm_app.command()
def start(
    socket: Socket,
    backend: Annotated[str, Option(metavar="NAME", help="The backend of the jobs.")] = "exact",
    idle: Annotated[int, Option(metavar="SECONDS", min=1, help="End the worker after this time without a run.")] = 900,
) -> None:
    """Start a worker that keeps its compiled shaders from run to run, until 'lookdev warm stop'."""
    from lookdev.rendering.executors.warm import start as start_at

    start_at(socket, backend, idle)
    say(f"a worker is kept at {socket}")


@warm_app.command()
def stop(socket: Socket) -> None:
    """End the worker at a socket."""
    from lookdev.rendering.executors.warm import stop as stop_at

    say(f"the worker at {socket} has ended" if stop_at(socket) else f"no worker is kept at {socket}")
