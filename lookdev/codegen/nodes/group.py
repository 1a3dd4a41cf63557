"""Groups of nodes whose sockets are parameters of the models."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from lookdev.brdf import Parameter
from lookdev.codegen.nodes.builder import TreeBuilder
from lookdev.codegen.nodes.fits import match_fit
from lookdev.codegen.source import GroupSocket, Link, NodeTree
from lookdev.codegen.trace.graph import Graph, Node
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols


class Group:
    """One group that is being built from values traced in a graph of its own."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.graph = Graph()
        self.builder = TreeBuilder(name, match_fit)
        # By the name of a socket, its value: an array of the graph of the tree that shows the group.
        self._given: dict[str, Any] = {}
        self._sockets: list[GroupSocket] = []
        self._input = self.builder.add("NodeGroupInput")

    def take(self, parameters: Mapping[str, Parameter], values: Mapping[str, Any], panel: str = "") -> dict[str, Any]:
        """Return values of parameters inside the group: symbols of sockets, or constants at which terms vanish.

        `values` are tokens, and arrays of the graph outside. The name of a panel is part of the names of its sockets.
        A parameter with the value of the one that it follows has that one's socket.
        """
        inside: dict[str, Any] = {}
        for name, value in values.items():
            parameter = parameters[name]
            if followed := followed_by(parameter, values):
                inside[name] = inside[followed]
                continue
            if parameter.kind == "token" or _folds(parameter, value):
                inside[name] = value
                continue
            place = f"{panel} {name}" if panel else name
            self._sockets.append(replace(socket_of(parameter), name=place, panel=panel))
            self._given[place] = value
            vector = parameter.kind != "float"
            inside[name] = bound(self.graph, self.builder, place, Link(self._input, place), vector=vector)
        return inside

    def take_shader(self, name: str, panel: str = "") -> Link:
        """Add a socket for a shader and return its output inside."""
        self._sockets.append(GroupSocket(name, "shader", panel=panel))
        return Link(self._input, name)

    def tree(self, values: Mapping[GroupSocket, Any], shader: Link | None = None, *, shades: bool = True) -> NodeTree:
        """Return the tree; its outputs are a shader, if it `shades`, black without one, and `values` of the graph."""
        self.builder.prepare(_vectors(values.values()))
        inputs: dict[str, Any] = {socket.name: built(self.builder, value) for socket, value in values.items()}
        outputs = list(values)
        if shader is not None:
            inputs["Shader"] = shader
        if shades:
            outputs.insert(0, GroupSocket("Shader", "shader"))
        self.builder.add("NodeGroupOutput", inputs=inputs)
        return self.builder.tree(self._sockets, outputs)

    def show(self, outside: TreeBuilder, tree: NodeTree, shaders: Mapping[str, Link] | None = None) -> str:
        """Add a node that shows the finished tree to another tree, with its sockets' values; return its name."""
        given = self.wanted(tree)
        outside.prepare(_vectors(given.values()))
        inputs: dict[str, Any] = {name: built(outside, value) for name, value in given.items()}
        return outside.add("Group", inputs=inputs | dict(shaders or {}), group=self.name)

    def wanted(self, tree: NodeTree) -> dict[str, Any]:
        """Return the values of the finished tree's sockets, by name."""
        return {socket.name: self._given[socket.name] for socket in tree.inputs if socket.kind != "shader"}


def followed_by(parameter: Parameter, values: Mapping[str, Any]) -> str:
    """Return the name of the parameter that a parameter follows, if `values` has the same value for both; else ""."""
    followed = parameter.follows
    same = followed and elements_of(values[parameter.name]) == elements_of(values[followed])
    return followed if same else ""


def socket_of(parameter: Parameter) -> GroupSocket:
    """Return the socket of a parameter, by its own name."""
    kind: Any = "vector" if parameter.kind == "normal" else parameter.kind
    return GroupSocket(parameter.name, kind, parameter.default, parameter.soft, parameter.help)


def bound(graph: Graph, builder: TreeBuilder, name: str, link: Link, *, vector: bool) -> Any:
    """Return symbols of a name that are bound to an output, as an array, () or (3,)."""
    value = symbols_of(graph, name, vector=vector)
    builder.bind([str(node.args[0]) for node in elements_of(value)], link)
    return value


def symbols_of(graph: Graph, name: str, *, vector: bool) -> Any:
    """Return symbols of that name as an array, () or (3,)."""
    return symbols(graph, [f"{name}_{i}" for i in range(3)]) if vector else symbol(graph, name)


def built(builder: TreeBuilder, value: Any) -> Link | float | tuple[float, float, float]:
    """Return the output in a tree that has an array, () or (3,), or its constants."""
    elements = elements_of(value)
    return builder.vector(elements) if len(elements) == 3 else builder.scalar(elements[0])


def _folds(parameter: Parameter, value: Any) -> bool:
    """Return whether a value is a constant at which terms of the model vanish."""
    elements = elements_of(value)
    if any(isinstance(each, Node) for each in elements):
        return False
    if parameter.optional and elements[0] == parameter.default:
        return True
    if parameter.kind == "normal":
        return bool(elements[0] == elements[1] == 0.0 and elements[2] > 0.0)
    return not any(elements) if parameter.kind == "color" else elements[0] in parameter.hard


def _vectors(values: Iterable[Any]) -> list[list[Any]]:
    return [elements for value in values if len(elements := elements_of(value)) == 3]
