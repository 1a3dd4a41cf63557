"""Helpers of the edits of looks: paths, connections and removal of shader nodes in a USD layer.

A *layer* is here a file of USD, not a layer of a look. A prim can have several specs in one layer: one at its own path,
and one inside each variant that edits it. The paths of these specs are the *sites* of the prim.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from pxr import Sdf, Usd, UsdShade


def clear_input(attribute: Usd.Attribute) -> None:
    """Remove the value and the connections of an input in the edited file, and override connections of other files."""
    attribute.Clear()
    attribute.ClearConnections()
    # Another layer still states connections: an empty list is the stronger opinion.
    if attribute.HasAuthoredConnections():
        attribute.SetConnections([])


def free_path(stage: Usd.Stage, scope: Sdf.Path, name: str) -> Sdf.Path:
    """Return the path of a new child of `scope`: `name`, with a number if the name is in use, also in a variant."""
    used_paths = {path.StripAllVariantSelections() for path in layer_paths(stage.GetRootLayer())}
    path, number = scope.AppendChild(name), 2
    while path in used_paths or stage.GetPrimAtPath(path):
        path, number = scope.AppendChild(f"{name}{number}"), number + 1
    return path


def relative_asset(file: Path, stage: Usd.Stage) -> str:
    """Return the path of a file relative to the folder of the stage's root layer, as `relative_path`."""
    return relative_path(file, Path(stage.GetRootLayer().realPath).parent)


def relative_path(file: Path, folder: Path) -> str:
    """Return the path of a file relative to a folder, with forward slashes, beginning with ``./`` or ``../``."""
    # USD looks up a path without this beginning in its search path.
    path = Path(os.path.relpath(file, folder)).as_posix()
    return path if path.startswith("../") else f"./{path}"


def moved_path(path: Sdf.Path, new_paths: Mapping[Sdf.Path, Sdf.Path]) -> Sdf.Path | None:
    """Return the new path of a prim or property, or None where it is not at or below a moved prim.

    `new_paths` maps the old paths of the moved prims to their new ones.
    """
    return next((path.ReplacePrefix(old, new) for old, new in new_paths.items() if path.HasPrefix(old)), None)


def layer_paths(layer: Sdf.Layer) -> list[Sdf.Path]:
    """Return the paths of all specs in a layer: prims and properties, also those inside variants."""
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    return paths


def find_upstream(material: UsdShade.Material, attributes: Iterable[Usd.Attribute]) -> set[Sdf.Path]:
    """Return the paths of all prims inside the material on which the values of these attributes depend.

    They are found by following connections.
    """
    paths: set[Sdf.Path] = set()
    pending = [attribute for attribute in attributes if attribute]
    while pending:
        for path in pending.pop().GetConnections():
            prim = material.GetPrim().GetStage().GetPrimAtPath(path.GetPrimPath())
            inside = prim and prim != material.GetPrim() and prim.GetPath().HasPrefix(material.GetPath())
            if inside and prim.GetPath() not in paths:
                paths.add(prim.GetPath())
                pending += [attribute for descendant in Usd.PrimRange(prim) for attribute in descendant.GetAttributes()]
    return paths


def remove_unused(
    material: UsdShade.Material, candidates: Iterable[Sdf.Path], targets: Sequence[Sdf.Path] = ()
) -> None:
    """Remove the candidate prims that the edited file defines and to which nothing else is connected.

    The prims of `targets`, paths of outputs, count as used. A prim that only removed prims use is removed, too.
    """
    stage = material.GetPrim().GetStage()
    root = stage.GetRootLayer()
    remaining = set(candidates)
    while True:
        connected = [(Sdf.Path.emptyPath, path) for path in targets] + list(_all_connections(stage))
        unused = [
            path
            for path in remaining
            if not any(target.HasPrefix(path) and not user.HasPrefix(path) for user, target in connected)
            and is_defined(root, find_sites(root, path))
        ]
        if not unused:
            return
        remove_prims(root, [site for path in unused for site in find_sites(root, path)])
        remaining.difference_update(unused)


def _all_connections(stage: Usd.Stage) -> Iterator[tuple[Sdf.Path, Sdf.Path]]:
    """Yield all connections as pairs of paths (input, source), also connections in variants that are not selected."""
    for prim in stage.TraverseAll():
        for attribute in prim.GetAttributes():
            for target in attribute.GetConnections():
                yield attribute.GetPath(), target
    root = stage.GetRootLayer()
    for path in layer_paths(root):
        if path.IsPropertyPath() and isinstance(spec := root.GetPropertyAtPath(path), Sdf.AttributeSpec):
            for target in spec.connectionPathList.GetAddedOrExplicitItems():
                absolute = target.MakeAbsolutePath(path.GetPrimPath())
                yield path.StripAllVariantSelections(), absolute.StripAllVariantSelections()


def find_sites(layer: Sdf.Layer, prim: Sdf.Path) -> list[Sdf.Path]:
    """Return the sites of a prim in a layer: the paths of its specs, also inside variants."""
    return [path for path in layer_paths(layer) if path.IsPrimPath() and path.StripAllVariantSelections() == prim]


def is_defined(layer: Sdf.Layer, sites: Iterable[Sdf.Path]) -> bool:
    """Return whether a layer defines a prim at one of its sites, and not only overrides it."""
    return any(layer.GetPrimAtPath(site).specifier == Sdf.SpecifierDef for site in sites)


def remove_prims(layer: Sdf.Layer, prims: Iterable[Sdf.Path]) -> None:
    """Remove the prim specs at these paths from a layer."""
    for path in prims:
        if layer.GetPrimAtPath(path):  # it may have been removed with its parent
            edit = Sdf.BatchNamespaceEdit()
            edit.Add(path, Sdf.Path.emptyPath)
            layer.Apply(edit)
