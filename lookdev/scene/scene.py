"""A scene: an asset, what each of its parts wears, the lights, and the camera that sees it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

from lookdev.asset import Asset
from lookdev.light import Light
from lookdev.material import Look
from lookdev.scene.camera import Camera
from lookdev.scene.framing import frame_camera
from lookdev.space import REC709, Space


@dataclass(frozen=True)
class Film:
    """What the camera exposes: `resolution` is width and height in pixels, `space` that of all light."""

    resolution: tuple[int, int]
    space: Space = REC709


@dataclass(frozen=True, eq=False)
class Scene:
    """What is shown. `wears` maps the path of each slot of the asset to a look; ValueError where a slot has none.

    `lit` maps the paths of slots to the numbers of the lights that light them; all light a slot that it lacks. `groups`
    maps them to the groups of which `Emission.spared` has the numbers, 0 where it lacks one. Of the slots of the paths
    `catchers`, only what the rest of the asset does to their light is shown: they are a shadow catcher.
    """

    asset: Asset
    wears: Mapping[str, Look]
    lights: tuple[Light, ...]
    camera: Camera
    film: Film
    lit: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    groups: Mapping[str, int] = field(default_factory=dict)
    catchers: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        bare = [slot.path for slot in self.asset.slots if slot.path not in self.wears]
        if bare:
            raise ValueError(f"{self.asset.name}: no look for {', '.join(bare)}")

    @classmethod
    def of_look(
        cls, asset: Asset, look: Look, light: Light, resolution: tuple[int, int], camera: Camera | None = None
    ) -> Self:
        """Return a scene of one look and one light; the default camera frames the asset."""
        camera = camera or frame_camera(asset.center, asset.radius, resolution)
        return cls(asset, {slot.path: look for slot in asset.slots}, (light,), camera, Film(resolution))

    @property
    def looks(self) -> tuple[Look, ...]:
        """The look of each slot of the asset, in the order of the slots."""
        return tuple(self.wears[slot.path] for slot in self.asset.slots)

    @property
    def lit_by(self) -> tuple[tuple[int, ...], ...]:
        """The numbers of the lights of each slot of the asset, in the order of the slots."""
        every = tuple(range(len(self.lights)))
        return tuple(self.lit.get(slot.path, every) for slot in self.asset.slots)

    def without_idle_lights(self) -> Scene:
        """Return the scene without lights that reach no part in any pose and are not seen; each part keeps a light."""
        # Around the axis of the turns, at its height, the asset is in this sphere in every pose.
        x, y = self.camera.pivot
        center = (x, y, self.asset.center[2])
        radius = 1.001 * (self.asset.radius + math.dist((x, y), self.asset.center[:2]))
        reaching = {number for number, each in enumerate(self.lights) if each.may_reach(center, radius)}
        kept = {number for number, light in enumerate(self.lights) if light.emission.camera}
        for numbers in self.lit_by:
            kept |= reaching.intersection(numbers) or set(numbers[:1])
        if len(kept) == len(self.lights):
            return self
        place = {number: k for k, number in enumerate(sorted(kept))}
        lit = {path: tuple(place[each] for each in numbers if each in place) for path, numbers in self.lit.items()}
        return replace(self, lights=tuple(self.lights[number] for number in place), lit=lit)

    @property
    def grouped(self) -> tuple[int, ...]:
        """The group of each slot of the asset, in the order of the slots."""
        return tuple(self.groups.get(slot.path, 0) for slot in self.asset.slots)
