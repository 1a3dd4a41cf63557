"""Reads looks from USD: materials whose `outputs:lookdev:surface` is connected to a stack of layers or to one layer.

USD composes references, variants, sublayers and inherits. This module reads the composed network of shaders, and finds
all faults of a look before it raises them in one error. Materials of other shading models are read by
`lookdev.material.usd.bound`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from math import inf
from pathlib import Path
from typing import TypeAlias

from pxr import Sdf, Usd, UsdShade

from lookdev.brdf import MASK, MODELS, Mode, Parameter, find_mode_conflict, layer_shaders
from lookdev.brdf.parameters import expand_tokens
from lookdev.errors import Fault, LookError, ModelError, nearest_hint
from lookdev.material import UNITS, Displacement, Input, Layer, Look, Mask, depends_on_view
from lookdev.material.usd.inputs import read_input
from lookdev.material.usd.network import (
    LAYER_INPUT,
    TERMINAL,
    Network,
    OutputSource,
    authored_property_count,
    is_authored,
    shader_id,
)
from lookdev.material.variants import expand_wildcards
from lookdev.stage import clean_usd_message, lights_hint, open_stage, usd_errors_as_faults

VariantChoice: TypeAlias = Mapping[str, str] | None
"""The variants to select, by set: sets of a material or of prims above it. Other sets keep the file's selections."""

_MAX_PROPERTIES = 4096  # of a LookdevLayers shader: enough for a thousand layers
_DISPLACEMENT = "outputs:lookdev:displacement"
# The height of a displacement as a parameter: a float without limits.
_HEIGHT = Parameter("height", "float", 0.0, (-inf, inf), (-inf, inf))
_DISPLACEMENT_INPUTS = ("height", "scale", "midlevel", "units")
MODES: tuple[Mode, ...] = ("over", "transmit")
"""The modes that a layer of a stack in USD can have; see `lookdev.material.Layer`."""


def read_look(
    file: Path,
    prim: str | None = None,
    variants: VariantChoice = None,
    name: str | None = None,
    *,
    open_images: bool = True,
) -> Look:
    """Read a look from a file.

    Parameters
    ----------
    file
        A file that USD opens.
    prim
        The path of the material. By default, it is the file's default prim if that is a material, else the only
        material of the file.
    variants
        The variants to select, by set. Other sets keep the file's selections.
    name
        The name of the look, by default the name of the material.
    open_images
        Whether to read the header of every image now. Otherwise, an unreadable image is an error only when it is
        needed.

    Raises
    ------
    LookError
        The look has faults. The error lists all of them, each with the path of its prim or property.
    """
    stage = open_stage(file)
    network = Network(file, open_images)
    with usd_errors_as_faults(file):
        path = find_material(network, stage, prim, variants or {})
        return read_look_at(network, stage, path, name)


def read_material(file: Path, stage: Usd.Stage, path: Sdf.Path) -> Look:
    """Read the look of a material of an open stage; raises as `read_look`, with `file` as the file of the faults."""
    with usd_errors_as_faults(file):
        return read_look_at(Network(file), stage, path, None)


def layer_faults(file: Path, layer: UsdShade.Shader) -> tuple[Fault, ...]:
    """Return the faults of a layer's shader in `file`, where the layer is not part of a look, such as a preset."""
    network = Network(file)
    with usd_errors_as_faults(file):
        _read_layer(network, layer.GetIdAttr(), OutputSource(layer, "layer"), 1.0, "over")
    return network.faults


@contextmanager
def open_material(file: Path, prim: str | None, variants: VariantChoice = None) -> Iterator[UsdShade.Material]:
    """Within this context, open a file and select variants; yield the material.

    `prim` is as in `read_look`. Raises LookError where there is no such material or variant, or USD reports errors.
    """
    stage, network = open_stage(file), Network(file)
    with usd_errors_as_faults(file):
        path = find_material(network, stage, prim, variants or {})
        if path is None:
            raise LookError(network.faults)
        yield UsdShade.Material(stage.GetPrimAtPath(path))


def material_paths(stage: Usd.Stage) -> list[Sdf.Path]:
    """Return the paths of all materials of a stage."""
    return [prim.GetPath() for prim in stage.Traverse() if prim.IsA(UsdShade.Material)]


def expand_variants(file: Path, prim: str | None, variants: Mapping[str, str]) -> tuple[dict[str, str], ...]:
    """Return all selections that result if each ``"*"`` is replaced by a variant of its set; raises as `read_look`."""
    return expand_wildcards(variants, partial(_variant_names, file, prim), str(file), prim or "")


