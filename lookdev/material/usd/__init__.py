"""Looks from USD: a UsdShade.Material whose outputs:lookdev:surface is a stack of layers; its displacement.

USD composes (references, variants, sublayers, inherits); the composed network is read here. A lookdev shader has one
result, so the name of the output that is connected does not matter.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

from pxr import Sdf, Usd, UsdShade

from lookdev.brdf import MASK, MODELS, Mode, layer_shaders, stranger
from lookdev.brdf.parameters import spelled_out
from lookdev.errors import Fault, LookError, ModelError, nearest_hint
from lookdev.material.look import Formula, Input, Layer, Look, Mask, Primvar, Texture
from lookdev.material.usd.displacement import read_displacement
from lookdev.material.usd.inputs import read_input
from lookdev.material.usd.network import LAYER_INPUT, TERMINAL, Network, Source, authored_properties, is_set, shader_id
from lookdev.material.variants import combinations
from lookdev.stage import lights_hint, open_stage, reading, usd_words

_MOST_PROPERTIES = 4096  # of a LookdevLayers: a thousand layers
MODES: tuple[Mode, ...] = ("over", "transmit")
"""How a stack can say that a layer lies."""


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
        The name of the look; the material's by default.
    open_images
        Whether the header of every image is read. Otherwise an unreadable one is an error when it is needed.

    Raises
    ------
    LookError
        Every fault of the look, each with its place.
    """
    stage = open_stage(file)
    network = Network(file, open_images)
    with reading(file):
        path = find_material(network, stage, prim, variants or {})
        return read_found(network, stage, path, name)


def read_material(file: Path, stage: Usd.Stage, path: Sdf.Path) -> Look:
    """Read the look of a material of an open stage, as it is composed there; errors as `read_look`, of `file`."""
    with reading(file):
        return read_found(Network(file), stage, path, None)


def layer_faults(file: Path, layer: UsdShade.Shader) -> tuple[Fault, ...]:
    """Return the faults of a layer without a look, such as a preset, as faults of `file`."""
    network = Network(file)
    with reading(file):
        _read_layer(network, layer.GetIdAttr(), Source(layer, "layer"), 1.0, "over", tuple(layer_shaders()))
    return network.faults


def materials(stage: Usd.Stage) -> list[Sdf.Path]:
    """Return the paths of all materials of a stage."""
    return [prim.GetPath() for prim in stage.Traverse() if prim.IsA(UsdShade.Material)]


def expand_variants(file: Path, prim: str | None, variants: Mapping[str, str]) -> tuple[dict[str, str], ...]:
    """Replace each ``"*"`` by every variant of its set, by name: all combinations; errors as `read_look`."""
    return combinations(variants, lambda chosen, wanted: _choices(file, prim, chosen, wanted), str(file), prim or "")


def _choices(file: Path, prim: str | None, chosen: Mapping[str, str], wanted: str) -> list[str]:
    network, stage = Network(file), open_stage(file)
    path = find_material(network, stage, prim, {name: choice for name, choice in chosen.items() if choice != "*"})
    known = {} if path is None else variant_sets(stage, path)
    if path is not None and wanted not in known:
        _fault_of_set(network, path, wanted, known)
    if network.faults:
        raise LookError(network.faults)
    return list(known[wanted].GetVariantNames())


def variant_sets(stage: Usd.Stage, path: Sdf.Path) -> dict[str, Usd.VariantSet]:
    """Return the variant sets, by name, of the prims at and above a path; of one name the nearest prim's."""
    prims = [prim for prefix in path.GetPrefixes() if (prim := stage.GetPrimAtPath(prefix))]
    return {name: prim.GetVariantSet(name) for prim in prims for name in prim.GetVariantSets().GetNames()}


def _fault_of_set(network: Network, path: Sdf.Path, name: str, known: Collection[str]) -> None:
    hint = nearest_hint(name, sorted(known)) if known else "it has none"
    network.fault(path, f"has no variant set '{name}'", hint)


def has_look(file: Path, prim: str) -> bool:
    """Return whether `prim` is a material with a connected outputs:lookdev:surface; errors as `open_stage`."""
    stage = open_stage(file)
    material = UsdShade.Material(stage.GetPrimAtPath(prim))
    return bool(material) and bool(material.GetPrim().GetAttribute(TERMINAL).HasAuthoredConnections())


def read_found(network: Network, stage: Usd.Stage, path: Sdf.Path | None, name: str | None) -> Look:
    """Read the look at the path that `find_material` has returned; raises LookError with all faults of the network."""
    check_composition(network, stage, path)
    if path is None:
        raise LookError(network.faults)
    material = UsdShade.Material(stage.GetPrimAtPath(path))
    layers, displacement = _read_surface(network, material), read_displacement(network, material)
    if network.faults:
        raise LookError(network.faults)
    return Look(name or path.name, layers, f"{network.file}<{path}>", displacement)


def check_composition(network: Network, stage: Usd.Stage, path: Sdf.Path | None) -> None:
    """Note errors of the composition, above, at and below a path where one is given."""
    for error in stage.GetCompositionErrors():
        site = error.rootSite.path
        # The site is empty for a path that is an expression which USD cannot evaluate.
        if path is None or not site or path.HasPrefix(site) or site.HasPrefix(path):
            network.fault(site, usd_words(str(error)))


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
    known = known or lights_hint(stage)
    what = f"holds {len(found)} materials and none is the default prim" if found else "holds no material"
    network.fault("", what, known)
    return None


