"""Finds elements of a look without effect: layers that are disabled or hidden, and nodes that nothing reads."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeAlias

from pxr import Usd, UsdShade

from lookdev.material.library.nodes import find_upstream
from lookdev.material.library.stack import Stack
from lookdev.material.look import Layer
from lookdev.material.usd.network import is_set, shader_id
from lookdev.material.values import presence

Unused: TypeAlias = tuple[str, str, str]
"""A prim or property without effect: its path, what is wrong, and what would be right or ""."""


def disabled_switches(stack: Stack) -> list[Usd.Attribute]:
    """Return the inputs that disable layers."""
    return [stack.attribute(number, "Enabled") for number in stack.layers if not stack.is_enabled(number)]


def unseen_layers(stack: Stack, layers: Sequence[Layer]) -> Iterator[Unused]:
    """Yield the layers that are never visible, and those that hide all beneath; `layers` are the enabled layers."""
    for attribute in disabled_switches(stack):
        yield str(attribute.GetPath()), "the layer is not enabled", ""
    covers = [index for index, layer in enumerate(layers) if index and _is_everywhere(layer)]
    numbers = [number for number in (0, *stack.layers) if stack.is_enabled(number)]
    if len(layers) != len(numbers):  # a stack with faults
        return
    for index, (number, layer) in enumerate(zip(numbers, layers, strict=True)):
        where, mask = f"{stack.prim.GetPath()}.{stack.input_name(number, '')}", stack.attribute(number, "Mask")
        if layer.mask == 0.0:
            yield f"{where}Mask", "the layer never shows: its mask is 0", ""
        elif presence(layer) == 0.0:
            yield where, f"the layer never shows: the presence of {layer.name} is 0", ""
        elif covers and covers[-1] > index:
            message = f"the layer never shows: {layers[covers[-1]].name} covers it wholly"
            yield where, message, "give the layer that covers it a mask"
        if index in covers and not (mask and is_set(mask)):
            yield f"{where}Mask", "the mask is not connected, so the layer covers all beneath", ""


def unread_shaders(material: Usd.Prim) -> Iterator[Unused]:
    """Yield the shaders of a material that none of its outputs depends on."""
    outputs = [output.GetAttr() for output in UsdShade.Material(material).GetOutputs()]
    read_paths = find_upstream(UsdShade.Material(material), outputs)
    for prim in Usd.PrimRange(material):
        if prim.IsA(UsdShade.Shader) and prim.GetPath() not in read_paths:
            node = shader_id(UsdShade.Shader(prim)) or "a shader"
            yield str(prim.GetPath()), f"{node} that nothing reads", "connect it, or remove it"


def _is_everywhere(layer: Layer) -> bool:
    return layer.mode == "over" and layer.mask == 1.0 and presence(layer) == 1.0
