"""Light linking: the lights that illuminate each part of an asset, and those whose shadow it casts (UsdLux)."""

from __future__ import annotations

from dataclasses import replace

from lookdev.scene.dress import Part, asset_parts, assign_to_parts
from lookdev.scene.scene import Scene


def link_lights(scene: Scene) -> Scene:
    """Return a scene each of whose slots has one set of lights, and casts the shadows of one set of lights.

    Meshes whose instances have different links are split; without links, the scene is the same. `Scene.lit`,
    `Scene.groups` and `Emission.spared` are set. The slots of a group cast the shadows of the same lights; group 0
    casts all shadows.
    """
    asset, look_of_part, lights = scene.asset, scene.wears, scene.lights
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
    grouped = {
        path: groups.setdefault(shadow_numbers, len(groups)) for path, (_, _, shadow_numbers) in link_choices.items()
    }
    excluded_groups = [
        tuple(group for shadow_numbers, group in groups.items() if number not in shadow_numbers)
        for number in range(len(lights))
    ]
    return replace(
        scene,
        asset=split,
        wears={path: look_of_part[before] for path, (before, _, _) in link_choices.items()},
        lights=tuple(
            light.with_emission(replace(light.emission, spared=excluded))
            for light, excluded in zip(lights, excluded_groups, strict=True)
        ),
        lit={path: light_numbers for path, (_, light_numbers, _) in link_choices.items()} if any(light_links) else {},
        groups=grouped if any(grouped.values()) else {},
    )
