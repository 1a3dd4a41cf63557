"""Copies layers of looks: as USD text to a clipboard and back, as duplicates in a look, or as new presets.

The copied layer is a *fragment*: a USD layer in memory with a single Material. Its stack has the copied layer as
`layer1` and has no base. The nodes that the layer reads are beside the stack. In a text for the clipboard, values of
the look's interface are constants, and paths of files are absolute.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pxr import Sdf, Usd, UsdShade, UsdUtils

from lookdev.cache import atomic_path
from lookdev.errors import LookError
from lookdev.material.library import read_preset
from lookdev.material.library.arrange import redirect_connections
from lookdev.material.library.edit import camel_case, edit_material, report_faults_for
from lookdev.material.library.nodes import find_sites, find_upstream, free_path, is_defined, moved_path, relative_path
from lookdev.material.library.stack import ensure_stack, find_stack, layer_shader
from lookdev.material.usd import VariantChoice, open_material
from lookdev.material.usd.network import Network, OutputSource

_TYPES = Sdf.ValueTypeNames
# In a fragment: the path of its Material, and the path of the stack in the Material.
_ROOT = Sdf.Path("/LookdevLayer")
_STACK = _ROOT.AppendChild("Layers")
_MAX_LENGTH = 1 << 20  # characters of a text that is pasted
# The types of a stack's inputs for a layer, by the parts in `lookdev.material.library.stack.LAYER_PARTS` except "".
_PART_TYPES = {"Mask": _TYPES.Float, "Enabled": _TYPES.Bool, "Mode": _TYPES.Token}
_DOC = "A layer of a look, as the Designer copies and pastes it."


def copy_layer(file: Path, layer: str, prim: str | None = None, variants: VariantChoice = None) -> str:
    """Return a layer as USD text, for `paste_layer`.

    Raises LookError where the layer does not exist, or reads nodes outside of the material.
    """
    with open_material(file, prim, variants) as material:
        fragment = _extract_fragment(material, layer, by_value=True)
        folder = file.resolve().parent

        def make_absolute(asset: str) -> str:
            relative = asset and not Path(asset).is_absolute() and "://" not in asset
            return (folder / asset).resolve().as_posix() if relative else asset

        UsdUtils.ModifyAssetPaths(fragment, make_absolute)
        return str(fragment.ExportToString())


def paste_layer(file: Path, text: str, prim: str | None = None, variants: VariantChoice = None) -> int:
    """Add the layer in a text of `copy_layer` over the layers of a look, and return its number."""
    fragment = Sdf.Layer.CreateAnonymous(".usda")
    hint = "copy a layer first, here or in another Designer"
    error_without_layer = LookError.at("clipboard", "", "has no layer of a look as USD text", hint)
    if len(text) > _MAX_LENGTH:
        raise LookError.at("clipboard", "", "has more than 1 MiB", hint)
    try:
        is_parsed = fragment.ImportFromString(text)
    except Exception as error:  # USD raises its own for each syntax error
        raise error_without_layer from error
    if not is_parsed or not fragment.GetAttributeAtPath(_STACK.AppendProperty("inputs:layer1")):
        raise error_without_layer
    folder = file.resolve().parent
    UsdUtils.ModifyAssetPaths(fragment, lambda path: relative_path(path, folder) if Path(path).is_absolute() else path)
    with edit_material(file, prim, variants) as material:
        return _insert_fragment(material, fragment)


def duplicate_layer(file: Path, layer: str, prim: str | None = None, variants: VariantChoice = None) -> int:
    """Add a copy of a layer over the layers of the same look, and return its number.

    The copy is connected to the same interface inputs of the material.
    """
    with edit_material(file, prim, variants) as material:
        return _insert_fragment(material, _extract_fragment(material, layer, by_value=False))


def save_preset(
    file: Path,
    layer: str,
    target: Path,
    category: str,
    doc: str,
    prim: str | None = None,
    variants: VariantChoice = None,
) -> None:
    """Write the parameters of a layer to a new preset of a library, the file `target`.

    `category` and `doc` are texts for the list of presets. Raises LookError where `target` exists or has an invalid
    name, or where a parameter is not a constant.
    """
    name = camel_case(target.stem)
    if target.suffix != ".usda" or not Sdf.Path.IsValidIdentifier(name):
        raise LookError.at(target, "", "cannot be the name of a preset", "for instance red_rubber")
    if target.exists() or target.is_symlink():
        raise LookError.at(target, "", "exists already", "choose another name")
    with (
        open_material(file, prim, variants) as material,
        atomic_path(target) as temporary,
        report_faults_for(target, temporary),
    ):
        shader = layer_shader(material, layer)[1]
        stage = Usd.Stage.CreateNew(str(temporary))
        shader_copy = UsdShade.Shader.Define(stage, f"/{name}")
        stage.SetDefaultPrim(shader_copy.GetPrim())
        shader_copy.GetPrim().SetDocumentation(doc)
        shader_copy.GetPrim().SetCustomDataByKey("category", category)
        shader_copy.CreateIdAttr(shader.GetShaderId())
        for shader_input in shader.GetInputs():
            holder = Network(file).follow(shader_input.GetAttr())
            if isinstance(holder, OutputSource):
                message = f"has a {holder.shader.GetShaderId()}, and a preset only constants"
                raise LookError.at(file, shader_input.GetAttr().GetPath(), message, "make it a constant")
            if holder and holder.HasAuthoredValue():
                value = holder.Get()
                if isinstance(value, Sdf.AssetPath) and value.resolvedPath:
                    value = Sdf.AssetPath(relative_path(Path(value.resolvedPath), target.resolve().parent))
                shader_copy.CreateInput(shader_input.GetBaseName(), shader_input.GetTypeName()).Set(value)
        shader_copy.CreateOutput("layer", _TYPES.Token)
        stage.GetRootLayer().Save()
        # An invalid preset raises LookError here, and is not moved to `target`.
        read_preset(temporary)


def _extract_fragment(material: UsdShade.Material, layer: str, *, by_value: bool) -> Sdf.Layer:
    """Return a fragment with a layer of a look, the nodes that it reads, and its mask, switch and mode.

    With `by_value`, values of the look's interface become constants. Otherwise, connections to the interface stay.
    """
    stage, network = material.GetPrim().GetStage(), Network(Path())
    root, (number, shader), stack = stage.GetRootLayer(), layer_shader(material, layer), find_stack(material)
    attributes = {} if stack is None else {part: stack.attribute(number, part) for part in _PART_TYPES if number}
    authored = {part: attribute for part, attribute in attributes.items() if attribute}
    nodes = find_upstream(material, authored.values()) | {shader.GetPath()}
    nodes |= find_upstream(material, [shader_input.GetAttr() for shader_input in shader.GetInputs()])
    # Nodes inside another node, as in a node graph, are copied with it.
    top_paths = sorted(path for path in nodes if not any(path != other and path.HasPrefix(other) for other in nodes))
    sites = {path: find_sites(root, path) for path in top_paths}
    # If the file itself defines all nodes, outside of variants, their specs are copied. Otherwise, the composed stage
    # is flattened into one USD layer, and the specs are copied from this layer.
    is_plain = all(sites[path] == [path] and is_defined(root, [path]) for path in top_paths)
    source, fragment = root if is_plain else stage.Flatten(), Sdf.Layer.CreateAnonymous(".usda")
    top = Sdf.PrimSpec(fragment, _ROOT.name, Sdf.SpecifierDef, "Material")
    fragment.defaultPrim, top.documentation = _ROOT.name, _DOC
    new_paths: dict[Sdf.Path, Sdf.Path] = {}
    for path in top_paths:
        new_paths[path] = _free_path(fragment, path.name)
        Sdf.CopySpec(source, path, fragment, new_paths[path])
    redirect_connections(fragment, new_paths | {material.GetPath(): _ROOT})
    if by_value:
        _replace_interface(material, fragment, {new: old for old, new in new_paths.items()}, network)
    stack_spec = Sdf.PrimSpec(top, _STACK.name, Sdf.SpecifierDef, "Shader")
    Sdf.AttributeSpec(stack_spec, "info:id", _TYPES.Token, Sdf.VariabilityUniform).default = "LookdevLayers"
    output = new_paths[shader.GetPath()].AppendProperty("outputs:layer")
    Sdf.AttributeSpec(stack_spec, "inputs:layer1", _TYPES.Token).connectionPathList.explicitItems = [output]
    for part, attribute in authored.items():
        spec = Sdf.AttributeSpec(stack_spec, f"inputs:layer1{part}", _PART_TYPES[part])
        holder = network.follow(attribute)
        if isinstance(holder, OutputSource):
            target = moved_path(holder.path.AppendProperty(f"outputs:{holder.output}"), new_paths)
            if target is None:
                hint = "move it into the material to copy the layer"
                raise LookError.at("", holder.path, "is outside of the material", hint)
            spec.connectionPathList.explicitItems = [target]
        elif holder and holder.HasAuthoredValue():
            spec.default = holder.Get()
    return fragment


def _free_path(layer: Sdf.Layer, name: str) -> Sdf.Path:
    """Return an unused path in a fragment for the node `name`; a number follows a name that is in use."""
    name = name if name != _STACK.name else f"{name}Node"
    names = [name, *(f"{name}{number}" for number in range(2, 1000))]
    return next(path for candidate in names if not layer.GetPrimAtPath(path := _ROOT.AppendChild(candidate)))


def _replace_interface(
    material: UsdShade.Material, fragment: Sdf.Layer, origins: Mapping[Sdf.Path, Sdf.Path], network: Network
) -> None:
    """Replace connections of a fragment to interface inputs of the material by the values of these inputs.

    `origins` maps the path of a node in the fragment to its path in the material. Raises LookError where a node
    computes such an input.
    """
    stage = material.GetPrim().GetStage()

    def replace_connection(path: Sdf.Path) -> None:
        spec = fragment.GetAttributeAtPath(path) if path.IsPropertyPath() else None
        targets = spec.connectionPathList.GetAddedOrExplicitItems() if spec else ()
        if spec and any(target.GetPrimPath() == _ROOT for target in targets):
            holder = network.follow(stage.GetAttributeAtPath(moved_path(path, origins)))
            if isinstance(holder, OutputSource):
                raise LookError.at("", holder.path, "feeds the interface", "copy its source instead")
            spec.connectionPathList.ClearEdits()
            if holder and holder.HasValue():
                spec.default = holder.Get()

    fragment.Traverse(_ROOT, replace_connection)


def _insert_fragment(material: UsdShade.Material, fragment: Sdf.Layer) -> int:
    """Copy the nodes of a fragment into a material, and add its layer on top; return the layer's number."""
    stage = material.GetPrim().GetStage()
    stack, number = ensure_stack(material)
    root, new_paths = stage.GetRootLayer(), {_ROOT: material.GetPath()}
    Sdf.CreatePrimInLayer(root, stack.scope)
    for child in fragment.GetPrimAtPath(_ROOT).nameChildren:
        if child.path != _STACK:
            # `moved_path` takes the first match: `_ROOT` stays last, because it is a prefix of all others.
            new_paths = {child.path: free_path(stage, stack.scope, child.name)} | new_paths
            Sdf.CopySpec(fragment, child.path, root, new_paths[child.path])
    for old, new in new_paths.items():
        if old != _ROOT:
            redirect_connections(root, new_paths, new)
    for part, kind in {"": _TYPES.Token, **_PART_TYPES}.items():
        spec = fragment.GetAttributeAtPath(_STACK.AppendProperty(f"inputs:layer1{part}"))
        if not spec:
            continue
        attribute = stack.create_input(number, part, kind)
        if targets := spec.connectionPathList.GetAddedOrExplicitItems():
            attribute.SetConnections([moved_path(target, new_paths) or target for target in targets])
        elif spec.HasDefaultValue():
            attribute.Set(spec.default)
    return number
