"""Reader of a job's asset. A look can change variants and layers of the asset; equal compositions are read once."""

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
from lookdev.material.usd.bound import BoundLook, read_bound_looks
from lookdev.material.variants import expand_wildcards
from lookdev.scene.parts import MeshAtPath, Part, asset_parts
from lookdev.stage import Composed, Composition, compose, is_animated, variant_choices


@dataclass(frozen=True, eq=False)
class ComposedAsset:
    """An asset as a look composes it: geometry, parts (`asset_parts`), and the stage that it was read from.

    A built-in asset has no stage: `composed` is None.
    """

    asset: Asset
    parts: Mapping[MeshAtPath, tuple[Part, ...]]
    composed: Composed | None = None
    _bound: dict[str, BoundLook] = field(default_factory=dict)

    @property
    def paths(self) -> tuple[str, ...]:
        """The path of every part."""
        return tuple(part.path for parts in self.parts.values() for part in parts)

    @cached_property
    def collections(self) -> Mapping[str, frozenset[str]]:
        """The paths of the parts in each valid collection, for all collections on prims at or above a part."""
        members: dict[str, frozenset[str]] = {}
        for collection in collections_above(self.composed.stage, self.paths) if self.composed else ():
            with suppress(AssetError):
                members[collection] = self.members(collection)
        return members

    def members(self, pattern: str) -> frozenset[str]:
        """Return the paths of the parts that a collection includes; raise AssetError if there is no such collection."""
        if self.composed is None:
            raise AssetError(f"'{pattern}': a built-in asset has no collections")
        return collection_members(self.composed.stage, pattern, self.paths)

    def has_prim(self, path: str) -> bool:
        """Return whether the asset's stage has a prim at a path, whether or not the prim is rendered."""
        return self.composed is not None and prim_at(self.composed.stage, path) is not None

    def bound_looks(self, materials: Iterable[str]) -> dict[str, BoundLook]:
        """Read the looks of bound materials, by the material's path; raise the errors of `read_bound_looks`.

        `materials` has the paths of the materials.
        """
        paths = dict.fromkeys(materials)
        if self.composed is not None and (unread := [path for path in paths if path not in self._bound]):
            self._bound.update(read_bound_looks(self.composed, unread))
        return {path: self._bound[path] for path in paths if path in self._bound}


class AssetReader:
    """Reads the asset of a job as each look composes it, each composition only once.

    `table` is the table ``[asset]`` of the job file.
    """

    def __init__(self, table: JobAsset) -> None:
        self._table = table
        self._assets: dict[Composition | None, ComposedAsset] = {}

    def composition(self, look: JobLook) -> Composition | None:
        """Return the composition of the asset for a look; None for a built-in asset.

        If a look has no material of its own, its variants are variants of the asset.
        """
        table = self._table
        if table.usd is None:
            return None
        variants = {**table.variants, **({} if look.material else look.variants)}
        return Composition(table.usd, look.layer, table.prim, tuple(variants.items()), table.missing)

    def variant_choices(self, look: JobLook) -> tuple[dict[str, str], ...]:
        """Expand a look without a material: return the variants of each resulting look.

        A variant ``"*"`` stands for all variants of its set. Raises the errors of `compose`.
        """
        composition = self.composition(look)
        assert composition is not None, "a look of a built-in asset has a material, or no variants"

        def choices(selection: dict[str, str], variant_set: str) -> tuple[str, ...]:
            """Return the variants that a variant set has when the variants in `selection` are chosen."""
            variants = {**self._table.variants, **selection}
            fixed = tuple(choice for choice in variants.items() if choice[1] != "*")
            return variant_choices(compose(replace(composition, variants=fixed)), variant_set)

        return expand_wildcards(look.variants, choices, str(composition.file), composition.prim or "")

    def read(self, look: JobLook) -> ComposedAsset:
        """Return the asset as a look composes it; raise AssetError, or the FaultsError of `compose`."""
        composition = self.composition(look)
        if composition not in self._assets:
            self._assets[composition] = self._read(composition)
        return self._assets[composition]

    def _read(self, composition: Composition | None) -> ComposedAsset:
        if composition is None:
            asset = load_asset(builtin=self._table.builtin)
            return ComposedAsset(asset, asset_parts(asset))
        composed = compose(composition)
        asset = read_usd(composed, self._table.time, self._table.purposes)
        if self._table.time is not None and not is_animated(composed.stage):
            note = f"{composition.file}: time = {self._table.time:g} has no effect: nothing in it is animated"
            asset = replace(asset, notes=(*asset.notes, note))
        return ComposedAsset(asset, asset_parts(asset), composed)
