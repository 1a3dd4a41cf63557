"""Shader nodes in a file: their places and connections, and how they are removed.

The sites of a prim are the paths of its specs in a layer: its own path, and paths inside variants, selected or not.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from pxr import Sdf, Usd, UsdShade


def clear_input(attribute: Usd.Attribute) -> None:
    """Remove value and connections of an input; connections of other layers are overridden by none."""
    attribute.Clear()
    attribute.ClearConnections()
    if attribute.HasAuthoredConnections():
        attribute.SetConnections([])


def free_path(stage: Usd.Stage, scope: Sdf.Path, name: str) -> Sdf.Path:
    """Return an unused child path of `scope`, unused in every variant of the root layer too."""
    taken = {path.StripAllVariantSelections() for path in layer_paths(stage.GetRootLayer())}
    path, number = scope.AppendChild(name), 2
    while path in taken or stage.GetPrimAtPath(path):
        path, number = scope.AppendChild(f"{name}{number}"), number + 1
    return path


def relative_asset(file: Path, stage: Usd.Stage) -> str:
    """Return the path of a file relative to the root layer, with forward slashes."""
    return relative_path(file, Path(stage.GetRootLayer().realPath).parent)


def relative_path(file: Path, folder: Path) -> str:
    """Return the path of a file relative to a folder; ``./`` keeps USD from its search path."""
    path = Path(os.path.relpath(file, folder)).as_posix()
    return path if path.startswith("../") else f"./{path}"


def layer_paths(layer: Sdf.Layer) -> list[Sdf.Path]:
    """Return the path of every spec in a layer, inside variants too."""
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    return paths


def upstream(material: UsdShade.Material, attributes: Iterable[Usd.Attribute]) -> set[Sdf.Path]:
    """Return every prim inside the material that the attributes' values come from."""
    found: set[Sdf.Path] = set()
    todo = [attribute for attribute in attributes if attribute]
    while todo:
        for path in todo.pop().GetConnections():
            prim = material.GetPrim().GetStage().GetPrimAtPath(path.GetPrimPath())
            inside = prim and prim != material.GetPrim() and prim.GetPath().HasPrefix(material.GetPath())
            if inside and prim.GetPath() not in found:
                found.add(prim.GetPath())
                todo += [attribute for each in Usd.PrimRange(prim) for attribute in each.GetAttributes()]
    return found


def prune(material: UsdShade.Material, candidates: Iterable[Sdf.Path], held: Sequence[Sdf.Path] = ()) -> None:
    """Remove those of some nodes, defined in the edited file, that are connected to nothing but `held`."""
    stage = material.GetPrim().GetStage()
    root = stage.GetRootLayer()
    remaining = set(candidates)
    while True:
        connected = [(Sdf.Path.emptyPath, path) for path in held] + list(_connections(stage))
        unused = [
            path
            for path in remaining
            if not any(target.HasPrefix(path) and not user.HasPrefix(path) for user, target in connected)
            and any(root.GetPrimAtPath(site).specifier == Sdf.SpecifierDef for site in sites(root, path))
        ]
        if not unused:
            return
        delete(root, [site for path in unused for site in sites(root, path)])
        remaining.difference_update(unused)


def _connections(stage: Usd.Stage) -> Iterator[tuple[Sdf.Path, Sdf.Path]]:
    """Yield every connection, from a property to another, in variants that are not selected too."""
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


def sites(layer: Sdf.Layer, prim: Sdf.Path) -> list[Sdf.Path]:
    """Return the sites of a prim in a layer."""
    return [path for path in layer_paths(layer) if path.IsPrimPath() and path.StripAllVariantSelections() == prim]


def delete(layer: Sdf.Layer, prims: Iterable[Sdf.Path]) -> None:
    """Remove prims from a layer."""
    for path in prims:
        if layer.GetPrimAtPath(path):  # it may be removed with its parent
            edit = Sdf.BatchNamespaceEdit()
            edit.Add(path, Sdf.Path.emptyPath)
            layer.Apply(edit)
