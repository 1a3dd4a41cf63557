"""Build a tree of Blender's shader nodes that computes the values of a traced expression graph, in float32.

Other modules of this package add their nodes to a `TreeBuilder`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import TypeAlias, TypeGuard

import numpy as np

from lookdev.cache import Content
from lookdev.codegen.nodes.layout import lay_out_nodes
from lookdev.codegen.nodes.match import add_depths, match_operation
from lookdev.codegen.source import GroupSocket, NodeLink, NodeTree, ShaderNode, SocketValue
from lookdev.codegen.trace.graph import GraphNode, Scalar, Symbol
from lookdev.codegen.trace.vectors import Triple, match_cross, match_dot, match_normalize
from lookdev.errors import CodegenError

# Blender's identifiers of the sockets of Separate XYZ and Combine XYZ.
_AXES = ("X", "Y", "Z")
# Blender's identifiers of the input sockets of Math and of Vector Math, in order.
_SOCKETS = ("Value", "Value_001", "Value_002")
_VECTOR_SOCKETS = ("Vector", "Vector_001", "Vector_002")

# Operations that one node can apply to the three components of vectors: those of both Math and Vector Math, and Mix.
_VECTOR_OPERATIONS = {
    "ADD", "SUBTRACT", "MULTIPLY", "DIVIDE", "MULTIPLY_ADD", "ABSOLUTE", "MINIMUM", "MAXIMUM", "FLOOR", "POWER", "SINE",
    "COSINE", "TANGENT", "MIX",
}  # fmt: skip

NodeTerm: TypeAlias = "GraphNode | Triple"
"""The value that one output of a node computes: a graph's node, or three components that are not all the same."""


Operand: TypeAlias = "Scalar | Triple | NodeLink"
"""The input of a node's socket: a constant, a term that has yet to be computed, or the output of an existing node."""


@dataclass(frozen=True)
class _Recipe:
    """A plan of the node that computes a term.

    `kind`, `properties` and `group` are those of `ShaderNode`. `inputs` has the operands by the sockets' identifiers.
    `output` is the identifier of the socket that has the term's value.
    """

    kind: str
    inputs: Mapping[str, Operand]
    output: str
    properties: Mapping[str, SocketValue | bool] = field(default_factory=dict)
    group: str = ""


GroupMatcher: TypeAlias = "Callable[[GraphNode], tuple[str, Mapping[str, Scalar]] | None]"
"""A function that finds a group of nodes whose output ``"Value"`` computes a given node of a graph.

It returns the group's name and the values of the group's inputs by name, or None if no group computes the node.
"""


