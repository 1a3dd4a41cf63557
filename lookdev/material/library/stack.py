"""Reads and changes the layer stack of a look in USD: the LookdevLayers shader and its inputs, for the edits of looks.

The inputs of layer 2, for instance, are ``layer2``, which is connected to the shader of the layer, and ``layer2Mask``,
``layer2Enabled`` and ``layer2Mode``. The base is number 0 and has the input ``base`` only. The name of a layer is the
name of its shader prim.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pxr import Sdf, Usd, UsdShade

from lookdev.brdf import Mode, layer_shaders
from lookdev.errors import LookError, nearest_hint
from lookdev.material.library.nodes import find_sites, free_path, remove_prims
from lookdev.material.usd import VariantChoice, open_material
from lookdev.material.usd.network import LAYER_INPUT, TERMINAL, Network, OutputSource, shader_id

_TYPES = Sdf.ValueTypeNames
LAYER_PARTS = ("", "Mask", "Enabled", "Mode")
"""The parts of a layer: the ends of the names of its inputs. "" is the input that is connected to the layer."""


@dataclass(frozen=True)
class Stack:
    """The LookdevLayers shader of a look.

    `network` reads the inputs of the shader, and `prim` is the shader's prim. `base` is the name of the base layer, and
    `layers` has the names of the layers over it by number.
    """

    network: Network
    prim: Usd.Prim
    base: str
    layers: dict[int, str]

    @property
    def stage(self) -> Usd.Stage:
        """The stage of the shader."""
        return self.prim.GetStage()

    @property
    def scope(self) -> Sdf.Path:
        """The prim below which nodes of the layers are written: the parent of the stack."""
        return self.prim.GetPath().GetParentPath()

    def find(self, layer: str) -> tuple[int, str]:
        """Return the number and name of a layer over the base, given either of them; LookError where there is none."""
        if layer == "0" or layer.casefold() == self.base.casefold():
            raise self.make_error(f"'{layer}' is the base", "every stack has one, without a mask; choose another layer")
        numbers = [n for n, name in self.layers.items() if layer == str(n) or layer.casefold() == name.casefold()]
        if len(numbers) > 1:
            raise self.make_error(f"layers {', '.join(map(str, numbers))} are all '{layer}'", "give the number")
        if not numbers:
            valid_names = [label for number, name in self.layers.items() for label in (name, str(number))]
            hint = nearest_hint(layer, valid_names) if valid_names else "it has only a base"
            raise self.make_error(f"no layer '{layer}'", hint)
        return numbers[0], self.layers[numbers[0]]

    def make_error(self, message: str, hint: str) -> LookError:
        """Return an error at the prim of the stack."""
        return LookError.at(self.network.file, self.prim.GetPath(), message, hint)

    @staticmethod
    def input_name(number: int, part: str) -> str:
        """Return the name of the attribute for a part (see `LAYER_PARTS`) of a layer, or of the base, number 0."""
        return f"inputs:layer{number}{part}" if number else f"inputs:base{part}"

    def create_input(self, number: int, part: str, type_name: Sdf.ValueTypeName) -> Usd.Attribute:
        """Return the attribute for a part of a layer over the base, created if missing."""
        return UsdShade.Shader(self.prim).CreateInput(f"layer{number}{part}", type_name).GetAttr()

    def attribute(self, number: int, part: str) -> Usd.Attribute:
        """Return the attribute for a part of a layer, or of the base, number 0; it is invalid where there is none."""
        return self.prim.GetAttribute(self.input_name(number, part))

    def shader(self, number: int) -> UsdShade.Shader | None:
        """Return the shader of a layer, or of the base, number 0; None where none is connected."""
        source = self.network.follow(self.attribute(number, ""))
        return source.shader if isinstance(source, OutputSource) else None

    def is_enabled(self, number: int) -> bool:
        """Return whether a layer, or the base, is enabled."""
        return self.network.read_constant(self.attribute(number, "Enabled"), _TYPES.Bool) is not False

    def is_in_file(self, attribute: Usd.Attribute) -> bool:
        """Return whether only the edited file states an input, and not also a referenced prim or another file."""
        root = self.stage.GetRootLayer()
        return all(
            spec.layer == root and spec.path.StripAllVariantSelections() == attribute.GetPath()
            for spec in attribute.GetPropertyStack()
        )

    def remove_inputs(self, number: int) -> None:
        """Remove the inputs of a layer and renumber the layers over it, in every variant."""
        self.renumber({number: 0} | {other: other - 1 for other in self.layers if other > number})

    def renumber(self, order: Mapping[int, int]) -> None:
        """Give layers new numbers, in every variant: `order` maps old numbers to new ones.

        The inputs of a layer with the new number 0 are removed.
        """
        root = self.stage.GetRootLayer()
        for site in find_sites(root, self.prim.GetPath()):
            prim = root.GetPrimAtPath(site)
            matches = ((LAYER_INPUT.fullmatch(spec.name.removeprefix("inputs:")), spec) for spec in prim.properties)
            specs = [(int(match[1]), match[2] or "", spec) for match, spec in matches if match]
            renumbered = [(order[number], part, spec) for number, part, spec in specs if number in order]
            # Inputs first get temporary names, because the new names may still be in use.
            for number, part, spec in renumbered:
                if number:
                    spec.name = f"inputs:lookdevMoved{number}{part}"
                else:
                    prim.RemoveProperty(spec)
            for number, part, spec in renumbered:
                if number:
                    spec.name = self.input_name(number, part)
            if prim.isInert:
                remove_prims(root, [site])


@dataclass(frozen=True)
class LayerEntry:
    """A layer of a stack in a `LookOutline`: its number and name, whether it is enabled, and its mode."""

    number: int
    name: str
    enabled: bool = True
    mode: Mode = "over"


@dataclass(frozen=True)
class LookOutline:
    """All layers of a look, enabled or not, and the variant sets of its material.

    `entries` begin with the base. `variants` maps the name of a set to the pair (names of its variants, selected
    variant).
    """

    entries: tuple[LayerEntry, ...]
    variants: Mapping[str, tuple[tuple[str, ...], str]]


def read_outline(file: Path, prim: str | None = None, variants: VariantChoice = None) -> LookOutline:
    """Read a look's layers, without their inputs, and variant sets; raises LookError where the file is not a look."""
    with open_material(file, prim, variants) as material:
        variant_sets = material.GetPrim().GetVariantSets()
        sets: dict[str, tuple[tuple[str, ...], str]] = {}
        for name in variant_sets.GetNames():
            variant_set = variant_sets.GetVariantSet(name)
            sets[name] = tuple(variant_set.GetVariantNames()), variant_set.GetVariantSelection()
        stack = find_stack(material)
        if stack is None:
            return LookOutline((LayerEntry(0, require_surface(material).path.name),), sets)
        entries = [LayerEntry(0, stack.base)]
        for number, name in stack.layers.items():
            transmits = stack.network.read_constant(stack.attribute(number, "Mode"), _TYPES.Token) == "transmit"
            entries.append(LayerEntry(number, name, stack.is_enabled(number), "transmit" if transmits else "over"))
        return LookOutline(tuple(entries), sets)


