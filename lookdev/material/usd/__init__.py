"""Looks from USD: a UsdShade.Material whose outputs:lookdev:surface is a stack of layers.

Composition (references, variants, sublayers, inherits) is USD's own; the composed network is read here.
A lookdev shader has one result, so the name of the output that is connected does not matter.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from pxr import Sdf, Usd, UsdShade

from lookdev.brdf import MASK, MODELS, Mode, layer_shaders, stranger
from lookdev.errors import Fault, LookError, nearest_hint
from lookdev.material.look import Formula, Input, Layer, Look, Mask, Primvar, Texture
from lookdev.material.usd.file import open_stage, reading, usd_words
from lookdev.material.usd.inputs import read_input
from lookdev.material.usd.network import Network, Source, authored_properties, shader_id

MOST_PROPERTIES = 4096
"""Properties that a LookdevLayers may have: a thousand layers. More are no work of a person."""

_TERMINAL = "outputs:lookdev:surface"
_LAYER_INPUT = re.compile(r"layer([1-9][0-9]{0,8})(Mask|Enabled|Mode)?")
_MODES: tuple[Mode, ...] = ("over", "transmit")


def read_look(
    file: Path,
    prim: str | None = None,
    variants: Mapping[str, str] | None = None,
    name: str | None = None,
    *,
    open_images: bool = True,
) -> Look:
    """Read a look.

    Parameters
    ----------
    file
        Any file USD opens.
    prim
        Path of the material; None takes the default prim if it is one, else the only material of the file.
    variants
        Variant set to variant, for sets on the material or above it; otherwise the file's own selections.
    name
        What the look is called; the material's name by default.
    open_images
        Read the header of every image. Otherwise one that cannot be read is found when it is needed.

    Raises
    ------
    LookError
        Carries every fault of the look, each with its place.
    """
    stage = open_stage(file)
    network = Network(file, open_images)
    with reading(file):
        path = find_material(network, stage, prim, variants or {})
        return _read(network, stage, path, name)


def read_material(file: Path, stage: Usd.Stage, path: Sdf.Path) -> Look:
    """Read the look of a material of an open stage, as it is composed there; `file` is what faults name.

    Raises
    ------
    LookError
        Carries every fault of the look, each with its place.
    """
    with reading(file):
        return _read(Network(file), stage, path, None)


def layer_faults(file: Path, layer: UsdShade.Shader) -> tuple[Fault, ...]:
    """Return what is wrong with a layer of its own, as a preset is; `file` is what faults name."""
    network = Network(file)
    with reading(file):
        _read_layer(network, layer.GetIdAttr(), Source(layer, "layer"), 1.0, "over", tuple(layer_shaders()))
    return network.faults


def materials(stage: Usd.Stage) -> list[Sdf.Path]:
    """Return the paths of all materials of a stage."""
    return [prim.GetPath() for prim in stage.Traverse() if prim.IsA(UsdShade.Material)]


MOST_COMBINATIONS = 1000
"""Looks that ``"*"`` may stand for."""


def expand_variants(file: Path, prim: str | None, variants: Mapping[str, str]) -> tuple[dict[str, str], ...]:
    """Replace each ``"*"`` by every variant of its set, by name: all combinations.

    Raises
    ------
    LookError
        As `read_look`, for the file, the material and the variant sets.
    """
    combinations: list[dict[str, str]] = [dict(variants)]
    while (wanted := next((name for name, choice in combinations[0].items() if choice == "*"), None)) is not None:
        if len(combinations) > MOST_COMBINATIONS:
            what = f"'*' stands for more than {MOST_COMBINATIONS} combinations of variants"
            raise LookError([Fault(str(file), prim or "", what, "name a variant of some of the sets")])
        # A set may stand inside a variant of another: what that one selects decides what there is.
        combinations = [
            {**chosen, wanted: choice}
            for chosen in combinations
            for choice in _choices(
                file, prim, {name: choice for name, choice in chosen.items() if choice != "*"}, wanted
            )
        ]
    return tuple(combinations)


def _choices(file: Path, prim: str | None, chosen: Mapping[str, str], wanted: str) -> list[str]:
    network = Network(file)
    stage = open_stage(file)
    path = find_material(network, stage, prim, chosen)
    choices: list[str] = []
    if path is not None:
        sets = [stage.GetPrimAtPath(prefix).GetVariantSets() for prefix in path.GetPrefixes()]
        owners = [each for each in sets if each.HasVariantSet(wanted)]
        known = sorted({name for each in sets for name in each.GetNames()})
        if owners:
            choices = owners[-1].GetVariantSet(wanted).GetVariantNames()
        else:
            hint = nearest_hint(wanted, known) if known else "it has none"
            network.fault(path, f"has no variant set '{wanted}'", hint)
    if network.faults:
        raise LookError(network.faults)
    return list(choices)


def has_look(file: Path, prim: str) -> bool:
    """Say whether `prim` is a material with a connected outputs:lookdev:surface.

    Raises
    ------
    LookError
        The file is missing or is not USD.
    """
    stage = open_stage(file)
    material = UsdShade.Material(stage.GetPrimAtPath(prim))
    return bool(material) and bool(material.GetPrim().GetAttribute(_TERMINAL).HasAuthoredConnections())


def _read(network: Network, stage: Usd.Stage, path: Sdf.Path | None, name: str | None) -> Look:
    for error in stage.GetCompositionErrors():
        site = error.rootSite.path
        # USD names no site for a path that is an expression it cannot evaluate.
        if path is None or not site or path.HasPrefix(site) or site.HasPrefix(path):
            network.fault(site, usd_words(str(error)))
    layers = () if path is None else _read_surface(network, UsdShade.Material(stage.GetPrimAtPath(path)))
    if path is None or network.faults:
        raise LookError(network.faults)
    return Look(name or path.name, layers, f"{network.file}<{path}>")


def find_material(network: Network, stage: Usd.Stage, prim: str | None, variants: Mapping[str, str]) -> Sdf.Path | None:
    """Select the variants and return the material's path; None, and a fault, where there is none."""
    if prim is None:
        path = _only_material(network, stage)
        if path is None:
            return None
    elif prim.startswith("/") and Sdf.Path.IsValidPathString(prim) and Sdf.Path(prim).IsPrimPath():
        path = Sdf.Path(prim)
    else:
        network.fault(prim, "is not a prim path", "for instance '/Paint'")
        return None
    _select_variants(network, stage, path, variants)
    found = stage.GetPrimAtPath(path)
    if found and found.IsA(UsdShade.Material):
        return path
    known = [str(material) for material in materials(stage)]
    hint = nearest_hint(str(path), known) if known else "the file holds no material"
    network.fault(path, "is not a material" if found else "no such prim", hint)
    return None


