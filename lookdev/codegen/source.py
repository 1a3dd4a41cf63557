"""The results of code generation, as plain data: shaders' texts, node trees, and the files and attributes they read."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol

from lookdev.cache import Content
from lookdev.errors import CodegenError

TANGENT = "lookdev_tangent"
"""Name of the mesh attribute of the tangents, which only sources that depend on their direction read."""

HANDEDNESS = "lookdev_handedness"
"""Name of the mesh attribute that is -1 where the first UV set is mirrored, 1 elsewhere."""


_PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,39}")
_ODD = re.compile(r"[^A-Za-z0-9]")
_TAKEN = {"position", "material_index", "sharp_face", "sharp_edge", "crease_vert", "crease_edge", "id", "radius"}
_TAKEN |= {"velocity", "normal", "custom_normal", "prototype", "matrix", "N", "P"}
# What Cycles computes itself: it looks these up before the attributes of a mesh.
_TAKEN |= {"Ng", "corner_normal", "face_normal", "uv", "tangent", "tangent_sign", "undisplaced_tangent", "generated"}
_TAKEN |= {"undisplaced_tangent_sign", "vertex_color", "generated_transform", "undeformed", "undisplaced", "particle"}
_TAKEN |= {"undisplaced_N", "motion_P", "motion_N", "curve_intercept", "curve_length", "curve_random", "point_random"}
_TAKEN |= {"ptex_face_id", "ptex_uv", "density", "color", "flame", "heat", "temperature", "pointiness"}
_TAKEN |= {"velocity_x", "velocity_y", "velocity_z", "random_per_island", "shadow_transparency"}
_SHORTENED = re.compile(r".*_[0-9a-f]{12}")


@dataclass(frozen=True)
class TextureBinding:
    """A texture of a shader: the parameter that takes its path, and the linear EXR file."""

    parameter: str
    file: Content


@dataclass(frozen=True)
class TableBinding:
    """A table that a shader looks up: a parameter, and the file of its values.

    Of an .npy the parameter is an array of all its float32 numbers, of an EXR it takes the path.
    """

    parameter: str
    file: Content


@dataclass(frozen=True)
class AttributeBinding:
    """A mesh attribute, and the parameter of a shader that takes it.

    A mesh without it has `fallback` everywhere; None: every mesh must have it (a UV set, the tangents).
    """

    parameter: str
    attribute: str
    kind: Literal["uv", "float", "color", "vector"]
    fallback: tuple[float, ...] | None = None

    @property
    def stored(self) -> str:
        """The attribute's name on a mesh in Blender, where a UV set and a primvar cannot share one."""
        if self.attribute in (TANGENT, HANDEDNESS):
            return self.attribute
        return f"{'' if self.kind == 'uv' else 'primvars:'}{short_name(self.attribute)}"

    @property
    def symbols(self) -> tuple[str, ...]:
        """The names of its numbers in a program: of a float the parameter, else with ``[0]``, ``[1]`` behind it."""
        width = {"float": 0, "uv": 2}.get(self.kind, 3)
        return tuple(f"{self.parameter}[{i}]" for i in range(width)) if width else (self.parameter,)


def short_name(name: str) -> str:
    """Return the name of a UV set or primvar in Blender and in shaders, different for each.

    Blender cuts names, OSL's identifiers are ASCII, and some names have a meaning in Blender, in Cycles or here.
    """
    plain = _PLAIN.fullmatch(name) and name not in _TAKEN and not _SHORTENED.fullmatch(name)
    if plain and not name.startswith("lookdev_"):
        return name
    return f"{_ODD.sub('_', name[:24])}_{hashlib.sha256(name.encode()).hexdigest()[:12]}"


TANGENT_BINDING = AttributeBinding("shading_tangent", TANGENT, "vector")


class Source(Protocol):
    """A look as a slot of an asset wears it, generated for one backend: a frozen dataclass of plain data.

    It reads `attributes` and `images`; `digest` depends on all that affects the picture. A look `transmits` if light
    passes through its surface, and is `see_through` if its presence is below 1 somewhere.
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
"""Of a scene with a shadow catcher: whether a look is the ground's or the asset's."""

LOBE_GROUPS = ("diffuse", "specular", "clearcoat", "sheen", "transmission")
"""The groups of lobes whose light can be recorded; a lobe that transmits is of the last, whatever its own."""

FIRST_LIGHT_PART = 2 + len(LOBE_GROUPS)
"""The number of the first group of lights among the parts of the light that shaders record."""


@dataclass(frozen=True)
class ShaderSource:
    """A `Source` of OSL.

    The text reads the look's `constants` by their names `look_0`, `look_1`, ...; those of the places `varying` are not
    compiled into it, so that sources with one `program` differ in numbers alone. `directions` are the numbers drawn at
    a shading point from the BSDF and from the light; with `shadows`, rays are traced along them. `recorded` are those
    of `LOBE_GROUPS` that the look has, if it can record parts of its light. So many lobes are `folded`: constants make
    them 0, and no code is theirs. If `catching`, it can show the parts of a frame with a shadow catcher.
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
        """What is compiled: it has neither name nor digest, and 0 for constants that vary."""
        fixed = tuple(0.0 if place in self.varying else each for place, each in enumerate(self.constants))
        return replace(self, name="", digest="", constants=fixed)

    @property
    def images(self) -> tuple[Content, ...]:
        return tuple(binding.file for binding in self.textures)


