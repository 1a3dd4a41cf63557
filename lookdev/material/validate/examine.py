"""All faults of the looks of a file, in every combination of variants.

These are the faults of `read_look`, the findings of USD's own validators, and notes on what is legal without effect. Of
a material of another shading model, notes say what it is read as and what is not carried.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

from pxr import Sdf, Sdr, Usd, UsdShade, UsdValidation

from lookdev.brdf import layer_shaders
from lookdev.errors import Fault, LookError, shortened
from lookdev.material.definitions import DEFINITIONS
from lookdev.material.look import Layer
from lookdev.material.usd import find_material, layer_faults, materials, read_material, variant_sets
from lookdev.material.usd.bound import is_foreign, read_foreign
from lookdev.material.usd.network import Network, authored_properties, shader_id
from lookdev.material.validate.report import SEVERITIES, Finding, Report, Severity
from lookdev.material.validate.unused import Stack, unread
from lookdev.stage import lights_hint, open_stage, reading, usd_words

MOST_COMBINATIONS = 64
"""Where a material's variants combine to more, each variant is tried once, with the other sets as the file has them."""

MOST_FINDINGS = 1000
"""Findings of a report."""

_MOST_VARIANTS = 256  # that are tried once
_MOST_PROPERTIES = 10_000  # and prims, of a material that is examined for more than faults

# USD's validators for a look: it has no geometry, thus neither axis nor unit.
_KEYWORDS = {"UsdCoreValidators", "UsdShadeValidators"}
_DEPENDENCIES = "usdUtilsValidators:MissingReferenceValidator"
_USD_SEVERITIES: dict[str, Severity] = {"Error": "error", "Warn": "warning", "Info": "note"}
# USD's error for an unknown shader: nodes of other renderers may be beside ours.
_UNKNOWN_SHADER = "MissingShaderIdInRegistry"
# A file of several looks has no look that stands for it: a job names the one that is meant.
_SEVERITIES: dict[str, Severity] = {_UNKNOWN_SHADER: "warning", "MissingDefaultPrim": "note"}
# Nodes of MaterialX are read, or noted; USD's wheels lack its definitions.
_MATERIALX = "shaderId 'ND_"
_TOO_LARGE = "is too large to be examined for more than faults"
_UNRESOLVED = "UnresolvableDependency"


def examine(file: Path, prim: str | None = None, variants: Mapping[str, str] | None = None) -> Report:
    """Examine every material of a file, or the one at `prim`, in every combination of variants.

    `variants` has a variant for each set that is not varied. In a file without materials, such as a preset, layers are
    examined alone. Nothing is raised: a file that cannot be read is a finding too.
    """
    found: list[Finding] = []
    looks: list[int] = []
    try:
        stage = open_stage(file)
        with reading(file):
            for path in [prim] if prim else map(str, materials(stage)):
                material, combinations = _examine_material(file, stage, path, variants or {})
                found += material
                looks.append(combinations)
            if not looks:
                found += _examine_layers(file, stage)
            whole = [] if any(each.what == _TOO_LARGE for each in found) else _usd_findings(stage, found)
            found += [each for each in whole if not prim or each.prim == prim or each.prim.startswith(f"{prim}/")]
    except LookError as error:
        found += map(_from_fault, error.faults)
    ordered = sorted(dict.fromkeys(found), key=lambda finding: SEVERITIES.index(finding.severity))
    if more := len(ordered[MOST_FINDINGS:]):
        last = Finding(ordered[MOST_FINDINGS].severity, "", "", f"{more} more findings", "mend those above first")
        ordered = [*ordered[:MOST_FINDINGS], last]
    return Report(str(file), tuple(ordered), len(looks), sum(looks))


