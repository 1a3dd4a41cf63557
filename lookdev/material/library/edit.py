"""Edits of looks in USD files: new looks, and layers added to or removed from their stacks, by reference to presets.

An edit changes a copy beside the file. The copy replaces the file only if `read_look` finds no faults in it, in any
variant of the material. Only this file changes: a stack that another file defines gets overrides. Each function raises
LookError where the file is not a look, or would not be one after the edit.

`layer` is the number of a layer, or its name, where upper and lower case are equal. `prim` is the path of the material,
which is needed if a file has several. `variants` are the variants in which the material is composed.
"""

from __future__ import annotations

import logging
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from pxr import Gf, Sdf, Usd, UsdShade

from lookdev.brdf import Mode, Model
from lookdev.brdf.measured import MEASURED
from lookdev.brdf.vectors import Parameters
from lookdev.cache import atomic_path
from lookdev.errors import LookError
from lookdev.material import Look
from lookdev.material.expression import ExpressionKind
from lookdev.material.library import LOOK_SUFFIXES, Preset
from lookdev.material.library.layout import restore_layout
from lookdev.material.library.masks import InputState, MaskSource, MaskWriter
from lookdev.material.library.nodes import clear_input, find_upstream, free_path, relative_asset, remove_unused
from lookdev.material.library.preview import author_preview
from lookdev.material.library.stack import LAYER_PARTS, author_stack, enabled_layers, ensure_stack, require_stack
from lookdev.material.usd import VariantChoice, open_material, read_look, read_material
from lookdev.material.usd.network import Network, OutputSource, is_authored, shader_id
from lookdev.stage import usd_errors_as_faults

log = logging.getLogger("lookdev.material")

_TYPES = Sdf.ValueTypeNames
INPUT_TYPES = {"float": _TYPES.Float, "color": _TYPES.Color3f, "normal": _TYPES.Normal3f, "token": _TYPES.Token}
"""The types in USD of the inputs of a layer's shader, by the `Parameter.kind` of the parameter."""


def new_look(file: Path, preset: Preset, name: str | None = None) -> str:
    """Write a new look whose base references a preset, and return the path of its material.

    `file` must not exist. `name` is the name of the material. By default it derives from the file's name: ``WornPaint``
    for ``worn_paint.usda``.
    """
    return _write_new_look(file, name, lambda stage, path: _define_reference(stage, path, preset))


def measured_look(file: Path, measurement: Path) -> str:
    """Write a new look whose base shows a file of measured reflectance, and return the path of its material.

    The path of the measurement is written relative to the look.
    """
    return model_look(file, MEASURED, {"file": str(measurement)}, is_relative=True)


def model_look(file: Path, model: Model, values: Parameters, *, is_relative: bool = False) -> str:
    """Write a new look whose base is a layer of a model, and return the path of its material; otherwise as `new_look`.

    `values` has constants of the model by name; other parameters keep their defaults. Paths among the constants are
    written as absolute, or with `is_relative` as relative to the look. Raises ModelError for faulty constants.
    """
    model.complete(values)  # for the errors that it raises

    def define(stage: Usd.Stage, path: Sdf.Path) -> Sdf.Path:
        shader = UsdShade.Shader.Define(stage, path)
        shader.CreateIdAttr(model.identifier)
        for name, value in values.items():
            kind = model.parameters[name].kind
            if model.parameters[name].file and value not in model.parameters[name].choices:
                asset = relative_asset(Path(value), stage) if is_relative else str(Path(value).absolute())
                shader.CreateInput(name, _TYPES.Asset).Set(asset)
                continue
            usd_value = Gf.Vec3f(*map(float, value)) if kind in ("color", "normal") else value
            shader.CreateInput(name, INPUT_TYPES[kind]).Set(usd_value if kind != "float" else float(value))
        shader.CreateOutput("layer", _TYPES.Token)
        return path

    return _write_new_look(file, None, define)


def _write_new_look(file: Path, name: str | None, define: Callable[[Usd.Stage, Sdf.Path], Sdf.Path]) -> str:
    """Write a new look and return the path of its material.

    ``define(stage, path)`` defines the shader of the base layer at a path, and returns this path.
    """
    check_suffix(file)
    if file.exists() or file.is_symlink():
        raise LookError.at(file, "", "exists already", "choose another name, or 'lookdev materials add' a layer to it")
    name = name or camel_case(file.stem)
    if not Sdf.Path.IsValidIdentifier(name):
        hint = "letters, digits and '_', not a digit first; give one with --name"
        raise LookError.at(file, "", f"'{name}' cannot be the name of a material", hint)
    with atomic_path(file) as temporary, report_faults_for(file, temporary):
        stage = Usd.Stage.CreateNew(str(temporary))
        material = UsdShade.Material.Define(stage, f"/{name}")
        stage.SetDefaultPrim(material.GetPrim())
        base = define(stage, material.GetPath().AppendChild("Base"))
        author_stack(material, base)
        _author_preview(material)
        _check_variants(material)
    return f"/{name}"


