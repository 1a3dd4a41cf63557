"""Examines the looks of a file for `lookdev validate`: finds all faults, in every combination of variants.

Findings are the faults that `read_look` and USD's validators report, and notes on elements without effect. For a
foreign material, of another shading model, notes state the models that it is read as, and the inputs that are lost.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import accumulate, islice
from pathlib import Path
from typing import TypeAlias

from pxr import Sdf, Sdr, Usd, UsdShade, UsdValidation

from lookdev.brdf import layer_shaders
from lookdev.errors import Fault, LookError, shorten
from lookdev.material import Layer
from lookdev.material.definitions import DEFINITIONS
from lookdev.material.library.nodes import find_upstream
from lookdev.material.library.stack import Stack, find_stack
from lookdev.material.usd import find_material, layer_faults, material_paths, read_material, variant_sets
from lookdev.material.usd.bound import is_foreign, read_foreign
from lookdev.material.usd.network import Network, authored_property_count, is_authored, shader_id
from lookdev.material.validate.report import SEVERITIES, Severity, ValidationFinding, ValidationReport
from lookdev.material.values import presence
from lookdev.stage import clean_usd_message, lights_hint, open_stage, usd_errors_as_faults

Selection: TypeAlias = Mapping[str, str]
"""Selected variants by set."""

MAX_COMBINATIONS = 64
"""The largest number of combinations of variants that are all examined.

