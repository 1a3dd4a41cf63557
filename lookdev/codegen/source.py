"""What code generation hands on: a shader's text and what it must be given to run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

HANDEDNESS = "lookdev_handedness"
"""Name of the mesh attribute that is -1 where the first UV set is mirrored, 1 elsewhere."""


@dataclass(frozen=True)
class TextureBinding:
    """A texture of a shader: the shader parameter that takes the path, and the linear EXR file."""

    parameter: str
    file: Path


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


@dataclass(frozen=True)
class ShaderSource:
    """One generated OSL shader: its text, what it reads, and the digest of text and texture contents.

    `transmits` where light passes through the surface, `see_through` where the surface is not wholly present;
    `directions` are how many of a shading point come from the BRDF and how many from the light.
    """

    name: str
    osl: str
    textures: tuple[TextureBinding, ...]
    attributes: tuple[AttributeBinding, ...]
    digest: str
    transmits: bool = False
    see_through: bool = False
    directions: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class PrincipledSource:
    """Cycles' own Principled BSDF, which the benchmark compares with: constants by Blender's names of its sockets."""

    name: str
    inputs: Mapping[str, float | tuple[float, ...]]
