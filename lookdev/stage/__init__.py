"""Opening and composing USD files of any content: USD's messages become a `StageError`, nothing goes to stderr.

`open_stage` and `compose` check every layer before USD reads it (`files`). A damaged binary layer can nevertheless
crash the process, and what a layer refers to can be endless: `lookdev.guard` is told which file is read. `clips` checks
value clips, as USD does not.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, Literal

from pxr import Ar, Sdf, Tf, Usd, UsdLux, UsdUtils

from lookdev import guard
from lookdev.errors import Fault, LookError, StageError, close_hint, nearest_hint, shortened
from lookdev.mtlx import document_layer, is_document, redirect
from lookdev.stage.clips import clip_faults
from lookdev.stage.files import NOT_UTF8, layer_problem
from lookdev.text import has_text_path

_MOST_NAMES = 16  # in a hint
_LONGEST_VALUE = 60  # characters of a value of a file in a message
_MAPPED: ContextVar[Callable[[str], str] | None] = ContextVar("_MAPPED", default=None)
_EVERYTHING = Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)


@contextmanager
def reading(file: Path) -> Iterator[list[str]]:
    """Turn exceptions of USD while `file` is read into a `StageError`, and keep its warnings off stderr.

    The list that it yields has the warnings afterwards, the first of each kind.
    """
    held = UsdUtils.CoalescingDiagnosticDelegate()
    warnings: list[str] = []
    try:
        with guard.reading(file):
            yield warnings
    except Tf.ErrorException as error:
        raise StageError([Fault(str(file), "", f"USD cannot open it: {error_words(error)}")]) from error
    except UnicodeDecodeError as error:
        raise StageError([Fault(str(file), "", NOT_UTF8)]) from error
    finally:
        warnings += [_warning(each) for each in held.TakeCoalescedDiagnostics()]


@contextmanager
def mapped_assets(mapped: Callable[[str], str]) -> Iterator[None]:
    """Let absolute paths that layers name lead to other places, while a block opens them.

    `mapped` returns where a path is. Layers are changed in memory: references, payloads, sublayers, clips and values
    of attributes, but not in packages, which name members only.
    """
    token = _MAPPED.set(mapped)
    try:
        yield
    finally:
        _MAPPED.reset(token)


def open_stage(file: Path) -> Usd.Stage:
    """Open a USD file, or a MaterialX document as USD, and all of its layers.

    Raises
    ------
    StageError
        The file is missing or is not USD; or a layer of it is not a regular file or nested too deep, or a malformed
        MaterialX document.
    """
    with reading(file):
        layers = _open_layers(file)  # held, so that the stage finds them open
        stage = Usd.Stage.Open(layers[0])
        del layers
        return stage


@dataclass(frozen=True)
class Composition:
    """What a stage is composed of.

    `layer` is composed over `file`, stronger than it; its relative paths are those of its own folder. `prim` is the
    part that is meant, the whole stage by default. `variants` are (set, variant), selected on every prim at, above and
    below `prim` that has the set. What is missing or broken in the composition is an error, or a note.
    """

    file: Path
    layer: Path | None = None
    prim: str | None = None
    variants: tuple[tuple[str, str], ...] = ()
    missing: Literal["error", "warn"] = "error"


@dataclass(frozen=True, eq=False)
class Composed:
    """A composed stage; `notes` are for the user."""

    stage: Usd.Stage
    composition: Composition
    notes: tuple[str, ...]


def compose(composition: Composition) -> Composed:
    """Open a USD file, with a layer over it and variants selected; payloads are loaded.

    Raises
    ------
    StageError
        Every fault: a file cannot be opened, a variant or the prim is not there; with `missing` "error" also a
        reference, payload or sublayer that is missing, broken or cyclic, at the prim that names it.
    """
    file, session = composition.file, Sdf.Layer.CreateAnonymous("session.usda")
    _check_path(composition)
    with reading(file):
        held = _open_layers(file)
        if composition.layer is not None:
            with reading(composition.layer):
                held += (over := _open_layers(composition.layer))
            session.subLayerPaths.append(over[0].identifier)
        stage = Usd.Stage.Open(held[0], session)
        faults, notes = _select_variants(stage, composition)
        faults += _prim_faults(stage, composition)
        broken = _composition_faults(stage, file)
        broken += clip_faults(stage, file, _open_clip)
        if composition.layer is not None:
            notes += _astray(stage, composition.layer, over[0])
    if composition.missing == "error":
        faults += broken
    if faults:
        raise StageError(faults)
    return Composed(stage, composition, (*map(str, broken), *notes))


def lights_hint(stage: Usd.Stage) -> str:
    """Return what to do with a stage that has lights, where something else was expected; "" where it has none."""
    lit = any(prim.HasAPI(UsdLux.LightAPI) for prim in stage.Traverse())
    return "it has lights: 'lookdev inspect' lists them, and [[rig]] of a job names it" if lit else ""


def dependencies(file: Path) -> set[Path]:
    """Return a USD file, its layers and its images, absolute; those of unselected variants too."""
    with reading(file):
        held = [] if _MAPPED.get() is None else _open_layers(file)
        layers, images, _ = UsdUtils.ComputeAllDependencies(Sdf.AssetPath(str(file)))
        del held
    return {Path(layer.realPath) for layer in layers} | {Path(image) for image in images}


def _check_path(composition: Composition) -> None:
    prim = "/" if composition.prim is None else composition.prim
    path = Sdf.Path(prim) if Sdf.Path.IsValidPathString(prim) else Sdf.Path()
    if not (path.IsAbsolutePath() and path.IsAbsoluteRootOrPrimPath()):
        what, hint = f"{prim!r} is not the path of a prim", "one looks like '/World/Car'"
        raise StageError([Fault(str(composition.file), "", what, hint)])


def _prim_faults(stage: Usd.Stage, composition: Composition) -> list[Fault]:
    if composition.prim is None or stage.GetPrimAtPath(composition.prim):
        return []
    parent = Sdf.Path(composition.prim)
    while not stage.GetPrimAtPath(parent):
        parent = parent.GetParentPath()
    children = [str(child.GetPath()) for child in stage.GetPrimAtPath(parent).GetAllChildren()]
    more = max(len(children) - _MOST_NAMES, 0)
    listed = ", ".join(children[:_MOST_NAMES]) + f" and {more} more" * (more > 0)
    close = close_hint(composition.prim, children) if more else ""
    hint = close or f"below {parent} there are: {listed or 'none'}"
    return [Fault(str(composition.file), composition.prim, "there is no such prim", hint)]


def _select_variants(stage: Usd.Stage, composition: Composition) -> tuple[list[Fault], list[str]]:
    """Select the variants on the session layer, those inside other variants after them; return faults and notes."""
    wanted, file = dict(composition.variants), str(composition.file)
    chosen: set[tuple[Sdf.Path, str]] = set()
    while True:
        sets = {
            (prim.GetPath(), name): (each.GetVariantNames(), each.GetVariantSelection())
            for prim in (_meant(stage, composition.prim) if wanted else ())
            for name in (prim.GetVariantSets().GetNames() if prim.HasVariantSets() else ())
            for each in [prim.GetVariantSet(name)]
        }
        able = {key: current for key, (names, current) in sets.items() if wanted.get(key[1]) in names}
        edits = {key for key, current in able.items() if current != wanted[key[1]]} - chosen
        if not edits:
            break
        chosen |= edits
        with Sdf.ChangeBlock():
            for path, name in edits:
                _writable(stage, path).variantSelections[name] = wanted[name]
    faults = []
    for name, choice in wanted.items():
        choices = sorted({each for key, (names, _) in sets.items() if key[1] == name for each in names})
        known = sorted({key[1] for key in sets})
        if name not in known:
            hint = nearest_hint(name, known) if known else "it has none"
            faults.append(Fault(file, composition.prim or "", f"has no variant set '{name}'", hint))
        elif choice not in choices:
            what = f"variant set '{name}' has no variant '{choice}'"
            faults.append(Fault(file, composition.prim or "", what, nearest_hint(choice, choices)))
    unable = {key: current for key, (_, current) in sets.items() if key[1] in wanted and key not in able}
    return faults, [
        f"{file}: {path}: variant set '{name}' has no variant '{wanted[name]}'; '{current}' stays selected"
        for (path, name), current in unable.items()
    ]


def is_animated(stage: Usd.Stage) -> bool:
    """Return whether an attribute of a stage has values that differ over time."""
    return any(
        attribute.ValueMightBeTimeVarying()
        for root in (stage.GetPseudoRoot(), *stage.GetPrototypes())
        for prim in Usd.PrimRange(root)
        for attribute in prim.GetAuthoredAttributes()
    )


def variant_choices(composed: Composed, name: str) -> tuple[str, ...]:
    """Return the variants of a set, by name, of all prims on which `Composition.variants` would select them.

    Raises StageError where no prim has the set.
    """
    sets: dict[str, set[str]] = {}
    with reading(composed.composition.file):
        for prim in _meant(composed.stage, composed.composition.prim):
            for each in prim.GetVariantSets().GetNames() if prim.HasVariantSets() else ():
                sets.setdefault(each, set()).update(prim.GetVariantSet(each).GetVariantNames())
    if name not in sets:
        hint = nearest_hint(name, sorted(sets)) if sets else "it has none"
        place = composed.composition.prim or ""
        raise StageError([Fault(str(composed.composition.file), place, f"has no variant set '{name}'", hint)])
    return tuple(sorted(sets[name]))


def _meant(stage: Usd.Stage, path: str | None) -> Iterator[Usd.Prim]:
    """Yield the prims above, at and below a path."""
    for prefix in Sdf.Path(path or "/").GetPrefixes()[:-1]:
        if prim := stage.GetPrimAtPath(prefix):
            yield prim
    if prim := stage.GetPrimAtPath(path or "/"):
        yield from Usd.PrimRange(prim, _EVERYTHING)


def _writable(stage: Usd.Stage, path: Sdf.Path) -> Sdf.PrimSpec:
    """Return a prim of the session layer; the instances around it become prims of their own, that it may differ."""
    session = stage.GetSessionLayer()
    for prefix in path.GetPrefixes()[:-1]:
        if (prim := stage.GetPrimAtPath(prefix)) and prim.IsInstance():
            Sdf.CreatePrimInLayer(session, prefix).instanceable = False
    return Sdf.CreatePrimInLayer(session, path)


def relationship_targets(relation: Usd.Relationship) -> list[Sdf.Path]:
    """Return what a relationship leads to; where it leads nowhere, as in a cycle, what it names."""
    return list(relation.GetForwardedTargets() or relation.GetTargets())


def bound_paths(prim: Usd.Prim) -> dict[str, Sdf.Path]:
    """Return the path of the material that each binding of a prim names, by the name of its relationship."""
    return {
        relation.GetName(): targets[-1]
        for relation in prim.GetAuthoredPropertiesInNamespace("material")
        if isinstance(relation, Usd.Relationship) and relation.GetName().startswith("material:binding")
        if (targets := relationship_targets(relation))
    }


def _composition_faults(stage: Usd.Stage, file: Path) -> list[Fault]:
    """Return a fault for each arc that cannot be composed, once for all prims that meet it."""
    places: dict[str, list[str]] = {}
    for error in stage.GetCompositionErrors():
        place, text = error.rootSite.path, str(error)
        where = "" if place.isEmpty or place.IsAbsoluteRootPath() else str(place)
        places.setdefault(" ".join(usd_words(text).split()), []).append(where)
    return sorted(
        Fault(str(file), min(paths), text, f"and {len(paths) - 1} more prims" if len(paths) > 1 else "")
        for text, paths in places.items()
    )


def _astray(stage: Usd.Stage, layer: Path, over: Sdf.Layer) -> list[str]:
    """Return a note on each topmost prim that a layer overrides but that is nowhere defined."""
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


def _warning(same: Any) -> str:
    """Return a warning that USD gave at one place of its code, and how often."""
    try:
        texts = list(dict.fromkeys(each.commentary for each in same.unsharedItems))
    except UnicodeDecodeError:  # USD quotes the file
        return NOT_UTF8
    more = f" (and {len(texts) - 1} more like it)" if len(texts) > 1 else ""
    return " ".join(usd_words(texts[0]).split()) + more


def error_words(error: Tf.ErrorException) -> str:
    """Return the message of an exception of USD, as `usd_words`."""
    try:
        return usd_words("; ".join(dict.fromkeys(part.commentary.strip() for part in error.args)))
    except UnicodeDecodeError:  # USD quotes the file
        return NOT_UTF8


def usd_words(text: str) -> str:
    """Return a message of USD without names of its own code and of layers in memory, `shortened`."""
    text = re.sub(r"parse error matching pxr.*", "USD's syntax ends here", text)
    text = text.replace(":SDF_FORMAT_ARGS:target=usd", "")
    return shortened(re.sub(r",@anon:[^@]*@", "", text).strip())


def shown(text: str) -> str:
    """Return a text of a file in quotes, or its beginning, for a message."""
    return repr(text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}…")


def _open_clip(file: Path) -> Sdf.Layer:
    with reading(file):
        return _open_layers(file)[0]


def _open_layers(file: Path) -> list[Sdf.Layer]:
    """Check and open a file, the first, and every layer it may be composed of, those of unselected variants too."""
    if not has_text_path(file):
        raise StageError([Fault(str(file), "", "its path is not UTF-8", "rename it, or its folder")])
    if not file.is_file():
        raise StageError([Fault(str(file), "", "is not a file" if file.exists() else "no such file")])
    try:
        root = str(document_layer(str(file)) if is_document(str(file)) else file)
    except LookError as error:
        raise StageError(error.faults) from error
    layers: list[Sdf.Layer] = []
    faults: list[Fault] = []
    pending, seen = [root], {root, ""}
    while pending:
        path = pending.pop()
        whole = Path(Ar.SplitPackageRelativePathOuter(path)[0])
        guard.opened(whole)
        if problem := layer_problem(whole):
            faults.append(Fault(root, "", problem if path == root else f"its layer {path} {problem}"))
            continue
        try:
            layer = Sdf.Layer.FindOrOpen(path)
            if layer is not None:
                _map_assets(layer)
                redirect(layer)
        except LookError as error:
            faults += error.faults
            continue
        except Tf.ErrorException:
            if path == root:
                raise
            continue  # composition reports it, with the prim that names it
        if layer is None:
            if path == root:
                raise StageError([Fault(root, "", "USD cannot open it: it does not know the format")])
            continue  # the same for an unknown format
        layers.append(layer)
        found = {_resolved(layer, asset) for asset in layer.GetCompositionAssetDependencies()} - seen
        seen |= found
        pending += sorted(found)
    if faults:
        raise StageError(faults)
    return layers


def _is_absolute(path: str) -> bool:
    return PurePosixPath(path).is_absolute() or PureWindowsPath(path).is_absolute()


def _map_assets(layer: Sdf.Layer) -> None:
    """Map the absolute paths that a layer names, once: one that was changed in memory was opened before."""
    mapped = _MAPPED.get()
    if mapped is None or layer.dirty or Ar.IsPackageRelativePath(layer.identifier):
        return
    UsdUtils.ModifyAssetPaths(layer, lambda path: mapped(path) if _is_absolute(path) else path)
    layer.SetPermissionToSave(False)


def _resolved(layer: Sdf.Layer, asset: str) -> str:
    """Return the file that a layer names; '' where it is missing, which composition reports."""
    try:
        identifier, _ = Sdf.Layer.SplitIdentifier(layer.ComputeAbsolutePath(asset))
        return str(Ar.GetResolver().Resolve(identifier))
    except Tf.ErrorException:
        return ""
