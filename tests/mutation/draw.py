"""Draws mutants at random, for mutation testing, by the operators of Cosmic Ray and by four operators of this module.

An operator changes one place of a module's syntax tree. The methods of operators are those that Cosmic Ray defines.
"""

import ast
import random
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import islice, pairwise

import parso
from cosmic_ray import plugins
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from mutant import Mutant, functions_of, places_of, read_sources
from parso.python.tree import Keyword

# The number of mutants to draw for each room: one or several packages or modules below `lookdev`. In the first eight
# rooms the tests of the default tier find nine in ten mutants.
ROOMS = {
    "brdf": 400,
    "light": 390,
    "job, build": 260,
    "scene": 190,
    "codegen/trace": 120,
    "plan": 100,
    "rendering/adaptive": 50,
    "output/exr": 40,
    "asset": 130,
    "material": 140,
    "mtlx": 30,
    "output": 100,
    "run, export, inspect": 100,
    "studio": 100,
}

# Names of Cosmic Ray's operators that make faults as a person could make them: no shift replaces a sum, for example.
REPLACED = (
    *("Add_Sub", "Add_Mul", "Sub_Add", "Sub_Div", "Mul_Div", "Mul_Add", "Div_Mul", "FloorDiv_Div", "Div_FloorDiv"),
    *("Mod_FloorDiv", "Pow_Mul", "BitOr_BitAnd", "BitAnd_BitOr", "BitXor_BitOr", "LShift_RShift", "RShift_LShift"),
)
COMPARED = (
    *("Eq_NotEq", "NotEq_Eq", "Lt_LtE", "Lt_Gt", "LtE_Lt", "LtE_GtE", "Gt_GtE", "Gt_Lt", "GtE_Gt", "GtE_LtE"),
    *("Is_IsNot", "IsNot_Is"),
)
NAMES = (
    *(f"core/ReplaceBinaryOperator_{name}" for name in REPLACED),
    *(f"core/ReplaceComparisonOperator_{name}" for name in COMPARED),
    *("core/ReplaceUnaryOperator_USub_UAdd", "core/ReplaceUnaryOperator_Delete_Not", "core/AddNot"),
    *("core/ReplaceTrueWithFalse", "core/ReplaceFalseWithTrue", "core/ReplaceAndWithOr", "core/ReplaceOrWithAnd"),
    *("core/ReplaceBreakWithContinue", "core/ReplaceContinueWithBreak", "core/ExceptionReplacer"),
    *("core/NumberReplacer", "core/ZeroIterationForLoop"),
)


# Functions whose arguments are not exchanged, because their order does not matter.
COMMUTATIVE = ("min", "max", "minimum", "maximum", "hypot", "isclose", "allclose", "logical_and", "logical_or", "gcd")


class RemoveStatement(Operator):
    """Remove a call whose value is not used, or an augmented assignment, such as an unlock or an addition to a sum."""

    def mutation_positions(self, node):
        if node.type == "simple_stmt" and self._removable(node.children[0]):
            yield node.start_pos, node.end_pos

    @staticmethod
    def _removable(node) -> bool:
        if node.type == "atom_expr":
            return node.children[-1].type == "trailer" and node.children[-1].children[0] == "("
        return node.type == "expr_stmt" and node.children[1] not in ("=",) and node.children[1].type == "operator"

    def mutate(self, node, index):
        first = node.get_first_leaf()
        node.children[0] = Keyword("pass", first.start_pos, first.prefix)
        return node

    @classmethod
    def examples(cls):
        return ()


class DropOperand(Operator):
    """Leave out a factor or a term, such as a weight."""

    def mutation_positions(self, node):
        if node.type in ("term", "arith_expr"):
            for operand in node.children[2::2]:
                yield operand.start_pos, operand.end_pos

    def mutate(self, node, index):
        del node.children[2 * index + 1 : 2 * index + 3]
        return node

    @classmethod
    def examples(cls):
        return ()


class SwapArguments(Operator):
    """Exchange two neighbouring positional arguments, such as two axes."""

    def mutation_positions(self, node):
        for first, second in self._pairs(node):
            yield first.start_pos, second.end_pos

    @staticmethod
    def _pairs(node):
        called = node.get_previous_leaf().get_previous_leaf() if node.type == "arglist" else None
        if called is not None and called.value not in COMMUTATIVE:
            positional = [child for child in node.children[::2] if child.type != "argument"]
            yield from pairwise(positional)

    def mutate(self, node, index):
        first, second = list(self._pairs(node))[index]
        one, other = node.children.index(first), node.children.index(second)
        node.children[one], node.children[other] = second, first
        leaves = first.get_first_leaf(), second.get_first_leaf()
        leaves[0].prefix, leaves[1].prefix = leaves[1].prefix, leaves[0].prefix
        return node

    @classmethod
    def examples(cls):
        return ()


class DropKeyword(Operator):
    """Leave out a keyword argument, so that its default is used."""

    def mutation_positions(self, node):
        if node.type == "arglist":
            for child in node.children[2::2]:
                if child.type == "argument" and child.children[1] == "=":
                    yield child.start_pos, child.end_pos

    def mutate(self, node, index):
        named = [child for child in node.children[2::2] if child.type == "argument" and child.children[1] == "="]
        place = node.children.index(named[index])
        del node.children[place - 1 : place + 1]
        return node

    @classmethod
    def examples(cls):
        return ()


