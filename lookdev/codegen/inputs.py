"""The values that a shader reads at a point of a surface, as symbols: look-ups of textures, primvars, UV sets."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from lookdev.cache import Content
from lookdev.codegen.source import HANDEDNESS, AttributeBinding, ImageBinding, short_name
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.lobes import WO
from lookdev.codegen.trace.symbolic import SymbolicArray, symbol, symbols
from lookdev.errors import CodegenError
from lookdev.material import Bump, Primvar, Texture
from lookdev.material.textures import resolve_texture, udim_tiles


@dataclass
class SymbolicSurface:
    """The points of a surface at which code runs: a `lookdev.material.values.Surface` whose values are symbols.

    Equal reads of a texture are one look-up. Only `look_up` opens images, so an image whose look-ups fold away is never
    opened.
    `resolve` returns the linear EXR file of a texture, or the file of the slopes of a height map.
    """

    graph: Graph
    resolve: Callable[[Texture | Bump], Path]
    attributes: dict[str, AttributeBinding] = field(default_factory=dict)
    # The names of look-ups by all that distinguishes them; their images by name; and, for each symbol, the names of the
    # attributes and look-ups that it depends on, its own look-up first.
    _lookups: dict[tuple[object, ...], str] = field(default_factory=dict)
    _images: dict[str, Texture | Bump] = field(default_factory=dict)
    _sources: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def attributes_read_by(self, symbols: Iterable[str]) -> list[AttributeBinding]:
        """Return the attributes on which the values of these symbols depend, sorted by name."""
        sources = self._sources_of(symbols)
        return [binding for name, binding in sorted(self.attributes.items()) if name in sources]

    def look_ups_read_by(self, symbols: Iterable[str]) -> list[str]:
        """Return the names of the look-ups on which the values of these symbols depend."""
        sources = self._sources_of(symbols)
        return [name for name in self._images if name in sources]

    def _sources_of(self, symbols: Iterable[str]) -> set[str]:
        """Return the names of the attributes and look-ups on which the values of symbols depend."""
        # Directions and random numbers are also symbols, but have no source.
        return {source for symbol in symbols for source in self._sources.get(symbol, ())}

    def label(self, name: str) -> str:
        """Return the name, without suffix, of the file that a look-up reads."""
        source = self._images[name]
        return (source.height if isinstance(source, Bump) else source).file.stem

    def look_up(self, name: str) -> ImageBinding:
        """Open the images of a look-up.

        Raises
        ------
        TextureError
            An image is missing or unreadable.
        """
        source = self._images[name]
        texture = resolve_texture(source.height if isinstance(source, Bump) else source)
        tiles = udim_tiles(texture) or {0: texture}
        files = {number: self._file(source, tile) for number, tile in tiles.items()}
        uv, transform = self._uv_attribute(texture.st), tuple(map(float, texture.transform))
        return ImageBinding(name, uv, isinstance(source, Bump), texture.wrap_s, texture.wrap_t, transform, files)

    def _file(self, source: Texture | Bump, texture: Texture) -> Content:
        return Content.store_copy(
            self.resolve(replace(source, height=texture) if isinstance(source, Bump) else texture)
        )

    def uv(self, name: str) -> SymbolicArray:
        return self._symbols(self._uv_attribute(name), ("[0]", "[1]"))

    def texels(self, texture: Texture) -> SymbolicArray:
        return self._symbols(self._look_up_name(texture), ("[0]", "[1]", "[2]", "_a"))

    def slopes(self, height: Texture) -> SymbolicArray:
        return self._symbols(self._look_up_name(Bump(height)), ("[0]", "[1]"))

    def primvar(self, primvar: Primvar) -> SymbolicArray:
        name = f"primvar_{short_name(primvar.name)}"
        if isinstance(primvar.fallback, tuple):
            self._attribute(name, primvar.name, "color", primvar.fallback)
            return self._symbols(name, ("[0]", "[1]", "[2]"))
        return self._symbol(self._attribute(name, primvar.name, "float", (float(primvar.fallback),)))

    def handedness(self) -> SymbolicArray:
        return self._symbol(self._attribute("handed", HANDEDNESS, "float", (1.0,)))

    def view(self) -> SymbolicArray:
        return symbol(self.graph, WO[2])

    def look_up_of(self, symbol: str) -> str | None:
        """Return the name of the look-up of which a symbol is a channel, or None."""
        source = self._sources.get(symbol, ("",))[0]
        return source if source in self._images else None

    def _look_up_name(self, source: Texture | Bump) -> str:
        """Return the name of the look-up of an image; add the look-up unless an equal one exists."""
        texture = source.height if isinstance(source, Bump) else source
        height = (texture.channel, texture.scale) if isinstance(source, Bump) else ()
        key = texture.file, texture.colorspace, texture.wrap_s, texture.wrap_t, texture.st, texture.transform, height
        name = self._lookups.setdefault(key, f"lookup{len(self._lookups)}")
        self._images.setdefault(name, source)
        self._uv_attribute(texture.st)
        return name

    def _uv_attribute(self, name: str) -> str:
        """Return the name of the parameter that has a UV set."""
        return self._attribute(f"uv_{short_name(name)}", name, "uv", None)

    def _symbol(self, name: str) -> SymbolicArray:
        self._sources[name] = (name,)
        return symbol(self.graph, name)

    def _symbols(self, source: str, components: Sequence[str]) -> SymbolicArray:
        """Return symbols, and record what they depend on: an attribute, or a look-up and its UV set."""
        names, image = [f"{source}{component}" for component in components], self._images.get(source)
        texture = image.height if isinstance(image, Bump) else image
        self._sources |= dict.fromkeys(names, (source, self._uv_attribute(texture.st)) if texture else (source,))
        return symbols(self.graph, names)

    def _attribute(
        self, name: str, attribute: str, kind: Literal["uv", "float", "color"], fallback: tuple[float, ...] | None
    ) -> str:
        """Bind an attribute to a parameter, and return its name; two different bindings of one raise CodegenError."""
        binding = AttributeBinding(name, attribute, kind, fallback)
        if self.attributes.setdefault(name, binding) != binding:
            raise CodegenError(
                f"'{attribute}' is read both as {self.attributes[name].kind} and as {kind}, or with two fallbacks"
            )
        return name
