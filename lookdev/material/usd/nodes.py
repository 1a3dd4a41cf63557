"""Reads nodes in materials of foreign shading models: MaterialX's standard nodes that expressions can compute.

`NODES` lists the readers. A reader maps a `UsdNode` to its value, a constant, a texture or an expression. It raises
NotCarriedError where a look cannot have this value.

- MaterialX Specification 1.39: Math, Adjustment, Compositing, Conditional and Channel nodes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from lookdev.material import Bump, Texture
from lookdev.material.usd import sampling
from lookdev.material.usd.reader import UsdNode
from lookdev.material.usd.terms import NodeValue, NotCarriedError, constant, convert_channels

SOBEL_SCALE = 1.0 / 16.0
"""The factor from a height map's slopes to heighttonormal's slopes, from mx_heighttonormal of MaterialX's library."""


class _Formula(NamedTuple):
    """The formula of a node: an expression with the names of the node's inputs in braces.

    `defaults` has the defaults of the inputs. The expression is a linear function (with a constant term) of each of the
    inputs named in `linear` if the others are fixed.
    """

    text: str
    defaults: dict[str, float]
    linear: tuple[str, ...] = ()


# Inputs that several nodes have, with their defaults.
_PAIR = {"in1": 0.0, "in2": 0.0}
_FACTORS = {"in1": 0.0, "in2": 1.0}
_IN = {"in": 0.0}
_BLEND = {"fg": 0.0, "bg": 0.0, "mix": 1.0}
_RANGE = {"in": 0.0, "inlow": 0.0, "inhigh": 1.0, "outlow": 0.0, "outhigh": 1.0}
_CHOICE = {"value1": 1.0, "value2": 0.0, **_PAIR}

# The formulas of nodes by their category.
_FORMULAS = {
    "add": _Formula("{in1} + {in2}", _PAIR, ("in1", "in2")),
    "subtract": _Formula("{in1} - {in2}", _PAIR, ("in1", "in2")),
    "multiply": _Formula("{in1} * {in2}", _FACTORS, ("in1", "in2")),
    "divide": _Formula("{in1} / {in2}", _FACTORS, ("in1",)),
    "modulo": _Formula("{in1} % {in2}", _FACTORS),
    "power": _Formula("{in1} ^ {in2}", _FACTORS),
    "min": _Formula("min({in1}, {in2})", _PAIR),
    "max": _Formula("max({in1}, {in2})", _PAIR),
    **{name: _Formula(f"{name}({{in}})", _IN) for name in ("floor", "ceil", "round", "fract", "sqrt", "exp")},
    **{name: _Formula(f"{name}({{in}})", _IN) for name in ("sin", "cos", "tan")},
    "absval": _Formula("abs({in})", _IN),
    "ln": _Formula("log({in})", {"in": 1.0}),
    "atan2": _Formula("atan2({iny}, {inx})", {"iny": 0.0, "inx": 1.0}),
    "invert": _Formula("{amount} - {in}", {"in": 0.0, "amount": 1.0}, ("in", "amount")),
    "clamp": _Formula("clamp({in}, {low}, {high})", {"in": 0.0, "low": 0.0, "high": 1.0}),
    "smoothstep": _Formula("smoothstep({in}, {low}, {high})", {"in": 0.0, "low": 0.0, "high": 1.0}),
    "remap": _Formula("fit({in}, {inlow}, {inhigh}, {outlow}, {outhigh})", _RANGE, ("in",)),
    "contrast": _Formula("({in} - {pivot}) * {amount} + {pivot}", {"in": 0.0, "amount": 1.0, "pivot": 0.5}, ("in",)),
    "mix": _Formula("mix({bg}, {fg}, {mix})", {"fg": 0.0, "bg": 0.0, "mix": 0.0}, ("fg", "bg", "mix")),
    "plus": _Formula("{bg} + {fg} * {mix}", _BLEND, ("fg", "bg", "mix")),
    "minus": _Formula("{bg} - {fg} * {mix}", _BLEND, ("fg", "bg", "mix")),
    "difference": _Formula("mix({bg}, abs({bg} - {fg}), {mix})", _BLEND, ("mix",)),
    "screen": _Formula("mix({bg}, 1 - (1 - {fg}) * (1 - {bg}), {mix})", _BLEND, ("mix",)),
    "inside": _Formula("{in} * {mask}", {"in": 0.0, "mask": 1.0}, ("in", "mask")),
    "outside": _Formula("{in} * (1 - {mask})", {"in": 0.0, "mask": 0.0}, ("in", "mask")),
    **{
        name: _Formula(f"{{value1}} {sign} {{value2}} ? {{in1}} : {{in2}}", _CHOICE)
        for name, sign in (("ifgreater", ">"), ("ifgreatereq", ">="), ("ifequal", "=="))
    },
}