@cache
def operators() -> list[Operator]:
    """Return all operators that make mutants."""
    ours = [RemoveStatement(), DropOperand(), SwapArguments(), DropKeyword()]
    return [*(plugins.get_operator(name)() for name in NAMES), *ours]


def room_of(path: str) -> str | None:
    """Return the room of a module: the one with the longest name of a package that the path begins with, or None."""
    inside = path.removeprefix("lookdev/").removesuffix(".py") + "/"
    folders = {folder: room for room in ROOMS for folder in room.split(", ") if inside.startswith(f"{folder}/")}
    return folders[max(folders, key=len)] if folders else None


def draw_mutants(seed: int, counts: Mapping[str, int] = ROOMS, taken: Collection[Mutant] = ()) -> list[Mutant]:
    """Return random mutants, as many for each room as `counts` says, none of them in `taken`.

    Places in the code are drawn without replacement, and at each place one fault.
    """
    generator, sources = random.Random(seed), read_sources()
    places: dict[str, list[Place]] = defaultdict(list)
    for path, source in sources.items():
        if room := room_of(path):
            places[room] += places_of_faults(path, source)
    drawn: list[Mutant] = []
    names = {mutant.name for mutant in taken}
    for room, count in counts.items():
        generator.shuffle(places[room])
        # Not every place gives a mutant, so mutants are made one by one until there are `count` new ones.
        candidates = (_make(room, sources[place.path], place, generator) for place in places[room])
        new = (mutant for mutant in candidates if mutant and mutant.name not in names)
        drawn += sorted(islice(new, count), key=lambda mutant: mutant.name)
    return drawn


@dataclass(frozen=True)
class Place:
    """A place in a function of a module, and the operators that can change it."""

    path: str
    function: tuple[str, int, int]  # name, first and last line
    # For each operator: its index in `operators()`, and the number of this place among its places in the module.
    operators: tuple[tuple[int, int], ...]


def places_of_faults(path: str, source: str) -> list[Place]:
    """Return the places in the functions of a module at which a fault can be planted."""
    # By start and end of a place: its `Place.operators`.
    operators_of: dict[object, list[tuple[int, int]]] = defaultdict(list)
    nodes, skipped, functions = list(ast_nodes(get_ast(source))), list(_skipped(source)), list(functions_of(source))
    for index, operator in enumerate(operators()):
        spans = (span for node in nodes for span in operator.mutation_positions(node))
        for occurrence, (start, end) in enumerate(spans):
            if not any(first <= start and end <= last for first, last in skipped):
                operators_of[start, end].append((index, occurrence))
    places = []
    for (start, _), changes in operators_of.items():
        if function := next((entry for entry in functions if entry[1] <= start[0] <= entry[2]), None):
            places.append(Place(path, function, tuple(changes)))
    return places


def _make(room: str, source: str, place: Place, generator: random.Random) -> Mutant | None:
    """Return a mutant by a random operator at a place, or None if its code would not be valid."""
    index, occurrence = generator.choice(place.operators)
    try:
        mutated = mutate_code(source, operators()[index], occurrence)
        ast.parse(mutated or "")
    except (AttributeError, SyntaxError):  # an exception's name with a dot; `not` before `:=`
        return None
    return mutated and _named(room, place.path, source, mutated, place.function)


def _skipped(source: str) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    """Yield the start and the end of code that is not mutated: annotations, assertions, decorators, raised errors."""
    for node in ast_nodes(parso.parse(source)):
        if node.type in ("annassign", "tfpdef", "assert_stmt", "decorator", "raise_stmt"):
            children = node.children[1:2] if node.type == "annassign" else [node]
            yield from ((child.start_pos, child.end_pos) for child in children)
        if node.type == "param" and node.annotation is not None:
            yield node.annotation.start_pos, node.annotation.end_pos
        if node.type == "funcdef" and node.annotation is not None:
            yield node.annotation.start_pos, node.annotation.end_pos


def _named(room: str, path: str, source: str, mutated: str, body: tuple[str, int, int]) -> Mutant | None:
    """Return the mutant with the lines that differ between a module and its mutated text.

    `body` is the name of the changed function, with its first and last line. Returns None if only the layout differs.
    """
    before, after = source.split("\n"), mutated.split("\n")
    head = next((n for n, (a, b) in enumerate(zip(before, after, strict=False)) if a != b), None)
    if head is None:
        return None
    tail = 0
    while before[-1 - tail] == after[-1 - tail] and tail < min(len(before), len(after)) - head - 1:
        tail += 1
    old, new = before[head : len(before) - tail], after[head : len(after) - tail]
    if not old or not new or " ".join(old).split() == " ".join(new).split() or "not not " in " ".join(new):
        return None
    depth = len(old[0]) - len(old[0].lstrip())
    text = "\n".join(line.strip() for line in old)
    name, first, last = body
    occurrence = places_of(before, text, first, last).index(head + 1)
    changed = "\n".join(line[depth:] if line[:depth].isspace() else line.lstrip() for line in new)
    return Mutant(room, f"{path}:{name}", text, changed, occurrence)
