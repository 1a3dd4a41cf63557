"""Editing looks: layer stacks of references to presets, written in USD.

An edit is made on a copy beside the file, which replaces the file only if `read_look` finds no fault in it, in any
variant of the material. It is written to the file itself: a stack that comes from another file gets overrides. Each
function raises LookError where the file is not a look, or would not be one after the edit; layers are named by number
or, in whatever case, by name.
"""

from __future__ import annotations

import logging
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from pxr import Gf, Sdf, Usd, UsdShade

from lookdev.brdf import Mode, Model
from lookdev.brdf.measured import MEASURED, grid_of
from lookdev.cache import atomic_path
from lookdev.errors import Fault, LookError
from lookdev.material.expression import Kind
from lookdev.material.library import SUFFIXES, Preset
from lookdev.material.library.layout import with_layout
from lookdev.material.library.masks import Held, Mask, MaskWriter
from lookdev.material.library.nodes import clear_input, free_path, prune, relative_asset, upstream
from lookdev.material.library.preview import author_preview
from lookdev.material.library.stack import author_stack, find_stack, shown_layers, stack_of, surface_of
from lookdev.material.look import Look
from lookdev.material.usd import find_material, read_look, read_material
from lookdev.material.usd.network import Network, Source, is_set, shader_id
from lookdev.stage import open_stage, reading

log = logging.getLogger("lookdev.material")

_TYPES = Sdf.ValueTypeNames
INPUT_TYPES = {"float": _TYPES.Float, "color": _TYPES.Color3f, "normal": _TYPES.Normal3f, "token": _TYPES.Token}
"""Types of the inputs of a layer, by the kinds of parameters."""


def new_look(file: Path, preset: Preset, name: str | None = None) -> str:
    """Write a new look whose base is a preset, by reference, and return the path of its material.

    The material is called `name`, by default as the file: ``WornPaint`` for ``worn_paint.usda``, which must not exist.
    """
    return _new(file, name, lambda stage, path: _reference(stage, path, preset))


def measured_look(file: Path, measurement: Path) -> str:
    """Write a new look whose base is a file of measured reflectance; otherwise as `new_look`.

    A ModelError reports what is wrong with the measurement.
    """
    grid_of(str(measurement))

    def define(stage: Usd.Stage, path: Sdf.Path) -> Sdf.Path:
        shader = UsdShade.Shader.Define(stage, path)
        shader.CreateIdAttr(MEASURED.identifier)
        shader.CreateInput("file", _TYPES.Asset).Set(relative_asset(measurement, stage))
        shader.CreateOutput("layer", _TYPES.Token)
        return path

    return _new(file, None, define)


def model_look(file: Path, model: Model, values: Mapping[str, Any]) -> str:
    """Write a new look whose base is a model with some parameters, constants by name; otherwise as `new_look`.

    A ModelError reports what is wrong with them.
    """
    model.complete(values)

    def define(stage: Usd.Stage, path: Sdf.Path) -> Sdf.Path:
        shader = UsdShade.Shader.Define(stage, path)
        shader.CreateIdAttr(model.identifier)
        for name, value in values.items():
            kind = model.parameters[name].kind
            if model.parameters[name].file and value not in model.parameters[name].choices:
                shader.CreateInput(name, _TYPES.Asset).Set(str(Path(value).absolute()))
                continue
            given = Gf.Vec3f(*map(float, value)) if kind in ("color", "normal") else value
            shader.CreateInput(name, INPUT_TYPES[kind]).Set(given if kind != "float" else float(value))
        shader.CreateOutput("layer", _TYPES.Token)
        return path

    return _new(file, None, define)


def _new(file: Path, name: str | None, define: Callable[[Usd.Stage, Sdf.Path], Sdf.Path]) -> str:
    """Write a new look whose base is defined at a path; the function returns it."""
    check_suffix(file)
    if file.exists() or file.is_symlink():
        hint = "choose another name, or 'lookdev materials add' a layer to it"
        raise LookError([Fault(str(file), "", "exists already", hint)])
    name = name or camel_case(file.stem)
    if not Sdf.Path.IsValidIdentifier(name):
        hint = "letters, digits and '_', not a digit first; give one with --name"
        raise LookError([Fault(str(file), "", f"'{name}' cannot be the name of a material", hint)])
    with atomic_path(file) as temporary, reported_for(file, temporary):
        stage = Usd.Stage.CreateNew(str(temporary))
        material = UsdShade.Material.Define(stage, f"/{name}")
        stage.SetDefaultPrim(material.GetPrim())
        base = define(stage, material.GetPath().AppendChild("Base"))
        author_stack(material, base)
        _author_preview(material)
        _check(material)
    return f"/{name}"


