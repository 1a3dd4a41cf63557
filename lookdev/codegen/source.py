"""The results of code generation, as plain data that renderers and their worker processes read.

A `GeneratedSource` is one look for one backend: OSL text (`ShaderSource`), node trees (`NodeSource`), operations on
numbers (`ProgramSource`), or Blender's Principled BSDF (`PrincipledSource`). Bindings are the files and the mesh
attributes that a source reads.
"""

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


# The pattern of names that `short_name` keeps, unless they are in `_RESERVED` or match `_SHORTENED`.
_PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,39}")
_NON_ALPHANUMERIC = re.compile(r"[^A-Za-z0-9]")
_RESERVED = {
    # Attributes of Blender and of this package, and globals of OSL.
    "position", "material_index", "sharp_face", "sharp_edge", "crease_vert", "crease_edge", "id", "radius",
    "velocity", "normal", "custom_normal", "prototype", "matrix", "N", "P",
    # Cycles computes these attributes, and looks them up before the attributes of a mesh.
    "Ng", "corner_normal", "face_normal", "uv", "tangent", "tangent_sign", "undisplaced_tangent",
    "undisplaced_tangent_sign", "vertex_color", "generated", "generated_transform", "undeformed", "undisplaced",
    "particle", "undisplaced_N", "motion_P", "motion_N", "curve_intercept", "curve_length", "curve_random",
    "point_random", "ptex_face_id", "ptex_uv", "density", "color", "flame", "heat", "temperature", "pointiness",
    "velocity_x", "velocity_y", "velocity_z", "random_per_island", "shadow_transparency",
}  # fmt: skip
_SHORTENED = re.compile(r".*_[0-9a-f]{12}")


@dataclass(frozen=True)
class TextureBinding:
    """An image that a shader reads: the linear EXR file, and the shader's parameter that has the file's path."""

    parameter: str
    file: Content


@dataclass(frozen=True)
class TableBinding:
    """A table of numbers that a shader reads: the file of the numbers, and the shader's parameter for them.

    If the file is an .npy, the parameter is an array of all its float32 numbers. If it is an EXR, the parameter has the
    file's path.
    """

    parameter: str
    file: Content


@dataclass(frozen=True)
class AttributeBinding:
    """A mesh attribute, and the name of the shader's parameter that has the attribute's value.

    `attribute` is the attribute's name: either its name in USD, or one of `TANGENT` and `HANDEDNESS`. `kind` is the
    type of the values; a ``"uv"`` is a UV set. On a mesh without the attribute, the value is `fallback`. UV sets and
    tangents have no fallback: every mesh must have them.
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
        """The names of the value's components in a program: ``<parameter>[0]`` etc., or ``<parameter>`` of a float."""
        return tuple(f"{self.parameter}[{i}]" for i in range(self.width)) if self.width > 1 else (self.parameter,)

    @property
    def width(self) -> int:
        """The number of components of the value."""
        return {"float": 1, "uv": 2}.get(self.kind, 3)


def short_name(name: str) -> str:
    """Return the name that a UV set or primvar has in Blender and in shaders; different names stay different.

    A name is changed if Blender would truncate it, if it is not an identifier of OSL, or if it already has a meaning in
    Blender, in Cycles or in this package. The new name ends with 12 digits of the old name's hash.
    """
    plain = _PLAIN.fullmatch(name) and name not in _RESERVED and not _SHORTENED.fullmatch(name)
    if plain and not name.startswith("lookdev_"):
        return name
    return f"{_NON_ALPHANUMERIC.sub('_', name[:24])}_{hashlib.sha256(name.encode()).hexdigest()[:12]}"


TANGENT_BINDING = AttributeBinding("shading_tangent", TANGENT, "vector")
"""The binding of the tangents."""


class GeneratedSource(Protocol):
    """A look generated for one backend: a frozen dataclass of plain data.

    `attributes` are the mesh attributes that the source reads, `images` the files of its textures. The `digest` depends
    on everything that affects the picture. The look `transmits` if light passes through its surface. The look is
    `see_through` if its presence is below 1 somewhere.
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
"""In a scene with a shadow catcher, ``"ground"`` or ``"asset"``: the one that has a look. Else ``""``."""

LOBE_GROUPS = ("diffuse", "specular", "clearcoat", "sheen", "transmission")
"""The groups of lobes: a render can record a picture of each group's light. The last has all transmitting lobes."""

FIRST_LIGHT_PART = 2 + len(LOBE_GROUPS)
"""The number of the first group of lights among the numbered parts of the light that a shader records.

Part 0 is all light. Part 1 is the light of lamps and domes that the first hit reflects. Part 2 + i is the light of
group i in `LOBE_GROUPS`.
"""


