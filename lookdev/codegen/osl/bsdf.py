"""The lobes of a model as OSL: what is computed once a shading point, once a direction, once a sample.

The emitted fragments share names with the shaders that include them (`lookdev/shaders/*.osl`):

- setup reads ``wo_x wo_y wo_z`` and the inputs, and defines what does not depend on the light's direction;
- evaluate reads ``wi_x wi_y wi_z`` and sets ``color f``, the BSDF times the cosine of each lobe, and ``float pdf``;
- sample reads ``u1 u2`` and sets ``wi_x wi_y wi_z``.

Where some lobes are aided by directions of the light, evaluate also sets ``float unaided_pdf``, the part of the others,
and sample ``int aided``, whether it drew from one of them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lookdev.brdf import Bsdf
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.lobes import Directions, Lobe
from lookdev.brdf.vectors import same, scale
from lookdev.codegen.osl.block import Block
from lookdev.codegen.trace.graph import Graph, Node, depends_on, in_order, reachable
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols

WO = ("wo_x", "wo_y", "wo_z")
WI = ("wi_x", "wi_y", "wi_z")
VARYING = frozenset((*WI, "u1", "u2"))


@dataclass(frozen=True)
class TracedLobe:
    """The scalar expressions of one lobe; `share` is a constant where the lobe is there everywhere.

    `f` is times the cosine; `wi` is in the surface's frame. An `aided` lobe may leave light that meets nothing on its
    way to directions of the light.
    """

    name: str
    transmits: bool
    broad: bool
    share: Any
    f: tuple[Any, ...]
    pdf: Any
    wi: tuple[Any, ...]
    aided: bool = False


@dataclass(frozen=True)
class BrdfCode:
    """Emitted fragments, a list of lines each, and the run-time symbols they read.

    `transmits` where light can come from the back; `see_through` where setup defines a ``float presence``; `aids` where
    some lobes are aided by directions of the light.
    """

    setup: tuple[str, ...]
    evaluate: tuple[str, ...]
    sample: tuple[str, ...]
    inputs: frozenset[str]
    transmits: bool
    see_through: bool
    aids: bool


def trace_lobes(
    graph: Graph, bsdf: Bsdf, keep: Callable[[Lobe], bool] = lambda lobe: True, broad_share: float = 1.0
) -> tuple[TracedLobe, ...]:
    """Trace the lobes of a BSDF that are to be kept; those whose share folds to zero vanish, with all they read.

    Broad lobes get `broad_share` times their share.
    """
    wo, wi = symbols(graph, WO), symbols(graph, WI)
    u1, u2 = symbol(graph, "u1"), symbol(graph, "u2")
    traced = []
    for lobe in bsdf.lobes(wo):
        (share,) = elements_of(lobe.share * broad_share if lobe.broad else lobe.share)
        if keep(lobe) and (isinstance(share, Node) or share > 0.0):
            directions = Directions.of(*lobe.pair(wo, wi))
            # A shader evaluates on the lobe's side of the surface only: a normal of the lobe's own leans out of it, and
            # was bent towards a grazing view by less than float32 knows.
            valid: Any = True
            if not same(lobe.normal, ZENITH):
                valid = (directions.cos_theta_i > 0.0) & (directions.cos_theta_o > 0.0)
            f = scale(lobe.evaluate(directions), np.where(valid, directions.cos_theta_i, 0.0))
            (pdf,) = elements_of(np.where(valid, lobe.pdf(directions), 0.0))
            wi_drawn = tuple(elements_of(lobe.draw(u1, u2)))
            traced.append(
                TracedLobe(lobe.name, lobe.transmits, lobe.broad, share, tuple(elements_of(f)), pdf, wi_drawn)
            )
    return tuple(traced)


def emit_brdf(lobes: Sequence[TracedLobe], presence: Any = 1.0) -> BrdfCode:
    """Write the three fragments for traced lobes, and the presence, a scalar, where it is not 1."""
    see_through = isinstance(presence, Node) or presence < 1.0
    values = [value for lobe in lobes for value in (*lobe.f, lobe.pdf, *lobe.wi)]
    varying = depends_on(values, VARYING)
    invariant = _frontier(values, varying)

    setup = Block("s", indent=1)
    setup.prepare([*(lobe.share for lobe in lobes), *invariant, presence])
    for index, lobe in enumerate(lobes):
        setup.write(f"float share_{index} = {setup.expression(lobe.share)};  // {lobe.name}")
    setup.write(f"float shares = {' + '.join(f'share_{i}' for i in range(len(lobes))) or '0'};")
    if see_through:
        setup.write(f"float presence = {setup.expression(presence)};")
    for node in invariant:
        setup.name(node)

    read = reachable([*values, *(lobe.share for lobe in lobes), presence])
    inputs = {str(node.args[0]) for node in read if node.op == "symbol"} - VARYING - set(WO)
    return BrdfCode(
        setup=tuple(setup.lines),
        evaluate=tuple(_evaluate(lobes, setup, varying)),
        sample=tuple(_sample(lobes, setup)),
        inputs=frozenset(inputs),
        transmits=any(lobe.transmits for lobe in lobes),
        see_through=see_through,
        aids=any(lobe.aided for lobe in lobes),
    )


def _frontier(values: Iterable[Any], varying: set[Node]) -> list[Node]:
    """Return the nodes to compute once a shading point: invariant operands of varying nodes, in a stable order."""
    roots = [value for value in values if isinstance(value, Node)]
    operands = [operand for node in in_order(roots, lambda node: node not in varying) for operand in node.operands()]
    return [node for node in dict.fromkeys([*roots, *operands]) if node not in varying and node.op != "symbol"]


def _evaluate(lobes: Sequence[TracedLobe], setup: Block, varying: set[Node]) -> Iterable[str]:
    """Sum the lobes of the side that the light is on."""
    sides = {transmits: [lobe for lobe in lobes if lobe.transmits is transmits] for transmits in (False, True)}
    shares = {id(lobe): f"share_{index}" for index, lobe in enumerate(lobes)} if len(lobes) > 1 else {}
    outer = Block("", indent=2)
    outer.write("color f = 0;")
    outer.write("float pdf = 0;")
    aids = any(lobe.aided for lobe in lobes)
    if aids:
        outer.write("float unaided_pdf = 0;")
    both = all(sides.values())
    for transmits, members in sides.items():
        if members:
            if both or transmits:
                outer.write("if (wi_z < 0) {" if transmits else "if (wi_z > 0) {")
            outer.lines += _evaluate_side(members, shares, aids, setup, varying, "t" if transmits else "e", 2 + both)
            if both or transmits:
                outer.write("}")
    if len(lobes) > 1:
        outer.write("pdf /= shares;")
        if aids:
            outer.write("unaided_pdf /= shares;")
    return outer.lines


def _evaluate_side(
    lobes: Sequence[TracedLobe],
    shares: Mapping[int, str],
    aids: bool,
    setup: Block,
    varying: set[Node],
    prefix: str,
    indent: int,
) -> Iterable[str]:
    """Sum lobes; what two of them share is computed before, a lobe's own part under a guard on its share."""
    groups = [reachable((*lobe.f, lobe.pdf), stop=setup.named) for lobe in lobes]
    counts = Counter(node for group in groups for node in group)
    shared = {
        node
        for node, count in counts.items()
        if count > 1 and node.op != "symbol" and node in varying and node not in setup.named
    }
    # Only those that a lobe's own part uses directly: the rest is reached through them.
    direct: dict[Node, None] = {}
    for lobe, group in zip(lobes, groups, strict=True):
        roots = [value for value in (*lobe.f, lobe.pdf) if isinstance(value, Node)]
        own = [node for node in group if node not in shared]
        operands = [operand for node in own for operand in node.operands()]
        direct |= dict.fromkeys(node for node in (*roots, *operands) if node in shared)
    ordered = sorted(direct, key=lambda node: len(reachable([node])))

    outer = Block(prefix, indent, named=setup.named)
    outer.prepare(ordered)
    for node in ordered:
        outer.name(node)
    for index, lobe in enumerate(lobes):
        share = shares.get(id(lobe))
        inner = Block(f"{prefix}{index}_", indent + 1, named=outer.named)
        inner.prepare([*lobe.f, lobe.pdf])
        color = ", ".join(inner.expression(value) for value in lobe.f)
        density = inner.expression(lobe.pdf)
        # A scope of its own for each lobe, an `if` where the lobe may be absent at this point.
        guarded = isinstance(lobe.share, Node)
        outer.write(f"if ({share or 'share_0'} > 0) {{  // {lobe.name}" if guarded else f"{{  // {lobe.name}")
        outer.lines += inner.lines
        outer.write(f"    f += color({color});")
        if share:
            density = f"{share} * {density}"
        if aids and not lobe.aided:
            outer.write(f"    float own_pdf = {density};")
            outer.write("    unaided_pdf += own_pdf;")
            density = "own_pdf"
        outer.write(f"    pdf += {density};" if share else f"    pdf = {density};")
        outer.write("}")
    return outer.lines


