"""Normal maps and bumps on mirrored UVs: the normal that a file means, in the world, whatever way the UVs run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.brdf import MODELS
from lookdev.material import Bump, Primvar, Texture
from lookdev.material.look import Input
from lookdev.material.points import ImagePoints
from lookdev.material.values import Values

OPENGL = {"scale": (2.0, 2.0, 2.0, 1.0), "bias": (-1.0, -1.0, -1.0, 0.0)}
DIRECTX = {"scale": (2.0, -2.0, 2.0, 1.0), "bias": (-1.0, 1.0, -1.0, 0.0)}


@dataclass(frozen=True)
class Flat(ImagePoints):
    """A point of the plane z = 0 whose u grows along x and whose v grows along y, or against it."""

    mirrored: bool

    def uv(self, name: str) -> np.ndarray:
        return np.array([[0.5, 0.5]])

    def primvar(self, primvar: Primvar) -> np.ndarray:
        raise AssertionError

    def handedness(self) -> np.ndarray:
        return np.array([-1.0 if self.mirrored else 1.0])


def world(source: Input, mirrored: bool) -> np.ndarray:
    """Return the normal in the world: the shading frame is (x, y, z), its bitangent cross(normal, tangent)."""
    normal = np.asarray(Values(Flat(mirrored)).of(source, MODELS["disney"].parameters["normal"]))[0]
    return normal / np.linalg.norm(normal)


def tilted(folder: Path, up: float) -> Path:
    """Write a normal map that leans along v: green is up in OpenGL's convention for `up` > 0."""
    normal = np.array([0.0, up, np.sqrt(1.0 - up * up)])
    pixels = np.broadcast_to((normal * 0.5 + 0.5).astype(np.float32), (2, 2, 3))
    file = folder / f"{up}.tif"
    image = oiio.ImageBuf(np.ascontiguousarray(pixels))
    assert image.write(str(file)), image.geterror()
    return file


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize(("convention", "up"), [(OPENGL, 0.6), (DIRECTX, -0.6)])
def test_a_normal_map_leans_along_v(tmp_path: Path, mirrored: bool, convention: dict[str, tuple], up: float) -> None:
    texture = Texture(tilted(tmp_path, up), "rgb", "raw", **convention)
    # v grows along y, or against it where the UVs are mirrored: there the same texel leans the other way.
    np.testing.assert_allclose(world(texture, mirrored), [0.0, -0.6 if mirrored else 0.6, 0.8], atol=1e-6)


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_bump_leans_against_its_slope(tmp_path: Path, mirrored: bool) -> None:
    heights = np.linspace(1.0, 0.0, 64, dtype=np.float32)[:, np.newaxis, np.newaxis] * np.ones((1, 64, 1), np.float32)
    assert oiio.ImageBuf(heights).write(str(tmp_path / "h.tif"))  # row 0 is v = 1: the height grows with v
    bump = Bump(Texture(tmp_path / "h.tif", "r", "raw"), 1.0)
    normal = world(bump, mirrored)
    np.testing.assert_allclose(normal, [0.0, 0.7071 if mirrored else -0.7071, 0.7071], atol=0.01)
