"""Layers of looks as USD text: copied from one look, pasted into another, or twice into the same.

The text is a Material whose stack has the layer as its `layer1`, without a base, and the nodes that it reads. Values of
the look's interface are in it as constants, and paths of files are absolute.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pxr import Sdf, Usd, UsdShade, UsdUtils

from lookdev.cache import atomic_path
from lookdev.errors import Fault, LookError
from lookdev.material.library import read_preset
from lookdev.material.library.arrange import Variants, redirect
from lookdev.material.library.edit import camel_case, edited, reported_for
from lookdev.material.library.nodes import free_path, relative_path, sites, upstream
from lookdev.material.library.stack import author_stack, find_stack, layer_shader, surface_of
from lookdev.material.usd import find_material
from lookdev.material.usd.network import Network, Source
from lookdev.stage import open_stage, reading

_TYPES = Sdf.ValueTypeNames
_ROOT = Sdf.Path("/LookdevLayer")
_STACK = _ROOT.AppendChild("Layers")
_LONGEST = 1 << 20
_KINDS = {"Mask": _TYPES.Float, "Enabled": _TYPES.Bool, "Mode": _TYPES.Token}
_DOC = "A layer of a look, as the Designer copies and pastes it."


def copy_layer(file: Path, layer: str, prim: str | None = None, variants: Variants = None) -> str:
    """Return the USD text of a layer; raises LookError where there is none, or its nodes are not in the material."""
    stage, network = open_stage(file), Network(file)
    with reading(file):
        path = find_material(network, stage, prim, variants or {})
        if path is None:
            raise LookError(network.faults)
        fragment = _fragment(UsdShade.Material(stage.GetPrimAtPath(path)), layer, by_value=True)
        folder = file.resolve().parent

        def whole(asset: str) -> str:
            relative = asset and not Path(asset).is_absolute() and "://" not in asset
            return (folder / asset).resolve().as_posix() if relative else asset

        UsdUtils.ModifyAssetPaths(fragment, whole)
        return str(fragment.ExportToString())


def paste_layer(file: Path, text: str, prim: str | None = None, variants: Variants = None) -> int:
    """Lay a layer of `copy_layer` over those of a look, and return its number."""
    fragment = Sdf.Layer.CreateAnonymous(".usda")
    hint = "copy a layer first, here or in another Designer"
    refused = LookError([Fault("clipboard", "", "has no layer of a look as USD text", hint)])
    if len(text) > _LONGEST:
        raise LookError([Fault("clipboard", "", "has more than 1 MiB", hint)])
    try:
        read = fragment.ImportFromString(text)
    except Exception as error:  # USD raises its own for each syntax error
        raise refused from error
    if not read or not fragment.GetAttributeAtPath(_STACK.AppendProperty("inputs:layer1")):
        raise refused
    folder = file.resolve().parent
    UsdUtils.ModifyAssetPaths(fragment, lambda path: relative_path(path, folder) if Path(path).is_absolute() else path)
    with edited(file, prim, variants) as material:
        return _insert(material, fragment)


def duplicate_layer(file: Path, layer: str, prim: str | None = None, variants: Variants = None) -> int:
    """Lay a copy of a layer over those of a look, connected to the same interface, and return its number."""
    with edited(file, prim, variants) as material:
        return _insert(material, _fragment(material, layer, by_value=False))


def save_preset(
    file: Path, layer: str, target: Path, category: str, doc: str, prim: str | None = None, variants: Variants = None
) -> None:
    """Write the parameters of a layer to a new preset of a library, which must not exist.

    Raises LookError where it does, the name does not fit, or a parameter is no constant.
    """
    name = camel_case(target.stem)
    if target.suffix != ".usda" or not Sdf.Path.IsValidIdentifier(name):
        raise LookError([Fault(str(target), "", "cannot be the name of a preset", "for instance red_rubber")])
    if target.exists() or target.is_symlink():
        raise LookError([Fault(str(target), "", "exists already", "choose another name")])
    source, network = open_stage(file), Network(file)
    with reading(file), atomic_path(target) as temporary, reported_for(target, temporary):
        path = find_material(network, source, prim, variants or {})
        if path is None:
            raise LookError(network.faults)
        shader = layer_shader(UsdShade.Material(source.GetPrimAtPath(path)), layer)[1]
        stage = Usd.Stage.CreateNew(str(temporary))
        made = UsdShade.Shader.Define(stage, f"/{name}")
        stage.SetDefaultPrim(made.GetPrim())
        made.GetPrim().SetDocumentation(doc)
        made.GetPrim().SetCustomDataByKey("category", category)
        made.CreateIdAttr(shader.GetShaderId())
        for each in shader.GetInputs():
            held = network.follow(each.GetAttr())
            if isinstance(held, Source):
                what = f"has a {held.shader.GetShaderId()}, and a preset only constants"
                raise LookError([Fault(str(file), str(each.GetAttr().GetPath()), what, "make it a constant")])
            if held and held.HasAuthoredValue():
                value = held.Get()
                if isinstance(value, Sdf.AssetPath) and value.resolvedPath:
                    value = Sdf.AssetPath(relative_path(Path(value.resolvedPath), target.resolve().parent))
                made.CreateInput(each.GetBaseName(), each.GetTypeName()).Set(value)
        made.CreateOutput("layer", _TYPES.Token)
        stage.GetRootLayer().Save()
        read_preset(temporary)


def _fragment(material: UsdShade.Material, layer: str, *, by_value: bool) -> Sdf.Layer:
    """Return a layer of a look, its nodes and its mask, as a layer of USD."""
    stage, network = material.GetPrim().GetStage(), Network(Path())
    root, (number, shader), stack = stage.GetRootLayer(), layer_shader(material, layer), find_stack(material)
    own = {} if stack is None else {part: stack.attribute(number, part) for part in _KINDS if number}
    given = {part: attribute for part, attribute in own.items() if attribute}
    nodes = upstream(material, given.values()) | {shader.GetPath()}
    nodes |= upstream(material, [each.GetAttr() for each in shader.GetInputs()])
    tops = sorted(path for path in nodes if not any(path != each and path.HasPrefix(each) for each in nodes))
    plain = all(sites(root, path) == [path] and root.GetPrimAtPath(path).specifier == Sdf.SpecifierDef for path in tops)
    source, made = root if plain else stage.Flatten(), Sdf.Layer.CreateAnonymous(".usda")
    top = Sdf.PrimSpec(made, _ROOT.name, Sdf.SpecifierDef, "Material")
    made.defaultPrim, top.documentation = _ROOT.name, _DOC
    moved: dict[Sdf.Path, Sdf.Path] = {}
    for path in tops:
        moved[path] = _free(made, path.name)
        Sdf.CopySpec(source, path, made, moved[path])
    redirect(made, moved | {material.GetPath(): _ROOT})
    if by_value:
        _state_interface(material, made, {new: old for old, new in moved.items()}, network)
    shelf = Sdf.PrimSpec(top, _STACK.name, Sdf.SpecifierDef, "Shader")
    Sdf.AttributeSpec(shelf, "info:id", _TYPES.Token, Sdf.VariabilityUniform).default = "LookdevLayers"
    output = moved[shader.GetPath()].AppendProperty("outputs:layer")
    Sdf.AttributeSpec(shelf, "inputs:layer1", _TYPES.Token).connectionPathList.explicitItems = [output]
    for part, attribute in given.items():
        spec, held = Sdf.AttributeSpec(shelf, f"inputs:layer1{part}", _KINDS[part]), network.follow(attribute)
        if isinstance(held, Source):
            target = held.path.AppendProperty(f"outputs:{held.output}")
            spec.connectionPathList.explicitItems = [target.ReplacePrefix(*_within(held.path, moved))]
        elif held and held.HasAuthoredValue():
            spec.default = held.Get()
    return made


def _within(path: Sdf.Path, moved: Mapping[Sdf.Path, Sdf.Path]) -> tuple[Sdf.Path, Sdf.Path]:
    for old, new in moved.items():
        if path.HasPrefix(old):
            return old, new
    raise LookError([Fault("", str(path), "is outside of the material", "move it into the material to copy the layer")])


def _free(layer: Sdf.Layer, name: str) -> Sdf.Path:
    name = name if name != _STACK.name else f"{name}Node"
    names = [name, *(f"{name}{number}" for number in range(2, 1000))]
    return next(path for each in names if not layer.GetPrimAtPath(path := _ROOT.AppendChild(each)))


def _state_interface(
    material: UsdShade.Material, made: Sdf.Layer, origins: Mapping[Sdf.Path, Sdf.Path], network: Network
) -> None:
    """Replace connections to the material's own inputs by their values."""
    stage = material.GetPrim().GetStage()

    def state(path: Sdf.Path) -> None:
        spec = made.GetAttributeAtPath(path) if path.IsPropertyPath() else None
        targets = spec.connectionPathList.GetAddedOrExplicitItems() if spec else ()
        if spec and any(target.GetPrimPath() == _ROOT for target in targets):
            old = next(origin for new, origin in origins.items() if path.HasPrefix(new))
            new = next(new for new in origins if path.HasPrefix(new))
            held = network.follow(stage.GetAttributeAtPath(path.ReplacePrefix(new, old)))
            if isinstance(held, Source):
                raise LookError([Fault("", str(held.path), "feeds the interface", "copy its source instead")])
            spec.connectionPathList.ClearEdits()
            if held and held.HasValue():
                spec.default = held.Get()

    made.Traverse(_ROOT, state)


