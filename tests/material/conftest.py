"""Materials on disk for tests that read looks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from look_files import write_gray


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Write a material /M beside some images; its surface is connected to `terminal`."""
    write_gray(tmp_path / "gray.png")
    for name, kind in (("rgb.png", "uint8"), ("rgb16.png", "uint16"), ("rgb.exr", "half")):
        write_gray(tmp_path / name, 3, kind)

    def write(body: str, terminal: str = "</M/Base.outputs:layer>", material: str = "", before: str = "") -> Path:
        file = tmp_path / "look.usda"
        surface = f"token outputs:lookdev:surface.connect = {terminal}" if terminal else ""
        file.write_text(
            f'#usda 1.0\n(\n defaultPrim = "M"\n)\n{before}\ndef Material "M" {material}\n{{\n{surface}\n{body}\n}}\n'
        )
        return file

    return write
