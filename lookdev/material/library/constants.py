"""Constants of a look, set where the file states them: in the file itself, or in a copy of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdShade, UsdUtils

from lookdev.brdf import MODELS, layer_shaders
from lookdev.cache import atomic_path
from lookdev.errors import Fault, LookError, nearest_hint
from lookdev.material.change import Constant, Value, with_constants
from lookdev.material.library.edit import INPUT_TYPES, check_suffix, edited, reported_for
from lookdev.material.library.nodes import clear_input, relative_path
from lookdev.material.library.stack import shown_layers
from lookdev.material.usd import find_material, read_look
from lookdev.material.usd.network import Network, Source, shader_id
from lookdev.stage import open_stage, reading


def set_inputs(
    file: Path,
    values: Mapping[tuple[int, str], Value],
    prim: str | None = None,
    variants: Mapping[str, str] | None = None,
) -> None:
    """Set constants of layers, by the place of a layer in the look, from the base, and the name of a parameter.

    ``"mask"`` is that of the layer, ``"mask.dirt"`` an input of an expression. What the file itself says of an input is
    changed where it says it, also in a variant; an input of another file gets an override. The material is as in
    `variants`.
    """
    with edited(file, prim, variants) as material:
        for (number, name), value in values.items():
            set_constant(_input(material, number, name.split("."), value), value)


def write_changed(
    file: Path,
    out: Path,
    constants: Sequence[Constant],
    prim: str | None = None,
    variants: Mapping[str, str] | None = None,
) -> None:
    """Write a copy of the look of a file with other constants, whole or not at all; relative paths stay right.

    A constant is set where the file's strongest opinion of it is, also in a variant; one that comes from an interface
    or another file is overridden.

    Raises
    ------
    LookError
        The file is not a look of layers in USD, or another input has the same source as a constant.
    """
    check_suffix(out)
    look = read_look(file, prim, dict(variants or {}))
    rounded = [replace(each, value=tuple(float(np.float32(x)) for x in each.value)) for each in constants]
    wanted = with_constants(look, rounded)
    with atomic_path(out) as temporary, reported_for(out, temporary):
        # An interface is a look's own handle on a constant, unless other inputs hang on it.
        for by_interface in (True, False):
            _copy(file, temporary, out)
            path = _edit(temporary, constants, prim, variants or {}, by_interface)
            if read_look(temporary, str(path), dict(variants or {})).layers == wanted.layers:
                return
        names = ", ".join(each.name for each in constants)
        what = f"{names}: another input of the look has the same source, or a stronger layer sets it"
        raise LookError([Fault(str(file), str(path), what, "give each input a value of its own")])


def _copy(file: Path, temporary: Path, out: Path) -> None:
    """Write the layer of a file in the format and for the folder of another."""
    with reading(file):
        layer = Sdf.Layer.FindOrOpen(str(file))
        if layer is None or not layer.Export(str(temporary)):
            raise LookError([Fault(str(file), "", "cannot be copied as a look in USD")])
    before, after = file.resolve().parent, out.resolve().parent
    if before != after:
        _anchor(temporary, before, after)


def _edit(
    file: Path, constants: Sequence[Constant], prim: str | None, variants: Mapping[str, str], by_interface: bool
) -> Sdf.Path:
    """Set constants of the look of a file; return the material's path."""
    stage, network = open_stage(file), Network(file)
    path = find_material(network, stage, prim, variants)
    if path is None:
        raise LookError(network.faults)
    material = UsdShade.Material(stage.GetPrimAtPath(path))
    for each in constants:
        attribute = _input(material, each.layer, each.path, each.value)
        set_constant(attribute, each.value, by_interface=by_interface)
    stage.GetRootLayer().Save()
    return path


def check_writable(file: Path, prim: str | None = None, variants: Mapping[str, str] | None = None) -> None:
    """Raise LookError where `write_changed` cannot write a look of a file: it is not one of layers in USD."""
    check_suffix(file)
    stage, network = open_stage(file), Network(file)
    path = find_material(network, stage, prim, variants or {})
    if path is None:
        raise LookError(network.faults)
    shown_layers(UsdShade.Material(stage.GetPrimAtPath(path)))


def _input(material: UsdShade.Material, layer: int, path: Sequence[str], value: Any) -> Usd.Attribute:
    """Return the attribute of a constant, made where it is not there yet; `path` is as that of a `Constant`."""
    shader, stack, mask = shown_layers(material)[layer]
    name, *inside = path
    if name == "mask":
        attribute = stack.CreateInput(mask, Sdf.ValueTypeNames.Float).GetAttr()
    else:
        kind = MODELS[layer_shaders()[shader_id(shader)]].parameters[name].kind
        attribute = shader.CreateInput(name, INPUT_TYPES[kind]).GetAttr()
    if not inside:
        return attribute
    network = Network(Path())
    source = network.follow(attribute)
    known = [each.GetBaseName() for each in source.shader.GetInputs()] if isinstance(source, Source) else []
    if not isinstance(source, Source) or inside[0] not in known:
        place = str(attribute.GetPath())
        what = f"no expression with an input '{inside[0]}' has its value"
        file = attribute.GetStage().GetRootLayer().realPath
        raise LookError([Fault(file, place, what, nearest_hint(inside[0], known) if known else "")])
    kind = INPUT_TYPES["color" if isinstance(value, tuple) and len(value) == 3 else "float"]
    return source.shader.CreateInput(inside[0], kind).GetAttr()


def set_constant(attribute: Usd.Attribute, value: Any, *, by_interface: bool = True) -> None:
    """Set a constant where the strongest opinion of the edited file is.

    With `by_interface` that is the interface input to which the attribute is connected; otherwise the connection goes.
    Raises LookError where a node computes the input.
    """
    given = Gf.Vec3f(*map(float, value)) if isinstance(value, tuple) and len(value) == 3 else value
    given = float(given[0]) if isinstance(given, tuple) else given
    network = Network(Path(attribute.GetStage().GetRootLayer().realPath))
    holder = network.follow(attribute) if by_interface else None
    if isinstance(holder, Source):
        place, hint = str(attribute.GetPath()), "a texture or an expression has its value"
        raise LookError([Fault(str(network.file), place, "is connected", hint)])
    target = holder or attribute
    if target.HasAuthoredConnections():
        clear_input(target)
    root = target.GetStage().GetRootLayer()
    for spec in target.GetPropertyStack(Usd.TimeCode.Default()):
        if spec.layer == root and spec.HasDefaultValue():
            spec.default = given
            return
    target.Set(given)


def _anchor(layer_file: Path, before: Path, after: Path) -> None:
    """Rewrite relative paths of a layer for another folder."""
    layer = Sdf.Layer.FindOrOpen(str(layer_file))

    def moved(path: str) -> str:
        if not path or Path(path).is_absolute() or "://" in path or (path[0] != "." and not (before / path).exists()):
            return path
        return relative_path(before / path, after)

    UsdUtils.ModifyAssetPaths(layer, moved)
    layer.Save()
