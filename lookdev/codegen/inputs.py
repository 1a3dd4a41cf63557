"""What a shader reads at a point: constants fold, textures, primvars and expressions become symbols."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from lookdev.cache import Content
from lookdev.codegen.source import HANDEDNESS, AttributeBinding
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.symbolic import symbol, symbols
from lookdev.errors import CodegenError
from lookdev.material import Bump, Primvar, Texture
from lookdev.material.textures import resolved, udim_tiles


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
        return LookUp(texture, isinstance(source, Bump), self._uv(texture.st), files)

    def _file(self, source: Texture | Bump, texture: Texture) -> Content:
        return Content.of(self.resolve(replace(source, height=texture) if isinstance(source, Bump) else texture))

    def uv(self, name: str) -> Any:
        """Return the symbols of a UV set, (2,)."""
        uv = self._uv(name)
        return self._symbols(uv, [f"{uv}[{i}]" for i in range(2)])

    def texels(self, texture: Texture) -> Any:
        """Return the symbols of a look-up, (4,)."""
        name = self._lookup(texture)
        return self._symbols(name, [*(f"{name}[{i}]" for i in range(3)), f"{name}_a"])

    def slopes(self, height: Texture) -> Any:
        """Return the symbols of a look-up of slopes, (2,)."""
        name = self._lookup(Bump(height))
        return self._symbols(name, [f"{name}[{i}]" for i in range(2)])

    def primvar(self, primvar: Primvar) -> Any:
        """Return the symbols of a primvar, () or (3,)."""
        if isinstance(primvar.fallback, tuple):
            name = self._attribute(f"primvar_{primvar.name}", primvar.name, "color", primvar.fallback)
            return self._symbols(name, [f"{name}[{i}]" for i in range(3)])
        name = self._attribute(f"primvar_{primvar.name}", primvar.name, "float", (float(primvar.fallback),))
        return self._symbol(name)

    def handedness(self) -> Any:
        """Return the symbol of the handedness, ()."""
        return self._symbol(self._attribute("handed", HANDEDNESS, "float", (1.0,)))

    def look_up_of(self, symbol: str) -> str | None:
        """Return the name of the look-up that gives a symbol its value, if one does."""
        source = self._sources.get(symbol, ("",))[0]
        return source if source in self._images else None

    def _lookup(self, source: Texture | Bump) -> str:
        """Return the name of a look-up of an image at a texture's coordinates."""
        texture = source.height if isinstance(source, Bump) else source
        image = (texture.channel, texture.scale) if isinstance(source, Bump) else ()
        address = texture.file, texture.colorspace, texture.wrap_s, texture.wrap_t, texture.st, texture.transform, image
        name = self._lookups.setdefault(address, f"lookup{len(self._lookups)}")
        self._images.setdefault(name, source)
        self._uv(texture.st)
        return name

    def _uv(self, name: str) -> str:
        return self._attribute(f"uv_{name}", name, "uv", None)

    def _symbol(self, name: str) -> Any:
        self._sources[name] = (name,)
        return symbol(self.graph, name)

    def _symbols(self, source: str, names: list[str]) -> Any:
        """Return symbols and remember which look-up, by which UV set, or attribute gives them their values."""
        image = self._images.get(source)
        texture = image.height if isinstance(image, Bump) else image
        self._sources |= dict.fromkeys(names, (source, self._uv(texture.st)) if texture else (source,))
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
