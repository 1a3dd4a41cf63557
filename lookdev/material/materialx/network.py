"""Reads a MaterialX document for import: follows its connections, and collects its faults and losses.

Documents are not upgraded to the version of the MaterialX package: the nodes that `disney_principled` uses have not
changed since 1.38.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import MaterialX as mx

from lookdev.errors import Fault, LookError
from lookdev.mtlx import read_document
from lookdev.safe_text import TextError, read_bytes


@dataclass(frozen=True)
class PortSource:
    """The source of a value: the `element` is the node that computes it, or the port that states it.

    `output` is the name of the node's output. `channels` has the letters of the selected channels. Both may be empty.
    """

    element: mx.TypedElement
    output: str
    channels: str

    @property
    def is_computed(self) -> bool:
        """Whether a node computes the value."""
        return isinstance(self.element, mx.Node)


class DocumentNetwork:
    """The network of nodes of a document.

    A *fault* is an error of the document. A *loss* is a node, a connection or an input that is not carried over to a
    look. Readers mark the nodes that they carry over; all other nodes are losses in the end.

    Raises
    ------
    LookError
        The file is missing or is not a MaterialX document of a known version.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        self._nodes: dict[str, mx.Node] = {}
        self._sources: dict[str, PortSource] = {}
        self._carried: set[str] = set()
        self._losses: dict[Fault, None] = {}
        self._faults: dict[Fault, None] = {}
        self.document = self._read()

    @property
    def losses(self) -> tuple[Fault, ...]:
        """The losses so far, in the order in which they were found."""
        return tuple(self._losses)

    def add_fault(self, where: str, message: str, hint: str = "") -> None:
        """Add a fault of the document, which `raise_faults` raises."""
        self._faults[Fault(str(self.file), where, message, hint)] = None

    def raise_faults(self) -> None:
        """Raise a LookError with all faults so far, if there are any."""
        if self._faults:
            raise LookError(self._faults)

    def add_loss(self, element: mx.Element | str, message: str, hint: str = "") -> None:
        """Add a loss; `element` is the element that is lost, or a text that says where it is in the file."""
        where = element if isinstance(element, str) else element.getNamePath()
        self._losses[Fault(str(self.file), where, message, hint)] = None

    def add_value_loss(self, port: mx.Input, hint: str = "") -> None:
        """Add the loss of an input's value: a constant or a connection."""
        source = self.source_of(port)
        if source.is_computed:
            value = f"the connection to <{source.element.getCategory()}> '{source.element.getNamePath()}'"
        else:
            value = f"'{source.element.getValueString():.40}'"
        self.add_loss(port, f"{value} is not carried over", hint)

    def mark_carried(self, node: mx.Node, *names: str) -> None:
        """Mark a node as carried over with its inputs `names`, and add the losses of its other inputs."""
        self._carried.add(node.getNamePath())
        for port in node.getInputs():
            if port.getName() not in names:
                self.add_value_loss(port)

    def add_unread_losses(self) -> None:
        """Add a loss for each node, and each other element of the document, that is not marked as carried over."""
        for path, node in self._nodes.items():
            if path not in self._carried:
                self.add_loss(node, f"<{node.getCategory()}> is not carried over")
        for child in self.document.getChildren():
            for node in child.getNodes() if isinstance(child, mx.NodeGraph) else [child]:
                if not isinstance(node, mx.Output) and node.getNamePath() not in self._nodes:
                    self.add_loss(node, f"<{node.getCategory()}> is not carried over", "no imported material uses it")

    def source_of(self, port: mx.Input) -> PortSource:
        """Return the source of an input; the input must be of a node that `connect` has found."""
        return self._sources[port.getNamePath()]

    def connect(self, roots: Sequence[mx.Node]) -> None:
        """Find the nodes on which the nodes `roots` depend, and the sources of all their inputs.

        Broken connections and cycles are faults.
        """
        graph: dict[str, list[str]] = {}
        pending = list(roots)
        while pending:
            node = pending.pop()
            path = node.getNamePath()
            if path in graph:
                continue
            graph[path] = []
            self._nodes[path] = node
            for port in node.getInputs():
                source = self._follow(port)
                if source is None:
                    continue
                self._sources[port.getNamePath()] = source
                if source.is_computed:
                    graph[path].append(source.element.getNamePath())
                    pending.append(source.element)
        try:
            TopologicalSorter(graph).prepare()
        except CycleError as error:
            self.add_fault(error.args[1][0], "its connections run in a cycle")

    def _follow(self, port: mx.PortElement) -> PortSource | None:
        """Return the source of a port, through interface inputs and node graphs.

        None, with a fault added, where the connection is broken or runs in a cycle.
        """
        start, channels = port.getNamePath(), port.getAttribute("channels")
        seen: set[str] = set()
        while (path := port.getNamePath()) not in seen:
            seen.add(path)
            # An output connects to its siblings, an input to siblings of its node or node graph.
            scope = port.getParent() if isinstance(port, mx.Output) else port.getParent().getParent()
            link_names = ("interfacename", "nodegraph", "nodename", "output")
            interface, graph, node, output = (port.getAttribute(name) for name in link_names)
            if interface:
                name, target = interface, scope.getInput(interface)
            elif graph:
                name, target = f"{graph}.{output}", self._graph_output(scope, graph, output)
            elif node:
                name, target = node, scope.getChild(node)
                if isinstance(target, mx.Node):
                    return PortSource(target, output, channels)
                target = None
            elif output:
                name, target = output, scope.getOutput(output)
            else:
                return PortSource(port, "", "")
            if target is None:
                self.add_fault(path, f"is connected to '{name}', which is not there")
                return None
            port, channels = target, port.getAttribute("channels") or channels
        self.add_fault(start, "its connections run in a cycle")
        return None

    def _graph_output(self, scope: mx.Element, graph: str, output: str) -> mx.Output | None:
        """Return an output of the node graph `graph` in `scope` or the document.

        `output` is the name of the output; "" stands for the only output of the graph.
        """
        container = scope.getChild(graph) or self.document.getChild(graph)
        if not isinstance(container, mx.NodeGraph):
            return None
        outputs = container.getOutputs()
        return container.getOutput(output) if output else outputs[0] if len(outputs) == 1 else None

    def _read(self) -> mx.Document:
        """Read the document. Included files, which are not read, are losses."""
        try:
            data = read_bytes(self.file)
        except TextError as error:
            raise LookError(error.faults) from None
        document, includes = read_document(data, str(self.file))
        self._losses |= dict.fromkeys(includes)
        return document
