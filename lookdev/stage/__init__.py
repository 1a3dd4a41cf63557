"""Opens and composes USD files, for all modules that read assets, looks and rigs.

An error of USD becomes a `StageError`; USD writes nothing to stderr. `open_stage` and `compose` check every layer
before USD reads it (`files`). A damaged binary layer can nevertheless crash the process, and the references of a layer
can be endless. Every file is therefore reported to `lookdev.sandbox`, which limits the time and memory of reading.
`clips` checks value clips, which USD does not check.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Literal

from pxr import Ar, Sdf, Tf, Usd, UsdLux, UsdUtils

from lookdev import sandbox
from lookdev.errors import Fault, LookError, StageError, close_hint, nearest_hint, shorten
from lookdev.mtlx import document_layer, is_document, redirect_documents
from lookdev.safe_text import has_text_path
from lookdev.stage.clips import clip_faults
from lookdev.stage.files import NOT_UTF8, layer_problem

_MAX_NAMES = 16  # names that a hint lists
_MAX_QUOTED = 60  # characters of a value that a message quotes
# The function of the innermost `map_asset_paths`.
_MAP_PATH: ContextVar[Callable[[str], str] | None] = ContextVar("_MAP_PATH", default=None)
_ALL_PRIMS = Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)


@contextmanager
def usd_errors_as_faults(file: Path) -> Iterator[list[str]]:
    """Turn USD's exceptions in the block, which reads `file`, into a `StageError`, and collect USD's warnings.

    The block gets a list, to which the warnings are added when the block ends. The warnings that one line of
    USD's C++ code issues are a group. For each group, the list has a text with the first warning and the number of
    different others. No warning goes to stderr.
    """
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()
    warnings: list[str] = []
    try:
        with sandbox.report_reading(file):
            yield warnings
    except Tf.ErrorException as error:
        raise StageError.at(file, "", f"USD cannot open it: {error_message(error)}") from error
    except UnicodeDecodeError as error:
        raise StageError.at(file, "", NOT_UTF8) from error
    finally:
        warnings += [_warning_text(messages) for messages in diagnostics.TakeCoalescedDiagnostics()]


@contextmanager
def map_asset_paths(map_path: Callable[[str], str]) -> Iterator[None]:
    """Replace absolute asset paths in the layers that the block opens.

    `map_path` returns the new path for an absolute path. The paths of references, payloads, sublayers, clips and
    attribute values are replaced, in memory only. Paths in packages are not replaced, since they name members of the
    package.
    """
    token = _MAP_PATH.set(map_path)
    try:
        yield
    finally:
        _MAP_PATH.reset(token)


def open_stage(file: Path) -> Usd.Stage:
    """Open a USD file, or a MaterialX document as USD, and all of its layers.

    Raises
    ------
    StageError
        The file is missing or is not USD, or one of its layers is not a regular file, is nested too deep or is a
        malformed MaterialX document.
    """
    with usd_errors_as_faults(file):
        open_layers = _open_layers(file)  # this variable keeps the layers open until the stage has opened them
        stage = Usd.Stage.Open(open_layers[0])
        del open_layers
        return stage


@dataclass(frozen=True)
class Composition:
    """The request for a stage: a USD file, a layer over it, and the selected variants and prim.

    `layer` is stronger than `file`; relative paths in it are relative to the layer's own folder. `prim` is the path of
    the selected subtree; None selects the whole stage. `variants` are pairs of a variant set and a variant, which is
    selected on every prim at, above and below `prim` that has the set. `missing` decides whether a missing or broken
    reference, payload or sublayer is an error or a note.
    """

    file: Path
    layer: Path | None = None
    prim: str | None = None
    variants: tuple[tuple[str, str], ...] = ()
    missing: Literal["error", "warn"] = "error"


@dataclass(frozen=True, eq=False)
class Composed:
    """A composed stage, the composition that requested it, and notes for the user."""

    stage: Usd.Stage
    composition: Composition
    notes: tuple[str, ...]


def compose(composition: Composition) -> Composed:
    """Compose a stage: open the file with its payloads, put the layer over it, select the variants.

    Raises
    ------
    StageError
        A file cannot be opened, or a variant or the prim does not exist. If `missing` is "error", a reference,
        payload or sublayer that is missing, broken or cyclic is a fault, too; its location in the message is the prim
        that names the file. All faults are listed.
    """
    file, session = composition.file, Sdf.Layer.CreateAnonymous("session.usda")
    _check_path(composition)
    with usd_errors_as_faults(file):
        open_layers = _open_layers(file)
        if composition.layer is not None:
            with usd_errors_as_faults(composition.layer):
                open_layers += (over := _open_layers(composition.layer))
            session.subLayerPaths.append(over[0].identifier)
        stage = Usd.Stage.Open(open_layers[0], session)
        faults, notes = _select_variants(stage, composition)
        faults += _prim_faults(stage, composition)
        arc_faults = _composition_faults(stage, file)
        arc_faults += clip_faults(stage, file, _open_layer)
        if composition.layer is not None:
            notes += _ineffective_overrides(stage, composition.layer, over[0])
    if composition.missing == "error":
        faults += arc_faults
    if faults:
        raise StageError(faults)
    return Composed(stage, composition, (*map(str, arc_faults), *notes))


def lights_hint(stage: Usd.Stage) -> str:
    """Return the hint for a stage that has lights where other content is expected, or "" if it has no lights."""
    has_lights = any(prim.HasAPI(UsdLux.LightAPI) for prim in stage.Traverse())
    return "it has lights: 'lookdev inspect' lists them, and [[rig]] of a job names it" if has_lights else ""


def dependencies(file: Path) -> set[Path]:
    """Return the absolute paths of a USD file, its layers and its images, including files of unselected variants."""
    with usd_errors_as_faults(file):
        open_layers = [] if _MAP_PATH.get() is None else _open_layers(file)
        layers, images, _ = UsdUtils.ComputeAllDependencies(Sdf.AssetPath(str(file)))
        del open_layers
    return {Path(layer.realPath) for layer in layers} | {Path(image) for image in images}


def _check_path(composition: Composition) -> None:
    """Raise StageError unless the composition's prim is the path of a prim."""
    prim = "/" if composition.prim is None else composition.prim
    path = Sdf.Path(prim) if Sdf.Path.IsValidPathString(prim) else Sdf.Path()
    if not (path.IsAbsolutePath() and path.IsAbsoluteRootOrPrimPath()):
        raise StageError.at(composition.file, "", f"{prim!r} is not the path of a prim", "one looks like '/World/Car'")


