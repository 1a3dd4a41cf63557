"""Materials on disk for tests that read looks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from look_files import look, write_gray


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes a `look` beside some images."""
    write_gray(tmp_path / "gray.png")
    for name, kind in (("rgb.png", "uint8"), ("rgb16.png", "uint16"), ("rgb.exr", "half")):
        write_gray(tmp_path / name, 3, kind)

    def write(*parts: str, **more: str) -> Path:
        file = tmp_path / "look.usda"
        file.write_text(look(*parts, **more))
        return file

    return write