def camel_case(words: str) -> str:
    """Return words as the name of a prim: ``WornPaint`` for ``worn_paint``."""
    return "".join(word[:1].upper() + word[1:] for word in re.split(r"[^A-Za-z0-9]+", words))


def preset_look(preset: Preset, name: str) -> Look:
    """Return the look whose only layer is a preset, made in memory."""
    stage = Usd.Stage.CreateInMemory()
    material = UsdShade.Material.Define(stage, "/Preset")
    base = stage.DefinePrim("/Preset/Base", "Shader")
    base.GetReferences().AddReference(str(preset.file.absolute()), preset.prim)
    author_stack(material, base.GetPath())
    return replace(read_material(preset.file, stage, material.GetPath()), name=name)


def add_layer(
    file: Path,
    preset: Preset,
    mask: Mask = 1.0,
    mode: Mode = "over",
    prim: str | None = None,
    variants: Mapping[str, str] | None = None,
) -> tuple[int, str]:
    """Lay a preset, by reference, over the layers of a look, and return the new layer's number and name.

    A look of a single layer gets a stack first.
    """
    with edited(file, prim, variants) as material:
        if find_stack(material) is None:
            author_stack(material, surface_of(material)[1].path)
        stack = stack_of(material)
        number = max(stack.layers, default=0) + 1
        # The shader of a preset that is a look is called Base, as every base is.
        name = Sdf.Path(preset.prim).name
        called = camel_case(preset.name) if name == "Base" and camel_case(preset.name).isidentifier() else name
        path = _reference(stack.stage, free_path(stack.stage, stack.scope, called), preset)
        stack.input(number, "", _TYPES.Token).SetConnections([path.AppendProperty("outputs:layer")])
        if mode != "over":
            stack.input(number, "Mode", _TYPES.Token).Set(mode)
        if mask != 1.0:
            attribute = stack.input(number, "Mask", _TYPES.Float)
            MaskWriter(stack.stage, stack.scope, {}).write(attribute, f"{path.name}Mask", mask)
    return number, path.name


def remove_layer(
    file: Path, layer: str, prim: str | None = None, variants: Mapping[str, str] | None = None
) -> tuple[int, str, bool]:
    """Remove a layer from a stack; return its number, its name, and whether it is removed.

    Layers above it are renumbered, and nodes that only it used are removed. A layer that another file defines cannot be
    removed and is disabled.
    """
    with edited(file, prim, variants) as material:
        stack = stack_of(material)
        number, name = stack.find(layer)
        own = [stack.prim.GetAttribute(stack.input_name(number, part)) for part in ("", "Mask", "Enabled", "Mode")]
        removable = all(stack.is_own(attribute) for attribute in own if attribute)
        if removable:
            used = upstream(material, own)
            stack.drop(number)
            prune(material, used)
        else:
            stack.input(number, "Enabled", _TYPES.Bool).Set(False)
    return number, name, removable


def set_mask(
    file: Path, layer: str, mask: Mask, prim: str | None = None, variants: Mapping[str, str] | None = None
) -> tuple[int, str]:
    """Replace the mask of a layer; return its number and name.

    Nodes that only the old mask used are removed. Names of an expression without a new source keep the one that they
    have in the old expression.
    """
    with edited(file, prim, variants) as material:
        stack = stack_of(material)
        number, name = stack.find(layer)
        replace_source(material, stack.input(number, "Mask", _TYPES.Float), stack.scope, f"{name}Mask", mask)
    return number, name


def replace_source(
    material: UsdShade.Material,
    attribute: Usd.Attribute,
    scope: Sdf.Path,
    name: str,
    source: Mask | None,
    kind: Kind = "float",
) -> None:
    """Give an input another source, whose nodes are children of `scope`, or none; nodes that only the old one used go.

    Names of an expression without a new source keep the one that they have in the old expression.
    """
    old = _inputs(Network(Path()).follow(attribute)) if source is not None else {}
    used = upstream(material, [attribute])
    clear_input(attribute)
    prune(material, used, [path for held in old.values() for path in held.connections])
    if source is not None:
        MaskWriter(attribute.GetStage(), scope, old, kind).write(attribute, name, source)
        prune(material, used)


