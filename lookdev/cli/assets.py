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
    asset: Annotated[
        Path,
        typer.Argument(
            metavar="ASSET", help="A USD file with geometry or lights, or a built-in rig.", show_default=False
        ),
    ],
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
    rig: Annotated[
        bool, typer.Option("--rig", help="List the lights; default: where there is no geometry beside them.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """List what would be rendered of an asset: parts, materials and their translation, and what is not supported.

    Of a rig, list its lights.
    """
    from lookdev.errors import LookdevError, close_hint
    from lookdev.inspect.assets import inspect_file
    from lookdev.light.builtin_rigs import BUILTIN_RIGS, rig_file
    from lookdev.material.variants import parse_variants
    from lookdev.stage import Composition

    if not asset.exists() and str(asset) in BUILTIN_RIGS:
        asset = rig_file(str(asset))
    elif not asset.exists() and (hint := close_hint(str(asset), BUILTIN_RIGS)):
        raise LookdevError(f"{asset}: no such file or built-in rig ({hint})")
    # What is missing is listed beside the rest.
    composition = Composition(asset, layer, prim, tuple(parse_variants(variants or ()).items()), missing="warn")
    with nothing_printed():
        shown_purposes = tuple(purposes or (Purpose.default, Purpose.render))
        found, shown = inspect_file(composition, time, shown_purposes, rig=rig)
    if shown is None and (png is not None or time is not None or purposes):
        raise LookdevError(f"{asset}: is a rig, for which --png, --time and --purpose have no meaning")
    if as_json:
        say_json(found.data())
    else:
        say(found.text())
    if png is not None and shown is not None:
        from lookdev.inspect.portrait import write_portrait

        result = write_portrait(shown, png)
        if result.exit_code:
            say(result.summary(), err=True)
        raise typer.Exit(result.exit_code)