If a material has more combinations, each variant is examined once, with the file's selections of the other sets.
"""

MAX_FINDINGS = 1000
"""The largest number of findings in a report."""

_MAX_VARIANTS = 256  # the most variants that are examined once each, if there are more than `MAX_COMBINATIONS`
_MAX_PROPERTIES = 10_000  # properties and prims of a material; in a larger one, only the reader's faults are found

# The validators of USD that suit a look. Others ask for an up axis and units, which a look without geometry lacks.
_VALIDATOR_KEYWORDS = {"UsdCoreValidators", "UsdShadeValidators"}
_REFERENCE_VALIDATOR = "usdUtilsValidators:MissingReferenceValidator"
_USD_SEVERITIES: dict[str, Severity] = {"Error": "error", "Warn": "warning", "Info": "note"}
# USD's error for an unknown shader. Here it is only a warning: nodes of other renderers may be beside ours.
_UNKNOWN_SHADER = "MissingShaderIdInRegistry"
# Errors of USD with another severity here. A file of several looks needs no default prim, because a job names its look.
_SEVERITIES: dict[str, Severity] = {_UNKNOWN_SHADER: "warning", "MissingDefaultPrim": "note"}
# The beginning of USD's message for an unknown node of MaterialX. These messages are ignored: USD's wheels lack the
# definitions of these nodes, and our reader reads the nodes or adds notes itself.
_MATERIALX_SHADER = "shaderId 'ND_"
_TOO_LARGE = "is too large to be examined for more than faults"
_UNRESOLVED_REFERENCE = "UnresolvableDependency"

_Unused: TypeAlias = tuple[str, str, str]
"""A prim or property without effect: its path, what is wrong, and what would be right or ""."""


def examine_file(file: Path, prim: str | None = None, variants: Mapping[str, str] | None = None) -> ValidationReport:
    """Examine every material of a file, or the one at `prim`, in every combination of variants.

    `variants` selects variants by set; only combinations with these are examined. In a file without materials, such as
    a preset, the layers are examined. A file that cannot be read is a finding, not an error.
    """
    findings: list[ValidationFinding] = []
    looks: list[int] = []
    try:
        stage = open_stage(file)
        with usd_errors_as_faults(file):
            for path in [prim] if prim else map(str, material_paths(stage)):
                material, combinations = _examine_material(file, stage, path, variants or {})
                findings += material
                looks.append(combinations)
            if not looks:
                findings += _examine_layers(file, stage)
            if all(finding.what != _TOO_LARGE for finding in findings):
                inside = f"{prim}/" if prim else ""
                stage_findings = _usd_findings(stage, findings)
                findings += [finding for finding in stage_findings if f"{finding.prim}/".startswith(inside)]
    except LookError as error:
        findings += map(_to_finding, error.faults)
    ordered = sorted(dict.fromkeys(findings), key=lambda finding: SEVERITIES.index(finding.severity))
    if more := len(ordered[MAX_FINDINGS:]):
        last = ValidationFinding(
            ordered[MAX_FINDINGS].severity, "", "", f"{more} more findings", "mend those above first"
        )
        ordered = [*ordered[:MAX_FINDINGS], last]
    return ValidationReport(str(file), tuple(ordered), len(looks), sum(looks))


def _examine_material(
    file: Path, stage: Usd.Stage, prim: str, fixed: Mapping[str, str]
) -> tuple[list[ValidationFinding], int]:
    """Return the findings of a material, and the number of combinations of variants that were examined.

    `fixed` has the variants that all combinations have.
    """
    network, session = Network(file), stage.GetSessionLayer()
    path = find_material(network, stage, prim, fixed)
    if path is None or network.faults:
        session.Clear()
        return list(map(_to_finding, network.faults)), 0
    findings: list[ValidationFinding] = []
    combinations = _combinations(stage, path, fixed)
    if sum(1 for _ in islice(_combinations(stage, path, fixed), MAX_COMBINATIONS + 1)) > MAX_COMBINATIONS:
        combinations = islice(_single_variants(stage, path, fixed), _MAX_VARIANTS)
        message = f"has more than {MAX_COMBINATIONS} combinations of variants; not all were examined"
        hint = "each variant was, with the other sets as the file has them"
        findings.append(ValidationFinding("note", prim, "", message, hint))
    looks: dict[str, tuple[ValidationFinding, ...]] = {}
    foreign: set[str] = set()
    for selection in combinations:
        looks[label := _combination_label(selection)] = tuple(dict.fromkeys(_examine_look(file, stage, path)))
        if is_foreign(stage.GetPrimAtPath(path)):
            foreign.add(label)
    session.Clear()
    return [*findings, *_merge_findings(looks, foreign)], len(looks)


def _examine_layers(file: Path, stage: Usd.Stage) -> list[ValidationFinding]:
    """Return the findings of all shaders of layers in a file without materials."""
    shaders = [UsdShade.Shader(prim) for prim in stage.Traverse() if prim.IsA(UsdShade.Shader)]
    layers = [shader for shader in shaders if shader_id(shader) in layer_shaders()]
    if not layers:
        hint = lights_hint(stage) or "define a Material prim"
        return [ValidationFinding("error", "", "", "holds no material and no layer", hint)]
    return [_to_finding(fault) for layer in layers for fault in layer_faults(file, layer)]


def _combination_label(selection: Mapping[str, str]) -> str:
    """Return a combination of variants as text, such as ``"wear=dusty, metal=copper"``."""
    return ", ".join(f"{name}={choice or '(none)'}" for name, choice in selection.items())


def _merge_findings(
    looks: Mapping[str, tuple[ValidationFinding, ...]], foreign: set[str]
) -> Iterator[ValidationFinding]:
    """Merge the findings of all combinations of variants: each finding is yielded once.

    `looks` has the findings of each combination by its label. An error or warning that only some combinations have is
    yielded with their labels. A note that only some have is omitted: the element has no effect in these combinations,
    but other combinations may use it. `foreign` has the labels of the combinations in which the material is foreign. A
    note that only such combinations have is kept: it states a loss.
    """
    labelled: dict[ValidationFinding, list[str]] = {}
    for label, findings in looks.items():
        for finding in findings:
            labelled.setdefault(finding, []).append(label)
    for finding, labels in labelled.items():
        if len(labels) == len(looks):
            yield finding
        elif finding.severity != "note" or foreign.issuperset(labels):
            yield replace(finding, variants=tuple(labels))


def _combinations(stage: Usd.Stage, path: Sdf.Path, selection: Mapping[str, str]) -> Iterator[Mapping[str, str]]:
    """Yield all combinations of variants that extend a selection, each while it is selected on the stage.

    A variant may add further variant sets.
    """
    free_sets = variant_sets(stage, path).keys() - selection.keys()
    if not free_sets:
        yield selection
        return
    for extended in _select_variants(stage, path, min(free_sets), selection):
        yield from _combinations(stage, path, extended)


def _single_variants(stage: Usd.Stage, path: Sdf.Path, selection: Mapping[str, str]) -> Iterator[Mapping[str, str]]:
    """Yield a selection with one more variant, for each variant of each other set, while this variant is selected."""
    for name in sorted(variant_sets(stage, path).keys() - selection.keys()):
        yield from _select_variants(stage, path, name, selection)


def _select_variants(stage: Usd.Stage, path: Sdf.Path, name: str, selection: Selection) -> Iterator[Selection]:
    """Yield a selection extended by each variant of the set `name` in turn, while it is selected on the stage.

    Where the file selects no variant of the set, the first choice is "", which selects no variant.
    """
    variant_set, session = variant_sets(stage, path)[name], stage.GetSessionLayer()
    names: list[str] = variant_set.GetVariantNames()
    for choice in names if variant_set.GetVariantSelection() in names else ["", *names]:
        with Usd.EditContext(stage, session):
            variant_set.SetVariantSelection(choice)
        try:
            yield {**selection, name: choice}
        finally:
            with Usd.EditContext(stage, session):
                variant_set.ClearVariantSelection()


def _examine_look(file: Path, stage: Usd.Stage, path: Sdf.Path) -> Iterator[ValidationFinding]:
    """Yield the findings of a material with the variants that are selected now."""
    prim = stage.GetPrimAtPath(path)
    reader_findings, layers = _read_material(file, stage, path)
    yield from reader_findings
    if _is_huge(prim):
        yield ValidationFinding(
            "note", str(path), "", _TOO_LARGE, f"at most {_MAX_PROPERTIES} prims and properties would be"
        )
        return
    usd_findings = _usd_findings(list(Usd.PrimRange(prim)), reader_findings)
    if is_foreign(prim):  # USD's errors are warnings here: the material is read as far as possible, and rendered
        for finding in usd_findings:
            yield replace(finding, severity="warning") if finding.severity == "error" else finding
        return
    yield from usd_findings
    stack = find_stack(UsdShade.Material(prim))
    for where, message, hint in (*(_ineffective_layers(stack, layers) if stack else ()), *_unread_shaders(prim)):
        yield ValidationFinding("note", *_split_path(where), message, hint)
    if stack and (switches := _disabled_switches(stack)):
        # Faults of disabled layers are warnings. To find them, all layers are enabled for a moment.
        session = stage.GetSessionLayer()
        session_text = session.ExportToString()
        with Usd.EditContext(stage, session):
            for attribute in switches:
                attribute.SetConnections([])
                attribute.Set(True)
        for finding in _read_material(file, stage, path)[0]:
            if finding not in reader_findings:
                yield replace(finding, severity="warning", what=f"{finding.what} (in a layer that is not enabled)")
        session.ImportFromString(session_text)


def _disabled_switches(stack: Stack) -> list[Usd.Attribute]:
    """Return the inputs of a stack that disable layers."""
    return [stack.attribute(number, "Enabled") for number in stack.layers if not stack.is_enabled(number)]


def _ineffective_layers(stack: Stack, layers: Sequence[Layer]) -> Iterator[_Unused]:
    """Yield the layers of a stack that are never visible, and the layers without a mask that hide all layers beneath.

    `layers` are the enabled layers, base first.
    """
    for attribute in _disabled_switches(stack):
        yield str(attribute.GetPath()), "the layer is not enabled", ""
    # The indices, among the enabled layers, of layers that cover everything beneath.
    covers = [index for index, layer in enumerate(layers) if index and _covers_everything(layer)]
    numbers = [number for number in (0, *stack.layers) if stack.is_enabled(number)]
    if len(layers) != len(numbers):  # the reader has found faults, and layers are missing
        return
    for index, (number, layer) in enumerate(zip(numbers, layers, strict=True)):
        where, mask = f"{stack.prim.GetPath()}.{stack.input_name(number, '')}", stack.attribute(number, "Mask")
        if layer.mask == 0.0:
            yield f"{where}Mask", "the layer never shows: its mask is 0", ""
        elif presence(layer) == 0.0:
            yield where, f"the layer never shows: the presence of {layer.name} is 0", ""
        elif covers and covers[-1] > index:
            message = f"the layer never shows: {layers[covers[-1]].name} covers it wholly"
            yield where, message, "give the layer that covers it a mask"
        if index in covers and not (mask and is_authored(mask)):
            yield f"{where}Mask", "the mask is not connected, so the layer covers all beneath", ""


def _unread_shaders(material: Usd.Prim) -> Iterator[_Unused]:
    """Yield the shaders of a material on which none of its outputs depends."""
    outputs = [output.GetAttr() for output in UsdShade.Material(material).GetOutputs()]
    read_paths = find_upstream(UsdShade.Material(material), outputs)
    for prim in Usd.PrimRange(material):
        if prim.IsA(UsdShade.Shader) and prim.GetPath() not in read_paths:
            node = shader_id(UsdShade.Shader(prim)) or "a shader"
            yield str(prim.GetPath()), f"{node} that nothing reads", "connect it, or remove it"


def _covers_everything(layer: Layer) -> bool:
    """Return whether a layer hides all layers beneath it."""
    return layer.mode == "over" and layer.mask == 1.0 and presence(layer) == 1.0


def _is_huge(prim: Usd.Prim) -> bool:
    """Return whether a material has more than `_MAX_PROPERTIES` properties and prims."""
    counts = accumulate(1 + authored_property_count(descendant) for descendant in Usd.PrimRange(prim))
    return any(count > _MAX_PROPERTIES for count in counts)


def _read_material(
    file: Path, stage: Usd.Stage, path: Sdf.Path
) -> tuple[tuple[ValidationFinding, ...], tuple[Layer, ...]]:
    """Return the reader's findings in a material, and its layers.

    A foreign material has only notes, and no layers.
    """
    try:
        if is_foreign(stage.GetPrimAtPath(path)):
            bound = read_foreign(file, stage, path)
            read_as = ValidationFinding(
                "note", str(path), "", f"is read as {' and '.join(dict.fromkeys(bound.titles))}"
            )
            return (read_as, *(replace(_to_finding(fault), severity="note") for fault in bound.losses)), ()
        return (), read_material(file, stage, path).layers
    except LookError as error:
        return tuple(map(_to_finding, error.faults)), ()


def _to_finding(fault: Fault) -> ValidationFinding:
    """Return a fault as a finding of severity error."""
    return ValidationFinding("error", *_split_path(fault.where), fault.what, fault.hint)


def _split_path(where: str) -> tuple[str, str]:
    """Split the path of a property into the path of its prim and the property's name, which is "" for a prim."""
    prim, _, name = shorten(where).partition(".")
    return prim, name