def layer_shader(material: UsdShade.Material, layer: str) -> tuple[int, UsdShade.Shader]:
    """Return the number and shader of a layer by its number or name; it may be the base or the only layer.

    Raises LookError where there is no such layer.
    """
    surface = require_surface(material)
    stack = find_stack(material)
    is_base = layer == "0" or layer.casefold() == (stack.base if stack else surface.path.name).casefold()
    if stack is None:
        if not is_base:
            require_stack(material)  # raises, as the look has no stack
        return 0, surface.shader
    number = 0 if is_base else stack.find(layer)[0]
    shader = stack.shader(number)
    if shader is None:
        raise stack.make_error(f"layer {number} is not connected", "'lookdev materials remove' removes it")
    return number, shader


def require_surface(material: UsdShade.Material) -> OutputSource:
    """Return the shader output to which a look's surface is connected: the output of its stack or of its only layer.

    Raises LookError where it is connected to neither.
    """
    network = _network_of(material)
    source = network.surface_source(material)
    if source is None or shader_id(source.shader) not in ("LookdevLayers", *layer_shaders()):
        path = material.GetPath().AppendProperty(TERMINAL)
        network.add_fault(path, "is not connected to layers", "'lookdev materials new' makes a look")
        raise LookError(network.faults)
    return source


