"""Write a BSDF, a mixture of lobes, as three fragments of OSL: setup, evaluate and sample.

The shaders of `lookdev/shaders/*.osl` include the fragments, and share these variables with them:

- setup runs once for a shading point. It reads ``wo_x wo_y wo_z``, the direction to the viewer in the shading frame,
  and the inputs. It defines the variables that do not depend on the light's direction. If the BSDF also scatters along
  single directions, setup reads ``inside``, and sets these directions, ``vector delta_wi[]``, and the factors of light
  from there, ``color delta_f[]``.
- evaluate runs for each direction to the light, ``wi_x wi_y wi_z``. It sets ``color f``, the BSDF times the cosine,
  summed over the lobes, and ``float pdf``, the density with which sample draws the direction.
- sample runs for each pair of random numbers ``u1 u2``, and sets the direction ``wi_x wi_y wi_z``.

A lobe is light-sampled if the unoccluded light that it scatters is estimated by directions drawn from the light alone.
If a mixture has such lobes, evaluate also sets ``float bsdf_sampled_pdf``, the part of ``pdf`` from the other lobes,
and sample sets ``int light_sampled`` when it draws from a light-sampled lobe. On request, evaluate also sets ``color
f_diffuse``, the part of ``f`` from lobes of the group ``"diffuse"``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from lookdev.brdf import Array, Delta, Lobe
from lookdev.brdf.table import NumberTable
from lookdev.codegen.operators import strip_parentheses
from lookdev.codegen.osl.block import Block, SymbolText, plain_symbol_text
from lookdev.codegen.source import LOBE_GROUPS
from lookdev.codegen.trace.graph import (
    Graph,
    GraphNode,
    Scalar,
    Symbol,
    TableCell,
    dependent_nodes,
    post_order,
    reachable_nodes,
)
from lookdev.codegen.trace.lobes import INSIDE, WI, WO, lobe_parts, recorded_group, trace_mixture
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols

VARYING = frozenset((*WI, "u1", "u2"))
"""The symbols whose values differ between the directions to the light at a shading point."""


@dataclass(frozen=True)
class TracedLobe:
    """The scalar expressions of one lobe of a mixture.

    Attributes
    ----------
    side
        The condition on the light's direction under which the lobe's code runs. If it is None, the code runs where the
        light is on the lobe's side of the shading normal: below it if the lobe `transmits`, else above it.
    share
        The probability of the lobe in sampling, not normalised. It is a constant if the lobe is present at every point.
    value, density
        The three channels of the lobe's f times the cosine, and its density, as in `LobeTerms`.
    is_below_end
        The condition that u1 is below the end of the lobe's range, as in `LobeChoice`.
    wi
        The three components of the direction drawn from the lobe, in the shading frame.
    light_sampled
        Whether the unoccluded light on the lobe is estimated by directions drawn from the light alone.
    is_diffuse
        Whether the lights' factors for diffuse lobes apply to the lobe.
    group
        The group in `LOBE_GROUPS` in which the lobe's light is recorded.
    parts
        The parts of `value` that are recorded in other groups, by group.
    """

    name: str
    transmits: bool
    side: Scalar | None
    share: Scalar
    value: tuple[Scalar, ...]
    density: Scalar
    is_below_end: Scalar
    wi: tuple[Scalar, ...]
    light_sampled: bool
    is_diffuse: bool
    group: str
    parts: Mapping[str, tuple[Scalar, ...]]

    def direction_values(self) -> tuple[Scalar, ...]:
        """Return the expressions that are computed for each direction of the light."""
        return (*self.value, self.density, *(value for part in self.parts.values() for value in part))


@dataclass(frozen=True)
class BrdfCode:
    """The emitted fragments, and what a shader that includes them must know.

    Attributes
    ----------
    setup, evaluate, sample
        The lines of the fragments.
    inputs
        The names of the symbols that the fragments read, except directions and random numbers.
    tables
        The tables that the fragments look up.
    transmits
        Whether light can come from the back.
    crosses_surface
        Whether a lobe scatters to both sides of the surface (`Lobe.crosses_surface`).
    see_through
        Whether setup defines a ``float presence``.
    light_sampled
        Whether a lobe is light-sampled.
    features
        The lines of a fourth fragment, which defines the colours `features` of `emit_brdf`.
    groups
        The groups of all lobes and deltas, in the order of `LOBE_GROUPS`.
    """

    setup: tuple[str, ...]
    evaluate: tuple[str, ...]
    sample: tuple[str, ...]
    inputs: frozenset[str]
    tables: tuple[NumberTable, ...]
    transmits: bool
    crosses_surface: bool
    see_through: bool
    light_sampled: bool
    features: tuple[str, ...]
    groups: tuple[str, ...]

    @property
    def sections(self) -> dict[str, Sequence[str]]:
        """The lines of the fragments, by the names of their sections in templates."""
        return {"setup": self.setup, "evaluate": self.evaluate, "sample": self.sample, "features": self.features}


@dataclass(frozen=True)
class TracedMixture:
    """The scalar expressions of a mixture of lobes.

    `total_share` is the sum of the lobes' shares. `densities` has an expression for ``"pdf"`` and, if a lobe is
    light-sampled, for ``"bsdf_sampled_pdf"``. Each expression normalises a sum of the lobes' densities. This sum is the
    symbol that has the same name.
    """

    lobes: tuple[TracedLobe, ...]
    total_share: Scalar
    densities: Mapping[str, Scalar]


def trace_lobes(
    graph: Graph,
    lobes: Sequence[Lobe],
    light_sampled: Callable[[Lobe], bool] = lambda lobe: False,
    *,
    recorded: bool = False,
) -> TracedMixture:
    """Trace the mixture of lobes at the symbols ``wo_x wo_y wo_z wi_x wi_y wi_z u1 u2``.

    `light_sampled` returns whether a lobe is light-sampled. Only with `recorded` do lobes have `TracedLobe.parts`.
    """
    mixture, wi = trace_mixture(graph, lobes), symbols(graph, WI)
    # A lobe's code runs only where the light is on the lobe's side, so the trace can assume these conditions.
    sides = [_side_condition(lobe, mixture.wo, wi) for lobe in lobes]
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
            is_below_end=elements_of(choice.is_below_end)[0],
            wi=tuple(elements_of(lobe.draw(choice.remapped, symbol(graph, "u2")))),
            light_sampled=light_sampled(lobe),
            is_diffuse=lobe.group == "diffuse",
            group=recorded_group(lobe),
            parts={name: tuple(elements_of(part)) for name, part in lobe_parts(term).items()} if recorded else {},
        )
        for lobe, side, term, choice in zip(lobes, sides, terms, choices, strict=True)
    )
    sums = ("pdf", "bsdf_sampled_pdf") if any(lobe.light_sampled for lobe in traced) else ("pdf",)
    densities = {name: elements_of(mixture.normalise(symbol(graph, name)))[0] for name in sums}
    return TracedMixture(traced, elements_of(mixture.total_share)[0], densities)


def _side_condition(lobe: Lobe, wo: Array, wi: Array) -> Scalar | None:
    """Return the condition that both directions are above the horizon of a lobe that `crosses_surface`, else None."""
    if not lobe.crosses_surface:
        return None
    local_o, local_i = lobe.local_directions(wo, wi)
    return elements_of((local_o[..., 2] > 0.0) & (local_i[..., 2] > 0.0))[0]


def emit_brdf(
    mixture: TracedMixture,
    presence: Scalar = 1.0,
    symbol_text: SymbolText = plain_symbol_text,
    *,
    splits_diffuse: bool = False,
    recorded: bool = False,
    deltas: Sequence[Delta] = (),
    features: Mapping[str, Sequence[Scalar]] = MappingProxyType({}),
) -> BrdfCode:
    """Write the three fragments of a mixture, and the presence where it is not 1.

    Parameters
    ----------
    presence
        The share of the surface that is there, from 0 to 1.
    symbol_text
        Returns the text of symbols and uniforms (`SymbolText`).
    splits_diffuse
        Whether evaluate sets ``f_diffuse``.
    recorded
        Whether the fragments record the light of groups of lobes. Setup then sets ``int delta_group[]``, the group of
        each single direction. Evaluate sets ``f_lobe[]`` and, with `splits_diffuse`, ``f_lobe_diffuse[]``: entry i is
        the part of ``f`` or ``f_diffuse`` from group i of `BrdfCode.groups`.
    deltas
        The terms that scatter along single directions.
    features
        Triples of numbers that depend on the view alone, by name. Each becomes a colour of this name, defined in a
        fourth fragment.
    """
    lobes = mixture.lobes
    see_through = isinstance(presence, GraphNode) or presence < 1.0
    # The expressions of evaluate and sample. Setup computes those of their nodes that depend neither on the light's
    # direction nor on random numbers.
    values = [value for lobe in lobes for value in (*lobe.direction_values(), *lobe.wi, lobe.is_below_end)]
    values += [lobe.side for lobe in lobes if lobe.side is not None]
    varying = dependent_nodes(values, VARYING)
    invariant = _invariant_nodes(values, varying)

    setup = Block("s", indent=1, symbol_text=symbol_text)
    # The assignments for single directions: the text before the parenthesis, and the three components.
    triples = [
        (f"{name}[{number}] = {kind}", elements_of(value))
        for number, delta in enumerate(deltas)
        for name, kind, value in (("delta_wi", "vector", delta.direction), ("delta_f", "color", delta.value))
    ]
    delta_values = [value for _, triple in triples for value in triple]
    setup.prepare([*(lobe.share for lobe in lobes), *invariant, presence, *delta_values])
    for index, lobe in enumerate(lobes):
        setup.define(f"share_{index}", lobe.share, comment=lobe.name)
    setup.define("shares", mixture.total_share)
    if see_through:
        setup.write(f"float presence = {setup.expression(presence)};")
    for node in invariant:
        setup.name(node)
    for assigned, triple in triples:
        setup.write(f"{assigned}({', '.join(map(setup.expression, triple))});")

    if recorded:
        for number, delta in enumerate(deltas):
            setup.write(f"delta_group[{number}] = {LOBE_GROUPS.index(recorded_group(delta))};")
    feature_values = [value for triple in features.values() for value in triple]
    feature_block = setup.inner_block("a", indent=2)
    feature_block.prepare(feature_values)
    for name, feature in features.items():
        feature_block.write(f"color {name} = color({', '.join(map(feature_block.expression, feature))});")

    present = {group for lobe in lobes for group in (lobe.group, *lobe.parts)} | {*map(recorded_group, deltas)}
    groups = tuple(group for group in LOBE_GROUPS if group in present)
    group_indices = {group: index for index, group in enumerate(groups)} if recorded else {}
    nodes = reachable_nodes([*values, *(lobe.share for lobe in lobes), presence, *delta_values, *feature_values])
    inputs = {node.name for node in nodes if isinstance(node, Symbol)} - VARYING - {*WO, INSIDE}
    tables = {node.table.digest: node.table for node in nodes if isinstance(node, TableCell)}
    return BrdfCode(
        setup=tuple(setup.lines),
        evaluate=tuple(_evaluate_lines(mixture, setup, varying, splits_diffuse, group_indices)),
        sample=tuple(_sample_lines(lobes, setup)),
        inputs=frozenset(inputs),
        tables=tuple(tables.values()),
        transmits=any(lobe.transmits for lobe in lobes),
        crosses_surface=any(lobe.side is not None for lobe in lobes),
        see_through=see_through,
        light_sampled=any(lobe.light_sampled for lobe in lobes),
        features=tuple(feature_block.lines),
        groups=groups,
    )


def _invariant_nodes(values: Iterable[Scalar], varying: set[GraphNode]) -> list[GraphNode]:
    """Return the nodes that setup computes for the other fragments, in a reproducible order.

    These nodes are not in `varying`: they depend neither on the light's direction nor on random numbers. They are in
    `values`, or are operands of nodes in `varying`.
    """
    roots = [value for value in values if isinstance(value, GraphNode)]
    operands = [operand for node in post_order(roots, lambda node: node not in varying) for operand in node.operands()]
    return [node for node in dict.fromkeys([*roots, *operands]) if node not in varying and node.op != "symbol"]


def _evaluate_lines(
    mixture: TracedMixture,
    setup: Block,
    varying: set[GraphNode],
    splits_diffuse: bool,
    group_indices: Mapping[str, int],
) -> Iterable[str]:
    """Return the lines of evaluate, which sum the lobes on the light's side.

    `varying` are the nodes that depend on the light's direction or on random numbers. `group_indices` has the indices
    of groups in ``f_lobe``, by group, and is empty if nothing is recorded.
    """
    has_light_sampled = len(mixture.densities) > 1
    # The lobes by their side: False (above the shading normal's horizon), True (below), or a condition of their own.
    sides: dict[Scalar, list[TracedLobe]] = {False: [], True: []}
    for lobe in mixture.lobes:
        sides.setdefault(lobe.transmits if lobe.side is None else lobe.side, []).append(lobe)
    block = setup.inner_block("g", indent=2)
    block.write("color f = 0;")
    if splits_diffuse:
        block.write("color f_diffuse = 0;")
    for index in group_indices.values():
        block.write(f"f_lobe[{index}] = 0;")
        if splits_diffuse:
            block.write(f"f_lobe_diffuse[{index}] = 0;")
    for name in mixture.densities:
        block.write(f"float {name} = 0;")
    groups = {side: side_lobes for side, side_lobes in sides.items() if side_lobes}
    for number, (side, side_lobes) in enumerate(groups.items()):
        is_guarded = len(groups) > 1 or side is not False
        if is_guarded:
            condition = (
                strip_parentheses(block.expression(side))
                if isinstance(side, GraphNode)
                else f"wi_z {'<' if side else '>'} 0"
            )
            block.write(f"if ({condition}) {{")
        # Names of variables begin with "c" under a condition of the lobe's own, with "t" for transmitted light, and
        # with "e" for other light.
        prefix = f"c{number}_" if isinstance(side, GraphNode) else "t" if side else "e"
        block.lines += _side_lines(
            side_lobes, setup, varying, prefix, 2 + (len(groups) > 1), has_light_sampled, splits_diffuse, group_indices
        )
        if is_guarded:
            block.write("}")
    for name, density in mixture.densities.items():
        if not isinstance(density, GraphNode) or density.op != "symbol":
            block.write(f"{name} = {strip_parentheses(block.expression(density))};")
    return block.lines


def _side_lines(
    lobes: Sequence[TracedLobe],
    setup: Block,
    varying: set[GraphNode],
    prefix: str,
    indent: int,
    has_light_sampled: bool,
    splits_diffuse: bool,
    group_indices: Mapping[str, int],
) -> Iterable[str]:
    """Return the lines that sum the lobes of one side.

    Expressions that lobes share come first. Each lobe follows in a block, which runs if the lobe's share is above 0.
    With `has_light_sampled`, the densities of lobes that are not light-sampled are also summed separately. With
    `splits_diffuse`, so are the values of diffuse lobes. `varying` and `group_indices` are as in `_evaluate_lines`.
    """
    # The nodes that each lobe reads, and those that several lobes read.
    groups = [reachable_nodes(lobe.direction_values(), stop=setup.variables) for lobe in lobes]
    counts = Counter(node for group in groups for node in group)
    shared = {node for node, count in counts.items() if count > 1 and node in varying and node not in setup.variables}
    shared = {node for node in shared if node.op != "symbol"}
    # The shared nodes that a lobe's block reads itself. `Block` also writes the nodes that these depend on.
    shared_operands: dict[GraphNode, None] = {}
    for lobe, group in zip(lobes, groups, strict=True):
        roots = [value for value in lobe.direction_values() if isinstance(value, GraphNode)]
        private = [node for node in group if node not in shared]
        operands = [operand for node in private for operand in node.operands()]
        shared_operands |= dict.fromkeys(node for node in (*roots, *operands) if node in shared)
    ordered = sorted(shared_operands, key=lambda node: len(reachable_nodes([node])))

    block = setup.inner_block(prefix, indent)
    block.prepare(ordered)
    for node in ordered:
        block.name(node)
    for index, lobe in enumerate(lobes):
        inner = block.inner_block(f"{prefix}{index}_", indent + 1)
        inner.prepare(lobe.direction_values())
        color = ", ".join(inner.expression(value) for value in lobe.value)
        density = strip_parentheses(inner.expression(lobe.density))
        terms = {name: f"color({', '.join(map(inner.expression, part))})" for name, part in lobe.parts.items()}
        guard = f"if ({setup.expression(lobe.share)} > 0) " if isinstance(lobe.share, GraphNode) else ""
        block.write(f"{guard}{{  // {lobe.name}")
        block.lines += inner.lines
        adds_diffuse = splits_diffuse and lobe.is_diffuse
        summand = f"color({color})"
        if adds_diffuse or group_indices:
            block.write(f"    color own_f = {summand};")
            summand = "own_f"
        block.write(f"    f += {summand};")
        if adds_diffuse:
            block.write("    f_diffuse += own_f;")
        if group_indices:
            for name, part in terms.items():
                block.write(f"    color {name}_f = {part};")
            rest = "".join(f" - {name}_f" for name in terms)
            for name, term in {lobe.group: f"own_f{rest}", **{name: f"{name}_f" for name in terms}}.items():
                block.write(f"    f_lobe[{group_indices[name]}] += {term};")
                if adds_diffuse:
                    block.write(f"    f_lobe_diffuse[{group_indices[name]}] += {term};")
        if has_light_sampled and not lobe.light_sampled:
            block.write(f"    float own_pdf = {density};")
            block.write("    bsdf_sampled_pdf += own_pdf;")
            density = "own_pdf"
        block.write(f"    pdf += {density};")
        block.write("}")
    return block.lines


def _sample_lines(lobes: Sequence[TracedLobe], setup: Block) -> Iterable[str]:
    """Return the lines of sample, which choose a lobe by u1, and draw a direction from it."""
    block = setup.inner_block("d", indent=3)
    block.prepare([lobe.is_below_end for lobe in lobes[:-1]])
    conditions = [f"if ({strip_parentheses(block.expression(lobe.is_below_end))}) " for lobe in lobes[:-1]]
    # The last lobe has no condition: u1 is in its range if no other condition is true.
    for index, (lobe, condition) in enumerate(zip(lobes, [*conditions, ""], strict=False)):
        inner = block.inner_block(f"d{index}_", indent=4)
        block.write(f"{'else ' * (index > 0)}{condition}{{  // {lobe.name}")
        inner.prepare(lobe.wi)
        wi = [inner.expression(value) for value in lobe.wi]
        for name, code in zip(WI, wi, strict=True):
            inner.write(f"{name} = {code};")
        if lobe.light_sampled:
            inner.write("light_sampled = 1;")
        block.lines += inner.lines
        block.write("}")
    return block.lines