def _only_material(network: Network, stage: Usd.Stage) -> Sdf.Path | None:
    default = stage.GetDefaultPrim()
    if default and default.IsA(UsdShade.Material):
        return default.GetPath()
    found = materials(stage)
    if len(found) == 1:
        return found[0]
    if default and default.IsA(UsdShade.Shader) and not found:
        hint = f"make a look of it: lookdev materials new LOOK.usda {stage.GetRootLayer().realPath}"
        network.fault(default.GetPath(), "is a preset: a layer, not a material", hint)
        return None
    known = f"name one with prim: {', '.join(map(str, found[:8]))}{', ...' * (len(found) > 8)}" if found else ""
    network.fault("", f"holds {len(found)} materials and none is the default prim", known)
    return None


def _select_variants(network: Network, stage: Usd.Stage, path: Sdf.Path, variants: Mapping[str, str]) -> None:
    """Select variants on the session layer, for the nearest prim at or above `path` that has the set.

    A variant may bring further sets into being, so what is not there yet is tried again after each selection.
    """
    pending = dict(variants)
    known: dict[str, Usd.VariantSet] = {}
    while pending:
        known = {}
        for prefix in path.GetPrefixes():  # outermost first: the nearest prim's set wins
            if prim := stage.GetPrimAtPath(prefix):
                known.update({name: prim.GetVariantSet(name) for name in prim.GetVariantSets().GetNames()})
        if not (ready := pending.keys() & known.keys()):
            break
        name = min(ready)
        choice, choices = pending.pop(name), known[name].GetVariantNames()
        if choice not in choices:
            network.fault(path, f"variant set '{name}' has no variant '{choice}'", nearest_hint(choice, choices))
            continue
        with Usd.EditContext(stage, stage.GetSessionLayer()):
            known[name].SetVariantSelection(choice)
    for name in pending:
        hint = nearest_hint(name, sorted(known)) if known else "it has none"
        network.fault(path, f"has no variant set '{name}'", hint)


def _layers() -> str:
    return " or ".join(layer_shaders())


def _read_surface(network: Network, material: UsdShade.Material) -> tuple[Layer, ...]:
    place = material.GetPath().AppendProperty(_TERMINAL)
    attribute = material.GetPrim().GetAttribute(_TERMINAL)
    source = network.follow(attribute) if attribute else None
    if isinstance(source, Source):
        if shader_id(source.shader) == "LookdevLayers":
            return _read_stack(network, source.shader)
        layer = _read_layer(network, attribute, source, 1.0, "over", ("LookdevLayers", *layer_shaders()))
        return (layer,) if layer else ()
    if not attribute or source is not None:
        network.fault(place, "is not connected", f"connect it to a LookdevLayers, {_layers()} shader")
    return ()


