"""A MaterialX document, its connections followed to their sources.

Documents are not upgraded to the package's version: what `disney_principled` needs has not changed since 1.38.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

import MaterialX as mx

from lookdev.errors import Fault, LookError
from lookdev.mtlx import read_document
from lookdev.text import TextError, read_bytes


@dataclass(frozen=True)
class Source:
    """The source of a value: a node that computes it, or the port that holds it.

    `output` and `channels` are the part of a node's result; both may be empty.
    """

    element: Any
    output: str
    channels: str

    @property
    def computed(self) -> bool:
        """Whether a node computes the value."""
        return isinstance(self.element, mx.Node)


class Network:
    """A document, its connections, and what of it is carried over, not carried over, or wrong.

    Raises
    ------
    LookError
        The file is missing or is not a MaterialX document of a known version.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        self._nodes: dict[str, Any] = {}
        self._sources: dict[str, Source] = {}
        self._carried: set[str] = set()
        self._lost: dict[Fault, None] = {}
        self._faults: dict[Fault, None] = {}
        self.document = self._read()

    @property
    def unmapped(self) -> tuple[Fault, ...]:
        """What is not carried over, in the order of reading."""
        return tuple(self._lost)

    def fault(self, where: str, what: str, hint: str = "") -> None:
        """Note that the document is wrong: `check` raises."""
        self._faults[Fault(str(self.file), where, what, hint)] = None

    def check(self) -> None:
        """Raise every fault noted so far as a LookError."""
        if self._faults:
            raise LookError(self._faults)

    def lose(self, element: Any, what: str, hint: str = "") -> None:
        """Note something of an element, or of a place in the file, that is not carried over."""
        where = element if isinstance(element, str) else element.getNamePath()
        self._lost[Fault(str(self.file), where, what, hint)] = None

    def lose_value(self, port: Any, hint: str = "") -> None:
        """Note that the value of an input is not carried over."""
        source = self.source(port)
        if source.computed:
            what = f"the connection to <{source.element.getCategory()}> '{source.element.getNamePath()}'"
        else:
            what = f"'{source.element.getValueString():.40}'"
        self.lose(port, f"{what} is not carried over", hint)

    def carry(self, node: Any, *names: str) -> None:
        """Note that a node is carried over, but none of its inputs except `names`."""
        self._carried.add(node.getNamePath())
        for port in node.getInputs():
            if port.getName() not in names:
                self.lose_value(port)

    def lose_the_rest(self) -> None:
        """Note every node that is not carried over, and all else in the document."""
        for path, node in self._nodes.items():
            if path not in self._carried:
                self.lose(node, f"<{node.getCategory()}> is not carried over")
        for child in self.document.getChildren():
            for each in child.getNodes() if isinstance(child, mx.NodeGraph) else [child]:
                if not isinstance(each, mx.Output) and each.getNamePath() not in self._nodes:
                    self.lose(each, f"<{each.getCategory()}> is not carried over", "no imported material uses it")

    def source(self, port: Any) -> Source:
        """Return the source of an input of a node that `connect` has reached."""
        return self._sources[port.getNamePath()]

    def connect(self, roots: Sequence[Any]) -> None:
        """Follow all connections upstream of some nodes; note those that are broken or run in a cycle."""
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
                if source.computed:
                    graph[path].append(source.element.getNamePath())
                    pending.append(source.element)
        try:
            TopologicalSorter(graph).prepare()
        except CycleError as error:
            self.fault(error.args[1][0], "its connections run in a cycle")

    def _follow(self, port: Any) -> Source | None:
        """Follow a port through interface inputs, node graphs and outputs; None, and a fault, where that is broken."""
        place, channels = port.getNamePath(), port.getAttribute("channels")
        seen: set[str] = set()
        while (path := port.getNamePath()) not in seen:
            seen.add(path)
            # An output connects to its siblings, an input to siblings of its node or node graph.
            scope = port.getParent() if isinstance(port, mx.Output) else port.getParent().getParent()
            links = ("interfacename", "nodegraph", "nodename", "output")
            interface, graph, node, output = (port.getAttribute(name) for name in links)
            if interface:
                name, target = interface, scope.getInput(interface)
            elif graph:
                name, target = f"{graph}.{output}", self._output_of(scope, graph, output)
            elif node:
                name, target = node, scope.getChild(node)
                if isinstance(target, mx.Node):
                    return Source(target, output, channels)
                target = None
            elif output:
                name, target = output, scope.getOutput(output)
            else:
                return Source(port, "", "")
            if target is None:
                self.fault(path, f"is connected to '{name}', which is not there")
                return None
            port, channels = target, port.getAttribute("channels") or channels
        self.fault(place, "its connections run in a cycle")
        return None

    def _output_of(self, scope: Any, graph: str, output: str) -> Any | None:
        found = scope.getChild(graph) or self.document.getChild(graph)
        if not isinstance(found, mx.NodeGraph):
            return None
        outputs = found.getOutputs()
        return found.getOutput(output) if output else outputs[0] if len(outputs) == 1 else None

    def _read(self) -> Any:
        try:
            data = read_bytes(self.file)
        except TextError as error:
            raise LookError(error.faults) from None
        document, includes = read_document(data, str(self.file))
        self._lost |= dict.fromkeys(includes)
        return document
