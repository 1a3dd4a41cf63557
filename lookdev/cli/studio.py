"""The verbs of the web page: explore, design."""

from __future__ import annotations

import logging
import os
import sys
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from lookdev.cli.options import say
from lookdev.cli.plots import Library

app = typer.Typer()

_PANEL = "Looks"


@app.command(rich_help_panel=_PANEL)
def explore(
    subjects: Annotated[
        list[str] | None,
        typer.Argument(metavar="[WHAT]...", help="The first surfaces, in the words of plot.", show_default=False),
    ] = None,
    root: Annotated[
        list[Path] | None,
        typer.Option(
            "--root", metavar="DIR", help="A folder of looks and measured data that the page may open. Repeatable.",
            show_default=False,
        ),
    ] = None,
    port: Annotated[
        int | None,
        typer.Option("--port", min=0, max=65535, help="The port; default: 8421, or another that is free.",
                     show_default=False),
    ] = None,
    host: Annotated[str, typer.Option("--host", metavar="ADDRESS", help="Where to listen.")] = "127.0.0.1",
    name: Annotated[
        list[str] | None,
        typer.Option("--name", metavar="HOST", help="A name by which browsers may call this machine. Repeatable.",
                     show_default=False),
    ] = None,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
    library: Library = None,
) -> None:  # fmt: skip
    """Explore reflectance in the browser: sliders, plots, lobes and spheres, side by side."""
    from lookdev.studio import Address, require_packages

    require_packages()
    from lookdev.studio.explorer.run import explore as run

    logging.basicConfig(level=logging.WARNING, format="lookdev: %(message)s")
    run(subjects or (), root or (), library, Address(host, port, tuple(name or ())), browser=browser, say=say)
    _exit_at_once()


@app.command(rich_help_panel=_PANEL)
def design(
    source: Annotated[
        str,
        typer.Argument(
            metavar="JOB|ASSET", help="A job (.toml), an asset (.usd), or a built-in asset.", show_default=False
        ),
    ],
    material: Annotated[
        Path | None,
        typer.Option(
            "--material",
            metavar="LOOK",
            help="The look of the whole asset; default: the materials that it binds.",
            show_default=False,
        ),
    ] = None,
    port: Annotated[
        int | None,
        typer.Option(
            "--port", min=0, max=65535, help="The port; default: 8421, or another that is free.", show_default=False
        ),
    ] = None,
    host: Annotated[str, typer.Option("--host", metavar="ADDRESS", help="Where to listen.")] = "127.0.0.1",
    name: Annotated[
        list[str] | None,
        typer.Option(
            "--name",
            metavar="HOST",
            help="A name by which browsers may call this machine. Repeatable.",
            show_default=False,
        ),
    ] = None,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
) -> None:
    """Design looks in the browser: edit parameters live on the turning asset, and save them as USD."""
    from lookdev.studio import Address, require_packages

    require_packages()
    from lookdev.studio.designer.run import design as run

    logging.basicConfig(level=logging.WARNING, format="lookdev: %(message)s")
    run(source, material, Address(host, port, tuple(name or ())), browser=browser, say=say)
    _exit_at_once()


def _exit_at_once() -> NoReturn:
    # Everything is closed and removed. A normal exit of Python would wait for a computation in a thread, which cannot
    # be stopped, and then for the threads of libraries. The user who ends a server need not wait for either.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
