"""The results of code generation as plain data: shader text, node trees, and the files and attributes they read."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol

from lookdev.cache import Content
from lookdev.errors import CodegenError

TANGENT = "lookdev_tangent"
"""Name of the mesh attribute of the tangents. Only sources that depend on the direction of tangents read it."""

HANDEDNESS = "lookdev_handedness"
"""Name of the mesh attribute that is -1 where the first UV set is mirrored, 1 elsewhere."""


_PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,39}")
_NON_ALPHANUMERIC = re.compile(r"[^A-Za-z0-9]")
_RESERVED = {
    "position", "material_index", "sharp_face", "sharp_edge", "crease_vert", "crease_edge", "id", "radius",
    "velocity", "normal", "custom_normal", "prototype", "matrix", "N", "P",
    # Cycles computes these attributes, and looks them up before those of a mesh.
    "Ng", "corner_normal", "face_normal", "uv", "tangent", "tangent_sign", "undisplaced_tangent",
    "undisplaced_tangent_sign", "vertex_color", "generated", "generated_transform", "undeformed", "undisplaced",
    "particle", "undisplaced_N", "motion_P", "motion_N", "curve_intercept", "curve_length", "curve_random",
    "point_random", "ptex_face_id", "ptex_uv", "density", "color", "flame", "heat", "temperature", "pointiness",
    "velocity_x", "velocity_y", "velocity_z", "random_per_island", "shadow_transparency",
}  # fmt: skip
_SHORTENED = re.compile(r".*_[0-9a-f]{12}")


@dataclass(frozen=True)
class TextureBinding:
    """A texture of a shader: the parameter that has its path, and the linear EXR file."""

    parameter: str
    file: Content


@dataclass(frozen=True)
class TableBinding:
    """A table that a shader looks up: a parameter, and the file of its values.

    For an .npy file, the parameter is an array of all its float32 numbers; for an EXR, it has the path.
    """

    parameter: str
    file: Content


@dataclass(frozen=True)
class AttributeBinding:
    """A mesh attribute, and the parameter of a shader that has its value.

    On a mesh without the attribute, the value is `fallback`. If that is None, every mesh must have the attribute: it is
    a UV set, or the tangents.
    """

    parameter: str
    attribute: str
    kind: Literal["uv", "float", "color", "vector"]
    fallback: tuple[float, ...] | None = None

    @property
    def mesh_name(self) -> str:
        """The attribute's name on a mesh in Blender, where a UV set and a primvar cannot share a name."""
        if self.attribute in (TANGENT, HANDEDNESS):
            return self.attribute
        return f"{'' if self.kind == 'uv' else 'primvars:'}{short_name(self.attribute)}"

    @property
    def symbols(self) -> tuple[str, ...]:
        """The names of its numbers in a program: the parameter, with ``[0]``, ``[1]``, ... appended unless a float."""
        return tuple(f"{self.parameter}[{i}]" for i in range(self.width)) if self.width > 1 else (self.parameter,)

    @property
    def width(self) -> int:
        """The number of components of the value."""
        return {"float": 1, "uv": 2}.get(self.kind, 3)


def short_name(name: str) -> str:
    """Return the name of a UV set or primvar in Blender and in shaders; different names stay different.

    Names are changed because Blender truncates them, OSL's identifiers are ASCII, and some names have a meaning in
    Blender, in Cycles or here.
    """
    plain = _PLAIN.fullmatch(name) and name not in _RESERVED and not _SHORTENED.fullmatch(name)
    if plain and not name.startswith("lookdev_"):
        return name
    return f"{_NON_ALPHANUMERIC.sub('_', name[:24])}_{hashlib.sha256(name.encode()).hexdigest()[:12]}"


TANGENT_BINDING = AttributeBinding("shading_tangent", TANGENT, "vector")


