"""Finds elements of a look without effect: layers that are disabled or hidden, and nodes that nothing reads."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from pxr import Sdf, Usd, UsdShade

from lookdev.material.library.nodes import find_upstream
from lookdev.material.look import Layer
from lookdev.material.usd.network import LAYER_INPUT, Network, is_set, shader_id
from lookdev.material.values import presence


class Unused(NamedTuple):
    """A prim or property without effect."""

    where: str
    what: str
    hint: str = ""


class LayerInputs:
    """The layer inputs of a material's LookdevLayers; empty where the material has no such shader.

    `disabled` has the inputs that disable layers.
    """

    def __init__(self, file: Path, material: UsdShade.Material) -> None:
        network = Network(file)  # its faults are reported by the reader of the look
        source = network.surface_source(material)
        self._inputs: dict[str, Usd.Attribute] = {}
        if source and shader_id(source.shader) == "LookdevLayers":
            attributes = (shader_input.GetAttr() for shader_input in source.shader.GetInputs())
            self._inputs = {attribute.GetBaseName(): attribute for attribute in attributes if is_set(attribute)}
        matches = filter(None, map(LAYER_INPUT.fullmatch, self._inputs))
        names = [f"layer{number}" for number in sorted(int(match[1]) for match in matches if not match[2])]
        disabled = [name for name in names if self._is_disabled(network, f"{name}Enabled")]
        self.disabled = [self._inputs[f"{name}Enabled"] for name in disabled]
        self._enabled = [name for name in ("base", *names) if name in self._inputs and name not in disabled]

    def _is_disabled(self, network: Network, name: str) -> bool:
        return name in self._inputs and network.read_constant(self._inputs[name], Sdf.ValueTypeNames.Bool) is False

    def notes(self, layers: Sequence[Layer]) -> Iterator[Unused]:
        """Yield the layers that are never visible, and those that hide all beneath; `layers` are the enabled layers."""
        for attribute in self.disabled:
            yield Unused(str(attribute.GetPath()), "the layer is not enabled")
        covers = [number for number, layer in enumerate(layers) if number and _is_everywhere(layer)]
        if len(layers) != len(self._enabled):  # a single layer, or a stack with faults
            return
        for number, (name, layer) in enumerate(zip(self._enabled, layers, strict=True)):
            where = str(self._inputs[name].GetPath())
            if layer.mask == 0.0:
                yield Unused(f"{where}Mask", "the layer never shows: its mask is 0")
            elif presence(layer) == 0.0:
                yield Unused(where, f"the layer never shows: the presence of {layer.name} is 0")
            elif covers and covers[-1] > number:
                message = f"the layer never shows: {layers[covers[-1]].name} covers it wholly"
                yield Unused(where, message, "give the layer that covers it a mask")
            if number in covers and f"{name}Mask" not in self._inputs:
                yield Unused(f"{where}Mask", "the mask is not connected, so the layer covers all beneath")


def unread_shaders(material: Usd.Prim) -> Iterator[Unused]:
    """Yield the shaders of a material that none of its outputs depends on."""
    outputs = [output.GetAttr() for output in UsdShade.Material(material).GetOutputs()]
    read_paths = find_upstream(UsdShade.Material(material), outputs)
    for prim in Usd.PrimRange(material):
        if prim.IsA(UsdShade.Shader) and prim.GetPath() not in read_paths:
            node = shader_id(UsdShade.Shader(prim)) or "a shader"
            yield Unused(str(prim.GetPath()), f"{node} that nothing reads", "connect it, or remove it")


def _is_everywhere(layer: Layer) -> bool:
    return layer.mode == "over" and layer.mask == 1.0 and presence(layer) == 1.0