@dataclass(frozen=True)
class Operation:
    """One step of a program, on the results of earlier ones by their numbers.

    `op` is NumPy's name of a ufunc, or ``"where"``; or it has no operands: ``"constant"`` and ``"truth"``, of a
    `value`; ``"uniform"``, the number `place` among the program's constants; ``"symbol"``, of a `name`. ``"look_up"``
    reads the cell of a row and a column of the table `place`, whose columns number `value`, and there the channel
    `name`, if it has channels.
    """

    op: str
    operands: tuple[int, ...] = ()
    value: float = 0.0
    place: int = 0
    name: str = ""


@dataclass(frozen=True)
class ImageBinding:
    """A look-up of an image in a program: symbols ``name[0]`` to ``name[2]`` and ``name_a`` are its four channels.

    Coordinates are those of the attribute `uv` after the affine map of `transform`, (s, t) as rows of three. `files`
    are by the number of a UDIM tile, or 0. `slopes`: the channels 0 and 1 change sign where the image is mirrored.
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
    """A `Source` of operations on numbers, for renderers that trace programs themselves.

    `outputs` are the results by name. ``tangent bitangent normal facet`` are vectors of the world and depend on the
    symbols of the mesh; ``value`` (3) is the BSDF times the cosine of each lobe and ``pdf`` its density, of the symbols
    ``wo_x .. wi_z``; ``wi`` (3) a direction drawn by ``u1 u2``. ``diffuse`` (3) is what of the value is of diffuse
    lobes, ``of_<group>`` (6) the value of each of the groups `recorded` that has lobes, and what of that is of diffuse
    ones. ``delta0 ..`` (7) are a single direction each, what light from there is multiplied by, and the number of its
    group; where the viewer is in the solid, the symbol ``inside`` is 1. ``presence`` is there if the look is
    `see_through`; ``albedo`` and ``bent`` (3) guide a denoiser; ``value/roughness`` is the derivative of an output by a
    symbol of a live input. With `shadows`, rays are traced. A look is `glossy` if no lobe is broad or lets light pass.
    `folded` as in `ShaderSource`.
    """

    name: str
    operations: tuple[Operation, ...]
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
        return tuple(file for each in self.look_ups for file in each.files.values())

    def check_plugin(self, look: str) -> None:
        """Raise CodegenError for what a BSDF of Mitsuba's own scenes has not: single directions, UV sets, primvars."""
        if self.deltas:
            raise CodegenError(f"{look}: scatters along single directions; Mitsuba's own plug-ins do that")
        uvs = {each.attribute for each in self.attributes if each.kind == "uv"}
        if len(uvs) > 1:
            raise CodegenError(
                f"{look}: reads {len(uvs)} UV sets ({', '.join(sorted(uvs))}); Mitsuba's shapes have one"
            )
        if primvars := [each.attribute for each in self.attributes if each.parameter.startswith("primvar_")]:
            raise CodegenError(f"{look}: reads the primvar '{primvars[0]}', which Mitsuba's shapes do not have")


@dataclass(frozen=True)
class PrincipledSource:
    """A Principled BSDF for the benchmark: constants by Blender's names of its sockets."""

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
class Link:
    """An output of a node of the same tree: the node's name, and Blender's identifier of the socket."""

    node: str
    socket: str


@dataclass(frozen=True)
class ShaderNode:
    """One shader node of Blender.

    `kind` is Blender's type without the prefix ``ShaderNode`` (``"Math"``), or ``"NodeGroupInput"``,
    ``"NodeGroupOutput"``. `properties` are attributes of the node (``{"operation": "ADD"}``), `inputs` the values of
    its sockets by identifier. A ``"Group"`` shows the tree named `group`; a ``"TexImage"`` reads the file `image`,
    without colour conversion. `place` is the upper left corner, in Blender's units.
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
    """A socket of a group's interface, identified by its name; `default`, `soft` range and `help` as of `Parameter`."""

    name: str
    kind: Literal["float", "color", "vector", "shader"]
    default: SocketValue = 0.0
    soft: tuple[float, float] = (0.0, 1.0)
    help: str = ""
    panel: str = ""


@dataclass(frozen=True)
class NodeTree:
    """The nodes of a group, or of a material: then without inputs and outputs."""

    name: str
    nodes: tuple[ShaderNode, ...]
    inputs: tuple[GroupSocket, ...] = ()
    outputs: tuple[GroupSocket, ...] = ()


@dataclass(frozen=True)
class NodeSource:
    """A `Source` of native shader nodes: groups, each after those that it shows, and the material's own tree last.

    If `exact`, the nodes send one importance-sampled direction through a ray portal; else they are Cycles' closures.
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