def camel_case(words: str) -> str:
    """Return words as a prim name: ``WornPaint`` for ``worn_paint``."""
    return "".join(word[:1].upper() + word[1:] for word in re.split(r"[^A-Za-z0-9]+", words))


def preset_look(preset: Preset, name: str) -> Look:
    """Return a look in memory whose only layer is a preset."""
    stage = Usd.Stage.CreateInMemory()
    material = UsdShade.Material.Define(stage, "/Preset")
    base = stage.DefinePrim("/Preset/Base", "Shader")
    base.GetReferences().AddReference(str(preset.file.absolute()), preset.prim)
    author_stack(material, base.GetPath())
    return replace(read_material(preset.file, stage, material.GetPath()), name=name)


def add_layer(
    file: Path,
    preset: Preset,
    mask: MaskSource = 1.0,
    mode: Mode = "over",
    prim: str | None = None,
    variants: VariantChoice = None,
) -> tuple[int, str]:
    """Add a layer that references a preset over the layers of a look; return its number and its name.

    A look with a single layer gets a stack first.
    """
    with edit_material(file, prim, variants) as material:
        stack, number = ensure_stack(material)
        # The shader of a preset that is a look has the name Base, as the base of any look.
        name = Sdf.Path(preset.prim).name
        prim_name = camel_case(preset.name) if name == "Base" and camel_case(preset.name).isidentifier() else name
        path = _define_reference(stack.stage, free_path(stack.stage, stack.scope, prim_name), preset)
        stack.create_input(number, "", _TYPES.Token).SetConnections([path.AppendProperty("outputs:layer")])
        if mode != "over":
            stack.create_input(number, "Mode", _TYPES.Token).Set(mode)
        if mask != 1.0:
            attribute = stack.create_input(number, "Mask", _TYPES.Float)
            MaskWriter(stack.stage, stack.scope, {}).write(attribute, f"{path.name}Mask", mask)
    return number, path.name


def remove_layer(
    file: Path, layer: str, prim: str | None = None, variants: VariantChoice = None
) -> tuple[int, str, bool]:
    """Remove a layer from a stack; return its number, its name, and whether it was removed (not only disabled).

    The layers above get new numbers, and nodes that only this layer used are removed. A layer that another file defines
    cannot be removed. It is disabled instead.
    """
    with edit_material(file, prim, variants) as material:
        stack = require_stack(material)
        number, name = stack.find(layer)
        attributes = [stack.attribute(number, part) for part in LAYER_PARTS]
        removable = all(stack.is_in_file(attribute) for attribute in attributes if attribute)
        if removable:
            used = find_upstream(material, attributes)
            stack.remove_inputs(number)
            remove_unused(material, used)
        else:
            stack.create_input(number, "Enabled", _TYPES.Bool).Set(False)
    return number, name, removable


def set_mask(
    file: Path, layer: str, mask: MaskSource, prim: str | None = None, variants: VariantChoice = None
) -> tuple[int, str]:
    """Replace the mask of a layer; return the layer's number and name.

    Nodes that only the old mask used are removed. If `mask` is an expression and states nothing for one of its inputs,
    this input keeps its source from the old expression.
    """
    with edit_material(file, prim, variants) as material:
        stack = require_stack(material)
        number, name = stack.find(layer)
        replace_source(material, stack.create_input(number, "Mask", _TYPES.Float), stack.scope, f"{name}Mask", mask)
    return number, name


def replace_source(
    material: UsdShade.Material,
    attribute: Usd.Attribute,
    scope: Sdf.Path,
    name: str,
    source: MaskSource | None,
    kind: ExpressionKind = "float",
) -> None:
    """Replace the source of an input by `source`, or remove it where `source` is None.

    The nodes of the new source become children of the prim `scope`, under `name`. `kind` is the type of the input.
    Nodes that only the old source used are removed. If `source` is an expression and states nothing for one of its
    inputs, this input keeps its source from the old expression.
    """
    # This network only follows connections. Its file needs no name: this would only appear in faults.
    old_states = _input_states(Network(Path()).follow(attribute)) if source is not None else {}
    used = find_upstream(material, [attribute])
    clear_input(attribute)
    # The new expression may use the sources of the old expression's inputs. These are kept until it is written.
    remove_unused(material, used, [path for state in old_states.values() for path in state.connections])
    if source is not None:
        MaskWriter(attribute.GetStage(), scope, old_states, kind).write(attribute, name, source)
        remove_unused(material, used)