def _select_variants(network: Network, stage: Usd.Stage, path: Sdf.Path, variants: Mapping[str, str]) -> None:
    """Select variants on the session layer; a variant may add sets, which are selected after it."""
    pending = dict(variants)
    while ready := pending.keys() & (known := variant_sets(stage, path)).keys():
        name = min(ready)
        choice, choices = pending.pop(name), known[name].GetVariantNames()
        if choice not in choices:
            network.fault(path, f"variant set '{name}' has no variant '{choice}'", nearest_hint(choice, choices))
            continue
        with Usd.EditContext(stage, stage.GetSessionLayer()):
            known[name].SetVariantSelection(choice)
    for name in pending:
        _fault_of_set(network, path, name, known)


def _layers() -> str:
    return " or ".join(layer_shaders())


def _read_surface(network: Network, material: UsdShade.Material) -> tuple[Layer, ...]:
    place = material.GetPath().AppendProperty(TERMINAL)
    attribute = material.GetPrim().GetAttribute(TERMINAL)
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
    if (count := authored_properties(stack.GetPrim())) > _MOST_PROPERTIES:
        network.fault(stack.GetPath(), f"has {count} properties", f"at most {_MOST_PROPERTIES} would be right")
        return ()
    for each in stack.GetInputs():
        name, attribute = each.GetBaseName(), each.GetAttr()
        if name != "base" and not LAYER_INPUT.fullmatch(name):
            known = ["base", "layer1", "layer1Mask", "layer1Enabled", "layer1Mode"]
            network.fault(attribute, "unknown input", nearest_hint(name, known))
        elif is_set(attribute):
            given[name] = attribute
    # Each layer beside the input it is connected to, the place of its faults.
    layers: list[tuple[Usd.Attribute, Layer]] = []

    def add(attribute: Usd.Attribute, mask: Mask, mode: Mode) -> None:
        if layer := _read_connected_layer(network, attribute, mask, mode):
            layers.append((attribute, layer))

    if "base" in given:
        add(given["base"], 1.0, "over")
    else:
        network.fault(f"{stack.GetPath()}.inputs:base", "the stack has no base", "connect it to a layer")
    numbers = sorted({int(match[1]) for name in given if (match := LAYER_INPUT.fullmatch(name))})
    for number in numbers:
        layer = f"layer{number}"
        if layer not in given:
            network.fault(f"{stack.GetPath()}.inputs:{layer}", "is not connected, but has a mask, a mode or a switch")
        elif number > 1 and number - 1 not in numbers:
            network.fault(given[layer], f"there is no layer{number - 1}", "number the layers without gaps")
        enabled = given.get(f"{layer}Enabled")
        if enabled is None or network.constant(enabled, Sdf.ValueTypeNames.Bool) is not False:
            mode = _read_mode(network, given.get(f"{layer}Mode"))
            mask = _read_mask(network, given.get(f"{layer}Mask"))
            if layer in given:
                add(given[layer], mask, mode)
    _check_stack(network, layers)
    return tuple(layer for _, layer in layers)


def _read_mode(network: Network, attribute: Usd.Attribute | None) -> Mode:
    given = None if attribute is None else network.constant(attribute, Sdf.ValueTypeNames.Token)
    if given is not None and given not in MODES:
        network.fault(attribute, f"unknown value '{given}'", nearest_hint(given, MODES))
    return "transmit" if given == "transmit" else "over"


def _check_stack(network: Network, layers: list[tuple[Usd.Attribute, Layer]]) -> None:
    """Note layers that cannot lie on those beneath; tokens must agree as far as one model combines the layers."""
    for number, (place, layer) in enumerate(layers):
        beneath = [each for _, each in layers[:number]]
        wrong = stranger(layer.mode, [each.model for each in (*beneath, layer)])
        if wrong is not None:
            takers = " or ".join(model.identifier for model in MODELS.values() if layer.mode in model.modes)
            what = f"cannot be '{layer.mode}': {layers[wrong][1].name} is a {layers[wrong][1].model} layer"
            hint = f"only a {takers} layer over nothing but {takers} layers can {layer.mode}; use 'over'"
            network.fault(f"{place.GetPath()}Mode", what, hint)
        if number and all(each.model == layer.model for each in beneath):
            _check_tokens(network, place, layer, beneath[0])


def _check_tokens(network: Network, place: Usd.Attribute, layer: Layer, base: Layer) -> None:
    for name, parameter in MODELS[layer.model].parameters.items():
        own, others = (each.inputs.get(name, parameter.default) for each in (layer, base))
        if parameter.kind == "token" and parameter.among == "alike" and own != others:
            what = f"{name} of {layer.name} is '{own}', but that of {base.name} beneath is '{others}'"
            network.fault(place, what, "layers of one model on each other must agree")


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
    if source.output != "layer":
        network.fault(place, f"cannot use <{source.path}.outputs:{source.output}>", "use outputs:layer")
    parameters = MODELS[model].parameters
    network.check_inputs(source.shader, list(parameters))
    inputs: dict[str, Input] = {}
    for each in source.shader.GetInputs():
        if parameter := parameters.get(each.GetBaseName()):
            value = read_input(network, each.GetAttr(), parameter)
            if value is not None:
                inputs[parameter.name] = value
    try:
        spelled_out(model, parameters, inputs)
    except ModelError as error:
        network.fault(source.path, str(error))
    for parameter in parameters.values():
        name = f"inputs:{parameter.name}"
        if parameter.file and not source.shader.GetPrim().HasAttribute(name):
            network.fault(f"{source.path}.{name}", "names no file", parameter.help)
    return Layer(source.shader.GetPrim().GetName(), model, inputs, mask, mode)
