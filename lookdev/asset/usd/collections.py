"""The members of collections of a USD stage, by USD's own membership query."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from pxr import Sdf, Usd

from lookdev.errors import AssetError, nearest_hint
from lookdev.stage import reading, usd_words

_MARK = ".collection:"


def is_collection(pattern: str) -> bool:
    """Return whether a pattern is the path of a collection, such as ``/Car.collection:paint``."""
    return _MARK in pattern


def prim_at(stage: Usd.Stage, path: str) -> Usd.Prim | None:
    """Return the prim of a path that somebody has written; None where there is none, or where it is no path."""
    valid = path.startswith("/") and Sdf.Path.IsValidPathString(path)
    return (stage.GetPrimAtPath(path) or None) if valid else None


def collections_above(stage: Usd.Stage, paths: Iterable[str]) -> tuple[str, ...]:
    """Return the paths of the collections of the prims at and above `paths`, sorted."""
    known: set[str] = set()
    found: set[str] = set()
    for path in paths:
        while path and path not in known:
            known.add(path)
            if prim := prim_at(stage, path):
                found.update(f"{path}{_MARK}{each.GetName()}" for each in Usd.CollectionAPI.GetAll(prim))
            path = path.rpartition("/")[0]
    return tuple(sorted(found))


def collection_members(stage: Usd.Stage, collection: str, paths: Iterable[str]) -> frozenset[str]:
    """Return those of `paths` that the collection of a path includes.

    Raises
    ------
    AssetError
        The stage has no such prim, the prim no such collection, or it includes itself.
    """
    place, _, name = collection.partition(_MARK)
    prim = prim_at(stage, place)
    if prim is None:
        raise AssetError(f"'{collection}' is no collection of the asset: it has no prim {place}")
    known = {each.GetName(): each for each in Usd.CollectionAPI.GetAll(prim)}
    if name not in known:
        hint = nearest_hint(name, sorted(known)) if known else "it has none"
        raise AssetError(f"'{collection}' is no collection of the asset: {place} has no '{name}' ({hint})")
    with reading(Path(stage.GetRootLayer().identifier)):
        valid, reason = known[name].Validate()
        if not valid:
            raise AssetError(f"'{collection}' is not a valid collection: {usd_words(reason)}")
        for target in known[name].GetIncludesRel().GetTargets():
            if target.IsPropertyPath() and not Usd.CollectionAPI.Get(stage, target):
                raise AssetError(f"'{collection}' is not a valid collection: it includes {target}, which is none")
        query = known[name].ComputeMembershipQuery()
        return frozenset(path for path in paths if query.IsPathIncluded(Sdf.Path(path)))
