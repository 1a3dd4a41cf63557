"""From a look to the inputs of one BRDF: constants fold, textures and primvars become symbols."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lookdev.brdf import LOBES, PARAMETERS, Lobe, Parameter, complete_parameters
from lookdev.brdf.layering import blend_parameters
from lookdev.brdf.vectors import scale
from lookdev.codegen.graph import Graph
from lookdev.codegen.source import AttributeBinding, TextureBinding
from lookdev.codegen.symbolic import symbols
from lookdev.errors import CodegenError
from lookdev.material import Layer, Look, Primvar, Texture

_CHANNEL = {"r": 0, "g": 1, "b": 2, "a": 3}


@dataclass
class Inputs:
    """What a shader reads at a point: symbol to the code that defines it, and what that code must be given.

    One texture read twice with the same addressing is one look-up. `resolve` turns a texture into its linear EXR.
    """

    graph: Graph
    resolve: Callable[[Texture], Path]
    code: dict[str, str] = field(default_factory=dict)
    textures: dict[str, TextureBinding] = field(default_factory=dict)
    attributes: dict[str, AttributeBinding] = field(default_factory=dict)
    _lookups: dict[Any, str] = field(default_factory=dict)
    _sources: dict[str, tuple[str, ...]] = field(default_factory=dict)
    _uv_of: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def read_by(self, symbols: Iterable[str]) -> tuple[list[str], list[AttributeBinding]]:
        """Return the textures, and the attributes, without which these symbols have no value."""
        needed = {source for symbol in symbols for source in self._sources[symbol]}
        return (
            [name for name in self.textures if name in needed],
            [binding for name, binding in self.attributes.items() if name in needed],
        )

    def value(self, source: float | tuple[float, ...] | Texture | Primvar, parameter: Parameter) -> Any:
        """Return the array of one input, clipped to the hard range where it is only known at run time."""
        if isinstance(source, Texture):
            value = self._texture(source)
        elif isinstance(source, Primvar):
            value = self._primvar(source, parameter)
        else:
            return np.asarray(source, dtype=np.float64)
        if parameter.kind == "color" and value.shape == ():
            value = scale(np.ones(3), value)
        return np.clip(value, *parameter.hard)

    def _texture(self, texture: Texture) -> Any:
        address = (
            texture.file, texture.colorspace, texture.wrap_s, texture.wrap_t, texture.st, texture.transform
        )  # fmt: skip
        name = self._lookups.get(address)
        if name is None:
            name = self._lookups[address] = f"texture{len(self._lookups)}"
            uv = self._attribute(f"uv_{texture.st}", texture.st, "uv", None)
            self._uv_of[name] = (uv,)
            self.textures[name] = TextureBinding(f"{name}_file", self.resolve(texture))
            m = [repr(float(x)) for x in texture.transform]
            self.code[name] = (
                f"float {name}_a; color {name} = lookdev_texture({name}_file, "
                f"{m[0]} * {uv}[0] + {m[1]} * {uv}[1] + {m[2]}, {m[3]} * {uv}[0] + {m[4]} * {uv}[1] + {m[5]}, "
                f'"{_OSL_WRAP[texture.wrap_s]}", "{_OSL_WRAP[texture.wrap_t]}", {name}_a);'
            )
        if texture.channel == "rgb":
            raw = self._symbols(name, [f"{name}[{i}]" for i in range(3)])
            return raw * np.array(texture.scale[:3]) + np.array(texture.bias[:3])
        index = _CHANNEL[texture.channel]
        raw = self._symbols(name, [f"{name}_a" if index == 3 else f"{name}[{index}]"])[0]
        return raw * texture.scale[index] + texture.bias[index]

    def _primvar(self, primvar: Primvar, parameter: Parameter) -> Any:
        if isinstance(primvar.fallback, tuple):
            name = self._attribute(f"primvar_{primvar.name}", primvar.name, "color", primvar.fallback)
            return self._symbols(name, [f"{name}[{i}]" for i in range(3)])
        name = self._attribute(f"primvar_{primvar.name}", primvar.name, "float", (float(primvar.fallback),))
        return self._symbols(name, [name])[0]

    def _symbols(self, source: str, names: list[str]) -> Any:
        """Return symbols and remember which look-up or attribute gives them their value."""
        needs = (source, *self._uv_of.get(source, ()))
        self._sources.update(dict.fromkeys(names, needs))
        return symbols(self.graph, names)

    def _attribute(self, wanted: str, attribute: str, kind: Any, fallback: tuple[float, ...] | None) -> str:
        # USD names may hold ':' and '.', which OSL identifiers may not.
        name = "".join(character if character.isalnum() else "_" for character in wanted)
        binding = AttributeBinding(name, attribute, kind, fallback)
        if self.attributes.setdefault(name, binding) != binding:
            raise CodegenError(
                f"'{attribute}' is read both as {self.attributes[name].kind} and as {kind}, or with two fallbacks"
            )
        return name


_OSL_WRAP = {"black": "black", "clamp": "clamp", "repeat": "periodic", "mirror": "mirror"}
_MASK = Parameter("mask", "float", 1.0)


def look_lobes(look: Look, inputs: Inputs) -> tuple[Lobe, ...]:
    """Blend the layers of a look into one parameter set and build its lobes.

    Raises
    ------
    ModelError
        A constant is outside its hard range, or layers disagree on a token.
    CodegenError
        Layers of different models.
    """
    models = {layer.model for layer in look.layers}
    if len(models) != 1:
        raise CodegenError(f"look '{look.name}' mixes the models {', '.join(sorted(models))}; one would be right")
    (model,) = models
    below = _layer_parameters(look.layers[0], inputs)
    for layer in look.layers[1:]:
        mask = inputs.value(layer.mask, _MASK)
        below = blend_parameters(PARAMETERS[model], below, _layer_parameters(layer, inputs), mask)
    return LOBES[model](below)


def _layer_parameters(layer: Layer, inputs: Inputs) -> dict[str, Any]:
    varying = {name: value for name, value in layer.inputs.items() if isinstance(value, Texture | Primvar)}
    constant = {name: value for name, value in layer.inputs.items() if name not in varying}
    parameters = complete_parameters(layer.model, constant)
    for name, source in varying.items():
        parameters[name] = inputs.value(source, PARAMETERS[layer.model][name])
    return parameters
