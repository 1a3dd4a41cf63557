"""Edits in a look's file: the order, names, switches and modes of its layers, and the selected variant.

Names of layers, `prim` and `variants` are as in `lookdev.material.library.edit`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pxr import Sdf, Usd

from lookdev.brdf import Mode
from lookdev.errors import LookError, nearest_hint
from lookdev.material.library.constants import set_constant
from lookdev.material.library.edit import edit_material
from lookdev.material.library.nodes import find_sites, is_defined, layer_paths, moved_path
from lookdev.material.library.stack import LAYER_PARTS, layer_shader, require_stack
from lookdev.material.usd import VariantChoice, variant_sets

_TYPES = Sdf.ValueTypeNames


def move_layer(file: Path, layer: str, to: int, prim: str | None = None, variants: VariantChoice = None) -> None:
    """Give a layer the number `to`, and renumber the layers between the old and the new number, in every variant.

    Number 1 is the layer directly over the base. The base itself cannot be moved.
    """
    with edit_material(file, prim, variants) as material:
        stack = require_stack(material)
        number, name = stack.find(layer)
        if to not in stack.layers:
            hint = f"a number from 1 to {max(stack.layers)} would be right; the base stays beneath"
            raise stack.make_error(f"'{name}' cannot be layer {to}", hint)
        step = 1 if to < number else -1
        # The new number of each layer whose number changes, by its old number.
        order = {number: to} | {other: other + step for other in range(min(number, to), max(number, to) + 1)}
        order[number] = to
        attributes = [stack.attribute(other, part) for other in order for part in LAYER_PARTS]
        if not all(stack.is_in_file(attribute) for attribute in attributes if attribute):
            raise stack.make_error("another file or a variant states its layers", "move them there")
        stack.renumber(order)


def rename_layer(file: Path, layer: str, name: str, prim: str | None = None, variants: VariantChoice = None) -> None:
    """Rename the shader of a layer, which is the layer's name, and update connections to it."""
    with edit_material(file, prim, variants) as material:
        path = layer_shader(material, layer)[1].GetPath()
        root, new = material.GetPrim().GetStage().GetRootLayer(), path.ReplaceName(name) if _is_name(name) else path
        if not _is_name(name):
            hint = "letters, digits and '_', not a digit first"
            raise LookError.at(file, path, f"'{name}' cannot be the name of a layer", hint)
        used_paths = {path.StripAllVariantSelections() for path in layer_paths(root)}
        if new != path and (new in used_paths or material.GetPrim().GetStage().GetPrimAtPath(new)):
            raise LookError.at(file, path, f"'{name}' is there already", "choose another name")
        if not is_defined(root, find_sites(root, path)):
            raise LookError.at(file, path, "is defined by another file", "rename it there")
        for site in find_sites(root, path):
            edit = Sdf.BatchNamespaceEdit()
            edit.Add(site, site.ReplaceName(name), Sdf.NamespaceEdit.same)
            root.Apply(edit)
        redirect_connections(root, {path: new})


def redirect_connections(
    layer: Sdf.Layer, new_paths: Mapping[Sdf.Path, Sdf.Path], within: Sdf.Path = Sdf.Path.absoluteRootPath
) -> None:
    """Redirect connections to moved prims to their new paths, for all inputs at or below `within` in a USD layer.

    `new_paths` maps the old paths of the prims to the new ones.
    """
    for path in layer_paths(layer):
        spec = layer.GetPropertyAtPath(path) if path.IsPropertyPath() and path.HasPrefix(within) else None
        if not isinstance(spec, Sdf.AttributeSpec):
            continue
        for target in spec.connectionPathList.GetAddedOrExplicitItems():
            absolute = target.MakeAbsolutePath(path.GetPrimPath()).StripAllVariantSelections()
            if (moved := moved_path(absolute, new_paths)) is not None:
                spec.connectionPathList.ReplaceItemEdits(target, moved)


def enable_layer(
    file: Path, layer: str, enabled: bool, prim: str | None = None, variants: VariantChoice = None
) -> None:
    """Switch a layer over the base on or off.

    The switch is changed at the file's strongest opinion, even inside a variant; see `set_constant`.
    """
    with edit_material(file, prim, variants) as material:
        stack = require_stack(material)
        set_constant(stack.create_input(stack.find(layer)[0], "Enabled", _TYPES.Bool), enabled)


def set_mode(file: Path, layer: str, mode: Mode, prim: str | None = None, variants: VariantChoice = None) -> None:
    """Set the mode of a layer over the base: ``"over"`` or ``"transmit"``; see `lookdev.material.Layer`."""
    with edit_material(file, prim, variants) as material:
        stack = require_stack(material)
        set_constant(stack.create_input(stack.find(layer)[0], "Mode", _TYPES.Token), mode)


def select_variant(file: Path, name: str, choice: str, prim: str | None = None) -> None:
    """Select the variant `choice` of the set `name`, at the material or a prim above it, in the file itself."""
    with edit_material(file, prim) as material:
        stage = material.GetPrim().GetStage()
        sets = variant_sets(stage, material.GetPath())
        if name not in sets or choice not in sets[name].GetVariantNames():
            choices = [] if name not in sets else sets[name].GetVariantNames()
            hint = nearest_hint(choice if choices else name, choices or sorted(sets)) if sets else "it has none"
            raise LookError.at(file, material.GetPath(), f"has no variant {name}={choice}", hint)
        with Usd.EditContext(stage, stage.GetRootLayer()):
            sets[name].SetVariantSelection(choice)


def _is_name(name: str) -> bool:
    """Return whether a text can be the name of a prim."""
    return bool(Sdf.Path.IsValidIdentifier(name))