def _usd_findings(
    target: Usd.Stage | list[Usd.Prim], reader_findings: Iterable[ValidationFinding]
) -> Iterator[ValidationFinding]:
    """Yield the findings of USD's validators in a stage or in prims, except those that `reader_findings` state too."""
    reported = tuple(reader_findings)
    for error in UsdValidation.ValidationContext(_validators()).Validate(target)[:MAX_FINDINGS]:
        message = clean_usd_message(error.GetMessage())
        if error.GetName() == _UNKNOWN_SHADER and message.startswith(_MATERIALX_SHADER):
            continue
        where = (site.GetProperty() if site.IsProperty() else site.GetPrim() for site in error.GetSites())
        prim, name = next((_split_path(str(site.GetPath())) for site in where if site), ("", ""))
        # The reader already reports a missing file, with the input or the reference that names it. USD's message has
        # the file in quotes.
        file_name = (
            Path(message.split("'")[1]).name if error.GetName() == _UNRESOLVED_REFERENCE and "'" in message else message
        )
        locations = {(finding.prim, finding.input) for finding in reported}
        if (name and (prim, name) in locations) or any(file_name in finding.what for finding in reported):
            continue
        severity = _SEVERITIES.get(error.GetName()) or _USD_SEVERITIES[error.GetType().name]
        yield ValidationFinding(severity, "" if prim == "/" else prim, name, message)


@cache
def _validators() -> tuple[UsdValidation.Validator, ...]:
    """Return USD's validators for a look, after registering our nodes, which a validator looks up."""
    definitions = Usd.Stage.Open(str(DEFINITIONS))
    for prim in definitions.Traverse():
        for node in UsdShade.ShaderDefUtils.GetDiscoveryResults(UsdShade.Shader(prim), str(DEFINITIONS)):
            Sdr.Registry().AddDiscoveryResult(node)
    registry = UsdValidation.ValidationRegistry()
    names = [data.name for data in registry.GetAllValidatorMetadata() if _VALIDATOR_KEYWORDS & set(data.GetKeywords())]
    return tuple(registry.GetOrLoadValidatorsByName([*names, _REFERENCE_VALIDATOR]))
