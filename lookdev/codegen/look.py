"""From a look to one BSDF: constants fold, textures and primvars become symbols."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lookdev.brdf import PARAMETERS, Bsdf, Parameter, StackLayer, complete_parameters, stack_bsdf
from lookdev.brdf.vectors import scale
from lookdev.codegen.graph import Graph
from lookdev.codegen.source import HANDEDNESS, AttributeBinding, TextureBinding
from lookdev.codegen.symbolic import symbol
from lookdev.errors import CodegenError
from lookdev.material import Bump, Layer, Look, Primvar, Texture

_CHANNEL = {"r": 0, "g": 1, "b": 2, "a": 3}


@dataclass
class Inputs:
    """What a shader reads at a point: symbol to the code that defines it, and what that code must be given.

    One texture read twice with the same addressing is one look-up. `resolve` turns a texture into its linear EXR, a
    height map into that of its slopes.
    """

    graph: Graph
    resolve: Callable[[Texture | Bump], Path]
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

    def value(self, source: Any, parameter: Parameter) -> Any:
        """Return the array of one input: a constant, or what is known only at run time, clipped to the hard range."""
        if isinstance(source, Bump):
            return self._handed(self._bump(source))
        if isinstance(source, Texture):
            value = self._texture(source)
        elif isinstance(source, Primvar):
            value = self._primvar(source, parameter)
        else:
            value = np.asarray(source, dtype=np.float64)
            return self._handed(value) if parameter.kind == "normal" and value[1] else value
        if parameter.kind == "color" and value.shape == ():
            value = scale(np.ones(3), value)
        value = np.clip(value, *parameter.hard)
        return self._handed(value) if parameter.kind == "normal" else value

    def _handed(self, normal: Any) -> Any:
        """Turn a normal of the UV map into the shading frame: mirrored UVs have their bitangent on the other side."""
        handed = self._symbol(*[self._attribute("handed", HANDEDNESS, "float", (1.0,))] * 2)
        return np.stack([normal[0], normal[1] * handed, normal[2]])

    def _bump(self, bump: Bump) -> Any:
        texture = bump.height
        name = self._lookup(texture, bump)
        along_s, along_t = (self._symbol(name, f"{name}[{i}]") * bump.scale for i in range(2))
        # The chain rule: the image's st is the transform of the surface's.
        a, b, _, c, d, _ = texture.transform
        return np.stack([-(along_s * a + along_t * c), -(along_s * b + along_t * d), np.array(1.0)])

    def _texture(self, texture: Texture) -> Any:
        name = self._lookup(texture, texture)
        if texture.channel == "rgb":
            raw = np.stack([self._symbol(name, f"{name}[{i}]") for i in range(3)])
            return raw * np.array(texture.scale[:3]) + np.array(texture.bias[:3])
        index = _CHANNEL[texture.channel]
        raw = self._symbol(name, f"{name}_a" if index == 3 else f"{name}[{index}]")
        return raw * texture.scale[index] + texture.bias[index]

    def _lookup(self, texture: Texture, source: Texture | Bump) -> str:
        """Return the name of a look-up, at a texture's coordinates, of the image that `source` stands for."""
        image = (texture.channel, texture.scale) if isinstance(source, Bump) else ()
        address = texture.file, texture.colorspace, texture.wrap_s, texture.wrap_t, texture.st, texture.transform, image
        name = self._lookups.get(address)
        if name is None:
            name = self._lookups[address] = f"texture{len(self._lookups)}"
            uv = self._attribute(f"uv_{texture.st}", texture.st, "uv", None)
            self._uv_of[name] = (uv,)
            self.textures[name] = TextureBinding(f"{name}_file", self.resolve(source))
            m = [repr(float(x)) for x in texture.transform]
            function = "lookdev_slopes" if isinstance(source, Bump) else "lookdev_texture"
            self.code[name] = (
                f"float {name}_a; color {name} = {function}({name}_file, "
                f"{m[0]} * {uv}[0] + {m[1]} * {uv}[1] + {m[2]}, {m[3]} * {uv}[0] + {m[4]} * {uv}[1] + {m[5]}, "
                f'"{_OSL_WRAP[texture.wrap_s]}", "{_OSL_WRAP[texture.wrap_t]}", {name}_a);'
            )
        return name

    def _primvar(self, primvar: Primvar, parameter: Parameter) -> Any:
        if isinstance(primvar.fallback, tuple):
            name = self._attribute(f"primvar_{primvar.name}", primvar.name, "color", primvar.fallback)
            return np.stack([self._symbol(name, f"{name}[{i}]") for i in range(3)])
        name = self._attribute(f"primvar_{primvar.name}", primvar.name, "float", (float(primvar.fallback),))
        return self._symbol(name, name)

    def _symbol(self, source: str, name: str) -> Any:
        """Return a symbol and remember which look-up or attribute gives it its value."""
        self._sources[name] = (source, *self._uv_of.get(source, ()))
        return symbol(self.graph, name)

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


def look_bsdf(look: Look, inputs: Inputs) -> Bsdf:
    """Combine the layers of a look.

    Raises
    ------
    ModelError
        A constant is outside its hard range, or the layers do not fit together.
    """
    return stack_bsdf(
        [
            StackLayer(layer.model, _layer_parameters(layer, inputs), inputs.value(layer.mask, _MASK), layer.mode)
            for layer in look.layers
        ]
    )


def _layer_parameters(layer: Layer, inputs: Inputs) -> dict[str, Any]:
    varying = {name: value for name, value in layer.inputs.items() if isinstance(value, Texture | Bump | Primvar)}
    constant = {name: value for name, value in layer.inputs.items() if name not in varying}
    parameters = complete_parameters(layer.model, constant)
    known = PARAMETERS[layer.model]
    for name, value in layer.inputs.items():
        if known[name].kind != "token":
            source = value if name in varying else parameters[name]
            parameters[name] = inputs.value(source, known[name])
    return parameters
