"""A scene, the input of all renderers: an asset with looks, lights and a camera; its sampling, and light linking."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from itertools import starmap
from typing import Literal, Self

from lookdev.asset import Asset
from lookdev.light import Light
from lookdev.material import Look
from lookdev.scene.camera import Camera
from lookdev.scene.framing import frame_camera
from lookdev.scene.parts import Part, asset_parts, assign_to_parts
from lookdev.space import REC709, Space

SAMPLE_CAP = 4096
"""The default limit of samples per pixel for a frame with a target error (`Sampling.error`)."""

CONSTANT = "constant"
"""A key in the metadata of a field of `Sampling`; the value is the name of a constant in generated shaders."""


@dataclass(frozen=True)
class Sampling:
    """The numbers of samples, directions and bounces of a frame, and its outputs.

    If `error` is set, samples are added in rounds of growing size, until the estimated relMSE is at most `error` or
    their number reaches `samples`. `brdf_samples` and `ibl_samples` are the numbers of directions that are drawn at a
    shading point from the BSDF and from the light; if None, the look determines them.
    """

    samples: int = 64  # per pixel; an even number, because the error estimate compares two pictures with half of them
    error: float | None = None
    brdf_samples: int | None = None
    ibl_samples: int | None = None
    bounces: int = field(default=2, metadata={CONSTANT: "BOUNCES"})  # of indirect light
    seed: int = 0
    denoise: Literal["off", "measured"] = "off"  # "measured": denoise, and measure the error again
    passes: tuple[str, ...] = ()  # of `lookdev.rendering.passes`, in addition to the beauty pass

    @property
    def features(self) -> bool:
        """Whether shaders output albedos and normals."""
        return self.denoise != "off" or bool(self.passes)

    @property
    def shader_constants(self) -> dict[str, object]:
        """The constants of generated shaders, by name."""
        return {
            field.metadata[CONSTANT]: getattr(self, field.name) for field in fields(self) if CONSTANT in field.metadata
        }

    @property
    def records_parts(self) -> bool:
        """Whether shaders record parts of the light, for the passes ``lobes``, ``direct`` and ``lights``."""
        return not {"lobes", "direct", "lights"}.isdisjoint(self.passes)


@dataclass(frozen=True)
class Film:
    """The film: `resolution` is the width and height in pixels, `space` the colour space of all light."""

    resolution: tuple[int, int]
    space: Space = REC709


@dataclass(frozen=True, eq=False)
class Scene:
    """An asset with looks and lights, as a camera sees it.

    A *slot* of the asset (`Asset.slots`) is a set of its faces that have one look. Slots are named by their paths.

    Parameters
    ----------
    asset, lights, camera, film
        The asset, the lights, the camera and the film.
    look_of_slot
        The look of each slot by its path; ValueError if a slot has none.
    lights_of_slot
        For each path of a slot, the indices in `lights` of the lights that illuminate it. A slot that is not a key is
        illuminated by all lights.
    groups
        The shadow group of each slot by its path; a slot that is not a key has group 0. `Emission.shadow_excluded` is a
        tuple of such groups.
    catchers
        The paths of slots that are shadow catchers: the frame shows only the effect of the other slots on their light.
    """

    asset: Asset
    look_of_slot: Mapping[str, Look]
    lights: tuple[Light, ...]
    camera: Camera
    film: Film
    lights_of_slot: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    groups: Mapping[str, int] = field(default_factory=dict)
    catchers: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        bare = [slot.path for slot in self.asset.slots if slot.path not in self.look_of_slot]
        if bare:
            raise ValueError(f"{self.asset.name}: no look for {', '.join(bare)}")

    @classmethod
    def of_look(
        cls, asset: Asset, look: Look, light: Light, resolution: tuple[int, int], camera: Camera | None = None
    ) -> Self:
        """Return a scene with one look and one light; the default camera frames the asset."""
        camera = camera or frame_camera(asset.center, asset.radius, resolution)
        return cls(asset, {slot.path: look for slot in asset.slots}, (light,), camera, Film(resolution))

    @property
    def looks(self) -> tuple[Look, ...]:
        """The look of each slot of the asset, in the order of the slots."""
        return tuple(self.look_of_slot[slot.path] for slot in self.asset.slots)

    @property
    def slot_lights(self) -> tuple[tuple[int, ...], ...]:
        """The indices of the lights that illuminate each slot of the asset, in the order of the slots."""
        every = tuple(range(len(self.lights)))
        return tuple(self.lights_of_slot.get(slot.path, every) for slot in self.asset.slots)

    def without_idle_lights(self) -> Scene:
        """Return the scene without lights that the camera does not see and that reach the asset in no pose.

        Each slot keeps at least one light.
        """
        # In every pose the asset is in this sphere, whose centre is on the turntable's axis at the asset's height.
        x, y = self.camera.pivot
        center = (x, y, self.asset.center[2])
        radius = 1.001 * (self.asset.radius + math.dist((x, y), self.asset.center[:2]))
        reaching = {number for number, light in enumerate(self.lights) if light.may_reach(center, radius)}
        remaining = {number for number, light in enumerate(self.lights) if light.emission.camera}
        for numbers in self.slot_lights:
            remaining |= reaching.intersection(numbers) or set(numbers[:1])
        if len(remaining) == len(self.lights):
            return self
        new_numbers = {number: k for k, number in enumerate(sorted(remaining))}
        lights_of_slot = {
            path: tuple(new_numbers[number] for number in numbers if number in new_numbers)
            for path, numbers in self.lights_of_slot.items()
        }
        return replace(self, lights=tuple(self.lights[number] for number in new_numbers), lights_of_slot=lights_of_slot)

    @property
    def slot_groups(self) -> tuple[int, ...]:
        """The shadow group of each slot of the asset, in the order of the slots."""
        return tuple(self.groups.get(slot.path, 0) for slot in self.asset.slots)


def link_lights(scene: Scene) -> Scene:
    """Return the scene with the links of its lights applied.

    The returned scene has new `Scene.lights_of_slot` and `Scene.groups`, and its lights have new
    `Emission.shadow_excluded`. The slots of a group cast the shadows of the same lights; group 0 casts the shadows of
    all lights. Meshes whose instances have different links are split, so that all parts of a slot have the same links.
    If no light has a link, the scene is the same object.
    """
    asset, look_of_slot, lights = scene.asset, scene.look_of_slot, scene.lights
    light_links = [light.emission.light_link for light in lights]
    shadow_links = [light.emission.shadow_link for light in lights]
    if not any(light_links) and not any(shadow_links):
        return scene

    def links_of_part(part: Part) -> tuple[str, tuple[int, ...], tuple[int, ...]]:
        """Return the path of a part's slot, the lights that illuminate it, and the lights whose shadow it casts."""
        light_numbers, shadow_numbers = (
            tuple(number for number, link in enumerate(links) if link is None or link.includes(part.path))
            for links in (light_links, shadow_links)
        )
        return part.slot.path, light_numbers, shadow_numbers

    split, link_choices = assign_to_parts(asset, asset_parts(asset), links_of_part)
    groups = {tuple(range(len(lights))): 0}
    group_of_slot = {
        path: groups.setdefault(shadow_numbers, len(groups)) for path, (_, _, shadow_numbers) in link_choices.items()
    }

    def exclude_groups(number: int, light: Light) -> Light:
        """Return a light, by its index, with the groups that do not cast its shadow."""
        excluded = tuple(group for shadow_numbers, group in groups.items() if number not in shadow_numbers)
        return light.with_emission(replace(light.emission, shadow_excluded=excluded))

    return replace(
        scene,
        asset=split,
        look_of_slot={path: look_of_slot[old_path] for path, (old_path, _, _) in link_choices.items()},
        lights=tuple(starmap(exclude_groups, enumerate(lights))),
        lights_of_slot={path: light_numbers for path, (_, light_numbers, _) in link_choices.items()}
        if any(light_links)
        else {},
        groups=group_of_slot if any(group_of_slot.values()) else {},
    )
