"""Looks with other constants: a copy of a file, in which they are set, and nothing else is changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdShade, UsdUtils

from lookdev.cache import atomic_path
from lookdev.errors import Fault, LookError
from lookdev.material.change import Constant, with_constants
from lookdev.material.library.edit import check_suffix, reported_for, shown_layers
from lookdev.material.library.nodes import clear_input, relative_path
from lookdev.material.usd import find_material, read_look
from lookdev.material.usd.network import Network, Source, is_set
from lookdev.stage import open_stage, reading

_TYPES = {1: Sdf.ValueTypeNames.Float, 3: Sdf.ValueTypeNames.Color3f}


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
        attribute = _input(material, each)
        holder = network.follow(attribute) if by_interface else None
        _set(holder if isinstance(holder, Usd.Attribute) else attribute, each.value)
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


def _input(material: UsdShade.Material, constant: Constant) -> Usd.Attribute:
    """Return the attribute of a constant, made where it is not there yet."""
    shader, stack, mask = shown_layers(material)[constant.layer]
    name, *inside = constant.path
    kind = _TYPES[len(constant.value)]
    shader, name = (stack, mask) if name == "mask" else (shader, name)
    if not inside:
        return shader.CreateInput(name, kind).GetAttr()
    network = Network(Path())
    source = network.follow(shader.GetInput(name).GetAttr())
    assert isinstance(source, Source), "an expression's input is of a node"
    return source.shader.CreateInput(inside[0], kind).GetAttr()


def _set(attribute: Usd.Attribute, value: tuple[float, ...]) -> None:
    if attribute.HasAuthoredConnections():
        clear_input(attribute)
    given: Any = value[0] if len(value) == 1 else Gf.Vec3f(*value)
    root = attribute.GetStage().GetRootLayer()
    for spec in attribute.GetPropertyStack() if is_set(attribute) else ():
        if spec.layer == root and spec.HasDefaultValue():
            spec.default = given
            return
    attribute.Set(given)


def _anchor(layer_file: Path, before: Path, after: Path) -> None:
    """Rewrite relative paths of a layer for another folder."""
    layer = Sdf.Layer.FindOrOpen(str(layer_file))

    def moved(path: str) -> str:
        if not path or Path(path).is_absolute() or "://" in path or (path[0] != "." and not (before / path).exists()):
            return path
        return relative_path(before / path, after)

    UsdUtils.ModifyAssetPaths(layer, moved)
    layer.Save()
