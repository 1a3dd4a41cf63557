"""The data classes of a look: a stack of layers, each a reflectance model with values of its inputs and a mask.

`lookdev.material.usd` reads a look from a file, `lookdev.material.textures` converts the look's images to linear ones,
and `lookdev.codegen` turns the look into shader code. This module imports neither USD nor a renderer.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from math import cos, radians, sin
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf import Mode
from lookdev.material.expression import Expression, ExpressionKind
from lookdev.space import Color

Wrap = Literal["black", "clamp", "repeat", "mirror"]
"""How an image continues outside its unit square of texture coordinates, as wrapS and wrapT of UsdUVTexture."""

WRAPS: dict[str, Wrap] = {wrap: wrap for wrap in get_args(Wrap)}
"""The wrap modes by their names, for turning a text from a file into a `Wrap`."""

Units = Literal["object", "world"]
UNITS: tuple[Units, ...] = get_args(Units)
"""The units in which a displacement can be given; see `Displacement`."""

Channel = Literal["r", "g", "b", "a", "rgb"]
"""The channel or channels of an image that a texture reads."""

Transform = tuple[float, float, float, float, float, float]
"""A 2 x 3 matrix M, row major, that maps texture coordinates st to ``M[:, :2] @ st + M[:, 2]``."""

IDENTITY: Transform = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
"""The transform that leaves texture coordinates as they are."""


def to_transform(matrix: Floats) -> Transform:
    """Return the first two rows of a matrix (2, 3) or (3, 3) as a `Transform`."""
    a, b, c, d, e, f = (float(number) for number in matrix[:2].ravel())
    return a, b, c, d, e, f


def transform2d(scale: Iterable[float], degrees: float, translation: Iterable[float]) -> Floats:
    """Return the matrix (3, 3) of a UsdTransform2d: scale, then rotate counter-clockwise, then translate.

    The matrix multiplies column vectors (s, t, 1) from the left. `scale` and `translation` have two numbers each.
    """
    (x, y), (dx, dy), c, s = scale, translation, cos(radians(degrees)), sin(radians(degrees))
    return np.array([[c * x, -s * y, dx], [s * x, c * y, dy], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Texture:
    """A texture look-up, as UsdUVTexture defines it: ``texel * scale + bias`` in each of the channels r, g, b and a.

    The result is the selected `channel`: a float for one of ``"r" "g" "b" "a"``, a colour for ``"rgb"``. `colorspace`
    is the space of the image's texels. Texels of ``"raw"`` are used unchanged. Texels of ``"sRGB"`` and of the spaces
    in `lookdev.stage.colorspaces` are converted to linear Rec.709 before filtering. `st` names the UV set of the mesh;
    `transform` maps coordinates of this set to coordinates of the image, whose lower left corner is (0, 0).

    The `colorspace` ``"auto"`` and the wrap mode ``"useMetadata"`` stand for what the image file states.
    `lookdev.material.textures.resolve_texture` opens the file and replaces them. A file whose name contains ``<UDIM>``
    is a set of tiles.
    """

    file: Path
    channel: Channel
    colorspace: str
    wrap_s: Wrap | Literal["useMetadata"] = "repeat"
    wrap_t: Wrap | Literal["useMetadata"] = "repeat"
    st: str = "st"
    transform: Transform = IDENTITY
    scale: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    bias: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Primvar:
    """A primvar of the geometry, read by name: a float or a colour, of the type of its `fallback`.

    `fallback` is the value where the mesh has no primvar of this name.
    """

    name: str
    fallback: float | Color


@dataclass(frozen=True)
class Bump:
    """A bump map: the normal of a surface whose heights are one channel of a texture.

    A height of 1 stands `scale` units of the texture coordinates above the surface.
    """

    height: Texture
    scale: float = 1.0


@dataclass(frozen=True)
class Coordinates:
    """Texture coordinates as an input of an expression: the colour (s, t, 0).

    `st` names the UV set. `transform` is applied to its coordinates.
    """

    st: str
    transform: Transform = IDENTITY


@dataclass(frozen=True)
class ViewCosine:
    """The cosine between the shading normal and the direction to the viewer, as an input of an expression.

    The cosine is above 0. The shading normal is the interpolated normal of the displaced mesh, on the viewer's side.
    Bump maps, normal maps and parameters that are normals do not change it. In the shading frame, in which models are
    evaluated, the cosine is the z component of the direction to the viewer.
    """


VIEW = "view"
"""The name of the `ViewCosine` in an expression, unless the expression has an input of its own by this name."""


@dataclass(frozen=True)
class Formula:
    """An expression and the sources of its inputs.

    `inputs` maps each name that the expression uses to the source of its value, and `kinds` maps the name to its type.
    """

    expression: Expression
    inputs: dict[str, InputSource]
    kinds: dict[str, ExpressionKind]


InputSource: TypeAlias = "float | Color | Texture | Primvar | Coordinates | ViewCosine | Formula"
"""The source of a value that an expression reads: a constant, or something that varies over the surface or the view."""

Varying = Texture | Primvar | Bump | Formula
"""A source of a layer's input, if it varies over the surface."""

Input = float | Color | str | Varying
"""The value of an input of a layer: a constant, a token (``variant = "2012"``), or a source that varies.

An input that is a normal is a constant vector, an ``"rgb"`` texture (a normal map) or a `Bump`.
"""

Mask = float | Texture | Primvar | Formula
"""The mask of a layer: how much of the layer there is, from 0 to 1. Also the type of a displacement's height."""


def leaf_sources(sources: Iterable[InputSource | Input]) -> Iterator[InputSource | Input]:
    """Yield the sources in order, with each formula replaced by the sources of its inputs, recursively.

    A formula that several sources share is expanded only once.
    """
    pending, seen = list(sources)[::-1], set[int]()
    while pending:
        source = pending.pop()
        if not isinstance(source, Formula):
            yield source
        elif id(source) not in seen:
            seen.add(id(source))
            pending += [*source.inputs.values()][::-1]


def depends_on_view(source: InputSource | Input) -> bool:
    """Return whether the value of a source depends on the direction to the viewer."""
    return any(isinstance(leaf, ViewCosine) for leaf in leaf_sources([source]))


@dataclass(frozen=True)
class Layer:
    """One layer of a look: a reflectance model, the values of its inputs, and a mask.

    `model` is a key of `lookdev.brdf.MODELS` or, for a foreign model, of `lookdev.material.translate.TRANSLATIONS`. A
    foreign model is rendered as layers of models in `MODELS`. `inputs` holds the inputs that are set; others have the
    model's defaults. The mask of the base layer is 1.

    `mode` states how the layer combines with the layers beneath it. A layer in mode ``"over"`` covers them by its mask.
    In mode ``"transmit"``, the light that the layer transmits falls on the layers beneath.
    """

    name: str
    model: str
    inputs: dict[str, Input] = field(default_factory=dict)
    mask: Mask = 1.0
    mode: Mode = "over"


@dataclass(frozen=True)
class Displacement:
    """A displacement of each point of the surface along its normal, by ``(height - midlevel) * scale``.

    The distance is in `units`: ``"object"``, the units of the asset's file in object space, or ``"world"``, metres.
    """

    height: Mask
    scale: float = 1.0
    midlevel: float = 0.0
    units: Units = "object"


@dataclass(frozen=True)
class Look:
    """A look: a stack of layers, base first, and a displacement of the surface.

    Layers that its file disables are left out. `source` is the file and the prim path of the look, for messages and
    for the headers of frames.
    """

    name: str
    layers: tuple[Layer, ...]
    source: str = ""
    displacement: Displacement | None = None