def _prim_faults(stage: Usd.Stage, composition: Composition) -> list[Fault]:
    """Return a fault if the composition's prim does not exist; its hint lists prims that do exist near it."""
    if composition.prim is None or stage.GetPrimAtPath(composition.prim):
        return []
    parent = Sdf.Path(composition.prim)
    while not stage.GetPrimAtPath(parent):
        parent = parent.GetParentPath()
    children = [str(child.GetPath()) for child in stage.GetPrimAtPath(parent).GetAllChildren()]
    more = max(len(children) - _MAX_NAMES, 0)
    child_list = ", ".join(children[:_MAX_NAMES]) + f" and {more} more" * (more > 0)
    close = close_hint(composition.prim, children) if more else ""
    hint = close or f"below {parent} there are: {child_list or 'none'}"
    return [Fault(str(composition.file), composition.prim, "there is no such prim", hint)]


def _select_variants(stage: Usd.Stage, composition: Composition) -> tuple[list[Fault], list[str]]:
    """Select the composition's variants on the session layer; return faults and notes.

    A selected variant can contain prims with further variant sets. Selection is therefore repeated, from the outer
    variants to those inside them, until nothing changes.
    """
    selections, file = dict(composition.variants), str(composition.file)
    edited: set[tuple[Sdf.Path, str]] = set()  # the prims and variant sets for which a variant was selected so far
    while True:
        # By prim and variant set: the names of the set's variants, and the selected variant.
        sets = {
            (prim.GetPath(), set_name): (variant_set.GetVariantNames(), variant_set.GetVariantSelection())
            for prim in (_prims_around(stage, composition.prim) if selections else ())
            for set_name in (prim.GetVariantSets().GetNames() if prim.HasVariantSets() else ())
            for variant_set in [prim.GetVariantSet(set_name)]
        }
        selectable = {key: selected for key, (names, selected) in sets.items() if selections.get(key[1]) in names}
        edits = {key for key, selected in selectable.items() if selected != selections[key[1]]} - edited
        if not edits:
            break
        edited |= edits
        with Sdf.ChangeBlock():
            for path, set_name in edits:
                _session_prim(stage, path).variantSelections[set_name] = selections[set_name]
    faults = []
    for set_name, variant in selections.items():
        variants = sorted({variant for key, (names, _) in sets.items() if key[1] == set_name for variant in names})
        set_names = sorted({key[1] for key in sets})
        if set_name not in set_names:
            hint = nearest_hint(set_name, set_names) if set_names else "it has none"
            faults.append(Fault(file, composition.prim or "", f"has no variant set '{set_name}'", hint))
        elif variant not in variants:
            problem = f"variant set '{set_name}' has no variant '{variant}'"
            faults.append(Fault(file, composition.prim or "", problem, nearest_hint(variant, variants)))
    return faults, [
        f"{file}: {path}: variant set '{set_name}' has no variant '{selections[set_name]}'; '{selected}' stays selected"
        for (path, set_name), (_, selected) in sets.items()
        if set_name in selections and (path, set_name) not in selectable
    ]


