"""Build groups of nodes whose input sockets are the parameters of a reflectance model, for backend ``nodes``."""

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
    """A group of nodes under construction.

    The group's values are traced in its own graph, `graph`. `builder` makes the group's nodes from this graph. The
    values that the group's sockets receive are traced in the outer graph. It belongs to the tree that contains the
    group's node.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.graph = Graph()
        self.builder = TreeBuilder(name, match_fit)
        # The values of sockets by name: arrays of the outer graph.
        self._values: dict[str, Array] = {}
        self._sockets: list[GroupSocket] = []
        self._input = self.builder.add("NodeGroupInput")

    def add_inputs(self, parameters: Mapping[str, Parameter], values: Parameters, panel: str = "") -> Parameters:
        """Add input sockets for parameters, and return the values of the parameters inside the group.

        `values` has tokens, and arrays of the outer graph. Inside the group, the value of a parameter is the symbols of
        its socket. Tokens, and constants at which terms of the model vanish, have no socket: inside, they have the same
        value. If a parameter follows another one (`Parameter.follows`) and has the same value, both share a socket.
        `panel` is the heading of the sockets; their names begin with it.
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
        """Add an input socket for a shader, and return the shader as an output inside the group."""
        self._sockets.append(GroupSocket(name, "shader", panel=panel))
        return NodeLink(self._input, name)

    def tree(
        self, values: Mapping[GroupSocket, Real], shader: NodeLink | None = None, *, has_shader: bool = True
    ) -> NodeTree:
        """Return the finished tree. Its outputs are `values`, arrays of the group's graph, by socket.

        If `has_shader`, the first output is `shader`; None stands for a black shader.
        """
        self.builder.plan_vectors(_vector_elements(values.values()))
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
        """Add a node of the group to the outer tree, and return the node's name.

        `tree` is the group's finished tree. `shaders` has the outputs of the outer tree that are linked to the sockets
        for shaders, by the names of these sockets.
        """
        values = self.input_values(tree)
        outer.plan_vectors(_vector_elements(values.values()))
        inputs = {name: add_value(outer, value) for name, value in values.items()}
        return outer.add("Group", inputs=inputs | dict(shaders or {}), group=self.name)

    def input_values(self, tree: NodeTree) -> dict[str, Array]:
        """Return the values of the finished tree's input sockets, by name, without shaders.

        The values are arrays of the outer graph.
        """
        return {socket.name: self._values[socket.name] for socket in tree.inputs if socket.kind != "shader"}


def followed_parameter(parameter: Parameter, values: Parameters) -> str:
    """Return the name in `parameter.follows` if `values` has the same value for both parameters, else ``""``."""
    followed = parameter.follows
    same = followed and elements_of(values[parameter.name]) == elements_of(values[followed])
    return followed if same else ""


def parameter_socket(parameter: Parameter) -> GroupSocket:
    """Return the socket of a parameter, which has the parameter's name."""
    assert parameter.kind != "token"
    kind: Literal["float", "color", "vector"] = "vector" if parameter.kind == "normal" else parameter.kind
    return GroupSocket(parameter.name, kind, parameter.default, parameter.soft, parameter.help)


def bind_symbols(graph: Graph, builder: TreeBuilder, name: str, link: NodeLink, *, vector: bool) -> SymbolicArray:
    """Bind the symbols of `named_symbols` to the output `link`, and return them as an array, () or (3,)."""
    value = named_symbols(graph, name, vector=vector)
    builder.bind([node.name for node in elements_of(value) if isinstance(node, Symbol)], link)
    return value


def named_symbols(graph: Graph, name: str, *, vector: bool) -> SymbolicArray:
    """Return the symbol `name`, or with `vector` the symbols ``<name>_0`` to ``<name>_2``, as an array, () or (3,)."""
    return symbols(graph, [f"{name}_{i}" for i in range(3)]) if vector else symbol(graph, name)


def add_value(builder: TreeBuilder, value: Real) -> NodeLink | float | tuple[float, float, float]:
    """Add the nodes that compute an array, () or (3,); return their output, or the numbers if the array is constant."""
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
    """Return the elements of each value that has three elements."""
    return [elements for value in values if len(elements := elements_of(value)) == 3]
