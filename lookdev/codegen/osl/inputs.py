"""Write the inputs of a look as OSL for the surface shader: look-ups of images, and the look's constants."""

from __future__ import annotations

from dataclasses import dataclass, field

from lookdev.codegen.inputs import SymbolicSurface
from lookdev.codegen.osl.block import literal
from lookdev.codegen.source import ImageBinding, TextureBinding
from lookdev.codegen.trace.graph import Uniform

# OSL's names of UsdUVTexture's wrap modes.
_WRAP = {"black": "black", "clamp": "clamp", "repeat": "periodic", "mirror": "mirror"}


@dataclass
class ShaderNames:
    """The names of a look's inputs in a shader, numbered in the order in which the shader's text first reads them.

    `inputs` has the symbols of the traced look. `texture_names` has the names ``texture0``, ``texture1``, ... by the
    name of the look-up in `inputs`. `constants` has the names ``look_0``, ``look_1``, ... by the constant's value.
    """

    inputs: SymbolicSurface
    texture_names: dict[str, str] = field(default_factory=dict)
    constants: dict[float, str] = field(default_factory=dict)

    def symbol_text(self, symbol: str | Uniform) -> str:
        """Return the shader's text for a symbol, which is given by its name, or for a constant of the look."""
        if isinstance(symbol, Uniform):
            literal(symbol)  # raises if it is not finite
            return self.constants.setdefault(float(symbol), f"look_{len(self.constants)}")
        source = self.inputs.look_up_of(symbol)
        if source is None:
            return symbol
        return self.texture_names.setdefault(source, f"texture{len(self.texture_names)}") + symbol.removeprefix(source)


def emit_look_up(name: str, look_up: ImageBinding) -> tuple[list[str], list[TextureBinding]]:
    """Return the lines of a look-up, and the bindings of the images that they read.

    The lines define ``color <name>``, the first three channels of the image, and ``float <name>_a``, the fourth.
    """
    function = "lookdev_slopes" if look_up.slopes else "lookdev_texture"
    m, uv = list(map(repr, look_up.transform)), look_up.uv
    s, t = (f"{m[k]} * {uv}[0] + {m[k + 1]} * {uv}[1] + {m[k + 2]}" for k in (0, 3))
    if 0 in look_up.files:  # an image without UDIM tiles
        wraps = f'"{_WRAP[look_up.wrap_s]}", "{_WRAP[look_up.wrap_t]}"'
        code = [f"float {name}_a; color {name} = {function}({name}_file, {s}, {t}, {wraps}, {name}_a);"]
        return code, [TextureBinding(f"{name}_file", look_up.files[0])]
    # Tile 1001 + i + 10 j has s in [i, i + 1) and t in [j, j + 1). Where there is no tile, all channels are 0.
    code = [f"float {name}_a = 0; color {name} = 0; float {name}_s = {s}; float {name}_t = {t};"]
    number = f"1001 + int({name}_s) + 10 * int(floor({name}_t))"
    code += [f"int {name}_tile = {name}_s < 0 || {name}_s >= 10 ? 0 : {number};"]
    bindings = []
    for tile, image in look_up.files.items():
        file = f"{name}_{tile}_file"
        tile_uv = f"{name}_s - floor({name}_s), {name}_t - floor({name}_t)"
        code.append(f'if ({name}_tile == {tile}) {name} = {function}({file}, {tile_uv}, "clamp", "clamp", {name}_a);')
        bindings.append(TextureBinding(file, image))
    return code, bindings
