"""The lobes of a model as OSL: what is computed once a shading point, once a direction, once a sample.

The emitted fragments share names with the shaders that include them (`lookdev/shaders/*.osl`):

- setup reads ``wo_x wo_y wo_z`` and the inputs, and defines what does not depend on the light's direction;
- evaluate reads ``wi_x wi_y wi_z`` and sets ``color f`` and ``float pdf``;
- sample reads ``u1 u2`` and sets ``wi_x wi_y wi_z``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from lookdev.brdf.lobes import Directions, Lobe
from lookdev.codegen.graph import Graph, Node
from lookdev.codegen.osl import Block, depends_on, reachable
from lookdev.codegen.symbolic import elements_of, symbol, symbols

WO = ("wo_x", "wo_y", "wo_z")
WI = ("wi_x", "wi_y", "wi_z")
VARYING = frozenset((*WI, "u1", "u2"))


@dataclass(frozen=True)
class TracedLobe:
    """The scalar expressions of one lobe; `share` is a constant where the lobe is there everywhere."""

    name: str
    share: Any
    f: tuple[Any, ...]
    pdf: Any
    wi: tuple[Any, ...]


@dataclass(frozen=True)
class BrdfCode:
    """Emitted fragments, a list of lines each, and the run-time symbols they read."""

    setup: tuple[str, ...]
    evaluate: tuple[str, ...]
    sample: tuple[str, ...]
    inputs: frozenset[str]


def trace_lobes(graph: Graph, lobes: Sequence[Lobe]) -> tuple[TracedLobe, ...]:
    """Trace the lobes of a model; those whose share folds to zero vanish, with all they read."""
    wo, wi = symbols(graph, WO), symbols(graph, WI)
    u1, u2 = symbol(graph, "u1"), symbol(graph, "u2")
    directions = Directions.of(wo, wi)
    traced = []
    for lobe in lobes:
        (share,) = elements_of(lobe.selection(wo))
        if isinstance(share, Node) or share > 0.0:
            f = tuple(elements_of(lobe.evaluate(directions)))
            (pdf,) = elements_of(lobe.pdf(directions))
            traced.append(TracedLobe(lobe.name, share, f, pdf, tuple(elements_of(lobe.sample(wo, u1, u2)))))
    return tuple(traced)


def emit_brdf(lobes: Sequence[TracedLobe]) -> BrdfCode:
    """Write the three fragments for traced lobes."""
    values = [value for lobe in lobes for value in (*lobe.f, lobe.pdf, *lobe.wi)]
    varying = depends_on(values, VARYING)
    invariant = _frontier(values, varying)

    setup = Block("s", indent=1)
    setup.prepare([*(lobe.share for lobe in lobes), *invariant])
    for index, lobe in enumerate(lobes):
        setup.write(f"float share_{index} = {setup.expression(lobe.share)};  // {lobe.name}")
    setup.write(f"float shares = {' + '.join(f'share_{i}' for i in range(len(lobes))) or '0'};")
    for node in invariant:
        setup.name(node)

    read = reachable([*values, *(lobe.share for lobe in lobes)])
    inputs = {str(node.args[0]) for node in read if node.op == "symbol"} - VARYING - set(WO)
    return BrdfCode(
        setup=tuple(setup.lines),
        evaluate=tuple(_evaluate(lobes, setup, varying)),
        sample=tuple(_sample(lobes, setup)),
        inputs=frozenset(inputs),
    )


def _frontier(values: Iterable[Any], varying: set[Node]) -> list[Node]:
    """Return the nodes to compute once a shading point: invariant operands of varying nodes, in a stable order."""
    found: dict[Node, None] = {}
    seen: set[Node] = set()

    def visit(node: Node) -> None:
        if node in seen:
            return
        seen.add(node)
        if node not in varying:
            if node.op != "symbol":
                found[node] = None
            return
        for operand in node.operands():
            visit(operand)

    for value in values:
        if isinstance(value, Node):
            visit(value)
    return list(found)


def _evaluate(lobes: Sequence[TracedLobe], setup: Block, varying: set[Node]) -> Iterable[str]:
    """Sum all lobes; what two of them share is computed before, a lobe's own part under a guard on its share."""
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

    outer = Block("e", indent=2, named=setup.named)
    outer.prepare(ordered)
    outer.write("color f = 0;")
    outer.write("float pdf = 0;")
    for node in ordered:
        outer.name(node)
    for index, lobe in enumerate(lobes):
        guarded = isinstance(lobe.share, Node)
        inner = Block(f"l{index}_", indent=3, named=outer.named)
        inner.prepare([*lobe.f, lobe.pdf])
        color = ", ".join(inner.expression(value) for value in lobe.f)
        density = inner.expression(lobe.pdf)
        # A scope of its own for each lobe, an `if` where the lobe may be absent at this point.
        outer.write(f"if (share_{index} > 0) {{  // {lobe.name}" if guarded else f"{{  // {lobe.name}")
        outer.lines += inner.lines
        outer.write(f"    f += color({color});")
        outer.write(f"    pdf += share_{index} * {density};" if len(lobes) > 1 else f"    pdf = {density};")
        outer.write("}")
    if len(lobes) > 1:
        outer.write("pdf /= shares;")
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
        outer.lines += inner.lines
        outer.write("}")
    return outer.lines