class GeneratedSource(Protocol):
    """A look generated for one backend, as it is assigned to a slot of an asset: a frozen dataclass of plain data.

    It reads `attributes` and `images`. `digest` depends on everything that affects the picture. A look `transmits` if
    light passes through its surface, and is `see_through` if its presence is below 1 somewhere.
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


Catching = Literal["", "ground", "asset"]
"""In a scene with a shadow catcher: whether a look is that of the ground or of the asset; else ``""``."""

LOBE_GROUPS = ("diffuse", "specular", "clearcoat", "sheen", "transmission")
"""The groups of lobes whose light can be recorded. Light of a lobe that transmits is recorded in the last."""

FIRST_LIGHT_PART = 2 + len(LOBE_GROUPS)
"""The index of the first group of lights among the parts of light that shaders record."""


@dataclass(frozen=True)
class ShaderSource:
    """A `GeneratedSource` of OSL.

    Attributes
    ----------
    directions
        The numbers of directions drawn at a shading point from the BSDF and from the light.
    shadows
        Whether rays are traced along these directions.
    constants
        Numbers of the look. The text refers to them as ``look_0``, ``look_1``, ...
    varying
        Indices of constants that are not compiled into the shader. Sources that share a `program` differ only in these.
    recorded
        The groups in `LOBE_GROUPS` that the look has, if the source can record parts of its light.
    folded
        The number of lobes for which no code is generated, as constants make them 0.
    catching
        Whether the source can show the parts of a frame with a shadow catcher, and which part the look is.
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
    tables: tuple[TableBinding, ...] = ()
    constants: tuple[float, ...] = ()
    varying: tuple[int, ...] = ()
    recorded: tuple[str, ...] = ()
    folded: int = 0
    catching: Catching = ""

    @property
    def program(self) -> ShaderSource:
        """The part of the source that is compiled: without name and digest, and with 0 for constants that vary."""
        fixed = tuple(0.0 if index in self.varying else constant for index, constant in enumerate(self.constants))
        return replace(self, name="", digest="", constants=fixed)

    @property
    def images(self) -> tuple[Content, ...]:
        return tuple(binding.file for binding in self.textures)


def shared_programs(sources: Iterable[ShaderSource]) -> dict[ShaderSource, ShaderSource]:
    """Return, for each source, an equivalent one that shares its program with all sources of the same text.

    Constants that are equal in all these sources stay constants. The picture does not change: the shader reads a number
    that was a literal in its code.
    """
    by_text: dict[ShaderSource, list[ShaderSource]] = {}
    for source in dict.fromkeys(sources):
        by_text.setdefault(replace(source, name="", digest="", constants=()), []).append(source)
    shared: dict[ShaderSource, ShaderSource] = {}
    for members in by_text.values():
        columns = zip(*(source.constants for source in members), strict=True)
        varying = tuple(index for index, column in enumerate(columns) if len(set(column)) > 1)
        shared |= {source: replace(source, varying=varying) for source in members}
    return shared


@dataclass(frozen=True)
class ProgramOperation:
    """One step of a program. Operands are the numbers of earlier steps, whose results it reads.

    `op` is NumPy's name of a ufunc, ``"where"``, or one of these:

    ``"constant"``, ``"truth"``
        The number, or the truth, `value`.
    ``"uniform"``
        The number at `index` of the program's constants.
    ``"symbol"``
        The symbol `name`.
    ``"look_up"``
        A cell of the table at `index`; the operands are its row and column. `value` is the number of columns of
        the table, `name` the channel that is read, or ``""`` if cells are numbers.
    """

    op: str
    operands: tuple[int, ...] = ()
    value: float = 0.0
    index: int = 0
    name: str = ""


@dataclass(frozen=True)
class ImageBinding:
    """A look-up of an image in a program: symbols ``name[0]`` to ``name[2]`` and ``name_a`` are its four channels.

    Coordinates are those of the attribute `uv` after the affine map `transform`, whose rows of three are for s and t.
    `files` are by the number of a UDIM tile, or 0. With `slopes`, channels 0 and 1 are slopes of heights, which change
    sign where the image is mirrored.
    """

    name: str
    uv: str
    slopes: bool
    wrap_s: str
    wrap_t: str
    transform: tuple[float, ...]
    files: Mapping[int, Content]


