"""The verb of assets: inspect."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from lookdev.cli.options import AsJson, Variants, nothing_printed, say, say_json

app = typer.Typer()


class Purpose(StrEnum):
    """The use that geometry is meant for, by UsdGeom.Imageable."""

    default = "default"
    render = "render"
    proxy = "proxy"
    guide = "guide"


@app.command(rich_help_panel="Assets")
def inspect(
    asset: Annotated[Path, typer.Argument(metavar="ASSET", help="A USD file with geometry.", show_default=False)],
    prim: Annotated[
        str | None, typer.Option("--prim", metavar="PATH", help="Only what is under this prim.", show_default=False)
    ] = None,
    layer: Annotated[
        Path | None,
        typer.Option("--layer", metavar="USD", help="A layer composed over the asset.", show_default=False),
    ] = None,
    variants: Variants = None,
    time: Annotated[
        float | None, typer.Option("--time", help="The time; default: the start of the asset.", show_default=False)
    ] = None,
    purposes: Annotated[
        list[Purpose] | None,
        typer.Option("--purpose", help="Repeatable; default: default and render.", show_default=False),
    ] = None,
    png: Annotated[
        Path | None,
        typer.Option("--png", metavar="FILE", help="Render a picture with a colour for each part.", show_default=False),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List what would be rendered of an asset: parts, materials and their translation, and what is not supported."""
    from lookdev.batch.inspect import inspect_file
    from lookdev.material.variants import parse_variants
    from lookdev.stage import Composition

    # What is missing is listed beside the rest.
    composition = Composition(asset, layer, prim, tuple(parse_variants(variants or ()).items()), missing="warn")
    with nothing_printed():
        found, shown = inspect_file(composition, time, tuple(purposes or (Purpose.default, Purpose.render)))
    if as_json:
        say_json(found.data())
    else:
        say(found.text())
    if png is not None:
        from lookdev.batch.portrait import write_portrait

        result = write_portrait(shown, png)
        if result.exit_code:
            say(result.summary(), err=True)
        raise typer.Exit(result.exit_code)
