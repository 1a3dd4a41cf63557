"""Finds and reads presets: USD files, each with one layer for looks, in the folders of a library.

The default prim of the file is the shader of the layer, or a look that has only this layer. A preset has the name of
its file without the suffix. Looks reference the file, so a change of a preset changes them.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from pxr import Usd, UsdShade

from lookdev.brdf import layer_shaders
from lookdev.errors import Fault, LookError, nearest_hint
from lookdev.safe_text import align_columns
from lookdev.shipped import shipped_folder
from lookdev.stage import open_stage

LIBRARY_VARIABLE = "LOOKDEV_LIBRARY"
"""The environment variable that lists folders of presets, separated as in ``PATH``."""

SHIPPED_FOLDERS = tuple(Path("materials", folder) for folder in ("presets", "metals", "classic"))
"""The folders of presets, relative to the current folder and to `lookdev.shipped.shipped_folder`."""

LOOK_SUFFIXES = (".usda", ".usd", ".usdc")
"""The suffixes of files that can hold a look or a preset."""


@dataclass(frozen=True)
class Preset:
    """A preset of a library.

    `file` is an absolute path, and `prim` the path of the layer's shader in that file. `model` is a key of
    `lookdev.brdf.MODELS`. `category` and `doc` are texts of the file for the list of presets.
    """

    name: str
    file: Path
    prim: str
    model: str
    category: str
    doc: str


@dataclass(frozen=True)
class Library:
    """The presets of some folders, sorted by category and name, and the faults of files there that are not presets."""

    presets: tuple[Preset, ...]
    faults: tuple[Fault, ...]


def library_folders(library: Path | None = None) -> tuple[Path, ...]:
    """Return the absolute folders of presets, the one with the highest precedence first.

    They are `library`; if that is None, the folders in ``$LOOKDEV_LIBRARY``; if that is empty, the existing folders of
    `SHIPPED_FOLDERS`. Raises LookError where a folder that the user names, or every shipped folder, is missing.
    """
    environment_folders = [Path(entry) for entry in os.environ.get(LIBRARY_VARIABLE, "").split(os.pathsep) if entry]
    named_folders = [library] if library else environment_folders
    shipped = [above / folder for above in (Path(), shipped_folder()) for folder in SHIPPED_FOLDERS]
    folders = dict.fromkeys(folder.absolute() for folder in named_folders or shipped)
    missing = [folder for folder in folders if not folder.is_dir()]
    if named_folders and missing:
        origin = "--library" if library else f"${LIBRARY_VARIABLE}"
        raise LookError([Fault(str(folder), "", f"{origin} names no folder") for folder in missing])
    if len(missing) == len(folders):
        hint = f"name a folder of presets with --library or ${LIBRARY_VARIABLE}"
        raise LookError.at("library", "", f"no folder {_join_folders(folders)}", hint)
    return tuple(folder for folder in folders if folder not in missing)


def read_library(folders: Iterable[Path], category: str | None = None) -> Library:
    """Read the presets of some folders, of all categories or of one; raises LookError where there are none."""
    folders = tuple(folders)
    presets: list[Preset] = []
    faults: list[Fault] = []
    for file in _preset_files(folders).values():
        try:
            presets.append(read_preset(file))
        except LookError as error:
            faults += error.faults
    categories = sorted({preset.category for preset in presets} - {""})
    if category is not None:
        presets = [preset for preset in presets if preset.category == category]
    if not presets and category is not None and categories:
        raise LookError.at("library", "", f"no preset of category '{category}'", nearest_hint(category, categories))
    if not presets:
        message = f"no preset in {_join_folders(folders)}"
        raise LookError(faults or [Fault("library", "", message, "put *.usda files there")])
    return Library(tuple(sorted(presets, key=lambda preset: (preset.category, preset.name))), tuple(faults))


def find_preset(name: str, library: Path | None = None) -> Preset:
    """Return the preset in the file `name`, if this has the suffix of a USD file, or else the library's preset `name`.

    Upper and lower case are equal in names of the library. Raises LookError where there is no such preset.
    """
    if Path(name).suffix in LOOK_SUFFIXES:
        return read_preset(Path(name).absolute())
    folders = library_folders(library)
    files = _preset_files(folders)
    if name.casefold() in files:
        return read_preset(files[name.casefold()])
    hint = nearest_hint(name.casefold(), sorted(files)) if files else "put *.usda files there"
    raise LookError.at("library", "", f"no preset '{name}' in {_join_folders(folders)}", hint)


def read_preset(file: Path) -> Preset:
    """Read the preset of a file.

    Raises
    ------
    LookError
        The file is missing, is not USD, or its default prim is neither the shader of a layer nor a look whose only
        layer is a shader of constants.
    """
    stage = open_stage(file)
    default_prim = stage.GetDefaultPrim()
    if not default_prim:
        raise LookError.at(file, "", "has no default prim", "a preset is a shader: set defaultPrim to it")
    prim = _only_layer(default_prim) or default_prim
    shader = UsdShade.Shader(prim)
    model = (shader.GetShaderId() if shader else None) or ""
    path = str(prim.GetPath())
    if model not in layer_shaders():
        message = f"its info:id is '{model}'" if shader else f"is a {prim.GetTypeName() or 'prim without a type'}"
        raise LookError.at(file, path, message, f"a preset is a Shader whose info:id is {' or '.join(layer_shaders())}")
    if not shader.GetOutput("layer"):
        raise LookError.at(file, path, "has no outputs:layer", "declare it: token outputs:layer")
    doc = default_prim.GetDocumentation() or stage.GetRootLayer().documentation
    category = str(default_prim.GetCustomDataByKey("category") or "")
    return Preset(file.stem, file, path, layer_shaders()[model], category, " ".join(doc.split()))


def _only_layer(prim: Usd.Prim) -> Usd.Prim | None:
    """Return the shader of the only layer of the look `prim`; None for another prim, or where an input is connected."""
    material = UsdShade.Material(prim)
    surface = material.GetOutput("lookdev:surface") if material else None
    sources = surface.GetConnectedSources()[0] if surface else []
    shader = UsdShade.Shader(sources[0].source.GetPrim() if sources else Usd.Prim())
    if not shader or any(shader_input.HasConnectedSource() for shader_input in shader.GetInputs()):
        return None
    return shader.GetPrim() if shader.GetShaderId() in layer_shaders() else None


def library_text(library: Library) -> str:
    """Return a library as a text table of each preset's name, category, model and first sentence of documentation."""
    rows = [("name", "category", "model", "")]
    rows += [(p.name, p.category, p.model, p.doc.partition(". ")[0].rstrip(".")) for p in library.presets]
    return "\n".join(align_columns(rows))


def _preset_files(folders: Iterable[Path]) -> dict[str, Path]:
    """Return the files in library folders by casefolded name. For equal names, the first folder counts."""
    files: dict[str, Path] = {}
    for folder in folders:
        for file in sorted(folder.iterdir()):
            if file.suffix in LOOK_SUFFIXES and not file.name.startswith("."):
                files.setdefault(file.stem.casefold(), file)
    return files


def _join_folders(folders: Iterable[Path]) -> str:
    """Return the paths of folders as text for a message."""
    return " or ".join(map(str, folders))