def _variant_names(file: Path, prim: str | None, selection: Mapping[str, str], set_name: str) -> list[str]:
    """Return the variants that a set has while `selection` is selected; a ``"*"`` in it selects no variant."""
    network, stage = Network(file), open_stage(file)
    path = find_material(network, stage, prim, {name: choice for name, choice in selection.items() if choice != "*"})
    sets = {} if path is None else variant_sets(stage, path)
    if path is not None and set_name not in sets:
        _add_unknown_set_fault(network, path, set_name, sets)
    if network.faults:
        raise LookError(network.faults)
    return list(sets[set_name].GetVariantNames())


def variant_sets(stage: Usd.Stage, path: Sdf.Path) -> dict[str, Usd.VariantSet]:
    """Return the variant sets, by name, of the prim at a path and of all prims above it.

    Where several prims have a set of the same name, the set of the lowest prim is returned.
    """
    prims = [prim for prefix in path.GetPrefixes() if (prim := stage.GetPrimAtPath(prefix))]
    return {name: prim.GetVariantSet(name) for prim in prims for name in prim.GetVariantSets().GetNames()}


def _add_unknown_set_fault(network: Network, path: Sdf.Path, name: str, set_names: Collection[str]) -> None:
    """Add the fault that the material at a path has no variant set `name`, but the sets `set_names`."""
    hint = nearest_hint(name, sorted(set_names)) if set_names else "it has none"
    network.add_fault(path, f"has no variant set '{name}'", hint)


def read_look_at(network: Network, stage: Usd.Stage, path: Sdf.Path | None, name: str | None) -> Look:
    """Read the look of the material at `path`, the result of `find_material`.

    `name` is the name of the look, by default the material's. Raises LookError with all faults of the network, also
    where `path` is None.
    """
    check_composition(network, stage, path)
    if path is None:
        raise LookError(network.faults)
    material = UsdShade.Material(stage.GetPrimAtPath(path))
    layers, displacement = _read_surface(network, material), _read_displacement(network, material)
    if network.faults:
        raise LookError(network.faults)
    return Look(name or path.name, layers, f"{network.file}<{path}>", displacement)


def check_composition(network: Network, stage: Usd.Stage, path: Sdf.Path | None) -> None:
    """Add USD's composition errors as faults: errors at prims above, at and below `path`, or all if `path` is None."""
    for error in stage.GetCompositionErrors():
        site = error.rootSite.path
        # USD states no site for an asset path with a variable expression that it cannot evaluate.
        if path is None or not site or path.HasPrefix(site) or site.HasPrefix(path):
            network.add_fault(site, clean_usd_message(str(error)))


def find_material(network: Network, stage: Usd.Stage, prim: str | None, variants: Mapping[str, str]) -> Sdf.Path | None:
    """Select the variants, and return the path of the material `prim`, by default the file's default or only material.

    Returns None, with a fault added, where there is no such material.
    """
    if prim is None:
        path = _only_material(network, stage)
        if path is None:
            return None
    elif prim.startswith("/") and Sdf.Path.IsValidPathString(prim) and Sdf.Path(prim).IsPrimPath():
        path = Sdf.Path(prim)
    else:
        network.add_fault(prim, "is not a prim path", "for instance '/Paint'")
        return None
    _select_variants(network, stage, path, variants)
    material = stage.GetPrimAtPath(path)
    if material and material.IsA(UsdShade.Material):
        return path
    paths = [str(path) for path in material_paths(stage)]
    hint = nearest_hint(str(path), paths) if paths else "the file holds no material"
    network.add_fault(path, "is not a material" if material else "no such prim", hint)
    return None


def _only_material(network: Network, stage: Usd.Stage) -> Sdf.Path | None:
    """Return the path of the default prim if it is a material, else of the only material; else add a fault."""
    default = stage.GetDefaultPrim()
    if default and default.IsA(UsdShade.Material):
        return default.GetPath()
    paths = material_paths(stage)
    if len(paths) == 1:
        return paths[0]
    if default and default.IsA(UsdShade.Shader) and not paths:
        hint = f"make a look of it: lookdev materials new LOOK.usda {stage.GetRootLayer().realPath}"
        network.add_fault(default.GetPath(), "is a preset: a layer, not a material", hint)
        return None
    hint = f"name one with prim: {', '.join(map(str, paths[:8]))}{', ...' * (len(paths) > 8)}" if paths else ""
    hint = hint or lights_hint(stage)
    message = f"holds {len(paths)} materials and none is the default prim" if paths else "holds no material"
    network.add_fault("", message, hint)
    return None


def _select_variants(network: Network, stage: Usd.Stage, path: Sdf.Path, variants: Mapping[str, str]) -> None:
    """Select variants on the session layer; add a fault for each set or variant that does not exist."""
    # A set inside a variant exists only while this variant is selected. Sets that exist are therefore selected first.
    pending = dict(variants)
    while ready := pending.keys() & (sets := variant_sets(stage, path)).keys():
        name = min(ready)
        choice, choices = pending.pop(name), sets[name].GetVariantNames()
        if choice not in choices:
            network.add_fault(path, f"variant set '{name}' has no variant '{choice}'", nearest_hint(choice, choices))
            continue
        with Usd.EditContext(stage, stage.GetSessionLayer()):
            sets[name].SetVariantSelection(choice)
    for name in pending:
        _add_unknown_set_fault(network, path, name, sets)