def _formula_reader(entry: _Formula) -> Callable[[UsdNode], NodeValue]:
    """Return the reader of a node with this formula."""

    def read(node: UsdNode) -> NodeValue:
        operands = {name: node.read_any_term(name, default) for name, default in entry.defaults.items()}
        return node.terms.apply(entry.text, operands, entry.linear)

    return read


def _read_dot(node: UsdNode) -> NodeValue:
    """Read a dot, which passes its input on."""
    node.mark_read("note")
    return node.read_any_term("in", 0.0)


def _read_convert(node: UsdNode) -> NodeValue:
    """Read a convert, which changes the number of channels."""
    term = node.read_any_term("in", 0.0)
    return replace(convert_channels(term, node.width), is_tangent_normal=term.is_tangent_normal)


def _read_extract(node: UsdNode) -> NodeValue:
    """Read an extract: one channel of its input."""
    return node.terms.channel(node.read_any_term("in", 0.0), int(node.read_numbers("index", 0.0)[0]))


def _read_channels(node: UsdNode) -> NodeValue:
    """Read a separate2, separate3, separate4 or swizzle: channels of its input.

    The name of a separate's output has the letter of the channel. The input ``channels`` of a swizzle has several
    letters, ``rgba`` or ``xyzw``, where the digits 0 and 1 are constants.
    """
    term = node.read_any_term("in", 0.0)
    letters = node.output.removeprefix("out") if "separate" in node.identifier else node.read_text("channels", "")
    if not 1 <= len(letters) <= 4 or not set(letters) <= set("rgbaxyzw01"):
        raise NotCarriedError(f"'{letters:.40}' are not channels")
    if letters in ("rgb", "xyz", "xy") and len(letters) == term.width:
        return convert_channels(term, term.width)
    channels = [
        # The index modulo 4 is the channel: r and x are 0, g and y are 1, ...
        constant(float(letter)) if letter in "01" else node.terms.channel(term, "rgbaxyzw".index(letter) % 4)
        for letter in letters
    ]
    return channels[0] if len(channels) == 1 else node.terms.join_channels(*channels)


def _read_combine(node: UsdNode) -> NodeValue:
    """Read a combine2, combine3 or combine4: the channels of its inputs, joined."""
    count = int(node.identifier.removeprefix("ND_combine")[0])
    parts = [node.read_any_term(f"in{number}", 0.0) for number in range(1, count + 1)]
    channels = [node.terms.channel(part, index) for part in parts for index in range(4 if part.alpha else part.width)]
    if not 2 <= len(channels) <= 4:
        raise NotCarriedError(f"combines {len(channels)} channels")
    return node.terms.join_channels(*channels)


def _read_switch(node: UsdNode) -> NodeValue:
    """Read a switch: one of ten inputs, which the constant ``which`` selects."""
    index = int(node.read_numbers("which", 0.0)[0])
    node.mark_read(*(f"in{number}" for number in range(1, 11)))
    return node.read_any_term(f"in{index + 1}", 0.0) if 0 <= index < 10 else constant(0.0)


def _read_range(node: UsdNode) -> NodeValue:
    """Read a range: a remap with a gamma and, if ``doclamp`` is set, limits."""
    (gamma,), (is_clamped,) = node.read_numbers("gamma", 1.0), node.read_numbers("doclamp", 0.0)
    terms = {name: node.read_any_term(name, default) for name, default in _RANGE.items()}
    if gamma == 1.0:
        value = node.terms.apply(_FORMULAS["remap"].text, terms, ("in",))
    else:
        text = "{outlow} + ({outhigh} - {outlow}) * fit({in}, {inlow}, {inhigh}, 0, 1) ^ {power}"
        value = node.terms.apply(text, {**terms, "power": constant(1.0 / gamma if gamma else 0.0)})
    bounds = {"a": value, "low": terms["outlow"], "high": terms["outhigh"]}
    return node.terms.apply("clamp({a}, {low}, {high})", bounds) if is_clamped else value


_LUMA = (0.2722287, 0.6740818, 0.0536895)  # MaterialX's default of lumacoeffs: the weights of r, g, b in ACEScg