def write_preview(file: Path, prim: str | None = None) -> str:
    """Write or refresh the UsdPreviewSurface of a look, and return the path of its shader."""
    with edit_material(file, prim) as material:
        return _author_preview(material)


def _define_reference(stage: Usd.Stage, path: Sdf.Path, preset: Preset) -> Sdf.Path:
    """Define a shader that references a preset, and return its path."""
    prim = stage.DefinePrim(path, "Shader")
    prim.GetReferences().AddReference(relative_asset(preset.file, stage), preset.prim)
    return prim.GetPath()


def _author_preview(material: UsdShade.Material) -> str:
    """Write the preview of the enabled layers of a look, and return the path of its shader."""
    look = _save_and_read(material)
    shaders = [shader for shader, *_ in enabled_layers(material)]
    return author_preview(material, list(zip(look.layers, shaders, strict=True)))


def _input_states(source: Usd.Attribute | OutputSource | None) -> dict[str, InputState]:
    """Return the authored states of an expression node's inputs by name; {} where the source is not such a node."""
    if not isinstance(source, OutputSource) or shader_id(source.shader) != "LookdevExpression":
        return {}
    inputs = {shader_input.GetBaseName(): shader_input.GetAttr() for shader_input in source.shader.GetInputs()}
    return {
        name: InputState(attribute.GetTypeName(), tuple(attribute.GetConnections()), attribute.Get())
        for name, attribute in inputs.items()
        if name != "expression" and is_authored(attribute)
    }


@contextmanager
def edit_material(file: Path, prim: str | None, variants: VariantChoice = None) -> Iterator[UsdShade.Material]:
    """Yield the material of a copy of a file, to be edited. On exit, the copy replaces the file if its look is valid.

    A text file keeps the layout of its author. Raises LookError where the file is not a look, or the edited one has
    faults.
    """
    check_suffix(file)
    if file.is_symlink():
        raise LookError.at(file, "", "is a symbolic link", f"edit {file.resolve()} itself")
    if not file.is_file():
        raise LookError.at(file, "", "no such file", "'lookdev materials new' makes one")
    with atomic_path(file) as temporary, report_faults_for(file, temporary):
        shutil.copy(file, temporary)
        with open_material(temporary, prim, variants) as material:
            before = None if is_binary(file) else material.GetPrim().GetStage().GetRootLayer().ExportToString()
            yield material
            _check_variants(material)
        if before is not None:
            _restore_layout(file, temporary, before)


def _restore_layout(file: Path, temporary: Path, before: str) -> None:
    """Restore the layout of a file's text in its edited copy, or warn that this is not possible.

    `before` is the unedited layer as USD writes it.
    """
    text = restore_layout(file.read_text("utf-8"), before, temporary.read_text("utf-8"))
    if text is None:
        log.warning("%s: USD's own layout replaces that of its text, and its comments are lost", file)
    else:
        temporary.write_text(text, "utf-8")


def is_binary(file: Path) -> bool:
    """Return whether a file is a USD layer in binary format."""
    with file.open("rb") as stream:
        return stream.read(8) == b"PXR-USDC"


def check_suffix(file: Path) -> None:
    """Raise LookError where a file of this name cannot hold a look."""
    if file.suffix not in LOOK_SUFFIXES:
        raise LookError.at(file, "", "is not a file to write a look in", f"one of {', '.join(LOOK_SUFFIXES)}")


@contextmanager
def report_faults_for(file: Path, temporary: Path) -> Iterator[None]:
    """Within this context, raise faults and USD's errors of a temporary copy as faults of the file itself."""
    try:
        with usd_errors_as_faults(temporary):
            yield
    except LookError as error:

        def rename(text: str) -> str:
            return text.replace(str(temporary.absolute()), str(file)).replace(str(temporary), str(file))

        faults = [replace(fault, file=rename(fault.file), what=rename(fault.what)) for fault in error.faults]
        raise LookError(faults) from error


def _save_and_read(material: UsdShade.Material, **variants: str) -> Look:
    """Save the file of a material, and read its look with these variants selected, by set; raises as `read_look`."""
    layer = material.GetPrim().GetStage().GetRootLayer()
    layer.Save()
    return read_look(Path(layer.realPath), str(material.GetPath()), variants)


def _check_variants(material: UsdShade.Material) -> None:
    """Raise LookError if the look is faulty, as it is or with any single variant of the material selected."""
    _save_and_read(material)
    variants = material.GetPrim().GetVariantSets()
    for name in variants.GetNames():
        for choice in variants.GetVariantSet(name).GetVariantNames():
            _save_and_read(material, **{name: choice})
