"""Looks as plain data: layers of reflectance models, with masks, over named inputs.

`usd` reads a look from a file, `textures` makes its images linear, and `codegen` turns it into shader code. This module
depends on neither USD nor a renderer.
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
WRAPS: dict[str, Wrap] = {wrap: wrap for wrap in get_args(Wrap)}
"""The wrap modes by their names."""

Units = Literal["object", "world"]
UNITS: tuple[Units, ...] = get_args(Units)
"""The units of heights of displacement."""

Channel = Literal["r", "g", "b", "a", "rgb"]

Transform = tuple[float, float, float, float, float, float]
"""A 2 x 3 matrix M, row major, applied to texture coordinates: ``st' = M[:, :2] @ st + M[:, 2]``."""

IDENTITY: Transform = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


def to_transform(matrix: Floats) -> Transform:
    """Return the first two rows of a matrix (..., 3) as a `Transform`."""
    a, b, c, d, e, f = (float(number) for number in matrix[:2].ravel())
    return a, b, c, d, e, f


def transform2d(scale: Iterable[float], degrees: float, translation: Iterable[float]) -> Floats:
    """Return UsdTransform2d as a matrix (3, 3): ``in * scale * rotate + translation``, counter-clockwise."""
    (x, y), (dx, dy), c, s = scale, translation, cos(radians(degrees)), sin(radians(degrees))
    return np.array([[c * x, -s * y, dx], [s * x, c * y, dy], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Texture:
    """A texture look-up, as UsdUVTexture defines it: ``value * scale + bias`` per channel.

    `channel` is one of ``"r" "g" "b" "a"`` for a float, ``"rgb"`` for a colour. Values are linear Rec.709 once
    `colorspace` is resolved: ``"raw"`` is left as it is, ``"sRGB"`` and the spaces of `lookdev.stage.colorspaces`
    are converted before filtering. `st` names the UV set, whose (0, 0) is the lower left corner; `transform` is
    UsdTransform2d.

    The meaning of ``"auto"`` and ``"useMetadata"`` depends on the image, which is opened when it is needed. A file
    whose name contains ``<UDIM>`` is a set of tiles.
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
    """A float or a colour of the geometry; `fallback` where the mesh has no such primvar."""

    name: str
    fallback: float | Color


@dataclass(frozen=True)
class Bump:
    """A height map, of a single channel, as the source of a normal: a height of 1 is ``scale`` units of st."""

    height: Texture
    scale: float = 1.0


@dataclass(frozen=True)
class Coordinates:
    """Texture coordinates as an input of an expression: a colour (s, t, 0)."""

    st: str
    transform: Transform = IDENTITY


@dataclass(frozen=True)
class ViewCosine:
    """The cosine between the shading normal and the direction to the viewer, above 0, as an input of an expression.

    The normal is the mesh's, interpolated, displaced and on the viewer's side. Bumps, normal maps and the normals of
    tilted lobes do not change it. The cosine is z of the direction to the viewer in the frame in which models are
    evaluated.
    """


VIEW = "view"
"""The name of a `ViewCosine` in an expression, unless its node has another source of this name."""


@dataclass(frozen=True)
class Formula:
    """A mask expression, its inputs by name, and the type of each input."""

    expression: Expression
    inputs: dict[str, InputSource]
    kinds: dict[str, ExpressionKind]


InputSource: TypeAlias = "float | Color | Texture | Primvar | Coordinates | ViewCosine | Formula"
"""A value that an expression reads."""

Varying = Texture | Primvar | Bump | Formula
"""A value that differs over a surface."""

Input = float | Color | str | Varying
"""A constant, a token (``variant = "2012"``), or something that varies over the surface.

A normal is a constant vector, a ``"rgb"`` texture (a normal map) or a `Bump`.
"""

Mask = float | Texture | Primvar | Formula


def leaf_sources(sources: Iterable[InputSource | Input]) -> Iterator[InputSource | Input]:
    """Yield the sources that are not expressions, in order, and in place of an expression the sources that it reads.

    An expression that several sources read is expanded once.
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
    """One layer: a model, the inputs that are set, and a mask (1 for the base). Unset inputs have the model's defaults.

    `model` is one of `lookdev.brdf.MODELS`, or a foreign one of `lookdev.material.translate.TRANSLATIONS`.

    `mode` is how the layer combines with those beneath: ``"over"`` covers them by its mask, ``"transmit"`` lets the
    light that the layer transmits meet them. A `Look` does not contain disabled layers.
    """

    name: str
    model: str
    inputs: dict[str, Input] = field(default_factory=dict)
    mask: Mask = 1.0
    mode: Mode = "over"


@dataclass(frozen=True)
class Displacement:
    """Moves each point along its normal by ``(height - midlevel) scale``.

    `units` are ``"object"``, the units of the asset's file in object space, or ``"world"``, metres.
    """

    height: Mask
    scale: float = 1.0
    midlevel: float = 0.0
    units: Units = "object"


@dataclass(frozen=True)
class Look:
    """A layer stack, base first. `source` is its file and prim path, for messages and headers."""

    name: str
    layers: tuple[Layer, ...]
    source: str = ""
    displacement: Displacement | None = None