def _luma(node: UsdNode, color: NodeValue) -> NodeValue:
    """Return the luminance of a colour with the weights of the node's input ``lumacoeffs``."""
    weights = node.read_numbers("lumacoeffs", *_LUMA)
    return _weighted_sum(node, color, *map(constant, weights))


def _weighted_sum(node: UsdNode, color: NodeValue, *weights: NodeValue) -> NodeValue:
    """Return the sum of the channels of a colour or vector, each times its weight."""
    total = constant(0.0)
    for index, weight in enumerate(weights):
        channel = node.terms.channel(color, index)
        product = node.terms.apply("{a} * {b}", {"a": channel, "b": weight}, ("a", "b"))
        total = product if index == 0 else node.terms.apply("{a} + {b}", {"a": total, "b": product})
    return total


def _read_luminance(node: UsdNode) -> NodeValue:
    """Read a luminance: a grey of the colour's luminance, with the colour's alpha."""
    color = node.read_any_term("in", 0.0, 0.0, 0.0)
    gray = convert_channels(_luma(node, color), 3)
    return replace(gray, alpha=color.alpha)


def _read_saturate(node: UsdNode) -> NodeValue:
    """Read a saturate, which scales the distance of a colour from its luminance."""
    color, amount = node.read_any_term("in", 0.0, 0.0, 0.0), node.read_term("amount", 1, 1.0)
    gray = _luma(node, color)
    return node.terms.apply("mix({gray}, {color}, {amount})", {"color": color, "gray": gray, "amount": amount})


def _read_dot_product(node: UsdNode) -> NodeValue:
    """Read a dotproduct of two vectors."""
    a, b = node.read_any_term("in1", 0.0, 0.0), node.read_any_term("in2", 0.0, 0.0)
    return _weighted_sum(node, a, *(node.terms.channel(b, index) for index in range(min(a.width, b.width))))


def _read_magnitude(node: UsdNode) -> NodeValue:
    """Read a magnitude: the length of a vector."""
    vector = node.read_any_term("in", 0.0, 0.0)
    squares = _weighted_sum(node, vector, *(node.terms.channel(vector, index) for index in range(vector.width)))
    return node.terms.apply("sqrt({a})", {"a": squares})


def _read_normalize(node: UsdNode) -> NodeValue:
    """Read a normalize: a vector divided by its length."""
    vector = node.read_any_term("in", 0.0, 0.0)
    if vector.is_tangent_normal:  # a normal, which inputs of layers accept with any length
        return vector
    return node.terms.apply("{a} / {b}", {"a": vector, "b": _read_magnitude(node)})


def _ramp_reader(low: str, high: str, axis: int, *, is_split: bool = False) -> Callable[[UsdNode], NodeValue]:
    """Return the reader of a ramp along a texture coordinate, or, if `is_split`, of a step.

    `low` and `high` name the inputs for the values at 0 and 1. `axis` is 0 for s and 1 for t.
    """

    def read(node: UsdNode) -> NodeValue:
        coordinate = node.terms.channel(sampling.read_coordinates(node, "texcoord"), axis)
        terms = {"t": coordinate, "low": node.read_any_term(low, 0.0), "high": node.read_any_term(high, 0.0)}
        if is_split:
            terms["center"] = node.read_term("center", 1, 0.5)
        weight = "boxstep({t}, {center})" if is_split else "clamp({t}, 0, 1)"
        return node.terms.apply(f"mix({{low}}, {{high}}, {weight})", terms)

    return read


def _read_noise(node: UsdNode) -> NodeValue:
    """Read a noise2d or cellnoise2d as the noise of expressions, of the same scale and range but another pattern."""
    uv = sampling.read_coordinates(node, "texcoord")
    x, y = (node.terms.channel(uv, index) for index in (0, 1))
    node.reader.network.add_fault(node.path, f"{node.identifier} has another pattern here, of the same scale")
    if node.identifier.startswith("ND_cellnoise"):
        return node.terms.apply("cellnoise({x}, {y})", {"x": x, "y": y})
    amplitude, pivot = node.read_any_term("amplitude", 1.0), node.read_any_term("pivot", 0.0)
    value = node.terms.apply("2 * noise({x}, {y}) - 1", {"x": x, "y": y})
    terms = {"value": value, "amplitude": amplitude, "pivot": pivot}
    scaled = node.terms.apply("{value} * {amplitude} + {pivot}", terms)
    return convert_channels(scaled, node.width)