def is_animated(stage: Usd.Stage) -> bool:
    """Return whether a stage has an attribute whose value varies over time."""
    return any(
        attribute.ValueMightBeTimeVarying()
        for root in (stage.GetPseudoRoot(), *stage.GetPrototypes())
        for prim in Usd.PrimRange(root)
        for attribute in prim.GetAuthoredAttributes()
    )


def variant_choices(composed: Composed, name: str) -> tuple[str, ...]:
    """Return the sorted names of the variants of the variant set `name`, over all prims that have the set.

    These are the prims on which `Composition.variants` selects. Raises StageError if none of them has the set.
    """
    sets: dict[str, set[str]] = {}
    with usd_errors_as_faults(composed.composition.file):
        for prim in _prims_around(composed.stage, composed.composition.prim):
            for set_name in prim.GetVariantSets().GetNames() if prim.HasVariantSets() else ():
                sets.setdefault(set_name, set()).update(prim.GetVariantSet(set_name).GetVariantNames())
    if name not in sets:
        hint = nearest_hint(name, sorted(sets)) if sets else "it has none"
        file, path = composed.composition.file, composed.composition.prim or ""
        raise StageError.at(file, path, f"has no variant set '{name}'", hint)
    return tuple(sorted(sets[name]))


def _prims_around(stage: Usd.Stage, path: str | None) -> Iterator[Usd.Prim]:
    """Yield the prims above, at and below a path; None means the root."""
    for prefix in Sdf.Path(path or "/").GetPrefixes()[:-1]:
        if prim := stage.GetPrimAtPath(prefix):
            yield prim
    if prim := stage.GetPrimAtPath(path or "/"):
        yield from Usd.PrimRange(prim, _ALL_PRIMS)


def _session_prim(stage: Usd.Stage, path: Sdf.Path) -> Sdf.PrimSpec:
    """Return the session layer's spec of the prim at a path.

    Scene-graph instances above the prim become ordinary prims, so that the prim can differ from its counterparts in
    other instances.
    """
    session = stage.GetSessionLayer()
    for prefix in path.GetPrefixes()[:-1]:
        if (prim := stage.GetPrimAtPath(prefix)) and prim.IsInstance():
            Sdf.CreatePrimInLayer(session, prefix).instanceable = False
    return Sdf.CreatePrimInLayer(session, path)


