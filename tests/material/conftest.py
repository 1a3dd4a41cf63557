"""Materials on disk for tests that read looks."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from look_files import look, write_gray

MATERIALS = Path(__file__).parents[2] / "materials"


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


@pytest.fixture
def shipped(tmp_path: Path) -> Callable[[str], Path]:
    """Return a function that copies a look that ships, beside its textures."""
    shutil.copytree(MATERIALS / "textures", tmp_path / "textures")
    return lambda name: Path(shutil.copy(MATERIALS / f"{name}.usda", tmp_path))


@pytest.fixture
def car(shipped: Callable[[str], Path]) -> Path:
    """Return the car paint, flakes (1) and dust (2) over a base, with a comment at each layer; "clean" has no dust."""
    file = shipped("car_paint")
    text = file.read_text()
    for name in ("Base", "Flakes", "Dust"):
        text = text.replace(f'    def Shader "{name}"\n', f'    # This is {name}.\n    def Shader "{name}"\n')
    file.write_text(text)
    return file
