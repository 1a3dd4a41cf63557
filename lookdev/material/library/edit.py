"""Editing looks: layer stacks of references to presets, written in USD.

An edit is made on a copy beside the file, which replaces the file only if `read_look` finds no fault in it, in any
variant of the material. It is written to the file itself: a stack that comes from another file gets overrides. Each
function raises LookError where the file is not a look, or would not be one after the edit; layers are named by number
or, in whatever case, by name.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pxr import Gf, Sdf, Usd, UsdShade

from lookdev.brdf import MODELS, Mode, Model, layer_shaders
from lookdev.brdf.measured import MEASURED, grid_of
from lookdev.cache import atomic_path
from lookdev.errors import Fault, LookError, nearest_hint
from lookdev.material.change import Value
from lookdev.material.library import SUFFIXES, Preset
from lookdev.material.library.masks import Held, Mask, MaskWriter
from lookdev.material.library.nodes import clear_input, delete, free_path, prune, relative_asset, sites, upstream
from lookdev.material.library.preview import author_preview
from lookdev.material.look import Look
from lookdev.material.usd import find_material, read_look, read_material
from lookdev.material.usd.network import LAYER_INPUT, TERMINAL, Network, Source, is_set, shader_id
from lookdev.stage import open_stage, reading

_TYPES = Sdf.ValueTypeNames
_INPUT_TYPES = {"float": _TYPES.Float, "color": _TYPES.Color3f, "normal": _TYPES.Normal3f, "token": _TYPES.Token}


def new_look(file: Path, preset: Preset, name: str | None = None) -> str:
    """Write a new look whose base is a preset, by reference, and return the path of its material.

    The material is called `name`, by default as the file: ``WornPaint`` for ``worn_paint.usda``, which must not exist.
    """
    return _new(file, name, lambda stage, path: _reference(stage, path, preset))


def measured_look(file: Path, measurement: Path) -> str:
    """Write a new look whose base is a file of measured reflectance; otherwise as `new_look`.

    A ModelError reports what is wrong with the measurement.
    """
    grid_of(str(measurement))

    def define(stage: Usd.Stage, path: Sdf.Path) -> Sdf.Path:
        shader = UsdShade.Shader.Define(stage, path)
        shader.CreateIdAttr(MEASURED.identifier)
        shader.CreateInput("file", _TYPES.Asset).Set(relative_asset(measurement, stage))
        shader.CreateOutput("layer", _TYPES.Token)
        return path

    return _new(file, None, define)


def model_look(file: Path, model: Model, values: Mapping[str, Any]) -> str:
    """Write a new look whose base is a model with some parameters, constants by name; otherwise as `new_look`.

    A ModelError reports what is wrong with them.
    """
    model.complete(values)

    def define(stage: Usd.Stage, path: Sdf.Path) -> Sdf.Path:
        shader = UsdShade.Shader.Define(stage, path)
        shader.CreateIdAttr(model.identifier)
        for name, value in values.items():
            kind = model.parameters[name].kind
            if model.parameters[name].file and value not in model.parameters[name].choices:
                shader.CreateInput(name, _TYPES.Asset).Set(str(Path(value).absolute()))
                continue
            given = Gf.Vec3f(*map(float, value)) if kind in ("color", "normal") else value
            shader.CreateInput(name, _INPUT_TYPES[kind]).Set(given if kind != "float" else float(value))
        shader.CreateOutput("layer", _TYPES.Token)
        return path

    return _new(file, None, define)


def _new(file: Path, name: str | None, define: Callable[[Usd.Stage, Sdf.Path], Sdf.Path]) -> str:
    """Write a new look whose base is defined at a path; the function returns it."""
    check_suffix(file)
    if file.exists() or file.is_symlink():
        hint = "choose another name, or 'lookdev materials add' a layer to it"
        raise LookError([Fault(str(file), "", "exists already", hint)])
    name = name or "".join(word[:1].upper() + word[1:] for word in re.split(r"[^A-Za-z0-9]+", file.stem))
    if not Sdf.Path.IsValidIdentifier(name):
        hint = "letters, digits and '_', not a digit first; give one with --name"
        raise LookError([Fault(str(file), "", f"'{name}' cannot be the name of a material", hint)])
    with atomic_path(file) as temporary, reported_for(file, temporary):
        stage = Usd.Stage.CreateNew(str(temporary))
        material = UsdShade.Material.Define(stage, f"/{name}")
        stage.SetDefaultPrim(material.GetPrim())
        base = define(stage, material.GetPath().AppendChild("Base"))
        _author_stack(material, base)
        _author_preview(material)
        _check(material)
    return f"/{name}"


def preset_look(preset: Preset, name: str) -> Look:
    """Return the look whose only layer is a preset, made in memory."""
    stage = Usd.Stage.CreateInMemory()
    material = UsdShade.Material.Define(stage, "/Preset")
    base = stage.DefinePrim("/Preset/Base", "Shader")
    base.GetReferences().AddReference(str(preset.file.absolute()), preset.prim)
    _author_stack(material, base.GetPath())
    return replace(read_material(preset.file, stage, material.GetPath()), name=name)


def add_layer(
    file: Path, preset: Preset, mask: Mask = 1.0, mode: Mode = "over", prim: str | None = None
) -> tuple[int, str]:
    """Lay a preset, by reference, over the layers of a look, and return the new layer's number and name.

    A look of a single layer gets a stack first.
    """
    with _edited(file, prim) as material:
        if _find_stack(material) is None:
            _author_stack(material, _surface(material)[1].path)
        stack = _stack_of(material)
        number = max(stack.layers, default=0) + 1
        path = _reference(stack.stage, free_path(stack.stage, stack.scope, Sdf.Path(preset.prim).name), preset)
        stack.input(number, "", _TYPES.Token).SetConnections([path.AppendProperty("outputs:layer")])
        if mode != "over":
            stack.input(number, "Mode", _TYPES.Token).Set(mode)
        if mask != 1.0:
            attribute = stack.input(number, "Mask", _TYPES.Float)
            MaskWriter(stack.stage, stack.scope, {}).write(attribute, f"{path.name}Mask", mask)
    return number, path.name


def remove_layer(file: Path, layer: str, prim: str | None = None) -> tuple[int, str, bool]:
    """Remove a layer from a stack; return its number, its name, and whether it is removed.

    Layers above it are renumbered, and nodes that only it used are removed. A layer that another file defines cannot be
    removed and is disabled.
    """
    with _edited(file, prim) as material:
        stack = _stack_of(material)
        number, name = stack.find(layer)
        own = [stack.prim.GetAttribute(stack.input_name(number, part)) for part in ("", "Mask", "Enabled", "Mode")]
        removable = all(stack.is_own(attribute) for attribute in own if attribute)
        if removable:
            used = upstream(material, own)
            stack.drop(number)
            prune(material, used)
        else:
            stack.input(number, "Enabled", _TYPES.Bool).Set(False)
    return number, name, removable


def set_mask(file: Path, layer: str, mask: Mask, prim: str | None = None) -> tuple[int, str]:
    """Replace the mask of a layer; return its number and name.

    Nodes that only the old mask used are removed. Names of an expression without a new source keep the one that they
    have in the old expression.
    """
    with _edited(file, prim) as material:
        stack = _stack_of(material)
        number, name = stack.find(layer)
        attribute = stack.input(number, "Mask", _TYPES.Float)
        old, used = _inputs(stack.network.follow(attribute)), upstream(material, [attribute])
        clear_input(attribute)
        prune(material, used, [path for held in old.values() for path in held.connections])
        MaskWriter(stack.stage, stack.scope, old).write(attribute, f"{name}Mask", mask)
        prune(material, used)
    return number, name


def set_inputs(
    file: Path,
    values: Mapping[tuple[int, str], Value],
    prim: str | None = None,
    variants: Mapping[str, str] | None = None,
) -> None:
    """Set constants of layers, by the place of a layer in the look, from the base, and the name of a parameter.

    ``"mask"`` is that of the layer. What the file itself says of an input is changed where it says it, also in a
    variant; an input of another file gets an override. The material is as in `variants`.
    """
    with _edited(file, prim, variants) as material:
        layers, (network, _) = shown_layers(material), _surface(material)
        for (number, name), value in values.items():
            shader, holder, mask = layers[number]
            if name == "mask":
                _set(network, holder, mask, _TYPES.Float, value)
            else:
                kind = MODELS[layer_shaders()[shader_id(shader) or ""]].parameters[name].kind
                _set(network, shader, name, _INPUT_TYPES[kind], value)


def _set(network: Network, shader: UsdShade.Shader, name: str, kind: Sdf.ValueTypeName, value: Value) -> None:
    """Set a constant where the strongest opinion of the edited file is, which an input may have from its material."""
    stage = shader.GetPrim().GetStage()
    given = Gf.Vec3f(*map(float, value)) if isinstance(value, tuple) else value
    known = shader.GetInput(name)
    held = network.follow(known.GetAttr()) if known else None
    if isinstance(held, Source):
        place = str(known.GetAttr().GetPath())
        raise LookError([Fault(str(network.file), place, "is connected", "a texture or an expression has its value")])
    specs = held.GetPropertyStack(Usd.TimeCode.Default()) if held else []
    if own := [spec for spec in specs if spec.layer == stage.GetRootLayer() and spec.HasDefaultValue()]:
        own[0].default = given
    elif held:
        held.Set(given)
    else:
        shader.CreateInput(name, kind).Set(given)


def write_preview(file: Path, prim: str | None = None) -> str:
    """Write or refresh the UsdPreviewSurface of a look, and return the path of its shader."""
    with _edited(file, prim) as material:
        return _author_preview(material)


@dataclass(frozen=True)
class _Stack:
    """A LookdevLayers shader, and the number and name of each layer over its base."""

    network: Network
    prim: Usd.Prim
    base: str
    layers: dict[int, str]

    @property
    def stage(self) -> Usd.Stage:
        return self.prim.GetStage()

    @property
    def scope(self) -> Sdf.Path:
        """The parent of the nodes beside the stack."""
        return self.prim.GetPath().GetParentPath()

    def find(self, layer: str) -> tuple[int, str]:
        """Return number and name of a layer."""
        if layer == "0" or layer.casefold() == self.base.casefold():
            raise self._fault(f"'{layer}' is the base", "every stack has one, without a mask; choose another layer")
        numbers = [n for n, name in self.layers.items() if layer == str(n) or layer.casefold() == name.casefold()]
        if len(numbers) > 1:
            raise self._fault(f"layers {', '.join(map(str, numbers))} are all '{layer}'", "give the number")
        if not numbers:
            known = [each for number, name in self.layers.items() for each in (name, str(number))]
            raise self._fault(f"no layer '{layer}'", nearest_hint(layer, known) if known else "it has only a base")
        return numbers[0], self.layers[numbers[0]]

    def _fault(self, what: str, hint: str) -> LookError:
        return LookError([Fault(str(self.network.file), str(self.prim.GetPath()), what, hint)])

    @staticmethod
    def input_name(number: int, part: str) -> str:
        return f"inputs:layer{number}{part}"

    def input(self, number: int, part: str, type_name: Sdf.ValueTypeName) -> Usd.Attribute:
        return UsdShade.Shader(self.prim).CreateInput(f"layer{number}{part}", type_name).GetAttr()

    def is_own(self, attribute: Usd.Attribute) -> bool:
        """Return whether all opinions on an input are on the stack itself, in the file that is edited."""
        root = self.stage.GetRootLayer()
        return all(
            spec.layer == root and spec.path.StripAllVariantSelections() == attribute.GetPath()
            for spec in attribute.GetPropertyStack()
        )

    def drop(self, number: int) -> None:
        """Remove a layer's inputs, and renumber those of the layers over it, in every variant."""
        root = self.stage.GetRootLayer()
        for site in sites(root, self.prim.GetPath()):
            prim = root.GetPrimAtPath(site)
            matches = ((LAYER_INPUT.fullmatch(spec.name.removeprefix("inputs:")), spec) for spec in prim.properties)
            found = [(int(match[1]), match[2] or "", spec) for match, spec in matches if match]
            for each, part, spec in sorted(found, key=lambda entry: entry[0]):
                if each == number:
                    prim.RemoveProperty(spec)
                elif each > number:
                    spec.name = self.input_name(each - 1, part)
            if prim.isInert:
                delete(root, [site])


