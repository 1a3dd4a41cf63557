"""Edits in a look's file: set a parameter of a layer to an image, a primvar or an expression, or to its default.

Names of layers, `prim` and `variants` are as in `lookdev.material.library.edit`.
"""

from __future__ import annotations

from pathlib import Path

from pxr import Usd, UsdShade

from lookdev.brdf import MODELS, Parameter, layer_shaders
from lookdev.errors import LookError, ModelError, nearest_hint
from lookdev.material.expression import ExpressionKind
from lookdev.material.library.edit import INPUT_TYPES, edit_material, replace_source
from lookdev.material.library.masks import MaskSource
from lookdev.material.library.nodes import find_sites
from lookdev.material.library.stack import layer_shader
from lookdev.material.usd import VariantChoice
from lookdev.material.usd.network import is_authored, shader_id


def set_source(
    file: Path, layer: str, name: str, source: MaskSource, prim: str | None = None, variants: VariantChoice = None
) -> None:
    """Set the source of the parameter `name` of a layer, and write its nodes beside the layer's shader.

    Nodes that only the old source used are removed. If `source` is an expression and states nothing for one of its
    inputs, this input keeps its source from the old expression. Raises ModelError for a parameter that cannot have a
    source.
    """
    with edit_material(file, prim, variants) as material:
        shader, parameter = _find_parameter(material, layer, name)
        if parameter.kind not in ("float", "color"):
            raise ModelError(f"{name} is a {parameter.kind}: only numbers and colours get a source here")
        attribute = shader.CreateInput(name, INPUT_TYPES[parameter.kind]).GetAttr()
        path = shader.GetPath()
        node_name = f"{path.name}{name[:1].upper()}{name[1:]}"
        kind: ExpressionKind = "color" if parameter.kind == "color" else "float"
        replace_source(material, attribute, path.GetParentPath(), node_name, source, kind)


def unset_parameter(file: Path, layer: str, name: str, prim: str | None = None, variants: VariantChoice = None) -> None:
    """Reset a parameter of a layer to the model's default, in every variant.

    Values and connections from other files, such as presets, are blocked. Nodes that only the parameter used are
    removed.
    """
    with edit_material(file, prim, variants) as material:
        shader, _ = _find_parameter(material, layer, name)
        attribute = shader.GetPrim().GetAttribute(f"inputs:{name}")
        if not attribute or not is_authored(attribute):
            raise LookError.at(file, shader.GetPath(), f"does not state '{name}'")
        replace_source(material, attribute, shader.GetPath().GetParentPath(), "", None)
        _remove_property(shader.GetPrim(), f"inputs:{name}")
        # The attribute still exists if another file states it, too.
        remaining = shader.GetPrim().GetAttribute(f"inputs:{name}")
        if remaining and remaining.HasAuthoredConnections():
            remaining.SetConnections([])
        if remaining and remaining.HasAuthoredValue():
            remaining.Block()


def _remove_property(prim: Usd.Prim, name: str) -> None:
    """Remove a property of a prim from the edited file, also inside variants."""
    root = prim.GetStage().GetRootLayer()
    for site in find_sites(root, prim.GetPath()):
        spec = root.GetPrimAtPath(site)
        if name in spec.properties:
            spec.RemoveProperty(spec.properties[name])


def _find_parameter(material: UsdShade.Material, layer: str, name: str) -> tuple[UsdShade.Shader, Parameter]:
    """Return the shader of a layer and the record of one of its parameters; ModelError for an unknown name."""
    _, shader = layer_shader(material, layer)
    model = MODELS.get(layer_shaders().get(shader_id(shader), ""))
    if model is None or name not in model.parameters:
        valid_names = list(model.parameters) if model else []
        hint = nearest_hint(name, valid_names) if valid_names else "none"
        raise ModelError(f"'{name}' is not a parameter of layer {layer} ({hint})")
    return shader, model.parameters[name]