def _sample(lobes: Sequence[TracedLobe], setup: Block) -> Iterable[str]:
    """Choose a lobe by u1, stretch u1 over its share, sample it."""
    outer = Block("", indent=3)
    if len(lobes) > 1:
        outer.write("u1 *= shares;")
    for index, lobe in enumerate(lobes):
        inner = Block(f"d{index}_", indent=4, named=setup.named)
        if len(lobes) > 1:
            upto = " + ".join(f"share_{k}" for k in range(index + 1))
            before = "".join(f" - share_{k}" for k in range(index))
            branch = "else " * (index > 0) + f"if (u1 < {upto}) " * (index < len(lobes) - 1)
            outer.write(f"{branch}{{  // {lobe.name}")
            # Rounding may carry the number to the very end of the share, which stands for 1.
            inner.write(f"u1 = clamp((u1{before}) / share_{index}, 0, 0.99999994);")
        else:
            outer.write(f"{{  // {lobe.name}")
        inner.prepare(lobe.wi)
        wi = [inner.expression(value) for value in lobe.wi]
        for name, code in zip(WI, wi, strict=True):
            inner.write(f"{name} = {code};")
        if lobe.aided:
            inner.write("aided = 1;")
        outer.lines += inner.lines
        outer.write("}")
    return outer.lines