def _layer_shader_names() -> str:
    """Return the identifiers of the shaders of layers as text for a hint."""
    return " or ".join(layer_shaders())


def _read_surface(network: Network, material: UsdShade.Material) -> tuple[Layer, ...]:
    """Return the layers of a material, base first. Layers with faults may be missing; their faults are added."""
    terminal = material.GetPath().AppendProperty(TERMINAL)
    attribute = material.GetPrim().GetAttribute(TERMINAL)
    source = network.follow(attribute) if attribute else None
    if isinstance(source, OutputSource):
        # A LookdevLayers has a single output, so its name does not matter.
        if shader_id(source.shader) == "LookdevLayers":
            return _read_stack(network, source.shader)
        layer = _read_layer(network, attribute, source, 1.0, "over", ("LookdevLayers",))
        return (layer,) if layer else ()
    if not attribute or source is not None:
        hint = f"connect it to a LookdevLayers, {_layer_shader_names()} shader"
        network.add_fault(terminal, "is not connected", hint)
    return ()


def _read_stack(network: Network, stack: UsdShade.Shader) -> tuple[Layer, ...]:
    """Read the enabled layers of a LookdevLayers shader, base first."""
    attributes: dict[str, Usd.Attribute] = {}
    if (count := authored_property_count(stack.GetPrim())) > _MAX_PROPERTIES:
        network.add_fault(stack.GetPath(), f"has {count} properties", f"at most {_MAX_PROPERTIES} would be right")
        return ()
    for stack_input in stack.GetInputs():
        name, attribute = stack_input.GetBaseName(), stack_input.GetAttr()
        if name != "base" and not LAYER_INPUT.fullmatch(name):
            valid_names = ["base", "layer1", "layer1Mask", "layer1Enabled", "layer1Mode"]
            network.add_fault(attribute, "unknown input", nearest_hint(name, valid_names))
        elif is_authored(attribute):
            attributes[name] = attribute
    # Pairs of an input of the stack and the layer that is connected to it: faults of the layer name the input.
    layers: list[tuple[Usd.Attribute, Layer]] = []

    def add(attribute: Usd.Attribute, mask: Mask, mode: Mode) -> None:
        if layer := _read_connected_layer(network, attribute, mask, mode):
            layers.append((attribute, layer))

    if "base" in attributes:
        add(attributes["base"], 1.0, "over")
    else:
        network.add_fault(f"{stack.GetPath()}.inputs:base", "the stack has no base", "connect it to a layer")
    numbers = sorted({int(match[1]) for name in attributes if (match := LAYER_INPUT.fullmatch(name))})
    for number in numbers:
        layer = f"layer{number}"
        if layer not in attributes:
            where = f"{stack.GetPath()}.inputs:{layer}"
            network.add_fault(where, "is not connected, but has a mask, a mode or a switch")
        elif number > 1 and number - 1 not in numbers:
            network.add_fault(attributes[layer], f"there is no layer{number - 1}", "number the layers without gaps")
        if network.read_constant(attributes.get(f"{layer}Enabled"), Sdf.ValueTypeNames.Bool) is not False:
            mode = network.read_choice(attributes.get(f"{layer}Mode"), MODES)
            mask = _read_mask(network, attributes.get(f"{layer}Mask"))
            if layer in attributes:
                add(attributes[layer], mask, mode)
    _check_stack(network, layers)
    return tuple(layer for _, layer in layers)


def _check_stack(network: Network, layers: list[tuple[Usd.Attribute, Layer]]) -> None:
    """Add the faults of layers that cannot be combined.

    A mode may be impossible over the layers beneath, or layers of one model may differ in a token that they must share.
    """
    for number, (attribute, layer) in enumerate(layers):
        beneath = [layer_below for _, layer_below in layers[:number]]
        conflict = find_mode_conflict(layer.mode, [stack_layer.model for stack_layer in (*beneath, layer)])
        if conflict is not None:
            models = " or ".join(model.identifier for model in MODELS.values() if layer.mode in model.modes)
            message = f"cannot be '{layer.mode}': {layers[conflict][1].name} is a {layers[conflict][1].model} layer"
            hint = f"only a {models} layer over nothing but {models} layers can {layer.mode}; use 'over'"
            network.add_fault(f"{attribute.GetPath()}Mode", message, hint)
        if number and all(layer_below.model == layer.model for layer_below in beneath):
            _check_tokens(network, attribute, layer, beneath[0])


