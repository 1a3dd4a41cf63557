"""What code generation hands on: a shader's text and what it must be given to run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

from lookdev.cache import Content

HANDEDNESS = "lookdev_handedness"
"""Name of the mesh attribute that is -1 where the first UV set is mirrored, 1 elsewhere."""


@dataclass(frozen=True)
class TextureBinding:
    """A texture of a shader: the shader parameter that takes the path, and the linear EXR file."""

    parameter: str
    file: Content


@dataclass(frozen=True)
class AttributeBinding:
    """A mesh attribute of a shader.

    `parameter` is the shader's, `attribute` the mesh's name for it. A mesh without it gets `fallback` everywhere;
    None means that every mesh must have it (a UV set).
    """

    parameter: str
    attribute: str
    kind: Literal["uv", "float", "color"]
    fallback: tuple[float, ...] | None = None


class Source(Protocol):
    """What a slot of an asset wears, made of a look for one kind of renderer: a frozen dataclass of plain data.

    `attributes` and `images` are what it reads, `digest` is that of all that affects the picture. Light passes through
    the surface where it `transmits`; the surface is not wholly present where it is `see_through`.
    """

    @property
    def name(self) -> str: ...
    @property
    def digest(self) -> str: ...
    @property
    def attributes(self) -> tuple[AttributeBinding, ...]: ...
    @property
    def images(self) -> tuple[Content, ...]: ...
    @property
    def transmits(self) -> bool: ...
    @property
    def see_through(self) -> bool: ...


@dataclass(frozen=True)
class ShaderSource:
    """One generated OSL shader: its text, what it reads, and the digest of text and texture contents.

    `directions` are how many of a shading point come from the BRDF and how many from the light; `shadows` where the
    asset may stand in their way.
    """

    name: str
    osl: str
    textures: tuple[TextureBinding, ...]
    attributes: tuple[AttributeBinding, ...]
    digest: str
    transmits: bool = False
    see_through: bool = False
    directions: tuple[int, int] = (0, 0)
    shadows: bool = True

    @property
    def images(self) -> tuple[Content, ...]:
        """The files of its textures."""
        return tuple(binding.file for binding in self.textures)


@dataclass(frozen=True)
class PrincipledSource:
    """A Principled BSDF, which the benchmark compares with: constants by Blender's names of its sockets."""

    name: str
    inputs: Mapping[str, float | tuple[float, ...]]
    attributes: tuple[AttributeBinding, ...] = ()
    images: tuple[Content, ...] = ()
    transmits: bool = False
    see_through: bool = False

    @property
    def digest(self) -> str:
        """The SHA-256 of name and inputs."""
        return hashlib.sha256(json.dumps([self.name, self.inputs], sort_keys=True).encode()).hexdigest()


SocketValue = float | tuple[float, ...] | str
"""What a socket, or a property of a node, is set to."""


@dataclass(frozen=True)
class Link:
    """An output of another node of the same tree: the node by its name, the socket by Blender's identifier."""

    node: str
    socket: str


@dataclass(frozen=True)
class ShaderNode:
    """One shader node of Blender.

    `kind` is Blender's type without ``ShaderNode`` in front (``"Math"``), or in full ``"NodeGroupInput"`` and
    ``"NodeGroupOutput"``. `properties` are attributes of the node (``{"operation": "ADD"}``), `inputs` what its sockets
    are given, by their identifiers. `group` is the name of the tree that a ``"Group"`` shows, `image` the file that a
    ``"TexImage"`` reads, without colour conversion. `place` is the upper left corner, in Blender's units.
    """

    name: str
    kind: str
    properties: Mapping[str, SocketValue | bool] = field(default_factory=dict)
    inputs: Mapping[str, SocketValue | Link] = field(default_factory=dict)
    label: str = ""
    group: str = ""
    image: Content | None = None
    place: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class GroupSocket:
    """A socket of a group's interface. Its identifier is its name.

    `default`, the `soft` range and `help` of an input are those of the model's parameter. `panel` is the panel that it
    stands in, or empty.
    """

    name: str
    kind: Literal["float", "color", "vector", "shader"]
    default: SocketValue = 0.0
    soft: tuple[float, float] = (0.0, 1.0)
    help: str = ""
    panel: str = ""


@dataclass(frozen=True)
class NodeTree:
    """The nodes of a group, or of a material, which has neither inputs nor outputs."""

    name: str
    nodes: tuple[ShaderNode, ...]
    inputs: tuple[GroupSocket, ...] = ()
    outputs: tuple[GroupSocket, ...] = ()


@dataclass(frozen=True)
class NodeSource:
    """A look as native shader nodes: groups, each after those that it shows, and the material's own tree last.

    `exact` where the nodes send one importance-sampled direction on through a ray portal; otherwise they are Cycles'
    own closures.
    """

    name: str
    trees: tuple[NodeTree, ...]
    attributes: tuple[AttributeBinding, ...]
    digest: str
    exact: bool
    transmits: bool = False
    see_through: bool = False

    @property
    def images(self) -> tuple[Content, ...]:
        """The files that its image nodes read."""
        return tuple(node.image for tree in self.trees for node in tree.nodes if node.image is not None)