def _surface(material: UsdShade.Material) -> tuple[Network, Source]:
    """Return the stack or the only layer of a look."""
    network = Network(Path(material.GetPrim().GetStage().GetRootLayer().realPath))
    source = network.surface(material)
    if source is None or shader_id(source.shader) not in ("LookdevLayers", *layer_shaders()):
        place = material.GetPath().AppendProperty(TERMINAL)
        network.fault(place, "is not connected to layers", "'lookdev materials new' makes a look")
        raise LookError(network.faults)
    return network, source


def _find_stack(material: UsdShade.Material) -> _Stack | None:
    """Return the stack of a look; None where a single layer is its surface."""
    network, surface = _surface(material)
    if shader_id(surface.shader) in layer_shaders():
        return None
    names: dict[int, str] = {}
    for each in surface.shader.GetInputs():
        attribute = each.GetAttr()
        match = LAYER_INPUT.fullmatch(each.GetBaseName())
        if each.GetBaseName() == "base" or (match and not match[2] and attribute.HasAuthoredConnections()):
            layer = network.follow(attribute)
            names[int(match[1]) if match else 0] = layer.path.name if isinstance(layer, Source) else ""
    return _Stack(network, surface.shader.GetPrim(), names.pop(0, ""), dict(sorted(names.items())))


