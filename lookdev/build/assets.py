"""The asset of a job as each of its looks composes it; what looks compose alike is read once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

from lookdev.asset import Asset, load_asset
from lookdev.asset.usd import read_usd
from lookdev.asset.usd.collections import collection_members, collections_above, prim_at
from lookdev.errors import AssetError
from lookdev.job.parts import JobAsset, JobLook
from lookdev.material.usd.bound import BoundLook, read_bound
from lookdev.material.variants import combinations
from lookdev.scene.dress import Part, Shown, asset_parts
from lookdev.stage import Composed, Composition, compose, is_animated, variant_choices


@dataclass(frozen=True, eq=False)
class Turned:
    """An asset, its parts, and the stage that it was read from; a built-in asset has none."""

    asset: Asset
    parts: Mapping[Shown, tuple[Part, ...]]
    composed: Composed | None = None
    _bound: dict[str, BoundLook] = field(default_factory=dict)

    @property
    def paths(self) -> tuple[str, ...]:
        """The path of every part."""
        return tuple(part.path for own in self.parts.values() for part in own)

    @cached_property
    def collections(self) -> Mapping[str, frozenset[str]]:
        """The parts that each collection includes which the prims at and above parts have, and which is valid."""
        found: dict[str, frozenset[str]] = {}
        for each in collections_above(self.composed.stage, self.paths) if self.composed else ():
            with suppress(AssetError):
                found[each] = self.members(each)
        return found

    def members(self, pattern: str) -> frozenset[str]:
        """Return the parts that a collection includes; raises AssetError where there is no such collection."""
        if self.composed is None:
            raise AssetError(f"'{pattern}': a built-in asset has no collections")
        return collection_members(self.composed.stage, pattern, self.paths)

    def has_prim(self, path: str) -> bool:
        """Return whether the asset has a prim, whatever is rendered of it."""
        return self.composed is not None and prim_at(self.composed.stage, path) is not None

    def bound(self, materials: Iterable[str]) -> dict[str, BoundLook]:
        """Return the looks of materials that the asset binds; errors as `read_bound`."""
        wanted = dict.fromkeys(materials)
        if self.composed is not None and (unread := [each for each in wanted if each not in self._bound]):
            self._bound.update(read_bound(self.composed, unread))
        return {each: self._bound[each] for each in wanted if each in self._bound}


class Assets:
    """The asset of a job as looks compose it."""

    def __init__(self, given: JobAsset) -> None:
        self._given = given
        self._turned: dict[Composition | None, Turned] = {}

    def composition(self, look: JobLook) -> Composition | None:
        """Return what a look composes the asset of; None for a built-in one.

        Without a material of its own, a look's variants are those of the asset.
        """
        given = self._given
        if given.usd is None:
            return None
        variants = {**given.variants, **({} if look.material else look.variants)}
        return Composition(given.usd, look.layer, given.prim, tuple(variants.items()), given.missing)

    def looks(self, look: JobLook) -> tuple[dict[str, str], ...]:
        """Return the variants of each look that a look without a material stands for; errors as `compose`."""
        composition = self.composition(look)
        assert composition is not None, "a look of a built-in asset has a material, or no variants"

        def choices(chosen: dict[str, str], wanted: str) -> tuple[str, ...]:
            given = {**self._given.variants, **chosen}
            settled = tuple(each for each in given.items() if each[1] != "*")
            return variant_choices(compose(replace(composition, variants=settled)), wanted)

        return combinations(look.variants, choices, str(composition.file), composition.prim or "")

    def turned(self, look: JobLook) -> Turned:
        """Return the asset as a look composes it; raises AssetError, or FaultsError of `compose`."""
        composition = self.composition(look)
        if composition not in self._turned:
            self._turned[composition] = self._read(composition)
        return self._turned[composition]

    def _read(self, composition: Composition | None) -> Turned:
        if composition is None:
            asset = load_asset(builtin=self._given.builtin)
            return Turned(asset, asset_parts(asset))
        composed = compose(composition)
        asset = read_usd(composed, self._given.time, self._given.purposes)
        if self._given.time is not None and not is_animated(composed.stage):
            note = f"{composition.file}: time = {self._given.time:g} has no effect: nothing in it is animated"
            asset = replace(asset, notes=(*asset.notes, note))
        return Turned(asset, asset_parts(asset), composed)
