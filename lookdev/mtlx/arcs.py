"""Arcs of USD layers to MaterialX documents, redirected to the layers that stand for them."""

from __future__ import annotations

from pathlib import Path

from pxr import Ar, Sdf, Tf

from lookdev.mtlx.shade import document_layer

SUFFIX = ".mtlx"

_ITEMS = ("explicitItems", "addedItems", "prependedItems", "appendedItems", "deletedItems", "orderedItems")


def is_document(path: str) -> bool:
    """Return whether the name of a file is that of a MaterialX document, inside a package or not."""
    name = Ar.SplitPackageRelativePathInner(path)[1] if Ar.IsPackageRelativePath(path) else path
    return name.lower().endswith(SUFFIX)


def redirect(layer: Sdf.Layer) -> None:
    """Let the references, payloads and sublayers of a layer to MaterialX documents lead to USD layers instead.

    The layer is changed in memory and can no longer be saved. A document that is missing stays as it is, for
    composition to report.

    Raises
    ------
    LookError
        A document is malformed: every fault of it.
    """
    targets: dict[str, str] = {}
    for asset in filter(is_document, layer.GetCompositionAssetDependencies()):
        try:
            found = str(Ar.GetResolver().Resolve(layer.ComputeAbsolutePath(asset)))
        except Tf.ErrorException:
            continue
        if found and (Ar.IsPackageRelativePath(found) or Path(found).is_file()):
            targets[asset] = str(document_layer(found))
    if not targets:
        return
    for number, path in enumerate(layer.subLayerPaths):
        if path in targets:
            layer.subLayerPaths[number] = targets[path]

    def visit(path: Sdf.Path) -> None:
        if path.IsPrimPath() or path.IsPrimVariantSelectionPath():
            spec = layer.GetPrimAtPath(path)  # none for the path of a variant set
            for key in ("references", "payload") if spec else ():
                if spec.HasInfo(key):
                    spec.SetInfo(key, _redirected(spec.GetInfo(key), targets))

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    layer.SetPermissionToSave(False)


def _redirected(arcs: Sdf.ReferenceListOp | Sdf.PayloadListOp, targets: dict[str, str]) -> object:
    result = type(arcs)()
    for name in _ITEMS:
        items = [_moved(each, targets) for each in getattr(arcs, name)]
        if items or (name == "explicitItems" and arcs.isExplicit):
            setattr(result, name, items)
    return result


def _moved(arc: Sdf.Reference | Sdf.Payload, targets: dict[str, str]) -> Sdf.Reference | Sdf.Payload:
    if arc.assetPath not in targets:
        return arc
    if isinstance(arc, Sdf.Payload):
        return Sdf.Payload(targets[arc.assetPath], arc.primPath, arc.layerOffset)
    return Sdf.Reference(targets[arc.assetPath], arc.primPath, arc.layerOffset, arc.customData)
