"""Links of lights: which light each part of an asset, and of which it casts the shadow (UsdLux collections)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from lookdev.asset import Asset
from lookdev.light import Light
from lookdev.material import Look
from lookdev.scene.dress import Part, asset_parts, dress


@dataclass(frozen=True, eq=False)
class Linked:
    """What `lookdev.scene.Scene` has of an asset under linked lights, whose `Emission.spared` are set."""

    asset: Asset
    wears: Mapping[str, Look]
    lights: tuple[Light, ...]
    lit: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    groups: Mapping[str, int] = field(default_factory=dict)


def link_lights(asset: Asset, wears: Mapping[str, Look], lights: Sequence[Light]) -> Linked:
    """Return an asset whose slots each have one set of lights, and cast the shadows of one set.

    Without links all are as given, and no slot is named. Meshes whose instances are linked differently are split. A
    group is what casts the shadows of the same lights; group 0 casts those of all.
    """
    shining = [light.emission.light_link for light in lights]
    casting = [light.emission.shadow_link for light in lights]
    if not any(shining) and not any(casting):
        return Linked(asset, wears, tuple(lights))

    def worn(part: Part) -> tuple[str, tuple[int, ...], tuple[int, ...]]:
        lit, cast = (
            tuple(number for number, link in enumerate(links) if link is None or link.includes(part.path))
            for links in (shining, casting)
        )
        return part.slot.path, lit, cast

    split, chosen = dress(asset, asset_parts(asset), worn)
    groups = {tuple(range(len(lights))): 0}
    grouped = {path: groups.setdefault(cast, len(groups)) for path, (_, _, cast) in chosen.items()}
    spared = [tuple(group for cast, group in groups.items() if number not in cast) for number in range(len(lights))]
    return Linked(
        split,
        {path: wears[before] for path, (before, _, _) in chosen.items()},
        tuple(
            light.with_emission(replace(light.emission, spared=each))
            for light, each in zip(lights, spared, strict=True)
        ),
        {path: lit for path, (_, lit, _) in chosen.items()} if any(shining) else {},
        grouped if any(grouped.values()) else {},
    )
