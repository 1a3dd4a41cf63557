"""What gives a parameter of a layer its value: an image, a primvar, an expression, or the model's default again."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pxr import Usd, UsdShade

from lookdev.brdf import MODELS, Parameter, layer_shaders
from lookdev.errors import Fault, LookError, ModelError, nearest_hint
from lookdev.material.expression import Kind
from lookdev.material.library.edit import INPUT_TYPES, edited, replace_source
from lookdev.material.library.masks import Mask
from lookdev.material.library.nodes import sites
from lookdev.material.library.stack import layer_shader
from lookdev.material.usd.network import is_set, shader_id


def set_source(
    file: Path,
    layer: str,
    name: str,
    source: Mask,
    prim: str | None = None,
    variants: Mapping[str, str] | None = None,
) -> None:
    """Give a parameter of a layer an image, a primvar or an expression; its nodes lie beside the layer's shader.

    Nodes that only the old source used are removed. Names of an expression without a new source keep the one that they
    have in the old expression. A ModelError reports a parameter that can have no source.
    """
    with edited(file, prim, variants) as material:
        shader, parameter = _parameter(material, layer, name)
        if parameter.kind not in ("float", "color"):
            raise ModelError(f"{name} is a {parameter.kind}: only numbers and colours get a source here")
        attribute = shader.CreateInput(name, INPUT_TYPES[parameter.kind]).GetAttr()
        path = shader.GetPath()
        called = f"{path.name}{name[:1].upper()}{name[1:]}"
        kind: Kind = "color" if parameter.kind == "color" else "float"
        replace_source(material, attribute, path.GetParentPath(), called, source, kind)


def unset_parameter(
    file: Path, layer: str, name: str, prim: str | None = None, variants: Mapping[str, str] | None = None
) -> None:
    """Take back what a look states of a parameter of a layer, in every variant: it has the model's default.

    What another file states, as a preset, is blocked. Nodes that only it used are removed.
    """
    with edited(file, prim, variants) as material:
        shader, _ = _parameter(material, layer, name)
        attribute = shader.GetPrim().GetAttribute(f"inputs:{name}")
        if not attribute or not is_set(attribute):
            raise LookError([Fault(str(file), str(shader.GetPath()), f"does not state '{name}'")])
        replace_source(material, attribute, shader.GetPath().GetParentPath(), "", None)
        _remove(shader.GetPrim(), f"inputs:{name}")
        left = shader.GetPrim().GetAttribute(f"inputs:{name}")
        if left and left.HasAuthoredConnections():
            left.SetConnections([])
        if left and left.HasAuthoredValue():
            left.Block()


def _remove(prim: Usd.Prim, name: str) -> None:
    """Remove a property from the edited file, inside variants too."""
    root = prim.GetStage().GetRootLayer()
    for site in sites(root, prim.GetPath()):
        spec = root.GetPrimAtPath(site)
        if name in spec.properties:
            spec.RemoveProperty(spec.properties[name])


def _parameter(material: UsdShade.Material, layer: str, name: str) -> tuple[UsdShade.Shader, Parameter]:
    _, shader = layer_shader(material, layer)
    model = MODELS.get(layer_shaders().get(shader_id(shader), ""))
    if model is None or name not in model.parameters:
        known = list(model.parameters) if model else []
        raise ModelError(
            f"'{name}' is no parameter of layer {layer} ({nearest_hint(name, known) if known else 'none'})"
        )
    return shader, model.parameters[name]
