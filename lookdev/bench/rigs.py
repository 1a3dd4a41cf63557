"""The rigs that light a scene of the benchmark."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from lookdev.asset import Asset
from lookdev.light import DiskLight, Emission, Light, RectLight, SphereLight, load_environment, prepare_light
from lookdev.light.placement import placement


@dataclass(frozen=True)
class BenchRig:
    """Lights around an asset of radius 1 at the origin, and their description."""

    help: str
    make: Callable[[], tuple[Light, ...]]

    def around(self, asset: Asset) -> tuple[Light, ...]:
        """Return the lights around an asset."""
        return tuple(light.scaled(asset.radius, asset.center) for light in self.make())


def _at(x: float, y: float, z: float) -> dict[str, Any]:
    """Return position and axes of a light that faces the origin."""
    backward = np.array([x, y, z]) / np.linalg.norm([x, y, z])
    across = np.cross((0.0, 0.0, 1.0), backward)
    across /= np.linalg.norm(across)
    matrix = np.eye(4)
    matrix[:3] = np.stack([across, np.cross(backward, across), backward, (x, y, z)], axis=-1)
    position, axes, _ = placement(matrix)
    return {"position": position, "axes": axes}


def _three(dome: str, brightness: float) -> tuple[Light, ...]:
    """Return a dome, a key of a rectangle, a fill of a disk and a rim of a sphere."""
    return (
        prepare_light(load_environment(builtin=dome)).with_emission(Emission((brightness,) * 3)),
        RectLight(width=1.2, height=0.8, emission=Emission((18.0, 16.0, 14.0)), **_at(-2.2, -2.2, 1.8)),
        DiskLight(radii=(0.7, 0.7), emission=Emission((3.0, 4.0, 5.0)), **_at(2.6, -1.4, 0.6)),
        SphereLight(radius=0.3, position=(0.8, 2.6, 1.6), emission=Emission((30.0, 30.0, 36.0))),
    )


def _rectangles(count: int) -> tuple[Light, ...]:
    """Return rectangles above the horizon, at random places, which together send as much however many they are."""
    rng = np.random.default_rng(7)
    lights = []
    for _ in range(count):
        height, azimuth = rng.uniform(0.1, 0.95), rng.uniform(0.0, 2.0 * np.pi)
        across = 3.0 * np.sqrt(1.0 - height * height)
        place = _at(across * np.cos(azimuth), across * np.sin(azimuth), 3.0 * height)
        color = rng.uniform(0.2, 1.0, 3) * 40.0 / count
        r, g, b = color.tolist()
        lights.append(RectLight(width=0.6, height=0.4, emission=Emission((r, g, b)), **place))
    return tuple(lights)


def rectangles(count: int) -> BenchRig:
    """Return so many rectangles, together as bright however many they are."""
    return BenchRig(f"{count} rectangles", partial(_rectangles, count))


RIGS: dict[str, BenchRig] = {
    "studio+3": BenchRig("the studio, dimmed, with a rectangle, a disk and a sphere", partial(_three, "studio", 0.3)),
    "city+3": BenchRig("the city, dimmed, with a rectangle, a disk and a sphere", partial(_three, "city", 0.3)),
    "lamp": rectangles(1),
    "100lamps": rectangles(100),
}
