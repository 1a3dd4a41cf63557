"""A mixture of lobes as OSL: what is computed once a shading point, once a direction, once a sample.

The emitted fragments share names with the shaders that include them (`lookdev/shaders/*.osl`):

- setup reads ``wo_x wo_y wo_z`` and the inputs, and defines what does not depend on the light's direction; where terms
  scatter along single directions, it reads ``inside``, too, and sets ``vector delta_wi[]`` and ``color delta_f[]``;
- evaluate reads ``wi_x wi_y wi_z`` and sets ``color f``, the BSDF times the cosine of each lobe, and ``float pdf``;
- sample reads ``u1 u2`` and sets ``wi_x wi_y wi_z``.

Unoccluded light on a light-sampled lobe is estimated by directions of the light alone. Where a mixture has such lobes,
evaluate also sets ``float bsdf_sampled_pdf``, the part of the other lobes in ``pdf``, and sample sets ``int
light_sampled`` where it draws from a light-sampled lobe. On request, evaluate also sets ``color f_diffuse``, the part
of ``f`` that is of the group ``"diffuse"``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from lookdev.brdf import Array, Delta, Lobe
from lookdev.brdf.mixture import Term
from lookdev.brdf.table import Table
from lookdev.brdf.vectors import scale
from lookdev.codegen.osl.block import Block, Spell, bare, by_name
from lookdev.codegen.source import LOBE_GROUPS
from lookdev.codegen.trace.graph import Graph, Node, Scalar, dependent_nodes, post_order, reachable
from lookdev.codegen.trace.lobes import INSIDE, WI, WO, trace_mixture
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols

VARYING = frozenset((*WI, "u1", "u2"))


@dataclass(frozen=True)
class TracedLobe:
    """The scalar expressions of one lobe of a mixture.

    `value` (3) and `density` are those of `Term`, `below` that of `Choice`; `wi` (3) is the direction drawn, in the
    surface's frame. `share` is a constant where the lobe is present at every point. Code of a lobe runs where `side`
    holds, or, where that is None, on its side of the shading normal.
    """

    name: str
    transmits: bool
    side: Node | None
    share: Scalar
    value: tuple[Scalar, ...]
    density: Scalar
    below: Scalar
    wi: tuple[Scalar, ...]
    light_sampled: bool
    group: str
    parts: tuple[tuple[str, tuple[Scalar, ...]], ...] = ()  # of `value`, by other groups

    @property
    def diffuse(self) -> bool:
        """Whether lights' factors of diffuse lobes apply."""
        return self.group == "diffuse"

    @property
    def recorded(self) -> str:
        """The group of `LOBE_GROUPS` that its light is recorded as, but for its parts."""
        return "transmission" if self.transmits else self.group

    def evaluated(self) -> tuple[Scalar, ...]:
        """Return what is computed for each direction of the light."""
        return (*self.value, self.density, *(each for _, part in self.parts for each in part))


@dataclass(frozen=True)
class BrdfCode:
    """Emitted fragments, a list of lines each, and the run-time symbols and tables they read.

    `transmits` where light can come from the back; `crosses` where lobes lean across the horizon; `see_through` where
    setup defines a ``float presence``; `light_sampled` where some lobes are.
    """

    setup: tuple[str, ...]
    evaluate: tuple[str, ...]
    sample: tuple[str, ...]
    inputs: frozenset[str]
    tables: tuple[Table, ...]
    transmits: bool
    crosses: bool
    see_through: bool
    light_sampled: bool
    deltas: tuple[Delta, ...] = ()
    features: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()  # of `LOBE_GROUPS`, of all lobes and deltas

    @property
    def sections(self) -> dict[str, Sequence[str]]:
        """The fragments by their names in templates."""
        return {"setup": self.setup, "evaluate": self.evaluate, "sample": self.sample, "features": self.features}


@dataclass(frozen=True)
class TracedMixture:
    """The scalar expressions of a mixture: its lobes, the sum of their shares, and its densities by name.

    A density is normalised from the sum of the lobes' densities, a symbol of the same name.
    """

    lobes: tuple[TracedLobe, ...]
    total: Scalar
    densities: Mapping[str, Scalar]


