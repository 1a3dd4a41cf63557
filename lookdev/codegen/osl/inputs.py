"""Look-ups of textures, and constants of a look, as OSL."""

from __future__ import annotations

from dataclasses import dataclass, field

from lookdev.codegen.inputs import SymbolicSurface
from lookdev.codegen.osl.block import literal
from lookdev.codegen.source import ImageBinding, TextureBinding
from lookdev.codegen.trace.graph import Uniform

_WRAP = {"black": "black", "clamp": "clamp", "repeat": "periodic", "mirror": "mirror"}


@dataclass
class ShaderNames:
    """Names of look-ups and constants in a shader, numbered in the order in which the text first reads them.

    `texture_names` are the names ``texture0``, ``texture1``, ... by look-up. `constants` are the names ``look_0``,
    ``look_1``, ... of the look's constants, by value.
    """

    inputs: SymbolicSurface
    texture_names: dict[str, str] = field(default_factory=dict)
    constants: dict[float, str] = field(default_factory=dict)

    def symbol_text(self, symbol: str | Uniform) -> str:
        """Return the text of a symbol or of a uniform."""
        if isinstance(symbol, Uniform):
            literal(symbol)  # raises if it is not finite
            return self.constants.setdefault(float(symbol), f"look_{len(self.constants)}")
        source = self.inputs.look_up_of(symbol)
        if source is None:
            return symbol
        return self.texture_names.setdefault(source, f"texture{len(self.texture_names)}") + symbol.removeprefix(source)


def emit_look_up(name: str, look_up: ImageBinding) -> tuple[list[str], list[TextureBinding]]:
    """Return the code of a look-up, which defines ``color <name>`` and ``float <name>_a``, and the images it reads."""
    function = "lookdev_slopes" if look_up.slopes else "lookdev_texture"
    m, uv = list(map(repr, look_up.transform)), look_up.uv
    s, t = (f"{m[k]} * {uv}[0] + {m[k + 1]} * {uv}[1] + {m[k + 2]}" for k in (0, 3))
    if 0 in look_up.files:
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