@dataclass(frozen=True)
class ShaderSource:
    """A `GeneratedSource` of OSL.

    Attributes
    ----------
    osl
        The shader's text.
    textures, tables
        The images and the tables of numbers that the shader reads.
    directions
        The number of directions drawn at a shading point from the BSDF, and the number drawn from the light.
    shadows
        Whether rays are traced along these directions.
    constants
        Numbers of the look. The text refers to them as ``look_0``, ``look_1``, ...
    varying
        Indices of the constants that are parameters of the compiled shader, rather than part of its code. Sources of
        one `program` differ only in these constants.
    recorded
        The groups in `LOBE_GROUPS` that the look has, if the source can record the light of each group. Else empty.
    folded
        The number of lobes for which no code is generated, because the look's constants make them 0.
    catching
        Whether the ground or the asset has the look, in a scene with a shadow catcher (`Catching`).
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
        """The part of the source that the renderer compiles: no name, no digest, and 0 for each varying constant."""
        fixed = tuple(0.0 if index in self.varying else constant for index, constant in enumerate(self.constants))
        return replace(self, name="", digest="", constants=fixed)

    @property
    def images(self) -> tuple[Content, ...]:
        return tuple(binding.file for binding in self.textures)


def shared_programs(sources: Iterable[ShaderSource]) -> dict[ShaderSource, ShaderSource]:
    """Return an equivalent of each source, by the source; sources of the same text then share `ShaderSource.program`.

    A constant that differs among sources of the same text becomes `varying`: it is a parameter of the shader instead of
    a literal in its code. The pictures stay the same.
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
    """One operation in a program's list of operations.

    The result of an operation is a number or a boolean. The operation reads the results of earlier operations;
    `operands` are the indices of these in the list. `op` is NumPy's name of a ufunc, ``"where"``, or one of these:

    ``"constant"``
        The result is the number `value`.
    ``"truth"``
        The result is the boolean `value`, 0 or 1.
    ``"uniform"``
        The result is the number at `index` of `ProgramSource.constants`.
    ``"symbol"``
        The result is the value of the symbol `name`, which the renderer supplies.
    ``"look_up"``
        The result is read from a cell of the program's table number `index`. The operands are the cell's row and
        column, and `value` is the number of columns of the table. If cells are colours, `name` is the channel, ``"0"``
        to ``"2"``; else it is ``""``.
    """

    op: str
    operands: tuple[int, ...] = ()
    value: float = 0.0
    index: int = 0
    name: str = ""


@dataclass(frozen=True)
class ImageBinding:
    """A look-up of an image in generated code.

    The symbols ``<name>[0]``, ``<name>[1]``, ``<name>[2]`` and ``<name>_a`` are the image's four channels. `uv` is the
    shader's parameter for the UV set. The affine map `transform` converts UV coordinates to the texture coordinates s
    and t: its first three numbers are the row for s, the others the row for t. `wrap_s` and `wrap_t` are wrap modes of
    UsdUVTexture. `files` has the images of UDIM tiles by the tile's number; an image without tiles has the key 0. With
    `slopes`, channels 0 and 1 are the slopes of a height map along s and t. A slope changes sign where the image is
    mirrored.
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
    """A `GeneratedSource` of operations on numbers, for targets that compile or trace them: Mitsuba, GLSL and NumPy.

    If `shadows`, rays are traced from the shading point. A look is `glossy` if none of its lobes is broad, transmits or
    crosses the surface (`lookdev.brdf.Lobe`). `recorded` and `folded` are as in `ShaderSource`. `deltas` is the number
    of terms that scatter along a single direction. Operations read `constants` and `tables` by index. Symbols are
    channels of `look_ups`, components of `attributes`, and other values that the renderer supplies.

    `outputs` has the indices of the operations whose results are the components of an output, by the output's name. In
    this list, a number in parentheses is the number of components, 1 where it is left out:

    ``tangent``, ``bitangent``, ``normal``, ``facet`` (3)
        The axes of the shading frame and the facet's normal in world space, functions of the symbols of the mesh.
    ``value`` (3), ``pdf``
        The BSDF times the cosine, summed over the lobes, and the density with which ``wi`` is drawn. They are functions
        of the symbols ``wo_x`` to ``wo_z`` and ``wi_x`` to ``wi_z``, the directions to the viewer and to the light in
        the shading frame.
    ``wi`` (3)
        A direction to the light, drawn by the symbols ``u1`` and ``u2``.
    ``diffuse`` (3)
        The part of ``value`` from diffuse lobes.
    ``of_<group>`` (6)
        The part of ``value`` from the lobes of a group (3), then the part of ``value`` from the diffuse lobes among
        them (3). Each group in `recorded` that has lobes has this output.
    ``delta0``, ``delta1``, ... (7)
        A single direction (3), the factor of light from there (3), and the index in `LOBE_GROUPS` of the group in which
        this light is recorded. These numbers also depend on the symbol ``inside``, which is 1 where the viewer is
        inside the solid.
    ``presence``
        The presence. It exists if the look is `see_through`.
    ``albedo``, ``bent`` (3)
        The albedo and the mean normal of the lobes, which guide a denoiser.
    ``value/roughness``
        The derivative of ``value`` with respect to the symbol of a live input, here ``roughness``: a parameter that a
        fit varies. Other outputs have derivatives, too.
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
        """Raise CodegenError if the look, named `look`, cannot be a BSDF plug-in in a scene of Mitsuba.

        A plug-in has no deltas, no primvars and at most one UV set.
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
    its sockets by Blender's identifier. `label` is Blender's label of the node, or ``""``. A ``"Group"`` is an instance
    of the tree named `group`. A ``"TexImage"`` reads the file `image`, without colour conversion. `position` is the
    upper left corner of the node in Blender's editor, in Blender's units.
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
    """A socket of a group's interface, identified by its name.

    `default`, the range `soft` and `help` are as in `lookdev.brdf.Parameter`. `panel` is the heading under which
    Blender shows the socket, or ``""``.
    """

    name: str
    kind: Literal["float", "color", "vector", "shader"]
    default: SocketValue = 0.0
    soft: tuple[float, float] = (0.0, 1.0)
    help: str = ""
    panel: str = ""


@dataclass(frozen=True)
class NodeTree:
    """The nodes of a group or of a material. Only a group has `inputs` and `outputs`, the sockets of its interface."""

    name: str
    nodes: tuple[ShaderNode, ...]
    inputs: tuple[GroupSocket, ...] = ()
    outputs: tuple[GroupSocket, ...] = ()


@dataclass(frozen=True)
class NodeSource:
    """A `GeneratedSource` of Blender's native nodes.

    `trees` are the groups, each after the groups that it contains, and last the material's own tree. If `exact`, the
    nodes send a ray along one importance-sampled direction through a ray portal; else they are Cycles' closures.
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
