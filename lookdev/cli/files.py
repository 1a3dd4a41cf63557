"""The commands that describe a file: inspect, validate. The commands of the library are in `lookdev.cli.materials`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from lookdev.cli.options import AsJson, Prim, VariantOptions, say, say_json, stdout_to_stderr

app = typer.Typer()


class PurposeOption(StrEnum):
    """The purpose of geometry, as UsdGeom.Imageable defines it."""

    default = "default"
    render = "render"
    proxy = "proxy"
    guide = "guide"


@app.command(rich_help_panel="Assets")
def inspect(
    asset: Annotated[Path, Argument(metavar="ASSET", help="A USD file with geometry or lights, or a built-in rig.")],
    prim: Annotated[str | None, Option(metavar="PATH", help="Only this prim and the prims under it.")] = None,
    layer: Annotated[Path | None, Option(metavar="USD", help="A layer composed over the asset.")] = None,
    variants: VariantOptions = None,
    time: Annotated[float | None, Option(help="The time; default: the start of the asset.")] = None,
    purposes: Annotated[
        list[PurposeOption] | None, Option("--purpose", help="Repeatable; default: default and render.")
    ] = None,
    png: Annotated[Path | None, Option(metavar="FILE", help="Render a picture with a colour for each part.")] = None,
    rig: Annotated[bool, Option("--rig", help="List the lights; default: only if the file has no geometry.")] = False,
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
    # With "warn", the report lists files that the asset refers to and that are missing; otherwise they are errors.
    composition = Composition(asset, layer, prim, tuple(parse_variants(variants or ()).items()), missing="warn")
    with stdout_to_stderr():
        report, inspected_asset = inspect_file(composition, time, tuple(purposes or ("default", "render")), rig=rig)
    if inspected_asset is None and (png is not None or time is not None or purposes):
        raise LookdevError(f"{asset}: is a rig, for which --png, --time and --purpose have no meaning")
    say_json(report.data()) if as_json else say(report.text())
    if png is not None and inspected_asset is not None:
        from lookdev.inspect.pictures import write_portrait

        result = write_portrait(inspected_asset, png)
        if result.exit_code:
            say(result.summary(), err=True)
        raise typer.Exit(result.exit_code)


@app.command(rich_help_panel="Looks")
def validate(
    file: Annotated[Path, Argument(metavar="FILE", help="A USD or MaterialX file with looks.")],
    prim: Prim = None,
    variants: VariantOptions = None,
    as_json: AsJson = False,
) -> None:
    """List all faults of the looks in a file, in all variants that --variants leaves open; exit code 1 for errors."""
    from lookdev.material.validate.examine import examine_file
    from lookdev.material.variants import parse_variants

    with stdout_to_stderr():
        report = examine_file(file, prim, parse_variants(variants or ()))
    say_json(report.data()) if as_json else say(report.text())
    raise typer.Exit(1 if report.has_errors else 0)
