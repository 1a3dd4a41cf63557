"""Redirects the arcs of a USD layer that name MaterialX documents to the USD layers that the documents become.

An arc is a reference, a payload or a sublayer.
"""

from __future__ import annotations

from pathlib import Path

from pxr import Ar, Sdf, Tf

from lookdev.mtlx.shade import document_layer

SUFFIX = ".mtlx"


def is_document(path: str) -> bool:
    """Return whether a path, which may be inside a package, has the suffix of a MaterialX document."""
    name = Ar.SplitPackageRelativePathInner(path)[1] if Ar.IsPackageRelativePath(path) else path
    return name.lower().endswith(SUFFIX)


def redirect_documents(layer: Sdf.Layer) -> None:
    """Redirect references, payloads and sublayers of a layer from MaterialX documents to their USD layers.

    The layer changes in memory and can no longer be saved. Arcs to missing documents are not changed, so that
    composition reports them.

    Raises
    ------
    LookError
        A document is malformed; the error has all its faults.
    """
    # From the path of a document, as the layer names it, to the path of its USD layer.
    targets: dict[str, str] = {}
    for asset in filter(is_document, layer.GetCompositionAssetDependencies()):
        try:
            resolved = str(Ar.GetResolver().Resolve(layer.ComputeAbsolutePath(asset)))
        except Tf.ErrorException:
            continue
        if resolved and (Ar.IsPackageRelativePath(resolved) or Path(resolved).is_file()):
            targets[asset] = str(document_layer(resolved))
    if not targets:
        return
    for number, path in enumerate(layer.subLayerPaths):
        if path in targets:
            layer.subLayerPaths[number] = targets[path]

    def visit(path: Sdf.Path) -> None:
        """Redirect the references and payloads of the prim, or of the variant, at a path."""
        if path.IsPrimPath() or path.IsPrimVariantSelectionPath():
            spec = layer.GetPrimAtPath(path)  # the path of a variant set has no spec
            for arcs in (spec.referenceList, spec.payloadList) if spec else ():
                arcs.ModifyItemEdits(lambda arc: _redirect_arc(arc, targets))

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    layer.SetPermissionToSave(False)


def _redirect_arc(arc: Sdf.Reference | Sdf.Payload, targets: dict[str, str]) -> Sdf.Reference | Sdf.Payload:
    """Return an arc with its asset path replaced by `targets`, or the arc itself if `targets` lacks the path."""
    if arc.assetPath not in targets:
        return arc
    if isinstance(arc, Sdf.Payload):
        return Sdf.Payload(targets[arc.assetPath], arc.primPath, arc.layerOffset)
    return Sdf.Reference(targets[arc.assetPath], arc.primPath, arc.layerOffset, arc.customData)