def _insert(material: UsdShade.Material, fragment: Sdf.Layer) -> int:
    """Copy a fragment's nodes into a material, and lay its layer on top."""
    stage = material.GetPrim().GetStage()
    if find_stack(material) is None:
        author_stack(material, surface_of(material)[1].path)
    stack = find_stack(material)
    assert stack is not None, "it is made where there is none"
    number = max(stack.layers, default=0) + 1
    root, moved = stage.GetRootLayer(), {_ROOT: material.GetPath()}
    Sdf.CreatePrimInLayer(root, stack.scope)
    for child in fragment.GetPrimAtPath(_ROOT).nameChildren:
        if child.path != _STACK:
            moved = {child.path: free_path(stage, stack.scope, child.name)} | moved
            Sdf.CopySpec(fragment, child.path, root, moved[child.path])
    for old, new in moved.items():
        if old != _ROOT:
            redirect(root, moved, new)
    for part, kind in {"": _TYPES.Token, **_KINDS}.items():
        spec = fragment.GetAttributeAtPath(_STACK.AppendProperty(f"inputs:layer1{part}"))
        if not spec:
            continue
        attribute = stack.input(number, part, kind)
        if targets := spec.connectionPathList.GetAddedOrExplicitItems():
            attribute.SetConnections([_moved(target, moved) for target in targets])
        elif spec.HasDefaultValue():
            attribute.Set(spec.default)
    return number


def _moved(target: Sdf.Path, moved: Mapping[Sdf.Path, Sdf.Path]) -> Sdf.Path:
    return next((target.ReplacePrefix(old, new) for old, new in moved.items() if target.HasPrefix(old)), target)