def write_preview(file: Path, prim: str | None = None) -> str:
    """Write or refresh the UsdPreviewSurface of a look, and return the path of its shader."""
    with edited(file, prim) as material:
        return _author_preview(material)


def _reference(stage: Usd.Stage, path: Sdf.Path, preset: Preset) -> Sdf.Path:
    """Define a shader that is a preset, by reference."""
    prim = stage.DefinePrim(path, "Shader")
    prim.GetReferences().AddReference(relative_asset(preset.file, stage), preset.prim)
    return prim.GetPath()


def _author_preview(material: UsdShade.Material) -> str:
    look = _read_saved(material)
    shaders = [shader for shader, *_ in shown_layers(material)]
    return author_preview(material, list(zip(look.layers, shaders, strict=True)))


def _inputs(source: Usd.Attribute | Source | None) -> dict[str, Held]:
    """Return the present state of an expression's named inputs; none for any other node."""
    if not isinstance(source, Source) or shader_id(source.shader) != "LookdevExpression":
        return {}
    inputs = {each.GetBaseName(): each.GetAttr() for each in source.shader.GetInputs()}
    return {
        name: Held(attribute.GetTypeName(), tuple(attribute.GetConnections()), attribute.Get())
        for name, attribute in inputs.items()
        if name != "expression" and is_set(attribute)
    }


@contextmanager
def edited(file: Path, prim: str | None, variants: Mapping[str, str] | None = None) -> Iterator[UsdShade.Material]:
    """Yield the material of a copy of a file, which replaces the file if it is a look in the end."""
    check_suffix(file)
    if file.is_symlink():
        raise LookError([Fault(str(file), "", "is a symbolic link", f"edit {file.resolve()} itself")])
    if not file.is_file():
        raise LookError([Fault(str(file), "", "no such file", "'lookdev materials new' makes one")])
    with atomic_path(file) as temporary, reported_for(file, temporary):
        shutil.copy(file, temporary)
        stage, network = open_stage(temporary), Network(temporary)
        path = find_material(network, stage, prim, variants or {})
        if path is None:
            raise LookError(network.faults)
        material = UsdShade.Material(stage.GetPrimAtPath(path))
        before = None if is_binary(file) else stage.GetRootLayer().ExportToString()
        yield material
        _check(material)
        if before is not None:
            _keep_layout(file, temporary, before)


def _keep_layout(file: Path, temporary: Path, before: str) -> None:
    """Give an edited copy the layout of the text of a file, which USD writes as `before`."""
    text = with_layout(file.read_text("utf-8"), before, temporary.read_text("utf-8"))
    if text is None:
        log.warning("%s: USD's own layout replaces that of its text, and its comments are lost", file)
    else:
        temporary.write_text(text, "utf-8")


def is_binary(file: Path) -> bool:
    """Return whether a file is a layer in USD's binary format."""
    with file.open("rb") as stream:
        return stream.read(8) == b"PXR-USDC"


def check_suffix(file: Path) -> None:
    """Raise LookError where a look cannot be written in a file of this name."""
    if file.suffix not in SUFFIXES:
        raise LookError([Fault(str(file), "", "is not a file to write a look in", f"one of {', '.join(SUFFIXES)}")])


@contextmanager
def reported_for(file: Path, temporary: Path) -> Iterator[None]:
    """Report the faults of a temporary copy as faults of the file."""
    try:
        with reading(temporary):
            yield
    except LookError as error:

        def renamed(text: str) -> str:
            return text.replace(str(temporary.absolute()), str(file)).replace(str(temporary), str(file))

        faults = [replace(fault, file=renamed(fault.file), what=renamed(fault.what)) for fault in error.faults]
        raise LookError(faults) from error


def _read_saved(material: UsdShade.Material, **variants: str) -> Look:
    """Save and read a look."""
    layer = material.GetPrim().GetStage().GetRootLayer()
    layer.Save()
    return read_look(Path(layer.realPath), str(material.GetPath()), variants)


def _check(material: UsdShade.Material) -> None:
    """Read the look in each variant of the material."""
    _read_saved(material)
    variants = material.GetPrim().GetVariantSets()
    for name in variants.GetNames():
        for choice in variants.GetVariantSet(name).GetVariantNames():
            _read_saved(material, **{name: choice})
