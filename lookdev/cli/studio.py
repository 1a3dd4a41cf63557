"""The commands that serve a web page on this machine: explore, design."""

from __future__ import annotations

import logging
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer
from typer import Argument, Option

from lookdev.cli.options import say
from lookdev.cli.plots import LibraryOption

if TYPE_CHECKING:
    from lookdev.studio import Address

app = typer.Typer()
_PANEL = "Looks"

Port = Annotated[int | None, Option(min=0, max=65535, help="The port; default: 8421, or another that is free.")]
Host = Annotated[str, Option(metavar="ADDRESS", help="Where to listen.")]
HostNames = Annotated[
    list[str] | None, Option(metavar="HOST", help="A name by which browsers may call this machine. Repeatable.")
]
Browser = Annotated[bool, Option("--browser/--no-browser", help="Open the page in the browser.")]


@app.command(rich_help_panel=_PANEL)
def explore(
    subjects: Annotated[
        list[str] | None,
        Argument(metavar="[WHAT]...", help="The surfaces to show first, written as for 'lookdev plot'."),
    ] = None,
    root: Annotated[
        list[Path] | None,
        Option(metavar="DIR", help="A folder of looks and measured data that the page may open. Repeatable."),
    ] = None,
    port: Port = None,
    host: Host = "127.0.0.1",
    name: HostNames = None,
    browser: Browser = True,
    library: LibraryOption = None,
) -> None:
    """Explore reflectance in the browser: sliders, plots, lobes and spheres, side by side."""
    address = _address(host, port, name)
    from lookdev.studio.explorer.run import explore as run

    run(subjects or (), root or (), library, address, browser=browser, say=say)
    _exit_at_once()


@app.command(rich_help_panel=_PANEL)
def design(
    source: Annotated[str, Argument(metavar="JOB|ASSET", help="A job (.toml), an asset (.usd), or a built-in asset.")],
    material: Annotated[
        Path | None, Option(metavar="LOOK", help="The look of the whole asset; default: the materials that it binds.")
    ] = None,
    port: Port = None,
    host: Host = "127.0.0.1",
    name: HostNames = None,
    browser: Browser = True,
) -> None:
    """Design looks in the browser: edit parameters live on the turning asset, and save them as USD."""
    address = _address(host, port, name)
    from lookdev.studio.designer.run import design as run

    run(source, material, address, browser=browser, say=say)
    _exit_at_once()


def _address(host: str, port: int | None, names: list[str] | None) -> Address:
    """Return the address at which to serve a page, and set up logging to stderr.

    Raises LookdevError if a package that the pages need is not installed.
    """
    from lookdev.studio import Address, require_packages

    require_packages()
    logging.basicConfig(level=logging.WARNING, format="lookdev: %(message)s")
    return Address(host, port, tuple(names or ()))


def _exit_at_once() -> NoReturn:
    # The server is closed and its temporary files are removed already. A normal exit of Python would wait for a
    # computation in a thread, which cannot be stopped, and then for the threads of libraries. The user who ends a
    # server need not wait for either.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
