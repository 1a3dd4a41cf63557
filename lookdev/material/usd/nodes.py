"""The nodes of foreign networks, by category: what MaterialX's standard library defines, as far as expressions have it.

- MaterialX Specification 1.39: Math, Adjustment, Compositing, Conditional and Channel nodes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from lookdev.material.look import Bump, Texture
from lookdev.material.usd import sampling
from lookdev.material.usd.reader import Node
from lookdev.material.usd.terms import Term, Unread, constant, passed

SOBEL = 1.0 / 16.0
"""What heighttonormal multiplies slopes by: mx_heighttonormal of the MaterialX library."""


class _Formula(NamedTuple):
    """An expression of inputs with their defaults; `linear` are those in each of which it is a straight line."""

    text: str
    defaults: dict[str, float]
    linear: tuple[str, ...] = ()


_PAIR = {"in1": 0.0, "in2": 0.0}
_FACTORS = {"in1": 0.0, "in2": 1.0}
_IN = {"in": 0.0}
_BLEND = {"fg": 0.0, "bg": 0.0, "mix": 1.0}
_RANGE = {"in": 0.0, "inlow": 0.0, "inhigh": 1.0, "outlow": 0.0, "outhigh": 1.0}
_CHOICE = {"value1": 1.0, "value2": 0.0, **_PAIR}

_FORMULAS = {
    "add": _Formula("{in1} + {in2}", _PAIR, ("in1", "in2")),
    "subtract": _Formula("{in1} - {in2}", _PAIR, ("in1", "in2")),
    "multiply": _Formula("{in1} * {in2}", _FACTORS, ("in1", "in2")),
    "divide": _Formula("{in1} / {in2}", _FACTORS, ("in1",)),
    "modulo": _Formula("{in1} % {in2}", _FACTORS),
    "power": _Formula("{in1} ^ {in2}", _FACTORS),
    "min": _Formula("min({in1}, {in2})", _PAIR),
    "max": _Formula("max({in1}, {in2})", _PAIR),
    "absval": _Formula("abs({in})", _IN),
    "floor": _Formula("floor({in})", _IN),
    "ceil": _Formula("ceil({in})", _IN),
    "round": _Formula("round({in})", _IN),
    "fract": _Formula("fract({in})", _IN),
    "sqrt": _Formula("sqrt({in})", _IN),
    "exp": _Formula("exp({in})", _IN),
    "ln": _Formula("log({in})", {"in": 1.0}),
    "sin": _Formula("sin({in})", _IN),
    "cos": _Formula("cos({in})", _IN),
    "tan": _Formula("tan({in})", _IN),
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
    "ifgreater": _Formula("{value1} > {value2} ? {in1} : {in2}", _CHOICE),
    "ifgreatereq": _Formula("{value1} >= {value2} ? {in1} : {in2}", _CHOICE),
    "ifequal": _Formula("{value1} == {value2} ? {in1} : {in2}", _CHOICE),
}


def _formula(entry: _Formula) -> Callable[[Node], Term]:
    def read(node: Node) -> Term:
        operands = {name: node.any_term(name, default) for name, default in entry.defaults.items()}
        return node.terms.apply(entry.text, operands, entry.linear)

    return read


def _constant(node: Node) -> Term:
    return node.any_term("value", *[0.0] * node.width)


def _passed_on(node: Node) -> Term:
    node.ignore("note")
    return node.any_term("in", 0.0)


def _convert(node: Node) -> Term:
    term = node.any_term("in", 0.0)
    return replace(passed(term, node.width), tangent=term.tangent)


def _extract(node: Node) -> Term:
    return node.terms.channel(node.any_term("in", 0.0), int(node.numbers("index", 0.0)[0]))


def _separate(node: Node) -> Term:
    return _by_letters(node, node.any_term("in", 0.0), node.output.removeprefix("out"))


def _swizzle(node: Node) -> Term:
    return _by_letters(node, node.any_term("in", 0.0), node.text("channels", ""))


def _by_letters(node: Node, term: Term, letters: str) -> Term:
    """Return the channels that letters name, ``rgba`` or ``xyzw``; 0 and 1 are themselves."""
    if not 1 <= len(letters) <= 4 or not set(letters) <= set("rgbaxyzw01"):
        raise Unread(f"'{letters:.40}' are no channels")
    if letters in ("rgb", "xyz", "xy") and len(letters) == term.width:
        return passed(term, term.width)
    channels = [
        constant(float(letter)) if letter in "01" else node.terms.channel(term, "rgbaxyzw".index(letter) % 4)
        for letter in letters
    ]
    return channels[0] if len(channels) == 1 else node.terms.joined(*channels)


def _combine(node: Node) -> Term:
    count = int(node.identifier.removeprefix("ND_combine")[0])
    parts = [node.any_term(f"in{number}", 0.0) for number in range(1, count + 1)]
    channels = [node.terms.channel(part, index) for part in parts for index in range(4 if part.alpha else part.width)]
    if not 2 <= len(channels) <= 4:
        raise Unread(f"combines {len(channels)} channels")
    return node.terms.joined(*channels)


def _switch(node: Node) -> Term:
    which = int(node.numbers("which", 0.0)[0])
    node.ignore(*(f"in{number}" for number in range(1, 11)))
    return node.any_term(f"in{which + 1}", 0.0) if 0 <= which < 10 else constant(0.0)


def _range(node: Node) -> Term:
    (gamma,), (clamped,) = node.numbers("gamma", 1.0), node.numbers("doclamp", 0.0)
    value = node.any_term("in", 0.0)
    low, high, out_low, out_high = (node.any_term(name, default) for name, default in _RANGE.items() if name != "in")
    if gamma == 1.0:
        terms = {"in": value, "inlow": low, "inhigh": high, "outlow": out_low, "outhigh": out_high}
        value = node.terms.apply(_FORMULAS["remap"].text, terms, ("in",))
    else:
        text = "{outlow} + ({outhigh} - {outlow}) * fit({in}, {inlow}, {inhigh}, 0, 1) ^ {power}"
        terms = {"in": value, "inlow": low, "inhigh": high, "outlow": out_low, "outhigh": out_high}
        value = node.terms.apply(text, {**terms, "power": constant(1.0 / gamma if gamma else 0.0)})
    return (
        node.terms.apply("clamp({a}, {low}, {high})", {"a": value, "low": out_low, "high": out_high})
        if clamped
        else value
    )


_LUMA = (0.2722287, 0.6740818, 0.0536895)  # of ACEScg: MaterialX's default


def _gray(node: Node, color: Term) -> Term:
    weights = node.numbers("lumacoeffs", *_LUMA)
    return _weighted(node, color, *map(constant, weights))


def _weighted(node: Node, color: Term, *weights: Term) -> Term:
    """Return the sum of channels times weights."""
    total = constant(0.0)
    for index, weight in enumerate(weights):
        channel = node.terms.channel(color, index)
        product = node.terms.apply("{a} * {b}", {"a": channel, "b": weight}, ("a", "b"))
        total = product if index == 0 else node.terms.apply("{a} + {b}", {"a": total, "b": product})
    return total


def _luminance(node: Node) -> Term:
    color = node.any_term("in", 0.0, 0.0, 0.0)
    gray = passed(_gray(node, color), 3)
    return replace(gray, alpha=color.alpha)


def _saturate(node: Node) -> Term:
    color, amount = node.any_term("in", 0.0, 0.0, 0.0), node.term("amount", 1, 1.0)
    gray = _gray(node, color)
    return node.terms.apply("mix({gray}, {color}, {amount})", {"color": color, "gray": gray, "amount": amount})


def _dot_product(node: Node) -> Term:
    a, b = node.any_term("in1", 0.0, 0.0), node.any_term("in2", 0.0, 0.0)
    return _weighted(node, a, *(node.terms.channel(b, index) for index in range(min(a.width, b.width))))


def _magnitude(node: Node) -> Term:
    vector = node.any_term("in", 0.0, 0.0)
    squares = _weighted(node, vector, *(node.terms.channel(vector, index) for index in range(vector.width)))
    return node.terms.apply("sqrt({a})", {"a": squares})


def _normalize(node: Node) -> Term:
    vector = node.any_term("in", 0.0, 0.0)
    if vector.tangent:  # a normal may have any length
        return vector
    return node.terms.apply("{a} / {b}", {"a": vector, "b": _magnitude(node)})


def _ramp(low: str, high: str, axis: int) -> Callable[[Node], Term]:
    def read(node: Node) -> Term:
        place = node.terms.channel(sampling.coordinates(node, "texcoord"), axis)
        ends = {"low": node.any_term(low, 0.0), "high": node.any_term(high, 0.0)}
        return node.terms.apply("mix({low}, {high}, clamp({place}, 0, 1))", {"place": place, **ends})

    return read


def _split(low: str, high: str, axis: int) -> Callable[[Node], Term]:
    def read(node: Node) -> Term:
        place = node.terms.channel(sampling.coordinates(node, "texcoord"), axis)
        ends = {"low": node.any_term(low, 0.0), "high": node.any_term(high, 0.0), "center": node.term("center", 1, 0.5)}
        return node.terms.apply("mix({low}, {high}, boxstep({place}, {center}))", {"place": place, **ends})

    return read


def _noise(node: Node) -> Term:
    """Our noise is of the same scale and range; its pattern is another."""
    uv = sampling.coordinates(node, "texcoord")
    x, y = (node.terms.channel(uv, index) for index in (0, 1))
    node.reader.network.fault(node.path, f"{node.identifier} has another pattern here, of the same scale")
    if node.identifier.startswith("ND_cellnoise"):
        return node.terms.apply("cellnoise({x}, {y})", {"x": x, "y": y})
    amplitude, pivot = node.any_term("amplitude", 1.0), node.any_term("pivot", 0.0)
    value = node.terms.apply("2 * noise({x}, {y}) - 1", {"x": x, "y": y})
    scaled = node.terms.apply(
        "{value} * {amplitude} + {pivot}", {"value": value, "amplitude": amplitude, "pivot": pivot}
    )
    return passed(scaled, node.width)


def _normal_map(node: Node) -> Term:
    if (space := node.text("space", "tangent")) != "tangent":
        raise Unread(f"a normal map in {space:.40} space is not supported, only one in tangent space")
    scale = node.any_term("scale", 1.0)
    if isinstance((encoded := node.any_term("in", 0.5, 0.5, 1.0)).leaf, Bump):  # heighttonormal
        return _scaled_bump(node, encoded, scale)
    return sampling.tangent_normal(node, encoded, scale)


def _bump(node: Node) -> Term:
    return _scaled_bump(node, _height(node, node.term("height", 1, 0.0), 1.0), node.any_term("scale", 1.0))


def _height_to_normal(node: Node) -> Term:
    node.ignore("texcoord")
    (scale,) = node.numbers("scale", 1.0)
    return _height(node, node.term("in", 1, 0.0), scale)


def _height(node: Node, height: Term, scale: float) -> Term:
    if height.numbers is not None:
        return replace(constant(0.0, 0.0, 1.0), tangent=True)
    if not isinstance(height.leaf, Texture):
        raise Unread("only one channel of an image has a slope")
    return replace(node.terms.leaf(Bump(height.leaf, scale * SOBEL), 3, node.name), tangent=True)


def _scaled_bump(node: Node, bump: Term, scale: Term) -> Term:
    if not isinstance(bump.leaf, Bump):
        return bump
    if scale.numbers is None or len(set(scale.numbers)) != 1:
        raise Unread("the scale of a bump is not one constant")
    return replace(
        node.terms.leaf(replace(bump.leaf, scale=bump.leaf.scale * scale.numbers[0]), 3, node.name), tangent=True
    )


NODES: dict[str, Callable[[Node], Term]] = {
    **{name: _formula(entry) for name, entry in _FORMULAS.items()},
    **{f"UsdPrimvarReader{kind}": sampling.primvar for kind in ("", "_int", "_normal", "_point", "_vector")},
    **{f"UsdPrimvarReader{kind}": sampling.primvar for kind in ("_string", "_matrix")},
    "UsdTransform2d": sampling.transform2d,
    "UsdUVTexture": sampling.uv_texture,
    "bump": _bump,
    "cellnoise2d": _noise,
    "combine2": _combine,
    "combine3": _combine,
    "combine4": _combine,
    "constant": _constant,
    "convert": _convert,
    "dot": _passed_on,
    "dotproduct": _dot_product,
    "extract": _extract,
    "geompropvalue": sampling.primvar,
    "gltf_colorimage": sampling.gltf_image,
    "gltf_image": sampling.gltf_image,
    "gltf_normalmap": sampling.gltf_image,
    "heighttonormal": _height_to_normal,
    "image": sampling.image,
    "luminance": _luminance,
    "magnitude": _magnitude,
    "noise2d": _noise,
    "normalize": _normalize,
    "normalmap": _normal_map,
    "place2d": sampling.place2d,
    "ramplr": _ramp("valuel", "valuer", 0),
    "ramptb": _ramp("valueb", "valuet", 1),
    "range": _range,
    "rotate2d": sampling.rotate2d,
    "saturate": _saturate,
    "separate2": _separate,
    "separate3": _separate,
    "separate4": _separate,
    "splitlr": _split("valuel", "valuer", 0),
    "splittb": _split("valueb", "valuet", 1),
    "swizzle": _swizzle,
    "switch": _switch,
    "texcoord": sampling.texcoord,
    "tiledimage": sampling.tiled_image,
}
"""The reader of each node, by its category."""
