"""The command line: each module of this package has a group of commands, and `main` runs the program.

A command imports the modules that it needs when it runs, so that ``lookdev --help`` loads nothing heavy. The docstring
of a command is its help text.
"""

from __future__ import annotations

import io
import os
import signal
import sys
from typing import Annotated, NoReturn

import typer
from typer import Option

import lookdev
from lookdev.cache import take_notes
from lookdev.cli import checks, export, files, jobs, machine, materials, plots, studio
from lookdev.cli.options import say, say_notes
from lookdev.errors import FaultsError, LookdevError, OutputError, RenderError, WorkerError
from lookdev.processes import end_at_signals
from lookdev.sandbox import KilledError, NativeCrashError, run_supervised

EX_SOFTWARE = 70
"""Exit code after a defect of the program (sysexits.h)."""

app = typer.Typer(
    help="Batch look-dev turntables: film reflectance models, rendered exactly as published, on Cycles.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for group in (jobs, files, plots, studio, checks, machine):
    app.add_typer(group.app)
app.add_typer(materials.app, name="materials", rich_help_panel="Looks")
app.add_typer(machine.warm_app, name="warm", rich_help_panel="Jobs")
app.add_typer(export.app, name="export", rich_help_panel="Jobs")


def main() -> None:
    """Run the command line in a child process, so that a damaged file crashes at most the child (`lookdev.sandbox`)."""
    _open_streams()
    try:
        code = run_supervised(run)
    except KilledError as error:
        _exit_with_message(str(error), 1)
    except LookdevError as error:
        _exit_with_message(str(error), 2)
    except NativeCrashError as error:
        _exit_with_report(error)
    sys.exit(code)


def _open_streams() -> None:
    """Open the standard streams that are closed, and make output escape characters that it cannot encode."""
    for stream in range(3):
        try:
            os.fstat(stream)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free number: the number of the closed stream
    sys.stdin = sys.stdin or open(0, closefd=False, encoding="utf-8")  # noqa: SIM115
    sys.stdout = sys.stdout or open(1, "w", closefd=False, encoding="utf-8")  # noqa: SIM115
    sys.stderr = sys.stderr or open(2, "w", closefd=False, encoding="utf-8")  # noqa: SIM115
    for text_stream in (sys.stdout, sys.stderr):
        if isinstance(text_stream, io.TextIOWrapper):
            text_stream.reconfigure(errors="backslashreplace")


def run() -> None:
    """Run the command line in this process; an exception becomes a message on stderr and an exit code.

    Exit codes: 1, a frame, the output, the disk or the renderer failed; 2, the input is wrong; 70, a defect of the
    program, for which a report file is written; 130, interrupted.
    """
    try:
        with end_at_signals() as interruption:
            try:
                app()
            except BaseException:
                if interruption.came:
                    sys.exit(128 + signal.SIGINT)
                raise
    except (OutputError, RenderError, WorkerError) as error:
        _exit_with_message(str(error), 1)
    except FaultsError as error:
        count = len(error.faults)
        _exit_with_message(str(error) if count == 1 else f"{count} faults:\n{error}", 2)
    except LookdevError as error:
        _exit_with_message(str(error), 2)
    except OSError as error:  # such as a full disk: not a defect of the program
        location = f"{error.filename}: " if error.filename else ""
        _exit_with_message(f"{location}{error.strerror or error}", 1)
    except Exception as error:  # noqa: BLE001  the last resort
        _exit_with_report(error)
    finally:
        say_notes(take_notes())


def _exit_with_report(error: Exception) -> NoReturn:
    """Write a report file about a defect, tell the user about it, and exit."""
    from lookdev.cli.crash import record_crash

    _exit_with_message(record_crash(error, sys.argv), EX_SOFTWARE)


def _exit_with_message(message: str, code: int) -> NoReturn:
    say(f"lookdev: {message}", err=True)
    sys.exit(code)


def _show_version(show: bool) -> None:
    if show:
        typer.echo(f"lookdev {lookdev.__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, Option("--version", help="Show the version and exit.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    pass
