"""Arranging the layers of a look: their order, names, switches and modes, and the variant that its file shows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pxr import Sdf, Usd

from lookdev.brdf import Mode
from lookdev.errors import Fault, LookError, nearest_hint
from lookdev.material.library.constants import set_constant
from lookdev.material.library.edit import edited
from lookdev.material.library.nodes import layer_paths, sites
from lookdev.material.library.stack import layer_shader, stack_of
from lookdev.material.usd import variant_sets

_TYPES = Sdf.ValueTypeNames
_PARTS = ("", "Mask", "Enabled", "Mode")

Variants = Mapping[str, str] | None


def move_layer(file: Path, layer: str, to: int, prim: str | None = None, variants: Variants = None) -> None:
    """Give a layer over the base another number, from 1; those between are renumbered, in every variant."""
    with edited(file, prim, variants) as material:
        stack = stack_of(material)
        number, name = stack.find(layer)
        if to not in stack.layers:
            what = f"'{name}' cannot be layer {to}"
            raise stack.fault(what, f"a number from 1 to {max(stack.layers)} would be right; the base stays beneath")
        step = 1 if to < number else -1
        order = {number: to} | {each: each + step for each in range(min(number, to), max(number, to) + 1)}
        order[number] = to
        own = [stack.prim.GetAttribute(stack.input_name(each, part)) for each in order for part in _PARTS]
        if not all(stack.is_own(attribute) for attribute in own if attribute):
            raise stack.fault("another file or a variant states its layers", "move them there")
        stack.renumber(order)


def rename_layer(file: Path, layer: str, name: str, prim: str | None = None, variants: Variants = None) -> None:
    """Rename the shader of a layer, and what is connected to it."""
    with edited(file, prim, variants) as material:
        path = layer_shader(material, layer)[1].GetPath()
        root, new = material.GetPrim().GetStage().GetRootLayer(), path.ReplaceName(name) if _is_name(name) else path
        if not _is_name(name):
            hint = "letters, digits and '_', not a digit first"
            raise LookError([Fault(str(file), str(path), f"'{name}' cannot be the name of a layer", hint)])
        taken = {each.StripAllVariantSelections() for each in layer_paths(root)}
        if new != path and (new in taken or material.GetPrim().GetStage().GetPrimAtPath(new)):
            raise LookError([Fault(str(file), str(path), f"'{name}' is there already", "choose another name")])
        if not any(root.GetPrimAtPath(site).specifier == Sdf.SpecifierDef for site in sites(root, path)):
            raise LookError([Fault(str(file), str(path), "is defined by another file", "rename it there")])
        for site in sites(root, path):
            edit = Sdf.BatchNamespaceEdit()
            edit.Add(site, site.ReplaceName(name), Sdf.NamespaceEdit.same)
            root.Apply(edit)
        redirect(root, {path: new})


def redirect(
    layer: Sdf.Layer, moved: Mapping[Sdf.Path, Sdf.Path], within: Sdf.Path = Sdf.Path.absoluteRootPath
) -> None:
    """Connect what is at or below `within` in a layer to the new paths of prims that have moved."""
    for path in layer_paths(layer):
        spec = layer.GetPropertyAtPath(path) if path.IsPropertyPath() and path.HasPrefix(within) else None
        if not isinstance(spec, Sdf.AttributeSpec):
            continue
        for target in spec.connectionPathList.GetAddedOrExplicitItems():
            whole = target.MakeAbsolutePath(path.GetPrimPath()).StripAllVariantSelections()
            old = next((each for each in moved if whole.GetPrimPath().HasPrefix(each)), None)
            if old is not None:
                spec.connectionPathList.ReplaceItemEdits(target, whole.ReplacePrefix(old, moved[old]))


def enable_layer(file: Path, layer: str, enabled: bool, prim: str | None = None, variants: Variants = None) -> None:
    """Switch a layer over the base on or off, where the file says so, also in a variant."""
    with edited(file, prim, variants) as material:
        stack = stack_of(material)
        set_constant(stack.input(stack.find(layer)[0], "Enabled", _TYPES.Bool), enabled)


def set_mode(file: Path, layer: str, mode: Mode, prim: str | None = None, variants: Variants = None) -> None:
    """Lay a layer over those beneath, or let what it transmits meet them."""
    with edited(file, prim, variants) as material:
        stack = stack_of(material)
        set_constant(stack.input(stack.find(layer)[0], "Mode", _TYPES.Token), mode)


def select_variant(file: Path, name: str, choice: str, prim: str | None = None) -> None:
    """Write the variant of a set, at or above the material, that the file itself selects."""
    with edited(file, prim) as material:
        stage = material.GetPrim().GetStage()
        known = variant_sets(stage, material.GetPath())
        if name not in known or choice not in known[name].GetVariantNames():
            choices = [] if name not in known else known[name].GetVariantNames()
            hint = nearest_hint(choice if choices else name, choices or sorted(known)) if known else "it has none"
            raise LookError([Fault(str(file), str(material.GetPath()), f"has no variant {name}={choice}", hint)])
        with Usd.EditContext(stage, stage.GetRootLayer()):
            known[name].SetVariantSelection(choice)


def _is_name(name: str) -> bool:
    return bool(Sdf.Path.IsValidIdentifier(name))