def _read_stack(network: Network, stack: UsdShade.Shader) -> tuple[Layer, ...]:
    """Read the layers of a LookdevLayers shader, base first, without those that are not enabled."""
    given: dict[str, Usd.Attribute] = {}
    if (count := authored_properties(stack.GetPrim())) > MOST_PROPERTIES:
        network.fault(stack.GetPath(), f"has {count} properties", f"at most {MOST_PROPERTIES} would be right")
        return ()
    for each in stack.GetInputs():
        name, attribute = each.GetBaseName(), each.GetAttr()
        if name != "base" and not _LAYER_INPUT.fullmatch(name):
            network.fault(
                attribute,
                "unknown input",
                nearest_hint(name, ["base", "layer1", "layer1Mask", "layer1Enabled", "layer1Mode"]),
            )
        elif attribute.HasAuthoredConnections() or attribute.HasAuthoredValue():
            given[name] = attribute
    # Each layer beside the input it is connected to, which is the place to tell of it.
    layers: list[tuple[Usd.Attribute, Layer]] = []

    def add(attribute: Usd.Attribute, mask: Mask, mode: Mode) -> None:
        if layer := _read_connected_layer(network, attribute, mask, mode):
            layers.append((attribute, layer))

    if "base" in given:
        add(given["base"], 1.0, "over")
    else:
        network.fault(f"{stack.GetPath()}.inputs:base", "the stack has no base", "connect it to a layer")
    numbers = sorted({int(match[1]) for name in given if (match := _LAYER_INPUT.fullmatch(name))})
    for number in numbers:
        layer = f"layer{number}"
        if layer not in given:
            network.fault(f"{stack.GetPath()}.inputs:{layer}", "is not connected, but more is said of it")
        elif number > 1 and number - 1 not in numbers:
            network.fault(given[layer], f"there is no layer{number - 1}", "number the layers without gaps")
        if _is_enabled(network, given.get(f"{layer}Enabled")):
            mode = _read_mode(network, given.get(f"{layer}Mode"))
            mask = _read_mask(network, given.get(f"{layer}Mask"))
            if layer in given:
                add(given[layer], mask, mode)
    _check_stack(network, layers)
    return tuple(layer for _, layer in layers)


def _is_enabled(network: Network, attribute: Usd.Attribute | None) -> bool:
    return attribute is None or network.constant(attribute, Sdf.ValueTypeNames.Bool) is not False


def _read_mode(network: Network, attribute: Usd.Attribute | None) -> Mode:
    given = None if attribute is None else network.constant(attribute, Sdf.ValueTypeNames.Token)
    if given is not None and given not in _MODES:
        network.fault(attribute, f"unknown value '{given}'", nearest_hint(given, _MODES))
    return "transmit" if given == "transmit" else "over"


def _check_stack(network: Network, layers: list[tuple[Usd.Attribute, Layer]]) -> None:
    """Note layers that cannot lie on those beneath.

    Layers fold into one model as long as all are of the base's; from the first that differs on, each stands alone.
    """
    for number, (place, layer) in enumerate(layers):
        beneath = [each for _, each in layers[:number]]
        wrong = stranger(layer.mode, [each.model for each in (*beneath, layer)])
        if wrong is not None:
            takers = " or ".join(model.identifier for model in MODELS.values() if layer.mode in model.modes)
            other = layers[wrong][1]
            network.fault(
                f"{place.GetPath()}Mode",
                f"cannot be '{layer.mode}': {other.name} is a {other.model} layer",
                f"only a {takers} layer over nothing but {takers} layers can {layer.mode}; use 'over'",
            )
        if number and all(each.model == layer.model for each in beneath):
            _check_tokens(network, place, layer, beneath[0])


def _check_tokens(network: Network, place: Usd.Attribute, layer: Layer, base: Layer) -> None:
    for name, parameter in MODELS[layer.model].parameters.items():
        own, others = (each.inputs.get(name, parameter.default) for each in (layer, base))
        if parameter.kind == "token" and own != others:
            network.fault(
                place,
                f"{name} of {layer.name} is '{own}', but that of {base.name} beneath is '{others}'",
                "layers of one model on each other must agree",
            )


def _read_mask(network: Network, attribute: Usd.Attribute | None) -> Mask:
    mask = None if attribute is None else read_input(network, attribute, MASK)
    return mask if isinstance(mask, float | Texture | Primvar | Formula) else 1.0


def _read_connected_layer(network: Network, attribute: Usd.Attribute, mask: Mask, mode: Mode) -> Layer | None:
    source = network.follow(attribute)
    if isinstance(source, Source):
        return _read_layer(network, attribute, source, mask, mode, tuple(layer_shaders()))
    if source is not None:
        network.fault(attribute, "is not connected to a layer", f"connect it to a {_layers()} shader")
    return None


def _read_layer(
    network: Network, place: Usd.Attribute, source: Source, mask: Mask, mode: Mode, known: tuple[str, ...]
) -> Layer | None:
    model = layer_shaders().get(given := shader_id(source.shader))
    if model is None:
        network.fault(place, f"<{source.path}> has the unknown info:id '{given}'", nearest_hint(given, known))
        return None
    parameters = MODELS[model].parameters
    network.check_inputs(source.shader, list(parameters))
    inputs: dict[str, Input] = {}
    for each in source.shader.GetInputs():
        if parameter := parameters.get(each.GetBaseName()):
            value = read_input(network, each.GetAttr(), parameter)
            if value is not None:
                inputs[parameter.name] = value
    return Layer(source.shader.GetPrim().GetName(), model, inputs, mask, mode)
