"""The verb of assets: inspect."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from lookdev.cli.options import AsJson, Variants, say, say_json, stdout_to_stderr

app = typer.Typer()


class Purpose(StrEnum):
    """The purpose of geometry, as UsdGeom.Imageable defines it."""

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
        str | None,
        typer.Option("--prim", metavar="PATH", help="Only this prim and the prims under it.", show_default=False),
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
        bool, typer.Option("--rig", help="List the lights; default: only if the file has no geometry.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """List what lookdev would render of an asset: parts, materials and their translation, and what it does not support.

    For a rig, list its lights.
    """
    from lookdev.errors import LookdevError, close_hint
    from lookdev.inspect.assets import inspect_file
    from lookdev.material.variants import parse_variants
    from lookdev.shipped import BUILTIN_RIGS, rig_file
    from lookdev.stage import Composition

    if not asset.exists() and str(asset) in BUILTIN_RIGS:
        asset = rig_file(str(asset))
    elif not asset.exists() and (hint := close_hint(str(asset), BUILTIN_RIGS)):
        raise LookdevError(f"{asset}: no such file or built-in rig ({hint})")
    # Missing files are listed beside the rest.
    composition = Composition(asset, layer, prim, tuple(parse_variants(variants or ()).items()), missing="warn")
    with stdout_to_stderr():
        purpose_names = tuple(purposes or (Purpose.default, Purpose.render))
        report, inspected_asset = inspect_file(composition, time, purpose_names, rig=rig)
    if inspected_asset is None and (png is not None or time is not None or purposes):
        raise LookdevError(f"{asset}: is a rig, for which --png, --time and --purpose have no meaning")
    if as_json:
        say_json(report.data())
    else:
        say(report.text())
    if png is not None and inspected_asset is not None:
        from lookdev.inspect.pictures import write_portrait

        result = write_portrait(inspected_asset, png)
        if result.exit_code:
            say(result.summary(), err=True)
        raise typer.Exit(result.exit_code)