class TreeBuilder:
    """Collects the nodes of one tree; nodes that are equal are added once.

    A value is a scalar, or a vector of three components. If the components of a vector have the same operation, one
    vector node computes all of them. A scalar that is also such a component is then separated from the vector.
    """

    def __init__(self, name: str, match_group: GroupMatcher = lambda node: None) -> None:
        self.name = name
        self._match_group = match_group
        # The nodes by name; and their names by a key of kind, properties, inputs, group and image.
        self._nodes: dict[str, ShaderNode] = {}
        self._names: dict[tuple[object, ...], str] = {}
        # The output to which one symbol, or three together, are bound.
        self._bound: dict[tuple[str, ...], NodeLink] = {}
        # For a symbol bound as a component of a vector: the link of the vector, and the index of the component.
        self._parts: dict[str, tuple[NodeLink, int]] = {}
        # The outputs of the terms that have been built, and the plans of the terms.
        self._links: dict[NodeTerm, NodeLink] = {}
        self._recipes: dict[NodeTerm, _Recipe] = {}
        # For a scalar that is separated from a vector: the vector, and the index of the component.
        self._components: dict[GraphNode, tuple[Triple, int]] = {}
        # The depths of graph nodes in operations (`add_depths`).
        self._depths: dict[GraphNode, int] = {}

    def add(
        self,
        kind: str,
        properties: Mapping[str, SocketValue | bool] | None = None,
        inputs: Mapping[str, SocketValue | NodeLink] | None = None,
        label: str = "",
        group: str = "",
        image: Content | None = None,
    ) -> str:
        """Add a node, unless an equal one exists, and return its name; arguments are those of `ShaderNode`."""
        properties, inputs = dict(properties or {}), dict(inputs or {})
        # Values are compared by repr, as 0.0 == -0.0 and True == 1.0 in Python.
        key = (kind, *(tuple(sorted((k, repr(v)) for k, v in d.items())) for d in (properties, inputs)), group, image)
        name = self._names.get(key)
        if name is None:
            name = self._names[key] = f"{group or kind} {len(self._nodes)}"
            self._nodes[name] = ShaderNode(name, kind, properties, inputs, label, group, image)
        return name

    def bind(self, symbols: Sequence[str], link: NodeLink) -> None:
        """Make a node's output the value of a symbol, or a vector output the values of three symbols.

        Raises
        ------
        CodegenError
            The symbols are bound to another output.
        """
        if self._bound.setdefault(tuple(symbols), link) != link:
            raise CodegenError(f"nodes of {self.name} have two values for {', '.join(symbols)}; another name is right")
        if len(symbols) == 3:
            self._parts.update((symbol, (link, index)) for index, symbol in enumerate(symbols))

    def scalar(self, value: Scalar) -> NodeLink | float:
        """Return the output of the node that computes a value, or the number if the value is constant.

        Raises
        ------
        CodegenError
            A symbol is not bound, or a constant is not finite.
        """
        return self._term_value(value) if isinstance(value, GraphNode) else _number(value)

    def vector(self, values: Sequence[Scalar]) -> NodeLink | tuple[float, float, float]:
        """Return the output that has three values as a vector, or the three numbers if they are constant.

        If the three values are equal, the output can be a scalar: Blender copies it to the components of a vector. The
        errors are those of `scalar`.
        """
        term = _term(values)
        if _is_term(term):
            return self._term_value(term)
        x, y, z = (_number(value) for value in values)
        return x, y, z

    def plan_vectors(self, roots: Iterable[Sequence[Scalar]]) -> None:
        """Plan the nodes of vectors, without building them.

        If a component of these vectors is then built as a scalar, it is separated from the vector's node.
        """
        self._plan([term for root in roots if _is_term(term := _term(root))])

    def tree(self, inputs: Sequence[GroupSocket] = (), outputs: Sequence[GroupSocket] = ()) -> NodeTree:
        """Return the tree with the positions of its nodes.

        Nodes on which no output depends are left out, and so are `inputs` that no remaining node reads.
        """
        nodes_by_name = _nodes_before_output(self._nodes)
        sockets_read = {
            link.socket
            for node in nodes_by_name.values()
            for link in node.inputs.values()
            if isinstance(link, NodeLink) and nodes_by_name[link.node].kind == "NodeGroupInput"
        }
        positions = lay_out_nodes(nodes_by_name)
        nodes = tuple(replace(node, position=positions[name]) for name, node in nodes_by_name.items())
        group_inputs = tuple(socket for socket in inputs if socket.name in sockets_read)
        return NodeTree(self.name, nodes, group_inputs, tuple(outputs))

    def _term_value(self, term: NodeTerm) -> NodeLink:
        """Add the nodes that compute a term, and return the output that has the term's value."""
        self._plan([term])
        stack = [term]
        while stack:
            current = stack[-1]
            if current in self._links:
                stack.pop()
                continue
            recipe = self._recipes[current]
            missing = [
                operand for operand in recipe.inputs.values() if _is_term(operand) and operand not in self._links
            ]
            if missing:
                stack += reversed(missing)
                continue
            inputs = {
                socket: self._links[operand] if _is_term(operand) else _constant(operand)
                for socket, operand in recipe.inputs.items()
            }
            name = self.add(recipe.kind, recipe.properties, inputs, group=recipe.group)
            self._links[current] = NodeLink(name, recipe.output)
            stack.pop()
        return self._links[term]

    def _plan(self, roots: Sequence[NodeTerm]) -> None:
        """Choose the recipes of terms and of all their operands.

        Vectors are planned first, so that scalars can become components of them.
        """
        vectors = [root for root in roots if isinstance(root, tuple)]
        scalars = [root for root in roots if isinstance(root, GraphNode)]
        unbound: set[str] = set()
        while vectors or scalars:
            term = vectors.pop() if vectors else scalars.pop()
            if term in self._links or term in self._recipes or self._is_bound(term):
                continue
            if isinstance(term, Symbol) and term.name not in self._parts:
                unbound.add(term.name)
                continue
            for node in [term] if isinstance(term, GraphNode) else term:
                add_depths(node, self._depths)
            recipe = self._vector_recipe(term) if isinstance(term, tuple) else self._scalar_recipe(term)
            self._recipes[term] = recipe
            for operand in filter(_is_term, recipe.inputs.values()):
                if isinstance(operand, GraphNode):
                    scalars.append(operand)
                else:
                    vectors.append(operand)
        if unbound:
            missing, bound = (", ".join(sorted(names)) for names in (unbound, {*chain(*self._bound)}))
            raise CodegenError(f"nodes of {self.name} read unbound symbols: {missing}; bound: {bound or 'none'}")

    def _is_bound(self, term: NodeTerm) -> bool:
        """Return whether a term is a bound symbol, or three symbols bound together; if so, record the term's link."""
        nodes = (term,) if isinstance(term, GraphNode) else term
        names = tuple(node.name for node in nodes if isinstance(node, Symbol))
        if len(names) < len(nodes):
            return False
        link = self._bound.get(names)
        if link is not None:
            self._links[term] = link
        return link is not None

    def _scalar_recipe(self, node: GraphNode) -> _Recipe:
        """Return the recipe of a scalar: a component of a vector, a group, a dot product, or a single operation."""
        if node in self._components:
            triple, index = self._components[node]
            return _Recipe("SeparateXYZ", {"Vector": triple}, _AXES[index])
        if isinstance(node, Symbol):
            link, index = self._parts[node.name]
            return _Recipe("SeparateXYZ", {"Vector": link}, _AXES[index])
        group = self._match_group(node)
        if group:
            return _Recipe("Group", group[1], "Value", group=group[0])
        dot = match_dot(node)
        if dot and all(self._is_vector(factor) for factor in dot):
            return _vector_math("DOT_PRODUCT", [_term(factor) for factor in dot], "Value")
        operation, *operands = match_operation(node, self._links)
        if operation == "MIX":
            return _mix("Float", *operands)
        return _Recipe("Math", dict(zip(_SOCKETS, operands, strict=False)), "Value", {"operation": operation})

    def _vector_recipe(self, triple: Triple) -> _Recipe:
        """Return the recipe of a vector: a single node, or a node that combines three scalars.

        If it is a single node, the components that are needed as scalars are separated from it.
        """
        recipe = self._single_node_recipe(triple)
        if recipe is None:
            return _Recipe("CombineXYZ", dict(zip(_AXES, triple, strict=True)), "Vector")
        for index, node in enumerate(triple):
            if isinstance(node, GraphNode) and node not in self._components and node not in self._links:
                self._components[node] = triple, index
                # This also replaces the recipe of a component that was planned by itself before the vector.
                self._recipes[node] = self._scalar_recipe(node)
        return recipe

    def _is_vector(self, triple: Triple) -> bool:
        """Return whether three values need no Combine XYZ node to become a vector.

        They are constant, equal, bound as a vector, or computed by a single node.
        """
        term = _term(triple)
        if not _is_term(term) or not isinstance(term, tuple):
            return True
        return self._is_bound(term) or self._single_node_recipe(term) is not None

    def _single_node_recipe(self, triple: Triple) -> _Recipe | None:
        """Return the recipe of a single node that computes three values, or None."""
        nodes = [node for node in triple if isinstance(node, GraphNode)]
        # Components of the same depth do not depend on each other. Otherwise, a component that is separated from the
        # vector could be an operand of the vector.
        if len(nodes) < 3 or len({self._depths[node] for node in nodes}) > 1 or all(n in self._links for n in nodes):
            return None
        if any(node.op == "symbol" for node in nodes):
            return None
        vector = match_normalize(triple)
        if vector:
            return _vector_math("NORMALIZE", [vector])
        factors = match_cross(triple)
        if factors:
            return _vector_math("CROSS_PRODUCT", [_term(factor) for factor in factors])
        matches = [match_operation(node, self._links) for node in nodes]
        operation = matches[0][0]
        if operation not in _VECTOR_OPERATIONS or any(other[0] != operation for other in matches):
            return None
        operands = [_term(parts) for parts in zip(*(match[1:] for match in matches), strict=True)]
        if operation == "MIX":
            return _mix("Vector", *operands)
        if operation == "MULTIPLY":
            for scaled, factor in (operands, reversed(operands)):
                if not isinstance(factor, tuple):
                    return _Recipe("VectorMath", {"Vector": scaled, "Scale": factor}, "Vector", {"operation": "SCALE"})
        return _vector_math(operation, operands)


