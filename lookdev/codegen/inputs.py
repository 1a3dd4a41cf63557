"""What a shader reads at a point: constants fold, textures, primvars and expressions become symbols."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from lookdev.brdf import Parameter
from lookdev.brdf.vectors import scale
from lookdev.cache import Content
from lookdev.codegen.source import HANDEDNESS, AttributeBinding, TextureBinding
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.symbolic import symbol
from lookdev.errors import CodegenError
from lookdev.material import Bump, Coordinates, Formula, Primvar, Texture
from lookdev.material.textures import resolved, udim_tiles

_CHANNEL = {"r": 0, "g": 1, "b": 2, "a": 3}
_OSL_WRAP = {"black": "black", "clamp": "clamp", "repeat": "periodic", "mirror": "mirror"}


@dataclass(frozen=True)
class LookUp:
    """A look-up of an image, of the slopes of its heights where `slopes`.

    `texture` says how it is addressed, by the UV set of the attribute `uv`; `files` are what is read, by the number of
    a UDIM tile, or 0 for the one image that there is.
    """

    texture: Texture
    slopes: bool
    uv: str
    files: Mapping[int, Content]


@dataclass
class Inputs:
    """Everything that a look names, by symbol, and the code that gives the symbols their values.

    One texture read twice with the same addressing is one look-up. No image is opened before `emit` asks for it, so
    one that turned out not to matter never is. `resolve` turns a texture into its linear EXR, a height map into that
    of its slopes.
    """

    graph: Graph
    resolve: Callable[[Texture | Bump], Path]
    attributes: dict[str, AttributeBinding] = field(default_factory=dict)
    _lookups: dict[Any, str] = field(default_factory=dict)
    _images: dict[str, Texture | Bump] = field(default_factory=dict)
    _sources: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def read_by(self, symbols: Iterable[str]) -> list[AttributeBinding]:
        """Return the attributes, by name, without which these symbols have no value."""
        needed = self._needed(symbols)
        return [binding for name, binding in sorted(self.attributes.items()) if name in needed]

    def looked_up_by(self, symbols: Iterable[str]) -> list[str]:
        """Return the names of the look-ups without which these symbols have no value."""
        needed = self._needed(symbols)
        return [name for name in self._images if name in needed]

    def _needed(self, symbols: Iterable[str]) -> set[str]:
        # Directions and random numbers are symbols too, and nothing of the look gives them their values.
        return {source for symbol in symbols for source in self._sources.get(symbol, ())}

    def look_up(self, name: str) -> LookUp:
        """Open the images of a look-up.

        Raises
        ------
        TextureError
            An image is missing or unreadable.
        """
        source = self._images[name]
        texture = resolved(source.height if isinstance(source, Bump) else source)
        tiles = udim_tiles(texture) or {0: texture}
        files = {number: self._file(source, tile) for number, tile in tiles.items()}
        return LookUp(texture, isinstance(source, Bump), self._uv(texture), files)

    def emit(self, name: str) -> tuple[list[str], list[TextureBinding]]:
        """Return the code of a look-up and the images it reads.

        Raises
        ------
        TextureError
            An image is missing or unreadable.
        """
        look_up = self.look_up(name)
        texture, uv = look_up.texture, look_up.uv
        function = "lookdev_slopes" if look_up.slopes else "lookdev_texture"
        m = [repr(float(x)) for x in texture.transform]
        s, t = (f"{m[k]} * {uv}[0] + {m[k + 1]} * {uv}[1] + {m[k + 2]}" for k in (0, 3))
        if 0 in look_up.files:
            wraps = f'"{_OSL_WRAP[texture.wrap_s]}", "{_OSL_WRAP[texture.wrap_t]}"'
            code = [f"float {name}_a; color {name} = {function}({name}_file, {s}, {t}, {wraps}, {name}_a);"]
            return code, [TextureBinding(f"{name}_file", look_up.files[0])]
        # Tile 1001 + i + 10 j has s in [i, i + 1) and t in [j, j + 1); where there is none, all is 0.
        code = [f"float {name}_a = 0; color {name} = 0; float {name}_s = {s}; float {name}_t = {t};"]
        code += [
            f"int {name}_tile = {name}_s < 0 || {name}_s >= 10 ? 0 : 1001 + int({name}_s) + 10 * int(floor({name}_t));"
        ]
        bindings = []
        for number, image in look_up.files.items():
            file = f"{name}_{number}_file"
            place = f"{name}_s - floor({name}_s), {name}_t - floor({name}_t)"
            code.append(
                f'if ({name}_tile == {number}) {name} = {function}({file}, {place}, "clamp", "clamp", {name}_a);'
            )
            bindings.append(TextureBinding(file, image))
        return code, bindings

    def _file(self, source: Texture | Bump, texture: Texture) -> Content:
        return Content.of(self.resolve(replace(source, height=texture) if isinstance(source, Bump) else texture))

    def value(self, source: Any, parameter: Parameter) -> Any:
        """Return the array of one input: a constant, or what is known only at run time, clipped to the hard range."""
        if isinstance(source, Bump):
            return self._handed(self._bump(source))
        value = self._read(source, parameter.kind == "color")
        if isinstance(source, Texture | Primvar | Formula):
            value = np.clip(value, *parameter.hard)
        return self._handed(value) if parameter.kind == "normal" else value

    def _read(self, source: Any, color: bool) -> Any:
        """Return a value as it is; floats stand for three equal channels where a colour is wanted."""
        if isinstance(source, Texture):
            value = self._texture(source)
        elif isinstance(source, Primvar):
            value = self._primvar(source)
        elif isinstance(source, Coordinates):
            value = self._coordinates(source)
        elif isinstance(source, Formula):
            values = {name: self._read(each, source.kinds[name] == "color") for name, each in source.inputs.items()}
            value = source.expression.evaluate(values, source.kinds)
        else:
            value = np.asarray(source, dtype=np.float64)
        return scale(np.ones(3), value) if color and value.shape == () else value

    def _handed(self, normal: Any) -> Any:
        """Turn a normal of the UV map into the shading frame: mirrored UVs have their bitangent on the other side."""
        if isinstance(normal, np.ndarray) and not normal[1]:
            return normal
        name = self._attribute("handed", HANDEDNESS, "float", (1.0,))
        return np.stack([normal[0], normal[1] * self._symbol(name, name), normal[2]])

    def _bump(self, bump: Bump) -> Any:
        name = self._lookup(bump)
        along_s, along_t = (self._symbol(name, f"{name}[{i}]") * bump.scale for i in range(2))
        # The chain rule: the image's st is the transform of the surface's.
        a, b, _, c, d, _ = bump.height.transform
        return np.stack([-(along_s * a + along_t * c), -(along_s * b + along_t * d), np.array(1.0)])

    def _texture(self, texture: Texture) -> Any:
        name = self._lookup(texture)
        if texture.channel == "rgb":
            raw = np.stack([self._symbol(name, f"{name}[{i}]") for i in range(3)])
            return raw * np.array(texture.scale[:3]) + np.array(texture.bias[:3])
        index = _CHANNEL[texture.channel]
        raw = self._symbol(name, f"{name}_a" if index == 3 else f"{name}[{index}]")
        return raw * texture.scale[index] + texture.bias[index]

    def _lookup(self, source: Texture | Bump) -> str:
        """Return the name of a look-up of an image at a texture's coordinates."""
        texture = source.height if isinstance(source, Bump) else source
        image = (texture.channel, texture.scale) if isinstance(source, Bump) else ()
        address = texture.file, texture.colorspace, texture.wrap_s, texture.wrap_t, texture.st, texture.transform, image
        name = self._lookups.setdefault(address, f"lookup{len(self._lookups)}")
        self._images.setdefault(name, source)
        self._uv(texture)
        return name

    def _uv(self, place: Texture | Coordinates) -> str:
        return self._attribute(f"uv_{place.st}", place.st, "uv", None)

    def _coordinates(self, place: Coordinates) -> Any:
        uv = self._uv(place)
        s, t = (self._symbol(uv, f"{uv}[{i}]") for i in range(2))
        a, b, c, d, e, f = place.transform
        return np.stack([s * a + t * b + c, s * d + t * e + f, np.array(0.0)])

    def _primvar(self, primvar: Primvar) -> Any:
        if isinstance(primvar.fallback, tuple):
            name = self._attribute(f"primvar_{primvar.name}", primvar.name, "color", primvar.fallback)
            return np.stack([self._symbol(name, f"{name}[{i}]") for i in range(3)])
        name = self._attribute(f"primvar_{primvar.name}", primvar.name, "float", (float(primvar.fallback),))
        return self._symbol(name, name)

    def _symbol(self, source: str, name: str) -> Any:
        """Return a symbol and remember which look-up or attribute gives it its value."""
        image = self._images.get(source)
        texture = image.height if isinstance(image, Bump) else image
        self._sources[name] = (source, self._uv(texture)) if texture else (source,)
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