def trace_lobes(
    graph: Graph,
    lobes: Sequence[Lobe],
    light_sampled: Callable[[Lobe], bool] = lambda lobe: False,
    *,
    recorded: bool = False,
) -> TracedMixture:
    """Trace the mixture of lobes at the symbols ``wo_x wo_y wo_z wi_x wi_y wi_z u1 u2``, `recorded` with parts."""
    mixture, wi = trace_mixture(graph, lobes), symbols(graph, WI)
    # A lobe's code runs where the light is on its side.
    sides = [_side(lobe, mixture.wo, wi) for lobe in lobes]
    for condition in (*elements_of(wi[..., 2] > 0.0), *elements_of(wi[..., 2] < 0.0), *sides):
        if condition is not None:
            graph.assume(condition)
    terms, choices = mixture.terms(wi), mixture.choices(symbol(graph, "u1"))
    traced = tuple(
        TracedLobe(
            lobe.name,
            lobe.transmits,
            side,
            elements_of(lobe.share)[0],
            value=tuple(elements_of(term.value)),
            density=elements_of(term.density)[0],
            below=elements_of(choice.below)[0],
            wi=tuple(elements_of(lobe.draw(choice.stretched, symbol(graph, "u2")))),
            light_sampled=light_sampled(lobe),
            group=lobe.group,
            parts=tuple(_parts(term)) if recorded and not lobe.transmits else (),
        )
        for lobe, side, term, choice in zip(lobes, sides, terms, choices, strict=True)
    )
    sums = ("pdf", "bsdf_sampled_pdf") if any(lobe.light_sampled for lobe in traced) else ("pdf",)
    densities = {name: elements_of(mixture.normalised(symbol(graph, name)))[0] for name in sums}
    return TracedMixture(traced, elements_of(mixture.total)[0], densities)


def _parts(term: Term) -> Iterator[tuple[str, tuple[Scalar, ...]]]:
    """Yield the parts of a lobe's value that do not fold to 0."""
    for group, evaluate in term.lobe.parts.items():
        f = scale(evaluate(term.directions), term.lobe.weight)
        part = tuple(elements_of(replace(term, f=f).value))
        if any(isinstance(each, Node) or each > 0.0 for each in part):
            yield group, part


def _side(lobe: Lobe, wo: Array, wi: Array) -> Node | None:
    """Return the condition under which a lobe that crosses the horizon is not 0; None for any other lobe."""
    if not lobe.crosses:
        return None
    local_o, local_i = lobe.pair(wo, wi)
    side: Node
    (side,) = elements_of((local_o[..., 2] > 0.0) & (local_i[..., 2] > 0.0))
    return side


