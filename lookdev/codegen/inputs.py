"""Represent the inputs of a look as symbols while its model is traced; every emitter of looks uses this module.

The inputs are the values that a shader reads at a point of a surface: texels, primvars and UV coordinates.
"""

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
    """A `lookdev.material.values.Surface` whose values are symbols, and a record of the inputs that they stand for.

    A look-up is a read of a texture, or of the slopes of a height map (`Bump`). Equal reads share one look-up. Only the
    method `look_up` opens images. If folding removes a look-up from the traced code, its image is never opened.

    `graph` is the graph of the traced code. `resolve` returns the linear EXR file of a texture, or the file of the
    slopes of a height map. `attributes` has the mesh attributes that were read, by the names of the shader's
    parameters.
    """

    graph: Graph
    resolve: Callable[[Texture | Bump], Path]
    attributes: dict[str, AttributeBinding] = field(default_factory=dict)
    # The names of the look-ups. A key has all properties of a texture in which two look-ups can differ: file, colour
    # space, wrap modes, UV set and transform, and for a height map also channel and scale.
    _lookups: dict[tuple[object, ...], str] = field(default_factory=dict)
    # The texture or height map of each look-up, by the look-up's name.
    _images: dict[str, Texture | Bump] = field(default_factory=dict)
    # The names of what each symbol depends on, by the symbol. A component of an attribute depends on the attribute. A
    # channel of a look-up depends on the look-up and on the parameter of its UV set.
    _sources: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def attributes_read_by(self, symbols: Iterable[str]) -> list[AttributeBinding]:
        """Return the mesh attributes on which the values of named symbols depend, sorted by name."""
        sources = self._sources_of(symbols)
        return [binding for name, binding in sorted(self.attributes.items()) if name in sources]

    def look_ups_read_by(self, symbols: Iterable[str]) -> list[str]:
        """Return the names of the look-ups on which the values of named symbols depend."""
        sources = self._sources_of(symbols)
        return [name for name in self._images if name in sources]

    def _sources_of(self, symbols: Iterable[str]) -> set[str]:
        """Return the names of the attributes and look-ups on which the values of symbols depend."""
        # Directions and random numbers are also symbols, but have no source.
        return {source for symbol in symbols for source in self._sources.get(symbol, ())}

    def label(self, name: str) -> str:
        """Return the file name, without suffix, of the image of the look-up `name`."""
        source = self._images[name]
        return (source.height if isinstance(source, Bump) else source).file.stem

    def look_up(self, name: str) -> ImageBinding:
        """Open the image of the look-up `name`, or all its UDIM tiles, and return the binding.

        Raises
        ------
        TextureError
            An image is missing or unreadable.
        """
        source = self._images[name]
        texture = resolve_texture(source.height if isinstance(source, Bump) else source)
        # An image without UDIM tiles has the key 0, a tile has its number.
        tiles = udim_tiles(texture) or {0: texture}
        files = {number: self._file(source, tile) for number, tile in tiles.items()}
        uv, transform = self._uv_attribute(texture.st), tuple(map(float, texture.transform))
        return ImageBinding(name, uv, isinstance(source, Bump), texture.wrap_s, texture.wrap_t, transform, files)

    def _file(self, source: Texture | Bump, texture: Texture) -> Content:
        """Return the stored file of `texture`, which is the image of `source` or one of its UDIM tiles."""
        return Content.store_copy(
            self.resolve(replace(source, height=texture) if isinstance(source, Bump) else texture)
        )

    # The next methods are those of the protocol `Surface`, at a single point.

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
        """Return the name of the look-up that has this symbol as a channel, or None if the symbol is not a channel."""
        source = self._sources.get(symbol, ("",))[0]
        return source if source in self._images else None

    def _look_up_name(self, source: Texture | Bump) -> str:
        """Return the name of a look-up of a texture or height map; add the look-up unless an equal one exists."""
        texture = source.height if isinstance(source, Bump) else source
        height = (texture.channel, texture.scale) if isinstance(source, Bump) else ()
        key = texture.file, texture.colorspace, texture.wrap_s, texture.wrap_t, texture.st, texture.transform, height
        name = self._lookups.setdefault(key, f"lookup{len(self._lookups)}")
        self._images.setdefault(name, source)
        self._uv_attribute(texture.st)
        return name

    def _uv_attribute(self, name: str) -> str:
        """Bind the UV set `name`, and return the name of the shader's parameter for it."""
        return self._attribute(f"uv_{short_name(name)}", name, "uv", None)

    def _symbol(self, name: str) -> SymbolicArray:
        """Return the symbol of an attribute that is one number, and record the attribute as its source."""
        self._sources[name] = (name,)
        return symbol(self.graph, name)

    def _symbols(self, source: str, components: Sequence[str]) -> SymbolicArray:
        """Return the symbols of an attribute's components or a look-up's channels, and record what they depend on.

        `source` is the name of the attribute or look-up. The names of the symbols are `source` with the suffixes
        `components`, such as ``"[0]"``.
        """
        names, image = [f"{source}{component}" for component in components], self._images.get(source)
        texture = image.height if isinstance(image, Bump) else image
        self._sources |= dict.fromkeys(names, (source, self._uv_attribute(texture.st)) if texture else (source,))
        return symbols(self.graph, names)

    def _attribute(
        self, name: str, attribute: str, kind: Literal["uv", "float", "color"], fallback: tuple[float, ...] | None
    ) -> str:
        """Bind a mesh attribute to the shader's parameter `name`, and return `name`.

        Raises
        ------
        CodegenError
            The parameter is already bound in another way.
        """
        binding = AttributeBinding(name, attribute, kind, fallback)
        if self.attributes.setdefault(name, binding) != binding:
            raise CodegenError(
                f"'{attribute}' is read both as {self.attributes[name].kind} and as {kind}, or with two fallbacks"
            )
        return name
