"""The commands of ``lookdev materials``: they list the library of presets, and edit the layers of a look."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from typer import Argument, Option
from typer.core import TyperGroup

from lookdev.cli.options import LookFile, Prim, say, say_notes


class _ListByDefault(TyperGroup):
    """A group of commands whose default command is ``list``: it runs if the first argument is an option, or missing."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if not args or (args[0].startswith("-") and args[0] != "--help"):
            args = ["list", *args]
        return super().parse_args(ctx, args)


app = typer.Typer(cls=_ListByDefault, help="List the library of presets, or edit the layers of a look.")


PresetName = Annotated[str, Argument(metavar="PRESET", help="A preset's name, or its file.")]
LayerName = Annotated[str, Argument(metavar="LAYER", help="The layer's number or name.")]
Folder = Annotated[
    Path | None,
    Option(
        metavar="DIR",
        help="A folder of presets; default: $LOOKDEV_LIBRARY, else ./materials and the presets of the program.",
    ),
]
MASK_HELP = "A number, IMAGE[:CHANNEL], primvar:NAME, or an expression."
InputOptions = Annotated[
    list[str] | None,
    Option(
        "--input",
        metavar="NAME=SOURCE",
        help="The source of a name in an expression: a number, IMAGE[:CHANNEL], primvar:NAME or uv:NAME. Repeatable.",
    ),
]


@app.command("list")
def list_presets(
    library: Folder = None,
    category: Annotated[str | None, Option(help="Only presets of this category.")] = None,
    sheet: Annotated[Path | None, Option(metavar="FILE.png", help="Also render a contact sheet to this file.")] = None,
) -> None:
    """List the presets of the library; the default of 'lookdev materials'."""
    from lookdev.material.library import library_folders, library_text, read_library

    presets = read_library(library_folders(library), category)
    say_notes(presets.faults)
    say(library_text(presets))
    if sheet is not None:
        from lookdev.inspect.pictures import write_library_sheet
        from lookdev.run.progress import show_progress

        with show_progress(sys.stdout) as report:
            result = write_library_sheet(presets.presets, sheet, report)
        say(result.summary(), err=result.exit_code != 0)
        raise typer.Exit(result.exit_code)


@app.command()
def new(
    look: LookFile,
    preset: PresetName,
    name: Annotated[str | None, Option(help="The material's name; default: that of the file.")] = None,
    library: Folder = None,
) -> None:
    """Write a new look whose base is a preset, by reference."""
    from lookdev.material.library import find_preset
    from lookdev.material.library.edit import new_look

    library_preset = find_preset(preset, library)
    path = new_look(look, library_preset, name)
    say(f"{look}: {path} is {library_preset.name}")


@app.command()
def add(
    look: LookFile,
    preset: PresetName,
    mask: Annotated[str, Option(help=MASK_HELP)] = "1",
    inputs: InputOptions = None,
    mode: Annotated[
        Literal["over", "transmit"], Option(help="How the layer combines with the layers beneath.")
    ] = "over",
    prim: Prim = None,
    library: Folder = None,
) -> None:
    """Add a preset, by reference, as the top layer of a look."""
    from lookdev.material.library import find_preset
    from lookdev.material.library.edit import add_layer
    from lookdev.material.library.masks import parse_mask

    library_preset = find_preset(preset, library)
    number, name = add_layer(look, library_preset, parse_mask(mask, inputs or ()), mode, prim)
    say(f"{look}: layer {number} is {name}")


@app.command()
def remove(look: LookFile, layer: LayerName, prim: Prim = None) -> None:
    """Remove a layer, and the prims that only this layer uses, from a look."""
    from lookdev.material.library.edit import remove_layer

    number, name, gone = remove_layer(look, layer, prim)
    say(f"{look}: layer {number}, {name}, is {'removed' if gone else 'disabled: it comes from another file'}")


@app.command()
def mask(
    look: LookFile,
    layer: LayerName,
    mask: Annotated[str, Argument(metavar="MASK", help=MASK_HELP)],
    inputs: InputOptions = None,
    prim: Prim = None,
) -> None:
    """Give a layer another mask."""
    from lookdev.material.library.edit import set_mask
    from lookdev.material.library.masks import parse_mask

    number, name = set_mask(look, layer, parse_mask(mask, inputs or ()), prim)
    say(f"{look}: layer {number}, {name}, has the mask {mask}")


@app.command()
def preview(look: LookFile, prim: Prim = None) -> None:
    """Write or refresh a look's UsdPreviewSurface, which other USD viewers show."""
    from lookdev.material.library.edit import write_preview

    say(f"{look}: {write_preview(look, prim)} is up to date")


@app.command("import")
def import_document(
    document: Annotated[
        Path,
        Argument(metavar="FILE", help="A MaterialX document (.mtlx), a MERL binary or anisotropic data of Ngan et al."),
    ],
    look: Annotated[
        Path | None, Argument(metavar="[LOOK]", help="The look, a USD file; default: FILE with .usda.")
    ] = None,
) -> None:
    """Write a new look from MaterialX, its disney_principled materials, or from measured reflectance."""
    look = look or document.with_suffix(".usda")
    if document.suffix.lower() not in (".mtlx", ".xml"):
        from lookdev.material.library.edit import measured_look

        say(f"{look}: {measured_look(look, document)} is {document.name}")
        return
    from lookdev.material.materialx import import_materialx, write_usda

    imported = import_materialx(document)
    write_usda(imported, look)
    for fault in imported.losses:
        say(f"not carried over: {fault}", err=True)
    say(f"{look}: {', '.join(f'/{material.name}' for material in imported.materials)}")