def _network_of(material: UsdShade.Material) -> Network:
    """Return a new `Network` for the file of a material, without faults."""
    return Network(Path(material.GetPrim().GetStage().GetRootLayer().realPath))


def find_stack(material: UsdShade.Material) -> Stack | None:
    """Return the stack of a look; None where the look has none."""
    network = _network_of(material)
    surface = network.surface_source(material)
    if surface is None or shader_id(surface.shader) != "LookdevLayers":
        return None
    names: dict[int, str] = {}
    for shader_input in surface.shader.GetInputs():
        attribute = shader_input.GetAttr()
        match = LAYER_INPUT.fullmatch(shader_input.GetBaseName())
        if shader_input.GetBaseName() == "base" or (match and not match[2] and attribute.HasAuthoredConnections()):
            layer = network.follow(attribute)
            names[int(match[1]) if match else 0] = layer.path.name if isinstance(layer, OutputSource) else ""
    return Stack(network, surface.shader.GetPrim(), names.pop(0, ""), dict(sorted(names.items())))


def require_stack(material: UsdShade.Material) -> Stack:
    """Return the stack of a look; raises LookError where the look has none."""
    stack = find_stack(material)
    if stack is None:
        require_surface(material)
        file, hint = _network_of(material).file, "'lookdev materials add' lays another over it"
        raise LookError.at(file, material.GetPath(), "has a single layer, no stack", hint)
    return stack


def ensure_stack(material: UsdShade.Material) -> tuple[Stack, int]:
    """Return the stack of a look and the number for a new layer on top; a look of a single layer gets a stack first."""
    if find_stack(material) is None:
        author_stack(material, require_surface(material).path)
    stack = require_stack(material)
    return stack, max(stack.layers, default=0) + 1


def author_stack(material: UsdShade.Material, base: Sdf.Path) -> None:
    """Define a stack beside the shader `base` of its base layer, and connect the material to it."""
    stage, inside = material.GetPrim().GetStage(), base.HasPrefix(material.GetPath())
    scope = base.GetParentPath() if inside else material.GetPath()
    layers = UsdShade.Shader.Define(stage, free_path(stage, scope, "Layers"))
    layers.CreateIdAttr("LookdevLayers")
    layers.CreateInput("base", _TYPES.Token).GetAttr().SetConnections([base.AppendProperty("outputs:layer")])
    surface = layers.CreateOutput("surface", _TYPES.Token).GetAttr().GetPath()
    material.CreateOutput("lookdev:surface", _TYPES.Token).GetAttr().SetConnections([surface])


def enabled_layers(material: UsdShade.Material) -> list[tuple[UsdShade.Shader, UsdShade.Shader, str]]:
    """Return triples (shader of the layer, shader of the stack, name of the mask's input) of the enabled layers.

    The base is first. It has no mask, so the name of its mask's input is "". In a look without a stack, the shader of
    the only layer is also returned as the shader of the stack.
    """
    surface, stack = require_surface(material).shader, find_stack(material)
    if stack is None:
        return [(surface, surface, "")]
    numbers = [number for number in (0, *stack.layers) if stack.is_enabled(number)]
    shaders = {number: shader for number in numbers if (shader := stack.shader(number))}
    return [(shader, surface, f"layer{number}Mask" if number else "") for number, shader in shaders.items()]