def _read_normal_map(node: UsdNode) -> NodeValue:
    """Read a normalmap in tangent space. Its input can also be a heighttonormal, whose value is a bump map."""
    if (space := node.read_text("space", "tangent")) != "tangent":
        raise NotCarriedError(f"a normal map in {space:.40} space is not supported, only one in tangent space")
    scale = node.read_any_term("scale", 1.0)
    if isinstance((encoded := node.read_any_term("in", 0.5, 0.5, 1.0)).leaf, Bump):  # of a heighttonormal
        return _scale_bump(node, encoded, scale)
    return sampling.tangent_normal(node, encoded, scale)


def _read_bump(node: UsdNode) -> NodeValue:
    """Read a bump: the normal of a height map."""
    bump = _height_bump(node, node.read_term("height", 1, 0.0), 1.0)
    return _scale_bump(node, bump, node.read_any_term("scale", 1.0))


def _read_height_to_normal(node: UsdNode) -> NodeValue:
    """Read a heighttonormal, as a bump map."""
    node.mark_read("texcoord")
    (scale,) = node.read_numbers("scale", 1.0)
    return _height_bump(node, node.read_term("in", 1, 0.0), scale)


def _height_bump(node: UsdNode, height: NodeValue, scale: float) -> NodeValue:
    """Return the bump map of heights, which must be a channel of an image; for a constant, the shading normal."""
    if height.numbers is not None:
        return replace(constant(0.0, 0.0, 1.0), is_tangent_normal=True)
    if not isinstance(height.leaf, Texture):
        raise NotCarriedError("only one channel of an image has a slope")
    return replace(node.terms.leaf_term(Bump(height.leaf, scale * SOBEL_SCALE), 3, node.name), is_tangent_normal=True)


def _scale_bump(node: UsdNode, bump: NodeValue, scale: NodeValue) -> NodeValue:
    """Return a bump map with its scale multiplied by a constant; another value of `bump` is returned unchanged."""
    if not isinstance(bump.leaf, Bump):
        return bump
    if scale.numbers is None or len(set(scale.numbers)) != 1:
        raise NotCarriedError("the scale of a bump is not one constant")
    scaled = replace(bump.leaf, scale=bump.leaf.scale * scale.numbers[0])
    return replace(node.terms.leaf_term(scaled, 3, node.name), is_tangent_normal=True)


NODES: dict[str, Callable[[UsdNode], NodeValue]] = {
    **{name: _formula_reader(entry) for name, entry in _FORMULAS.items()},
    **{
        f"UsdPrimvarReader{kind}": sampling.read_primvar
        for kind in ("", "_int", "_normal", "_point", "_vector", "_string", "_matrix")
    },
    **dict.fromkeys(("combine2", "combine3", "combine4"), _read_combine),
    **dict.fromkeys(("separate2", "separate3", "separate4", "swizzle"), _read_channels),
    **dict.fromkeys(("gltf_image", "gltf_colorimage", "gltf_normalmap"), sampling.read_gltf_image),
    **dict.fromkeys(("noise2d", "cellnoise2d"), _read_noise),
    "UsdTransform2d": sampling.read_transform2d,
    "UsdUVTexture": sampling.read_uv_texture,
    "bump": _read_bump,
    "constant": lambda node: node.read_any_term("value", *[0.0] * node.width),
    "convert": _read_convert,
    "dot": _read_dot,
    "dotproduct": _read_dot_product,
    "extract": _read_extract,
    "geompropvalue": sampling.read_primvar,
    "heighttonormal": _read_height_to_normal,
    "image": sampling.read_image,
    "luminance": _read_luminance,
    "magnitude": _read_magnitude,
    "normalize": _read_normalize,
    "normalmap": _read_normal_map,
    "place2d": sampling.read_place2d,
    "ramplr": _ramp_reader("valuel", "valuer", 0),
    "ramptb": _ramp_reader("valueb", "valuet", 1),
    "range": _read_range,
    "rotate2d": sampling.read_rotate2d,
    "saturate": _read_saturate,
    "splitlr": _ramp_reader("valuel", "valuer", 0, is_split=True),
    "splittb": _ramp_reader("valueb", "valuet", 1, is_split=True),
    "switch": _read_switch,
    "texcoord": sampling.read_texcoord,
    "tiledimage": sampling.read_tiled_image,
}
"""The readers of nodes by the node's category; see `lookdev.material.usd.reader.node_category`."""