def _stack_of(material: UsdShade.Material) -> _Stack:
    stack = _find_stack(material)
    if stack is None:
        network, _ = _surface(material)
        network.fault(material, "has a single layer, no stack", "'lookdev materials add' lays another over it")
        raise LookError(network.faults)
    return stack


def _author_stack(material: UsdShade.Material, base: Sdf.Path) -> None:
    """Define a stack beside its base, and connect the material to it."""
    stage, inside = material.GetPrim().GetStage(), base.HasPrefix(material.GetPath())
    scope = base.GetParentPath() if inside else material.GetPath()
    layers = UsdShade.Shader.Define(stage, free_path(stage, scope, "Layers"))
    layers.CreateIdAttr("LookdevLayers")
    layers.CreateInput("base", _TYPES.Token).GetAttr().SetConnections([base.AppendProperty("outputs:layer")])
    surface = layers.CreateOutput("surface", _TYPES.Token).GetAttr().GetPath()
    material.CreateOutput("lookdev:surface", _TYPES.Token).GetAttr().SetConnections([surface])


def _reference(stage: Usd.Stage, path: Sdf.Path, preset: Preset) -> Sdf.Path:
    """Define a shader that is a preset, by reference."""
    prim = stage.DefinePrim(path, "Shader")
    prim.GetReferences().AddReference(relative_asset(preset.file, stage), preset.prim)
    return prim.GetPath()


