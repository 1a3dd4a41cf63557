"""Groups of nodes whose sockets are parameters of the models."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Literal

from lookdev.brdf import Array, Parameter, Real
from lookdev.brdf.vectors import Parameters
from lookdev.codegen.nodes.builder import TreeBuilder
from lookdev.codegen.nodes.fits import match_fit
from lookdev.codegen.source import GroupSocket, NodeLink, NodeTree, SocketValue
from lookdev.codegen.trace.graph import Graph, GraphNode, Scalar, Symbol
from lookdev.codegen.trace.symbolic import SymbolicArray, elements_of, symbol, symbols


class TracedGroup:
    """A group under construction, from values traced in a graph of its own."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.graph = Graph()
        self.builder = TreeBuilder(name, match_fit)
        # The values of sockets by name: arrays of the graph of the tree that contains the group's node.
        self._values: dict[str, Array] = {}
        self._sockets: list[GroupSocket] = []
        self._input = self.builder.add("NodeGroupInput")

    def add_inputs(self, parameters: Mapping[str, Parameter], values: Parameters, panel: str = "") -> Parameters:
        """Add sockets for parameters, and return the parameters' values inside the group.

        `values` are the values outside: tokens, and arrays of the graph outside. Inside, a value is the symbols of a
        socket. A token, and a constant at which terms of the model vanish, has no socket and is the same inside. A
        parameter that follows another one and has the same value shares the socket of the other. The name of a socket
        begins with that of its panel.
        """
        inner_values: dict[str, Array | str] = {}
        for name, value in values.items():
            parameter = parameters[name]
            if followed := followed_parameter(parameter, values):
                inner_values[name] = inner_values[followed]
                continue
            if parameter.kind == "token" or _is_folded(parameter, value):
                inner_values[name] = value
                continue
            socket = f"{panel} {name}" if panel else name
            self._sockets.append(replace(parameter_socket(parameter), name=socket, panel=panel))
            self._values[socket] = value
            vector = parameter.kind != "float"
            inner_values[name] = bind_symbols(
                self.graph, self.builder, socket, NodeLink(self._input, socket), vector=vector
            )
        return inner_values

    def add_shader_input(self, name: str, panel: str = "") -> NodeLink:
        """Add a socket for a shader and return its output inside."""
        self._sockets.append(GroupSocket(name, "shader", panel=panel))
        return NodeLink(self._input, name)

    def tree(
        self, values: Mapping[GroupSocket, Real], shader: NodeLink | None = None, *, has_shader: bool = True
    ) -> NodeTree:
        """Return the tree, whose outputs are `values` of the group's graph and, if `has_shader`, a shader first.

        The shader is black if `shader` is None.
        """
        self.builder.prepare(_vector_elements(values.values()))
        inputs: dict[str, SocketValue | NodeLink] = {
            socket.name: add_value(self.builder, value) for socket, value in values.items()
        }
        outputs = list(values)
        if shader is not None:
            inputs["Shader"] = shader
        if has_shader:
            outputs.insert(0, GroupSocket("Shader", "shader"))
        self.builder.add("NodeGroupOutput", inputs=inputs)
        return self.builder.tree(self._sockets, outputs)

    def add_to(self, outer: TreeBuilder, tree: NodeTree, shaders: Mapping[str, NodeLink] | None = None) -> str:
        """Add a node of the finished group, with the values of its sockets, to the tree outside; return its name.

        `shaders` are the outputs that are linked to the sockets of shaders, by name.
        """
        values = self.input_values(tree)
        outer.prepare(_vector_elements(values.values()))
        inputs = {name: add_value(outer, value) for name, value in values.items()}
        return outer.add("Group", inputs=inputs | dict(shaders or {}), group=self.name)

    def input_values(self, tree: NodeTree) -> dict[str, Array]:
        """Return the values of the sockets that the finished tree has, by name."""
        return {socket.name: self._values[socket.name] for socket in tree.inputs if socket.kind != "shader"}


def followed_parameter(parameter: Parameter, values: Parameters) -> str:
    """Return the parameter that a parameter follows, if `values` has the same value for both, else ``""``."""
    followed = parameter.follows
    same = followed and elements_of(values[parameter.name]) == elements_of(values[followed])
    return followed if same else ""


def parameter_socket(parameter: Parameter) -> GroupSocket:
    """Return the socket of a parameter, which has the parameter's name."""
    assert parameter.kind != "token"
    kind: Literal["float", "color", "vector"] = "vector" if parameter.kind == "normal" else parameter.kind
    return GroupSocket(parameter.name, kind, parameter.default, parameter.soft, parameter.help)


def bind_symbols(graph: Graph, builder: TreeBuilder, name: str, link: NodeLink, *, vector: bool) -> SymbolicArray:
    """Bind symbols of a name to an output, and return them as an array, () or (3,)."""
    value = named_symbols(graph, name, vector=vector)
    builder.bind([node.name for node in elements_of(value) if isinstance(node, Symbol)], link)
    return value


def named_symbols(graph: Graph, name: str, *, vector: bool) -> SymbolicArray:
    """Return the symbols of a name as an array, () or (3,)."""
    return symbols(graph, [f"{name}_{i}" for i in range(3)]) if vector else symbol(graph, name)


def add_value(builder: TreeBuilder, value: Real) -> NodeLink | float | tuple[float, float, float]:
    """Add nodes that compute an array, () or (3,), to a tree, and return the output, or the numbers of a constant."""
    elements = elements_of(value)
    return builder.vector(elements) if len(elements) == 3 else builder.scalar(elements[0])


def _is_folded(parameter: Parameter, value: Real) -> bool:
    """Return whether a value is a constant at which terms of the model vanish."""
    all_elements = elements_of(value)
    elements = [element for element in all_elements if not isinstance(element, GraphNode)]
    if len(elements) < len(all_elements):
        return False
    if parameter.optional and elements[0] == parameter.default:
        return True
    if parameter.kind == "normal":
        return bool(elements[0] == elements[1] == 0.0 and elements[2] > 0.0)
    return not any(elements) if parameter.kind == "color" else elements[0] in parameter.hard


def _vector_elements(values: Iterable[Real]) -> list[list[Scalar]]:
    return [elements for value in values if len(elements := elements_of(value)) == 3]
