"""Light links: which lights of a scene light each of its parts (UsdLux, collection ``lightLink``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from lookdev.asset import Asset
from lookdev.light import Light
from lookdev.material import Look
from lookdev.scene.dress import Part, asset_parts, dress


def link_lights(
    asset: Asset, wears: Mapping[str, Look], lights: Sequence[Light]
) -> tuple[Asset, Mapping[str, Look], Mapping[str, tuple[int, ...]]]:
    """Return an asset whose slots each have one set of lights, its looks, and the numbers of the lights of each slot.

    Without links all are as given, and no slot is named. Meshes whose instances are lit differently are split.
    """
    links = [light.emission.light_link for light in lights]
    if not any(links):
        return asset, wears, {}

    def worn(part: Part) -> tuple[str, tuple[int, ...]]:
        lit = tuple(number for number, link in enumerate(links) if link is None or link.includes(part.path))
        return part.slot.path, lit

    split, chosen = dress(asset, asset_parts(asset), worn)
    looks = {path: wears[before] for path, (before, _) in chosen.items()}
    return split, looks, {path: lit for path, (_, lit) in chosen.items()}