def emit_brdf(
    mixture: TracedMixture,
    presence: Scalar = 1.0,
    spell: Spell = by_name,
    *,
    by_group: bool = False,
    recorded: bool = False,
    deltas: Sequence[Delta] = (),
    features: Mapping[str, Sequence[Scalar]] | None = None,
) -> BrdfCode:
    """Write the three fragments of a mixture, and the presence where it is not 1; `spell` is called as of `Block`.

    `by_group`: evaluate sets ``f_diffuse``. `recorded`: it sets ``f_lobe[]``, and ``f_lobe_diffuse[]``, by the groups
    that the code has in the order of `LOBE_GROUPS`, and setup sets ``int delta_group[]``. `features` are triples of
    numbers that depend on the view alone, by the names of the colours that they become in a fragment of their own.
    """
    lobes = mixture.lobes
    see_through = isinstance(presence, Node) or presence < 1.0
    values = [value for lobe in lobes for value in (*lobe.evaluated(), *lobe.wi, lobe.below)]
    values += [lobe.side for lobe in lobes if lobe.side is not None]
    varying = dependent_nodes(values, VARYING)
    invariant = _frontier(values, varying)

    setup = Block("s", indent=1, spell=spell)
    triples = [
        (f"{name}[{number}] = {kind}", elements_of(value))
        for number, delta in enumerate(deltas)
        for name, kind, value in (("delta_wi", "vector", delta.direction), ("delta_f", "color", delta.value))
    ]
    followed = [each for _, triple in triples for each in triple]
    setup.prepare([*(lobe.share for lobe in lobes), *invariant, presence, *followed])
    for index, lobe in enumerate(lobes):
        setup.define(f"share_{index}", lobe.share, comment=lobe.name)
    setup.define("shares", mixture.total)
    if see_through:
        setup.write(f"float presence = {setup.expression(presence)};")
    for node in invariant:
        setup.name(node)
    for assigned, triple in triples:
        setup.write(f"{assigned}({', '.join(map(setup.expression, triple))});")

    if recorded:
        for number, delta in enumerate(deltas):
            setup.write(f"delta_group[{number}] = {LOBE_GROUPS.index(_delta_group(delta))};")
    others = [each for triple in (features or {}).values() for each in triple]
    shown = setup.inner("a", indent=2)
    shown.prepare(others)
    for name, feature in (features or {}).items():
        shown.write(f"color {name} = color({', '.join(map(shown.expression, feature))});")

    found = {*_groups(lobes), *map(_delta_group, deltas)} if recorded else ()
    places = {group: place for place, group in enumerate(sorted(found, key=LOBE_GROUPS.index))}
    read = reachable([*values, *(lobe.share for lobe in lobes), presence, *followed, *others])
    inputs = {str(node.args[0]) for node in read if node.op == "symbol"} - VARYING - {*WO, INSIDE}
    tables = {node.args[0].digest: node.args[0] for node in read if node.op == "look_up"}
    return BrdfCode(
        setup=tuple(setup.lines),
        evaluate=tuple(_evaluate(mixture, setup, varying, by_group, places)),
        sample=tuple(_sample(lobes, setup)),
        inputs=frozenset(inputs),
        tables=tuple(tables.values()),
        transmits=any(lobe.transmits for lobe in lobes),
        crosses=any(lobe.side is not None for lobe in lobes),
        see_through=see_through,
        light_sampled=any(lobe.light_sampled for lobe in lobes),
        deltas=tuple(deltas),
        features=tuple(shown.lines),
        groups=(*_groups(lobes), *map(_delta_group, deltas)),
    )


def _groups(lobes: Iterable[TracedLobe]) -> list[str]:
    """Return the groups of lobes and of their parts."""
    return [group for lobe in lobes for group in (lobe.recorded, *(name for name, _ in lobe.parts))]


def _delta_group(delta: Delta) -> str:
    return "transmission" if delta.transmits else "specular"


def _frontier(values: Iterable[Scalar], varying: set[Node]) -> list[Node]:
    """Return the nodes to compute once a shading point: invariant operands of varying nodes, in a stable order."""
    roots = [value for value in values if isinstance(value, Node)]
    operands = [operand for node in post_order(roots, lambda node: node not in varying) for operand in node.operands()]
    return [node for node in dict.fromkeys([*roots, *operands]) if node not in varying and node.op != "symbol"]


def _evaluate(
    mixture: TracedMixture, setup: Block, varying: set[Node], by_group: bool, recorded: Mapping[str, int]
) -> Iterable[str]:
    """Sum the lobes of the side that the light is on; `recorded` are the places of groups in ``f_lobe``, if any."""
    split = len(mixture.densities) > 1
    sides: dict[bool | Node, list[TracedLobe]] = {False: [], True: []}
    for lobe in mixture.lobes:
        sides.setdefault(lobe.transmits if lobe.side is None else lobe.side, []).append(lobe)
    outer = setup.inner("g", indent=2)
    outer.write("color f = 0;")
    if by_group:
        outer.write("color f_diffuse = 0;")
    for place in recorded.values():
        outer.write(f"f_lobe[{place}] = 0;")
        if by_group:
            outer.write(f"f_lobe_diffuse[{place}] = 0;")
    for name in mixture.densities:
        outer.write(f"float {name} = 0;")
    groups = {side: members for side, members in sides.items() if members}
    for number, (side, members) in enumerate(groups.items()):
        guarded = len(groups) > 1 or side is not False
        if guarded:
            condition = bare(outer.expression(side)) if isinstance(side, Node) else f"wi_z {'<' if side else '>'} 0"
            outer.write(f"if ({condition}) {{")
        prefix = f"c{number}_" if isinstance(side, Node) else "t" if side else "e"
        outer.lines += _evaluate_side(members, setup, varying, prefix, 2 + (len(groups) > 1), split, by_group, recorded)
        if guarded:
            outer.write("}")
    for name, density in mixture.densities.items():
        if not isinstance(density, Node) or density.op != "symbol":
            outer.write(f"{name} = {bare(outer.expression(density))};")
    return outer.lines


