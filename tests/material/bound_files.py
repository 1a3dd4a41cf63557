"""Assets with one foreign material /M, and its look."""

from __future__ import annotations

from pathlib import Path

from look_files import shader

from lookdev.material.usd.bound import BoundLook, read_bound
from lookdev.stage import Composition, compose

PREVIEW = "token outputs:surface.connect = </M/S.outputs:surface>\n"


def preview(inputs: str, *nodes: str, terminal: str = PREVIEW, identifier: str = "UsdPreviewSurface") -> str:
    """Return the body of a material of one surface shader."""
    return terminal + shader("S", identifier, inputs) + "".join(nodes)


def materialx(inputs: str, *nodes: str) -> str:
    return preview(inputs, *nodes, identifier="ND_UsdPreviewSurface_surfaceshader")


def asset(folder: Path, body: str) -> Path:
    file = folder / "asset.usda"
    file.write_text(f'#usda 1.0\ndef Material "M"\n{{\n{body}\n}}\n')
    return file


def bound(folder: Path, body: str, missing: str = "error", path: str = "/M") -> BoundLook:
    composed = compose(Composition(asset(folder, body), missing=missing))  # type: ignore[arg-type]
    return read_bound(composed, [path])[path]


def lost(found: BoundLook) -> list[tuple[str, str]]:
    return [(fault.where, fault.what) for fault in found.lost]
