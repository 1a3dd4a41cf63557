"""Materials on disk for tests that read looks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Write a material /M beside some images; its surface is connected to `terminal`."""
    for name, channels, kind in (
        ("gray.png", 1, oiio.UINT8),
        ("rgb.png", 3, oiio.UINT8),
        ("rgb16.png", 3, oiio.UINT16),
        ("rgb.exr", 3, oiio.HALF),
    ):
        output = oiio.ImageOutput.create(str(tmp_path / name))
        assert output.open(str(tmp_path / name), oiio.ImageSpec(2, 2, channels, kind))
        assert output.write_image(np.full((2, 2, channels), 0.5, np.float32))
        assert output.close()

    def write(body: str, terminal: str = "</M/Base.outputs:layer>", material: str = "", before: str = "") -> Path:
        file = tmp_path / "look.usda"
        surface = f"token outputs:lookdev:surface.connect = {terminal}" if terminal else ""
        file.write_text(
            f'#usda 1.0\n(\n defaultPrim = "M"\n)\n{before}\ndef Material "M" {material}\n{{\n{surface}\n{body}\n}}\n'
        )
        return file

    return write