def _vector_math(operation: str, operands: Sequence[Scalar | Triple], output: str = "Vector") -> _Recipe:
    """Return the recipe of a Vector Math node; a constant operand becomes a vector of three equal numbers."""
    vectors = (operand if isinstance(operand, GraphNode | tuple) else (operand,) * 3 for operand in operands)
    return _Recipe("VectorMath", dict(zip(_VECTOR_SOCKETS, vectors, strict=False)), output, {"operation": operation})


def _mix(kind: str, a: Scalar | Triple, b: Scalar | Triple, factor: Scalar | Triple) -> _Recipe:
    """Return the recipe of the mix a (1 - factor) + b factor, which is exactly a at factor 0 and exactly b at 1.

    `kind` is ``"Float"`` or ``"Vector"``.
    """
    properties: dict[str, SocketValue | bool] = {"data_type": kind.upper(), "clamp_factor": False}
    factor_socket = "Factor_Float"
    if kind == "Vector":
        properties["factor_mode"] = "NON_UNIFORM" if isinstance(factor, tuple) else "UNIFORM"
        factor_socket = "Factor_Vector" if isinstance(factor, tuple) else factor_socket
        a, b = (operand if isinstance(operand, GraphNode | tuple) else (operand,) * 3 for operand in (a, b))
    return _Recipe("Mix", {factor_socket: factor, f"A_{kind}": a, f"B_{kind}": b}, f"Result_{kind}", properties)