@dataclass(frozen=True)
class ProgramSource:
    """A `GeneratedSource` of operations on numbers, for renderers that trace programs themselves.

    With `shadows`, rays are traced. A look is `glossy` if no lobe is broad or transmits light. `folded` is as in
    `ShaderSource`. `outputs` are the numbers of operations, by these names:

    ``tangent bitangent normal facet`` (3)
        Vectors in world space, functions of the symbols of the mesh.
    ``value`` (3), ``pdf``
        The BSDF times the cosine of each lobe, and its density, functions of the symbols ``wo_x .. wi_z``.
    ``wi`` (3)
        A direction drawn by ``u1 u2``.
    ``diffuse`` (3)
        The part of ``value`` from diffuse lobes.
    ``of_<group>`` (6)
        For each group in `recorded` that has lobes, their part of ``value``, and the part of that from diffuse lobes.
    ``delta0 ..`` (7)
        A single direction, the factor of light from there, and the index of its group. The symbol ``inside`` is 1 where
        the viewer is in the solid.
    ``presence``
        Present if the look is `see_through`.
    ``albedo``, ``bent`` (3)
        Guides of a denoiser.
    ``value/roughness``
        The derivative of an output with respect to a symbol of a live input, here ``roughness``.
    """

    name: str
    operations: tuple[ProgramOperation, ...]
    outputs: Mapping[str, tuple[int, ...]]
    constants: tuple[float, ...]
    look_ups: tuple[ImageBinding, ...]
    attributes: tuple[AttributeBinding, ...]
    tables: tuple[Content, ...]
    digest: str
    transmits: bool = False
    see_through: bool = False
    shadows: bool = True
    deltas: int = 0
    glossy: bool = False
    recorded: tuple[str, ...] = ()
    folded: int = 0

    @property
    def images(self) -> tuple[Content, ...]:
        return tuple(file for look_up in self.look_ups for file in look_up.files.values())

    def check_plugin(self, look: str) -> None:
        """Raise CodegenError if the look cannot be a BSDF plug-in in a scene of Mitsuba.

        It cannot if it has deltas, several UV sets, or primvars.
        """
        if self.deltas:
            raise CodegenError(f"{look}: scatters along single directions; Mitsuba's own plug-ins do that")
        uvs = {binding.attribute for binding in self.attributes if binding.kind == "uv"}
        if len(uvs) > 1:
            raise CodegenError(
                f"{look}: reads {len(uvs)} UV sets ({', '.join(sorted(uvs))}); Mitsuba's shapes have one"
            )
        if primvars := [binding.attribute for binding in self.attributes if binding.parameter.startswith("primvar_")]:
            raise CodegenError(f"{look}: reads the primvar '{primvars[0]}', which Mitsuba's shapes do not have")


@dataclass(frozen=True)
class PrincipledSource:
    """A Principled BSDF for the benchmark: its constants, by Blender's names of the sockets."""

    name: str
    inputs: Mapping[str, float | tuple[float, ...]]
    attributes: tuple[AttributeBinding, ...] = ()
    images: tuple[Content, ...] = ()
    transmits: bool = False
    see_through: bool = False

    @property
    def digest(self) -> str:
        return hashlib.sha256(json.dumps([self.name, self.inputs], sort_keys=True).encode()).hexdigest()


SocketValue = float | tuple[float, ...] | str
"""The value of a socket, or of a property of a node."""


@dataclass(frozen=True)
class NodeLink:
    """A link to an output of a node of the same tree: the node's name, and Blender's identifier of the socket."""

    node: str
    socket: str


@dataclass(frozen=True)
class ShaderNode:
    """One shader node of Blender.

    `kind` is Blender's type without the prefix ``ShaderNode`` (``"Math"``), or ``"NodeGroupInput"``,
    ``"NodeGroupOutput"``. `properties` are attributes of the node (``{"operation": "ADD"}``), `inputs` the values of
    its sockets by identifier. A ``"Group"`` is an instance of the tree named `group`. A ``"TexImage"`` reads the file
    `image`, without colour conversion. `position` is the upper left corner, in Blender's units.
    """

    name: str
    kind: str
    properties: Mapping[str, SocketValue | bool] = field(default_factory=dict)
    inputs: Mapping[str, SocketValue | NodeLink] = field(default_factory=dict)
    label: str = ""
    group: str = ""
    image: Content | None = None
    position: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class GroupSocket:
    """A socket of a group's interface, identified by its name; `default`, `soft` and `help` are as in `Parameter`."""

    name: str
    kind: Literal["float", "color", "vector", "shader"]
    default: SocketValue = 0.0
    soft: tuple[float, float] = (0.0, 1.0)
    help: str = ""
    panel: str = ""


@dataclass(frozen=True)
class NodeTree:
    """The nodes of a group, or of a material, which has no inputs and outputs."""

    name: str
    nodes: tuple[ShaderNode, ...]
    inputs: tuple[GroupSocket, ...] = ()
    outputs: tuple[GroupSocket, ...] = ()


@dataclass(frozen=True)
class NodeSource:
    """A `GeneratedSource` of native nodes: groups, each after those that it contains, then the material's own tree.

    If `exact`, the nodes send rays along one importance-sampled direction through a ray portal; else they are Cycles'
    closures.
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
        return tuple(node.image for tree in self.trees for node in tree.nodes if node.image is not None)