def _check_tokens(network: Network, attribute: Usd.Attribute, layer: Layer, base: Layer) -> None:
    """Add a fault for each token in which a layer must agree with the base, of the same model, but differs."""
    for name, parameter in MODELS[layer.model].parameters.items():
        token, base_token = (stack_layer.inputs.get(name, parameter.default) for stack_layer in (layer, base))
        if parameter.kind == "token" and parameter.agreement == "alike" and token != base_token:
            message = f"{name} of {layer.name} is '{token}', but that of {base.name} beneath is '{base_token}'"
            network.add_fault(attribute, message, "layers of one model on each other must agree")


def _read_mask(network: Network, attribute: Usd.Attribute | None) -> Mask:
    """Return the mask of a layer, 1 where it is unset or wrong."""
    mask = None if attribute is None else read_input(network, attribute, MASK)
    return mask if isinstance(mask, Mask) else 1.0


def _read_connected_layer(network: Network, attribute: Usd.Attribute, mask: Mask, mode: Mode) -> Layer | None:
    """Return the layer to which an input of the stack is connected; None, with a fault added, where there is none."""
    source = network.follow(attribute)
    if isinstance(source, OutputSource):
        return _read_layer(network, attribute, source, mask, mode)
    if source is not None:
        network.add_fault(attribute, "is not connected to a layer", f"connect it to a {_layer_shader_names()} shader")
    return None


def _read_layer(
    network: Network,
    attribute: Usd.Attribute,
    source: OutputSource,
    mask: Mask,
    mode: Mode,
    others: tuple[str, ...] = (),
) -> Layer | None:
    """Read the layer of the shader `source`; None, with a fault added, where it is not the shader of a layer.

    `attribute` is the input or output that is connected to `source`. `others` are identifiers of shaders, other than
    those of layers, to which `attribute` may be connected, for the hint of the fault.
    """
    model = layer_shaders().get(identifier := shader_id(source.shader))
    if model is None:
        message = f"<{source.path}> has the unknown info:id '{identifier}'"
        network.add_fault(attribute, message, nearest_hint(identifier, [*others, *layer_shaders()]))
        return None
    if source.output != "layer":
        network.add_fault(attribute, f"cannot use <{source.path}.outputs:{source.output}>", "use outputs:layer")
    parameters = MODELS[model].parameters
    network.check_inputs(source.shader, list(parameters))
    inputs: dict[str, Input] = {}
    for shader_input in source.shader.GetInputs():
        if parameter := parameters.get(shader_input.GetBaseName()):
            value = read_input(network, shader_input.GetAttr(), parameter)
            if value is not None:
                inputs[parameter.name] = value
    try:
        expand_tokens(model, parameters, inputs)
    except ModelError as error:
        network.add_fault(source.path, str(error))
    for parameter in parameters.values():
        name = f"inputs:{parameter.name}"
        if parameter.file and not source.shader.GetPrim().HasAttribute(name):
            network.add_fault(f"{source.path}.{name}", "names no file", parameter.help)
    return Layer(source.shader.GetPrim().GetName(), model, inputs, mask, mode)


def _read_displacement(network: Network, material: UsdShade.Material) -> Displacement | None:
    """Return the displacement of a material; None where there is none or, with a fault added, where it is wrong."""
    terminal = material.GetPrim().GetAttribute(_DISPLACEMENT)
    if not terminal:
        return None
    source = network.follow(terminal)
    if not isinstance(source, OutputSource):
        if source is not None:
            network.add_fault(terminal, "is not connected", "connect it to a LookdevDisplacement shader")
        return None
    if (identifier := shader_id(source.shader)) != "LookdevDisplacement":
        message = f"<{source.path}> has the unknown info:id '{identifier}'"
        network.add_fault(terminal, message, nearest_hint(identifier, ["LookdevDisplacement"]))
        return None
    network.check_inputs(source.shader, _DISPLACEMENT_INPUTS)
    inputs = {name: source.shader.GetPrim().GetAttribute(f"inputs:{name}") for name in _DISPLACEMENT_INPUTS}
    fault_count = len(network.faults)
    height = read_input(network, inputs["height"], _HEIGHT) if inputs["height"] else None
    if height is None and len(network.faults) == fault_count:
        network.add_unset_fault(f"{source.path}.inputs:height")
    scale, midlevel = network.read_float(inputs["scale"], 1.0), network.read_float(inputs["midlevel"], 0.0)
    units = network.read_choice(inputs["units"], UNITS)
    if not isinstance(height, Mask):
        return None
    if depends_on_view(height):
        hint = "a surface has one shape for all views; parameters and masks can depend on the view"
        network.add_fault(f"{source.path}.inputs:height", "depends on the view", hint)
        return None
    return Displacement(height, scale, midlevel, units)