def _term(values: Sequence[Scalar]) -> Scalar | Triple:
    """Return three values as a triple, or a single value if all three are equal."""
    # Constants are compared by repr, as 0.0 == -0.0 in Python.
    different = {value if isinstance(value, GraphNode) else repr(value) for value in values}
    if len(different) == 1:
        return values[0]
    x, y, z = values
    return x, y, z


def _is_term(value: Operand) -> TypeGuard[NodeTerm]:
    """Return whether an operand is a term that a node must compute: not a constant, and not an output."""
    return isinstance(value, GraphNode) or (
        isinstance(value, tuple) and any(isinstance(element, GraphNode) for element in value)
    )


def _constant(value: Operand) -> SocketValue | NodeLink:
    """Return an operand that is an output or a constant (`_is_term` is false) as the input of a socket."""
    if isinstance(value, NodeLink):
        return value
    return tuple(_number(element) for element in value) if isinstance(value, tuple) else _number(value)


def _number(value: Scalar) -> float:
    """Return a constant as a float; raise CodegenError if it is not finite."""
    assert not isinstance(value, GraphNode)
    if not np.isfinite(value):
        raise CodegenError(f"a constant folded to {value}; the model leaves its domain")
    return float(value)


def _nodes_before_output(nodes: Mapping[str, ShaderNode]) -> dict[str, ShaderNode]:
    """Return the nodes that an output of the tree depends on, in the order of `nodes`."""
    stack = [name for name, node in nodes.items() if node.kind == "NodeGroupOutput" or node.kind.startswith("Output")]
    needed: set[str] = set()
    while stack:
        name = stack.pop()
        if name not in needed:
            needed.add(name)
            stack += [link.node for link in nodes[name].inputs.values() if isinstance(link, NodeLink)]
    return {name: node for name, node in nodes.items() if name in needed}