def _evaluate_side(
    lobes: Sequence[TracedLobe],
    setup: Block,
    varying: set[Node],
    prefix: str,
    indent: int,
    split: bool,
    by_group: bool,
    recorded: Mapping[str, int],
) -> Iterable[str]:
    """Sum lobes: common subexpressions first, then each lobe's own part under a guard on its share.

    With `split` the densities of lobes that are not light-sampled are summed by themselves, too, and so are the values
    of diffuse lobes `by_group`. `recorded` as of `_evaluate`.
    """
    groups = [reachable(lobe.evaluated(), stop=setup.named) for lobe in lobes]
    counts = Counter(node for group in groups for node in group)
    shared = {node for node, count in counts.items() if count > 1 and node in varying and node not in setup.named}
    shared = {node for node in shared if node.op != "symbol"}
    # Only the nodes that a lobe's own part reads: these name the nodes below them where needed.
    direct: dict[Node, None] = {}
    for lobe, group in zip(lobes, groups, strict=True):
        roots = [value for value in lobe.evaluated() if isinstance(value, Node)]
        own = [node for node in group if node not in shared]
        operands = [operand for node in own for operand in node.operands()]
        direct |= dict.fromkeys(node for node in (*roots, *operands) if node in shared)
    ordered = sorted(direct, key=lambda node: len(reachable([node])))

    outer = setup.inner(prefix, indent)
    outer.prepare(ordered)
    for node in ordered:
        outer.name(node)
    for index, lobe in enumerate(lobes):
        inner = outer.inner(f"{prefix}{index}_", indent + 1)
        inner.prepare(lobe.evaluated())
        color = ", ".join(inner.expression(value) for value in lobe.value)
        density = bare(inner.expression(lobe.density))
        terms = {name: f"color({', '.join(map(inner.expression, part))})" for name, part in lobe.parts}
        guard = f"if ({setup.expression(lobe.share)} > 0) " if isinstance(lobe.share, Node) else ""
        outer.write(f"{guard}{{  // {lobe.name}")
        outer.lines += inner.lines
        again = by_group and lobe.diffuse
        summand = f"color({color})"
        if again or recorded:
            outer.write(f"    color own_f = {summand};")
            summand = "own_f"
        outer.write(f"    f += {summand};")
        if again:
            outer.write("    f_diffuse += own_f;")
        if recorded:
            for name, part in terms.items():
                outer.write(f"    color {name}_f = {part};")
            rest = "".join(f" - {name}_f" for name in terms)
            for name, term in {lobe.recorded: f"own_f{rest}", **{name: f"{name}_f" for name in terms}}.items():
                outer.write(f"    f_lobe[{recorded[name]}] += {term};")
                if again:
                    outer.write(f"    f_lobe_diffuse[{recorded[name]}] += {term};")
        if split and not lobe.light_sampled:
            outer.write(f"    float own_pdf = {density};")
            outer.write("    bsdf_sampled_pdf += own_pdf;")
            density = "own_pdf"
        outer.write(f"    pdf += {density};")
        outer.write("}")
    return outer.lines


def _sample(lobes: Sequence[TracedLobe], setup: Block) -> Iterable[str]:
    """Choose a lobe by u1 and sample it."""
    outer = setup.inner("d", indent=3)
    outer.prepare([lobe.below for lobe in lobes[:-1]])
    conditions = [f"if ({bare(outer.expression(lobe.below))}) " for lobe in lobes[:-1]]
    # The last lobe takes the numbers that the others leave.
    for index, (lobe, condition) in enumerate(zip(lobes, [*conditions, ""], strict=False)):
        inner = outer.inner(f"d{index}_", indent=4)
        outer.write(f"{'else ' * (index > 0)}{condition}{{  // {lobe.name}")
        inner.prepare(lobe.wi)
        wi = [inner.expression(value) for value in lobe.wi]
        for name, code in zip(WI, wi, strict=True):
            inner.write(f"{name} = {code};")
        if lobe.light_sampled:
            inner.write("light_sampled = 1;")
        outer.lines += inner.lines
        outer.write("}")
    return outer.lines
