"""Edits of constants of a look, in its file or in a copy of it.

A constant is changed where the file states it most strongly, even inside a variant. USD calls such a statement an
*opinion*.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdShade, UsdUtils

from lookdev.brdf import MODELS, layer_shaders
from lookdev.brdf.parameters import ParameterValue
from lookdev.cache import atomic_path
from lookdev.errors import LookError, nearest_hint
from lookdev.material.change import Constant, replace_constants
from lookdev.material.library.edit import INPUT_TYPES, check_suffix, edit_material, report_faults_for
from lookdev.material.library.nodes import clear_input, relative_path
from lookdev.material.library.stack import enabled_layers
from lookdev.material.usd import VariantChoice, open_material, read_look
from lookdev.material.usd.network import Network, OutputSource, shader_id
from lookdev.stage import usd_errors_as_faults


def set_inputs(
    file: Path,
    values: Mapping[tuple[int, str], ParameterValue],
    prim: str | None = None,
    variants: VariantChoice = None,
) -> None:
    """Set constants of the layers of a look in its file.

    The keys of `values` are pairs: the index of a layer in the look, base first, and the name of an input. An input is
    a parameter, ``"mask"``, or an input of an expression, such as ``"mask.dirt"``. An opinion of the file itself is
    changed in place, also in a variant. An input that only another file states gets an override in this file.
    `variants` selects the variants in which the material is composed.
    """
    with edit_material(file, prim, variants) as material:
        for (number, name), value in values.items():
            set_constant(_constant_attribute(material, number, name.split("."), value), value)


def write_changed(
    file: Path, out: Path, constants: Sequence[Constant], prim: str | None = None, variants: VariantChoice = None
) -> None:
    """Write the USD layer of a look to the file `out`, with the values of `constants`. Relative paths stay valid.

    A constant is changed at the file's strongest opinion, also in a variant. It gets an override if another file states
    it, or if it comes from an interface input that other inputs share. `out` is replaced in one step.

    Raises
    ------
    LookError
        The file is not a look of layers in USD, or another input has the same source as a constant.
    """
    check_suffix(out)
    look = read_look(file, prim, variants)
    # USD stores float32. The values that are read back from the copy are therefore compared with rounded ones.
    rounded = [replace(constant, value=tuple(float(np.float32(x)) for x in constant.value)) for constant in constants]
    target = replace_constants(look, rounded)
    with atomic_path(out) as temporary, report_faults_for(out, temporary):
        # The first try sets the interface inputs that state constants. If this also changes other inputs, which are
        # connected to the same interface inputs, the second try overrides the connections of the constants.
        for by_interface in (True, False):
            _copy_layer(file, temporary, out)
            with open_material(temporary, prim, variants) as material:
                path = material.GetPath()
                for constant in constants:
                    attribute = _constant_attribute(material, constant.layer, constant.path, constant.value)
                    set_constant(attribute, constant.value, by_interface=by_interface)
                material.GetPrim().GetStage().GetRootLayer().Save()
            if read_look(temporary, str(path), variants).layers == target.layers:
                return
        names = ", ".join(constant.name for constant in constants)
        message = f"{names}: another input of the look has the same source, or a stronger layer sets it"
        raise LookError.at(file, path, message, "give each input a value of its own")


def _copy_layer(file: Path, temporary: Path, out: Path) -> None:
    """Write the USD layer of a file to `temporary`, in the format of its suffix, with paths relative to `out`."""
    with usd_errors_as_faults(file):
        layer = Sdf.Layer.FindOrOpen(str(file))
        if layer is None or not layer.Export(str(temporary)):
            raise LookError.at(file, "", "cannot be copied as a look in USD")
    before, after = file.resolve().parent, out.resolve().parent
    if before != after:
        _reanchor_paths(temporary, before, after)


def check_writable(file: Path, prim: str | None = None, variants: VariantChoice = None) -> None:
    """Raise LookError where `file` is not a look of layers in USD, so that `write_changed` could not write it."""
    check_suffix(file)
    with open_material(file, prim, variants) as material:
        enabled_layers(material)


def _constant_attribute(material: UsdShade.Material, layer: int, path: Sequence[str], value: object) -> Usd.Attribute:
    """Return the attribute of a constant, created if missing; `layer` and `path` are as in `Constant`."""
    shader, stack, mask = enabled_layers(material)[layer]
    name, *inside = path
    if name == "mask":
        attribute = stack.CreateInput(mask, Sdf.ValueTypeNames.Float).GetAttr()
    else:
        kind = MODELS[layer_shaders()[shader_id(shader)]].parameters[name].kind
        attribute = shader.CreateInput(name, INPUT_TYPES[kind]).GetAttr()
    if not inside:
        return attribute
    # This network only follows connections. Its file needs no name: this would only appear in faults.
    source = Network(Path()).follow(attribute)
    node_inputs = source.shader.GetInputs() if isinstance(source, OutputSource) else []
    names = [node_input.GetBaseName() for node_input in node_inputs]
    if not isinstance(source, OutputSource) or inside[0] not in names:
        where = str(attribute.GetPath())
        message = f"no expression with an input '{inside[0]}' has its value"
        file = attribute.GetStage().GetRootLayer().realPath
        raise LookError.at(file, where, message, nearest_hint(inside[0], names) if names else "")
    kind = INPUT_TYPES["color" if isinstance(value, tuple) and len(value) == 3 else "float"]
    return source.shader.CreateInput(inside[0], kind).GetAttr()


def set_constant(attribute: Usd.Attribute, value: object, *, by_interface: bool = True) -> None:
    """Set a constant at the strongest opinion of the edited file, or add an opinion where the file has none.

    An attribute may be connected to an interface input of the material. With `by_interface`, the interface input is
    set. Without it, the connection is removed. Raises LookError where `by_interface` is set and a node computes the
    attribute.
    """
    # `Constant.value` of a float is a tuple of one number.
    usd_value = Gf.Vec3f(*map(float, value)) if isinstance(value, tuple) and len(value) == 3 else value
    usd_value = float(usd_value[0]) if isinstance(usd_value, tuple) else usd_value
    network = Network(Path(attribute.GetStage().GetRootLayer().realPath))
    holder = network.follow(attribute) if by_interface else None
    if isinstance(holder, OutputSource):
        where, hint = str(attribute.GetPath()), "a texture or an expression has its value"
        raise LookError.at(network.file, where, "is connected", hint)
    target = holder or attribute
    if target.HasAuthoredConnections():
        clear_input(target)
    root = target.GetStage().GetRootLayer()
    for spec in target.GetPropertyStack(Usd.TimeCode.Default()):
        if spec.layer == root and spec.HasDefaultValue():
            spec.default = usd_value
            return
    target.Set(usd_value)


def _reanchor_paths(layer_file: Path, before: Path, after: Path) -> None:
    """Rewrite the paths in a USD layer that are relative to the folder `before` as relative to the folder `after`."""
    layer = Sdf.Layer.FindOrOpen(str(layer_file))

    def reanchor_path(path: str) -> str:
        # A path without ./ that does not exist comes from USD's search path, and stays.
        if not path or Path(path).is_absolute() or "://" in path or (path[0] != "." and not (before / path).exists()):
            return path
        return relative_path(before / path, after)

    UsdUtils.ModifyAssetPaths(layer, reanchor_path)
    layer.Save()
