"""Finds the members of collections of a USD stage, by USD's membership query.

A collection is given by its path, such as ``/Car.collection:paint``.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from pxr import Sdf, Usd

from lookdev.errors import AssetError, nearest_hint
from lookdev.stage import clean_usd_message, usd_errors_as_faults

_MARK = ".collection:"  # between the path of the prim and the collection's name


def is_collection(pattern: str) -> bool:
    """Return whether a pattern for the selection of prims is the path of a collection."""
    return _MARK in pattern


def prim_at(stage: Usd.Stage, path: str) -> Usd.Prim | None:
    """Return the prim at a path that a user wrote, or None if the text is not a path or there is no such prim."""
    is_path = path.startswith("/") and Sdf.Path.IsValidPathString(path)
    return (stage.GetPrimAtPath(path) or None) if is_path else None


def collections_above(stage: Usd.Stage, paths: Iterable[str]) -> tuple[str, ...]:
    """Return the paths of the collections of the prims at and above `paths`, sorted."""
    visited: set[str] = set()
    collections: set[str] = set()
    for path in paths:
        while path and path not in visited:
            visited.add(path)
            if prim := prim_at(stage, path):
                collections.update(
                    f"{path}{_MARK}{collection_api.GetName()}" for collection_api in Usd.CollectionAPI.GetAll(prim)
                )
            path = path.rpartition("/")[0]
    return tuple(sorted(collections))


def collection_members(stage: Usd.Stage, collection: str, paths: Iterable[str]) -> frozenset[str]:
    """Return the prim paths in `paths` that a collection includes; `collection` is the collection's path.

    Raises
    ------
    AssetError
        The stage has no such prim, the prim has no such collection, or the collection includes itself.
    """
    prim_path, _, name = collection.partition(_MARK)
    prim = prim_at(stage, prim_path)
    if prim is None:
        raise AssetError(f"'{collection}' is not a collection of the asset: it has no prim {prim_path}")
    collections = {api.GetName(): api for api in Usd.CollectionAPI.GetAll(prim)}
    if name not in collections:
        hint = nearest_hint(name, sorted(collections)) if collections else "it has none"
        raise AssetError(f"'{collection}' is not a collection of the asset: {prim_path} has no '{name}' ({hint})")
    with usd_errors_as_faults(Path(stage.GetRootLayer().identifier)):
        valid, reason = collections[name].Validate()
        if not valid:
            raise AssetError(f"'{collection}' is not a valid collection: {clean_usd_message(reason)}")
        for target in collections[name].GetIncludesRel().GetTargets():
            if target.IsPropertyPath() and not Usd.CollectionAPI.Get(stage, target):
                raise AssetError(
                    f"'{collection}' is not a valid collection: it includes {target}, which is not a collection"
                )
        query = collections[name].ComputeMembershipQuery()
        return frozenset(path for path in paths if query.IsPathIncluded(Sdf.Path(path)))