def prim_and_ancestors(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    """Yield a prim, then its ancestors, without the pseudo-root; nothing for the pseudo-root."""
    paths = () if prim.IsPseudoRoot() else prim.GetPath().GetAncestorsRange()
    return map(prim.GetStage().GetPrimAtPath, paths)


def relationship_targets(relation: Usd.Relationship) -> list[Sdf.Path]:
    """Return the forwarded targets of a relationship, or its own targets if there are none, as in a cycle."""
    return list(relation.GetForwardedTargets() or relation.GetTargets())


def binding_targets(prim: Usd.Prim) -> dict[str, Sdf.Path]:
    """Return the material path of each material binding of a prim, by the name of the binding's relationship."""
    return {
        relation.GetName(): targets[-1]
        for relation in prim.GetAuthoredPropertiesInNamespace("material")
        if isinstance(relation, Usd.Relationship) and relation.GetName().startswith("material:binding")
        if (targets := relationship_targets(relation))
    }


def _composition_faults(stage: Usd.Stage, file: Path) -> list[Fault]:
    """Return one fault for each arc that cannot be composed, regardless of the number of prims that it affects."""
    paths_by_message: dict[str, list[str]] = {}
    for error in stage.GetCompositionErrors():
        path, message = error.rootSite.path, str(error)
        location = "" if path.isEmpty or path.IsAbsoluteRootPath() else str(path)
        paths_by_message.setdefault(" ".join(clean_usd_message(message).split()), []).append(location)
    return sorted(
        Fault(str(file), min(locations), message, f"and {len(locations) - 1} more prims" if len(locations) > 1 else "")
        for message, locations in paths_by_message.items()
    )


def _ineffective_overrides(stage: Usd.Stage, layer: Path, over: Sdf.Layer) -> list[str]:
    """Return a note for each topmost prim that a layer overrides and that no layer defines.

    `over` is the layer of the file `layer`.
    """
    notes = []
    pending = list(over.rootPrims)
    while pending:
        spec = pending.pop(0)
        prim = stage.GetPrimAtPath(spec.path)
        if prim and prim.IsDefined():
            pending += spec.nameChildren
        elif spec.specifier == Sdf.SpecifierOver:
            notes.append(f"{layer}: {spec.path}: overrides a prim that is not there, and has no effect")
    return notes


def _warning_text(messages: UsdUtils.CoalescingDiagnosticDelegateItem) -> str:
    """Return the first warning of a group, which one line of USD's code issued, and the number of different others."""
    try:
        texts = list(dict.fromkeys(message.commentary for message in messages.unsharedItems))
    except UnicodeDecodeError:  # USD quotes text of the file
        return NOT_UTF8
    more = f" (and {len(texts) - 1} more like it)" if len(texts) > 1 else ""
    return " ".join(clean_usd_message(texts[0]).split()) + more


def error_message(error: Tf.ErrorException) -> str:
    """Return the message of a USD exception, cleaned by `clean_usd_message`."""
    try:
        return clean_usd_message("; ".join(dict.fromkeys(part.commentary.strip() for part in error.args)))
    except UnicodeDecodeError:  # USD quotes text of the file
        return NOT_UTF8


def clean_usd_message(text: str) -> str:
    """Return a USD message, shortened and without names of USD's source files and of layers in memory."""
    text = re.sub(r"parse error matching pxr.*", "the text from here on is not valid USD", text)
    text = text.replace(":SDF_FORMAT_ARGS:target=usd", "")
    return shorten(re.sub(r",@anon:[^@]*@", "", text).strip())


def quote(text: str) -> str:
    """Return a text in quotes for a message; a long text is cut off."""
    return repr(text if len(text) <= _MAX_QUOTED else f"{text[:_MAX_QUOTED]}…")


def _open_layer(file: Path) -> Sdf.Layer:
    """Check and open a file and the layers that it refers to; return the file's layer."""
    with usd_errors_as_faults(file):
        return _open_layers(file)[0]


def _open_layers(file: Path) -> list[Sdf.Layer]:
    """Check and open a file and all layers that can be composed with it, including layers of unselected variants.

    The first of the returned layers is the file's own. Raises StageError with the faults of all layers.
    """
    if not has_text_path(file):
        raise StageError.at(file, "", "its path is not UTF-8", "rename it, or its folder")
    if not file.is_file():
        raise StageError.at(file, "", "is not a file" if file.exists() else "no such file")
    try:
        root = str(document_layer(str(file)) if is_document(str(file)) else file)
    except LookError as error:
        raise StageError(error.faults) from error
    layers: list[Sdf.Layer] = []
    faults: list[Fault] = []
    pending, visited = [root], {root, ""}
    while pending:
        path = pending.pop()
        outer_file = Path(Ar.SplitPackageRelativePathOuter(path)[0])
        sandbox.report_opened(outer_file)
        if problem := layer_problem(outer_file):
            faults.append(Fault(root, "", problem if path == root else f"its layer {path} {problem}"))
            continue
        try:
            layer = Sdf.Layer.FindOrOpen(path)
            if layer is not None:
                _map_assets(layer)
                redirect_documents(layer)
        except LookError as error:
            faults += error.faults
            continue
        except Tf.ErrorException:
            if path == root:
                raise
            continue  # composition reports the error, with the prim that names the layer
        if layer is None:
            if path == root:
                raise StageError.at(root, "", "USD cannot open it: it does not know the format")
            continue  # composition reports an unknown format too
        layers.append(layer)
        assets = {_resolve_asset(layer, asset) for asset in layer.GetCompositionAssetDependencies()} - visited
        visited |= assets
        pending += sorted(assets)
    if faults:
        raise StageError(faults)
    return layers


def _is_absolute(path: str) -> bool:
    """Return whether a path is absolute on Linux or on Windows."""
    return PurePosixPath(path).is_absolute() or PureWindowsPath(path).is_absolute()


def _map_assets(layer: Sdf.Layer) -> None:
    """Replace the absolute paths in a layer as `map_asset_paths` requests.

    A layer that is dirty has been mapped before. A mapped layer can no longer be saved.
    """
    map_path = _MAP_PATH.get()
    if map_path is None or layer.dirty or Ar.IsPackageRelativePath(layer.identifier):
        return
    UsdUtils.ModifyAssetPaths(layer, lambda path: map_path(path) if _is_absolute(path) else path)
    layer.SetPermissionToSave(False)


def _resolve_asset(layer: Sdf.Layer, asset: str) -> str:
    """Return the path of the file that a layer names by `asset`; "" if it is missing, which composition reports."""
    try:
        identifier, _ = Sdf.Layer.SplitIdentifier(layer.ComputeAbsolutePath(asset))
        return str(Ar.GetResolver().Resolve(identifier))
    except Tf.ErrorException:
        return ""