def _author_preview(material: UsdShade.Material) -> str:
    look = _read_saved(material)
    shaders = [shader for shader, *_ in shown_layers(material)]
    return author_preview(material, list(zip(look.layers, shaders, strict=True)))


def shown_layers(material: UsdShade.Material) -> list[tuple[UsdShade.Shader, UsdShade.Shader, str]]:
    """Return each layer of a look, base first: its shader, the stack, and the name of the stack's input of its mask.

    Disabled layers are left out; the base has no mask, and the name is empty.
    """
    network, surface = _surface(material)
    stack = _find_stack(material)
    if stack is None:
        return [(surface.shader, surface.shader, "")]
    found = []
    for number in (0, *stack.layers):
        enabled = stack.prim.GetAttribute(stack.input_name(number, "Enabled")) if number else None
        if not enabled or network.constant(enabled, _TYPES.Bool) is not False:
            source = network.follow(stack.prim.GetAttribute(stack.input_name(number, "") if number else "inputs:base"))
            if isinstance(source, Source):
                found.append((source.shader, UsdShade.Shader(stack.prim), f"layer{number}Mask" if number else ""))
    return found


def _inputs(source: Usd.Attribute | Source | None) -> dict[str, Held]:
    """Return the present state of an expression's named inputs; none for any other node."""
    if not isinstance(source, Source) or shader_id(source.shader) != "LookdevExpression":
        return {}
    inputs = {each.GetBaseName(): each.GetAttr() for each in source.shader.GetInputs()}
    return {
        name: Held(attribute.GetTypeName(), tuple(attribute.GetConnections()), attribute.Get())
        for name, attribute in inputs.items()
        if name != "expression" and is_set(attribute)
    }


@contextmanager
def _edited(file: Path, prim: str | None, variants: Mapping[str, str] | None = None) -> Iterator[UsdShade.Material]:
    """Yield the material of a copy of a file, which replaces the file if it is a look in the end."""
    check_suffix(file)
    if file.is_symlink():
        raise LookError([Fault(str(file), "", "is a symbolic link", f"edit {file.resolve()} itself")])
    if not file.is_file():
        raise LookError([Fault(str(file), "", "no such file", "'lookdev materials new' makes one")])
    with atomic_path(file) as temporary, reported_for(file, temporary):
        shutil.copy(file, temporary)
        stage, network = open_stage(temporary), Network(temporary)
        path = find_material(network, stage, prim, variants or {})
        if path is None:
            raise LookError(network.faults)
        material = UsdShade.Material(stage.GetPrimAtPath(path))
        yield material
        _check(material)


def check_suffix(file: Path) -> None:
    """Raise LookError where a look cannot be written in a file of this name."""
    if file.suffix not in SUFFIXES:
        raise LookError([Fault(str(file), "", "is not a file to write a look in", f"one of {', '.join(SUFFIXES)}")])


@contextmanager
def reported_for(file: Path, temporary: Path) -> Iterator[None]:
    """Report the faults of a temporary copy as faults of the file."""
    try:
        with reading(temporary):
            yield
    except LookError as error:

        def renamed(text: str) -> str:
            return text.replace(str(temporary.absolute()), str(file)).replace(str(temporary), str(file))

        faults = [replace(fault, file=renamed(fault.file), what=renamed(fault.what)) for fault in error.faults]
        raise LookError(faults) from error


def _read_saved(material: UsdShade.Material, **variants: str) -> Look:
    """Save and read a look."""
    layer = material.GetPrim().GetStage().GetRootLayer()
    layer.Save()
    return read_look(Path(layer.realPath), str(material.GetPath()), variants)


def _check(material: UsdShade.Material) -> None:
    """Read the look in each variant of the material."""
    _read_saved(material)
    variants = material.GetPrim().GetVariantSets()
    for name in variants.GetNames():
        for choice in variants.GetVariantSet(name).GetVariantNames():
            _read_saved(material, **{name: choice})
