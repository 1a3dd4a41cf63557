"""A look as plain data: layers of a reflectance model, with masks, over named inputs.

This is what `material/usd` reads from a file and what `codegen` turns into shader code. Nothing here knows
USD, Blender or a renderer.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias

from lookdev.material.expression import Expression, Kind

Wrap = Literal["black", "clamp", "repeat", "mirror"]


@dataclass(frozen=True)
class Texture:
    """A texture look-up, as UsdUVTexture means it.

    `channel` is ``"r" "g" "b" "a"`` for a float or ``"rgb"`` for a colour. Values are linear Rec.709 when
    `colorspace` is resolved (``"sRGB"`` is decoded before filtering, ``"raw"`` is left alone), then
    ``value * scale + bias`` per channel. `st` names the UV set; `transform` is UsdTransform2d as a 2x3 matrix
    (row major) applied to st: ``st' = M[:, :2] @ st + M[:, 2]``. `st` (0, 0) is the lower left corner.

    ``"auto"`` and ``"useMetadata"`` leave the answer to the image, which is not opened before it is needed. A file
    whose name holds ``<UDIM>`` is a set of tiles.
    """

    file: Path
    channel: Literal["r", "g", "b", "a", "rgb"]
    colorspace: Literal["sRGB", "raw", "auto"]
    wrap_s: Wrap | Literal["useMetadata"] = "repeat"
    wrap_t: Wrap | Literal["useMetadata"] = "repeat"
    st: str = "st"
    transform: tuple[float, float, float, float, float, float] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    scale: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    bias: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Primvar:
    """A value carried by the geometry: a float or a colour, `fallback` where the mesh has none."""

    name: str
    fallback: float | tuple[float, float, float]


@dataclass(frozen=True)
class Bump:
    """A height map as the source of a normal.

    `height` has a single channel. A height of 1 stands ``scale`` units of st above the surface.
    """

    height: Texture
    scale: float = 1.0


@dataclass(frozen=True)
class Coordinates:
    """Texture coordinates as an input of an expression: a colour (s, t, 0). `transform` as a `Texture` has it."""

    st: str
    transform: tuple[float, float, float, float, float, float] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@dataclass(frozen=True)
class Formula:
    """A mask expression and where its inputs come from; `kinds` says which are floats and which colours."""

    expression: Expression
    inputs: dict[str, Source]
    kinds: dict[str, Kind]


Color = tuple[float, float, float]
Source: TypeAlias = "float | Color | Texture | Primvar | Coordinates | Formula"
"""What an expression reads."""

Varying = Texture | Primvar | Bump | Formula
"""What differs over a surface."""

Input = float | Color | str | Varying
"""A constant, a token (``variant = "2012"``), or something that varies over the surface.

A normal is a constant vector, a ``"rgb"`` texture (a normal map) or a `Bump`.
"""

Mode = Literal["over", "transmit"]


@dataclass(frozen=True)
class Layer:
    """One layer: a model, its inputs (only those that are set; the rest have the model's defaults), its mask.

    The mask of the base layer is 1. A disabled layer is not in a `Look` at all. `mode` says how a layer lies on those
    beneath: ``"over"`` covers them by its mask, ``"transmit"`` lets what the layer transmits meet them.
    """

    name: str
    model: str
    inputs: dict[str, Input] = field(default_factory=dict)
    mask: float | Texture | Primvar | Formula = 1.0
    mode: Mode = "over"


@dataclass(frozen=True)
class Look:
    """A layer stack, base first. `source` is the file and prim path it came from, for messages and headers."""

    name: str
    layers: tuple[Layer, ...]
    source: str = ""