def _examine_material(file: Path, stage: Usd.Stage, prim: str, fixed: Mapping[str, str]) -> tuple[list[Finding], int]:
    """Return the findings of a material, and in how many combinations of variants it was examined."""
    network, session = Network(file), stage.GetSessionLayer()
    path = find_material(network, stage, prim, fixed)
    if path is None or network.faults:
        session.Clear()
        return list(map(_from_fault, network.faults)), 0
    found: list[Finding] = []
    combinations = _combinations(stage, path, fixed)
    if sum(1 for _ in islice(_combinations(stage, path, fixed), MOST_COMBINATIONS + 1)) > MOST_COMBINATIONS:
        combinations = islice(_one_by_one(stage, path, fixed), _MOST_VARIANTS)
        what = f"has more than {MOST_COMBINATIONS} combinations of variants; not all were examined"
        found.append(Finding("note", prim, "", what, "each variant was, with the other sets as the file has them"))
    looks: dict[str, tuple[Finding, ...]] = {}
    foreign: set[str] = set()
    for chosen in combinations:
        looks[label := _label(chosen)] = tuple(dict.fromkeys(_examine_look(file, stage, path)))
        if is_foreign(stage.GetPrimAtPath(path)):
            foreign.add(label)
    session.Clear()
    return [*found, *_merged(looks, foreign)], len(looks)


def _examine_layers(file: Path, stage: Usd.Stage) -> list[Finding]:
    shaders = [UsdShade.Shader(prim) for prim in stage.Traverse() if prim.IsA(UsdShade.Shader)]
    layers = [shader for shader in shaders if shader_id(shader) in layer_shaders()]
    if not layers:
        return [
            Finding("error", "", "", "holds no material and no layer", lights_hint(stage) or "define a Material prim")
        ]
    return [_from_fault(fault) for layer in layers for fault in layer_faults(file, layer)]


def _label(chosen: Mapping[str, str]) -> str:
    return ", ".join(f"{name}={choice or '(none)'}" for name, choice in chosen.items())


def _merged(looks: Mapping[str, tuple[Finding, ...]], foreign: set[str]) -> Iterator[Finding]:
    """Yield the findings of every combination, and errors and warnings of some combinations with their names.

    Notes on some are left out: another variant may use what one does not. Those of `foreign` ones are on losses.
    """
    labelled: dict[Finding, list[str]] = {}
    for label, findings in looks.items():
        for finding in findings:
            labelled.setdefault(finding, []).append(label)
    for finding, labels in labelled.items():
        if len(labels) == len(looks):
            yield finding
        elif finding.severity != "note" or foreign.issuperset(labels):
            yield replace(finding, variants=tuple(labels))


def _combinations(stage: Usd.Stage, path: Sdf.Path, chosen: Mapping[str, str]) -> Iterator[Mapping[str, str]]:
    """Yield every combination of the variants that are not chosen yet; a variant may add further sets."""
    free = variant_sets(stage, path).keys() - chosen.keys()
    if not free:
        yield chosen
        return
    for each in _selections(stage, path, min(free), chosen):
        yield from _combinations(stage, path, each)


def _one_by_one(stage: Usd.Stage, path: Sdf.Path, chosen: Mapping[str, str]) -> Iterator[Mapping[str, str]]:
    for name in sorted(variant_sets(stage, path).keys() - chosen.keys()):
        yield from _selections(stage, path, name, chosen)


def _selections(stage: Usd.Stage, path: Sdf.Path, name: str, chosen: Mapping[str, str]) -> Iterator[Mapping[str, str]]:
    """Select each variant of a set in turn, and yield it with those chosen; "" where the file selects none."""
    variant_set, session = variant_sets(stage, path)[name], stage.GetSessionLayer()
    names: list[str] = variant_set.GetVariantNames()
    for choice in names if variant_set.GetVariantSelection() in names else ["", *names]:
        with Usd.EditContext(stage, session):
            variant_set.SetVariantSelection(choice)
        try:
            yield {**chosen, name: choice}
        finally:
            with Usd.EditContext(stage, session):
                variant_set.ClearVariantSelection()


def _examine_look(file: Path, stage: Usd.Stage, path: Sdf.Path) -> Iterator[Finding]:
    """Examine a material as it is composed now."""
    prim = stage.GetPrimAtPath(path)
    own, layers = _read(file, stage, path)
    yield from own
    if _is_huge(prim):
        yield Finding("note", str(path), "", _TOO_LARGE, f"at most {_MOST_PROPERTIES} prims and properties would be")
        return
    of_usd = _usd_findings(list(Usd.PrimRange(prim)), own)
    if is_foreign(prim):  # read more leniently: what USD objects to is rendered
        yield from (replace(each, severity="warning") if each.severity == "error" else each for each in of_usd)
        return
    yield from of_usd
    stack = Stack(file, UsdShade.Material(prim))
    for place, what, hint in (*stack.notes(layers), *unread(prim)):
        yield Finding("note", *_split(place), what, hint)
    if stack.disabled:
        # Faults of a disabled layer are reported as warnings, before it is enabled.
        session = stage.GetSessionLayer()
        before = session.ExportToString()
        with Usd.EditContext(stage, session):
            for attribute in stack.disabled:
                attribute.SetConnections([])
                attribute.Set(True)
        for finding in _read(file, stage, path)[0]:
            if finding not in own:
                yield replace(finding, severity="warning", what=f"{finding.what} (in a layer that is not enabled)")
        session.ImportFromString(before)


def _is_huge(prim: Usd.Prim) -> bool:
    count = 0
    for each in Usd.PrimRange(prim):
        count += 1 + authored_properties(each)
        if count > _MOST_PROPERTIES:
            return True
    return False


def _read(file: Path, stage: Usd.Stage, path: Sdf.Path) -> tuple[tuple[Finding, ...], tuple[Layer, ...]]:
    """Return the findings of the reader in a material, and the layers; of one of another model only notes."""
    try:
        if is_foreign(stage.GetPrimAtPath(path)):
            found = read_foreign(file, stage, path)
            read_as = Finding("note", str(path), "", f"is read as {' and '.join(dict.fromkeys(found.titles))}")
            return (read_as, *(replace(_from_fault(fault), severity="note") for fault in found.lost)), ()
        return (), read_material(file, stage, path).layers
    except LookError as error:
        return tuple(map(_from_fault, error.faults)), ()


def _from_fault(fault: Fault) -> Finding:
    return Finding("error", *_split(fault.where), fault.what, fault.hint)


def _split(where: str) -> tuple[str, str]:
    """Split a place into prim and property."""
    prim, _, name = shortened(where).partition(".")
    return prim, name


def _usd_findings(place: Usd.Stage | list[Usd.Prim], own: Iterable[Finding]) -> Iterator[Finding]:
    """Yield the findings of USD's validators that are not among `own`."""
    known = tuple(own)
    for error in UsdValidation.ValidationContext(_validators()).Validate(place)[:MOST_FINDINGS]:
        what = usd_words(error.GetMessage())
        if error.GetName() == _UNKNOWN_SHADER and what.startswith(_MATERIALX):
            continue
        where = (site.GetProperty() if site.IsProperty() else site.GetPrim() for site in error.GetSites())
        prim, name = next((_split(str(each.GetPath())) for each in where if each), ("", ""))
        # A missing file is already reported with the input or the reference that names it.
        named = Path(what.split("'")[1]).name if error.GetName() == _UNRESOLVED and "'" in what else what
        if any((name and (each.prim, each.input) == (prim, name)) or named in each.what for each in known):
            continue
        severity = _SEVERITIES.get(error.GetName()) or _USD_SEVERITIES[error.GetType().name]
        yield Finding(severity, "" if prim == "/" else prim, name, what)


@cache
def _validators() -> tuple[Any, ...]:
    """Return USD's validators for a look, after our nodes are registered."""
    definitions = Usd.Stage.Open(str(DEFINITIONS))
    for prim in definitions.Traverse():
        for node in UsdShade.ShaderDefUtils.GetDiscoveryResults(UsdShade.Shader(prim), str(DEFINITIONS)):
            Sdr.Registry().AddDiscoveryResult(node)
    registry = UsdValidation.ValidationRegistry()
    names = [data.name for data in registry.GetAllValidatorMetadata() if _KEYWORDS & set(data.GetKeywords())]
    return tuple(registry.GetOrLoadValidatorsByName([*names, _DEPENDENCIES]))
