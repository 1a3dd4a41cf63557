"""Reads materials of any shading model as looks: those that the file of an asset binds, and those that a job names.

A material of `lookdev` is read strictly: its faults are errors. A *foreign* material, of another shading model, is read
as far as possible. Its surface shader becomes a layer of a foreign model (see `lookdev.material.translate`). An input,
node or connection that cannot be carried over to the look is a *loss*, and is listed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from pxr import Sdf, Usd, UsdShade

from lookdev.brdf import MODELS, Parameter
from lookdev.errors import Fault, LookError, TextureError, close_hint
from lookdev.material import Bump, Displacement, Input, Layer, Look, Mask, Texture
from lookdev.material import InputSource as FormulaSource
from lookdev.material.textures import is_uncentred_normal_map, udim_tiles
from lookdev.material.translate import TRANSLATIONS, foreign_shaders, layer_parameters
from lookdev.material.usd import VariantChoice, check_composition, find_material, read_look_at, read_material
from lookdev.material.usd.network import TERMINAL, Network, OutputSource, shader_id
from lookdev.material.usd.nodes import NODES
from lookdev.material.usd.reader import Reader, node_category
from lookdev.material.usd.terms import NodeValue, NotCarriedError
from lookdev.mtlx import NOTES_KEY
from lookdev.stage import Composed, open_stage, usd_errors_as_faults

GREY_LAYER = Layer("Grey", "disney", {"baseColor": (0.18, 0.18, 0.18)})
"""The layer of a look that replaces a material which cannot be read."""

# The outputs of a material for each purpose, in the order of preference: first for MaterialX, then for all.
_SURFACE_TERMINALS = ("outputs:mtlx:surface", "outputs:surface")
_DISPLACEMENT_TERMINALS = ("outputs:mtlx:displacement", "outputs:displacement")
_VOLUME_TERMINALS = ("outputs:mtlx:volume", "outputs:volume")
_MAX_SHADERS = 64  # surface shaders connected in a row


@dataclass(frozen=True)
class BoundLook:
    """The look of a material. `losses` lists each input, node and connection that is not carried over, and why."""

    look: Look
    losses: tuple[Fault, ...] = ()

    @property
    def titles(self) -> tuple[str, ...]:
        """The title of each layer's model for messages, such as "OpenPBR Surface as Disney" for a foreign one."""
        if self.look.layers[0] is GREY_LAYER:
            return ("neutral grey",)
        return tuple(_model_title(layer.model) for layer in self.look.layers)


def read_bound_looks(composed: Composed, paths: Iterable[str]) -> dict[str, BoundLook]:
    """Read materials of a composed asset.

    Parameters
    ----------
    composed
        The asset. Images that are missing or unreadable and have no fallback are errors if
        ``composed.composition.missing`` is "error". Otherwise `BoundLook.losses` lists them.
    paths
        Paths of materials. A material that cannot be read becomes `GREY_LAYER`, and `BoundLook.losses` has the reason.

    Returns
    -------
    dict
        The looks by the path of the material.

    Raises
    ------
    LookError
        Images cannot be read (the error names all of them), or a material of `lookdev` has faults.
    """
    stage, file = composed.stage, composed.composition.file
    looks: dict[str, BoundLook] = {}
    missing_images: dict[Fault, None] = {}
    with usd_errors_as_faults(file):
        for path in paths:
            prim = stage.GetPrimAtPath(path)
            terminal = prim.GetAttribute(TERMINAL) if prim else None
            if terminal and terminal.HasAuthoredConnections():
                looks[path] = BoundLook(read_material(file, stage, prim.GetPath()))
                continue
            material = _Material(file, path)
            try:
                look = material.read(prim)
            except NotCarriedError as error:
                look = material.grey_look(str(error))
            missing_images |= dict.fromkeys(material.reader.missing)
            looks[path] = BoundLook(look, material.losses)
    if missing_images and composed.composition.missing == "error":
        raise LookError(missing_images)
    return looks


def read_any_look(
    file: Path, prim: str | None = None, variants: VariantChoice = None, name: str | None = None
) -> BoundLook:
    """Read a material of a file, whether it is of `lookdev` or foreign; parameters as `read_look`.

    Images of a material of `lookdev` are not opened. Raises LookError as `read_look` and `read_foreign`.
    """
    stage, network = open_stage(file), Network(file, opens_images=False)
    with usd_errors_as_faults(file):
        path = find_material(network, stage, prim, variants or {})
        if path is None or not is_foreign(stage.GetPrimAtPath(path)):
            return BoundLook(read_look_at(network, stage, path, name))
        if network.faults:
            raise LookError(network.faults)
        bound = read_foreign(file, stage, path)
        return replace(bound, look=replace(bound.look, name=name or bound.look.name))


def is_foreign(material: Usd.Prim) -> bool:
    """Return whether a material is foreign: it has a connected surface, but no outputs of `lookdev`."""
    lookdev_properties = material.GetAuthoredPropertiesInNamespace("outputs:lookdev")
    return not lookdev_properties and any(_is_connected(material, name) for name in _SURFACE_TERMINALS)


def read_foreign(file: Path, stage: Usd.Stage, path: Sdf.Path) -> BoundLook:
    """Read a foreign material that a user names, from an open stage. Missing images are errors.

    Raises
    ------
    LookError
        The material's composition has errors, or its surface shader or images cannot be read.
    """
    material, network = _Material(file, str(path)), Network(file)
    with usd_errors_as_faults(file):
        check_composition(network, stage, path)
        try:
            look = material.read(stage.GetPrimAtPath(path))
        except NotCarriedError as error:
            network.add_fault(path, str(error))
            raise LookError((*network.faults, *material.losses)) from error
    if missing_images := (*network.faults, *material.reader.missing):
        raise LookError(dict.fromkeys(missing_images))
    return BoundLook(look, material.losses)


def _model_title(model: str) -> str:
    """Return the title of a model for messages; for a foreign one, such as "OpenPBR Surface as Disney"."""
    return MODELS[model].title if model in MODELS else f"{TRANSLATIONS[model].title} as {MODELS['disney'].title}"


class _Material:
    """Reads one foreign material, and collects the losses as faults of `network`."""

    def __init__(self, file: Path, path: str) -> None:
        self.path = path
        self.network = Network(file)
        self.add_fault = self.network.add_fault
        self.reader = Reader(self.network, NODES)

    @property
    def losses(self) -> tuple[Fault, ...]:
        """The losses so far, with missing images last."""
        return (*self.network.faults, *dict.fromkeys(self.reader.missing))

    def grey_look(self, reason: str) -> Look:
        """Return a grey look for a material that cannot be read, and add the reason as a loss."""
        self.add_fault(self.path, reason, "its parts are grey")
        return Look(self.path.rpartition("/")[2], (GREY_LAYER,), f"{self.network.file}<{self.path}>")

    def read(self, prim: Usd.Prim) -> Look:
        """Return the look of a material; raises NotCarriedError where it has no surface that can be read."""
        if not prim or not prim.IsA(UsdShade.Material):
            raise NotCarriedError("is not a material")
        self._add_document_faults(prim)
        terminals = [name for name in _SURFACE_TERMINALS if _is_connected(prim, name)]
        for name in _VOLUME_TERMINALS:
            if _is_connected(prim, name):
                self.add_fault(prim.GetAttribute(name), "volumes are not supported", "only surfaces are shown")
        for name in terminals:
            try:
                layers = self._read_surface(prim.GetAttribute(name), 0)
            except NotCarriedError as error:
                self.add_fault(prim.GetAttribute(name), str(error) or "cannot be read")
                continue
            displacement = self._read_displacement(prim)
            return Look(prim.GetName(), tuple(layers), f"{self.network.file}<{self.path}>", displacement)
        raise NotCarriedError(f"has no surface shader{' that can be read' if terminals else ''}")

    def _add_document_faults(self, prim: Usd.Prim) -> None:
        """Add the losses that arose when a MaterialX document was converted to USD: its USD layer stores them."""
        for layer in dict.fromkeys(spec.layer for spec in prim.GetPrimStack()):
            for line in str(layer.customLayerData.get(NOTES_KEY, "")).splitlines():
                self.network.add_external_fault(Fault(*line.split("\t")))

    def _read_surface(self, attribute: Usd.Attribute, depth: int) -> list[Layer]:
        """Return the layers of the surface shader to which `attribute` is connected.

        `attribute` is an output of the material, at `depth` 0, or an input of another surface shader. `depth` counts
        the surface shaders from the output to `attribute`. Raises NotCarriedError where the shader cannot be read.
        """
        source = self.network.follow(attribute)
        if not isinstance(source, OutputSource):
            raise NotCarriedError("" if source is None else "is not connected to a shader")
        if depth == _MAX_SHADERS:
            raise NotCarriedError(f"more than {_MAX_SHADERS} shaders are connected in a row")
        kind = node_category(source.shader)
        if kind == "dot_surfaceshader":
            return self._read_surface(self._input_attribute(source, "in"), depth + 1)
        if kind == "mix_surfaceshader":
            return self._read_mix(source, depth)
        identifier = shader_id(source.shader)
        if identifier == "ND_disney_principled":
            return [self._read_layer(source, "disney", _PRINCIPLED_DEFAULTS)]
        if name := foreign_shaders().get(identifier):
            return [self._read_layer(source, name, {})]
        message = f"the surface shader <{source.path}> of {identifier or 'no info:id'} is not supported"
        titles = dict.fromkeys(translation.title for translation in TRANSLATIONS.values())
        raise NotCarriedError(f"{message}; {', '.join(titles)} are")

    @staticmethod
    def _input_attribute(source: OutputSource, name: str) -> Usd.Attribute:
        """Return the attribute of a shader's input; NotCarriedError where there is none."""
        attribute = source.shader.GetPrim().GetAttribute(f"inputs:{name}")
        if not attribute:
            raise NotCarriedError(f"<{source.path}> has no inputs:{name}")
        return attribute

    def _read_mix(self, source: OutputSource, depth: int) -> list[Layer]:
        """Return the layers of a mix of two surface shaders: all layers of one, and over them the other with a mask."""
        beneath = self._read_surface(self._input_attribute(source, "bg"), depth + 1)
        above = self._read_surface(self._input_attribute(source, "fg"), depth + 1)
        mask = self.reader.read_term(source.shader.GetPrim().GetAttribute("inputs:mix"), 1) or _ZERO
        if len(above) > 1:  # several layers cannot lie over others with one mask: put them beneath, and invert the mask
            beneath, above = above, beneath
            mask = self.reader.terms.apply("1 - {mask}", {"mask": mask}, ("mask",))
        if len(above) > 1:
            raise NotCarriedError(f"<{source.path}> mixes two mixtures, which no stack of layers does")
        return [*beneath, replace(above[0], mask=_mask_source(mask))]

    def _read_layer(self, source: OutputSource, model: str, defaults: Mapping[str, Input]) -> Layer:
        """Return the layer of a surface shader; `defaults` are the shader's defaults that differ from the model's."""
        inputs: dict[str, Input] = {}
        parameters = layer_parameters(model)
        for shader_input in source.shader.GetInputs():
            name, attribute = shader_input.GetBaseName(), shader_input.GetAttr()
            if name == "displacement" and model in _PREVIEW_MODELS:
                self._check_displacement(attribute, source)
            elif name in parameters:
                value = self._read_input(source, attribute, parameters[name])
                if value is not None:
                    inputs[name] = value
            elif self._has_value(attribute):
                message = f"is not carried: {shader_id(source.shader)} is read without it"
                self.add_fault(attribute, message, close_hint(name, list(parameters)))
        if model in TRANSLATIONS:
            for name, reason in TRANSLATIONS[model].losses(inputs):
                self.add_fault(f"{source.path}.inputs:{name}", reason)
        return Layer(source.shader.GetPrim().GetName(), model, {**defaults, **inputs})

    def _read_input(self, source: OutputSource, attribute: Usd.Attribute, parameter: Parameter) -> Input | None:
        """Return the value of an input of a layer; None where it is unset or, with a fault added, not carried over."""
        try:
            if parameter.kind == "token":
                return self._read_token(attribute, parameter)
            term = self.reader.read_term(attribute, 1 if parameter.kind == "float" else 3)
            if term is None:
                return None
            if parameter.kind == "normal":
                self._check_normal(source, attribute, term)
            return self._clip_to_range(attribute, term.source(), parameter)
        except NotCarriedError as error:
            default = parameter.default
            default_text = ", ".join(f"{number:g}" for number in default) if isinstance(default, tuple) else default
            self.add_fault(attribute, error.fault, f"{default_text} is taken")
            return None

    def _read_token(self, attribute: Usd.Attribute, parameter: Parameter) -> str | None:
        """Return the choice of a constant input, where a number counts as its digits; None where it is unset."""
        value = self.reader.read_constant(attribute)
        if value is None:
            return None
        text = f"{value[0]:g}" if isinstance(value, tuple) else str(value)
        if text not in parameter.choices:
            raise NotCarriedError(f"'{text:.40}' is not one of {', '.join(parameter.choices)}")
        return text

    def _clip_to_range(self, attribute: Usd.Attribute, value: FormulaSource | Bump, parameter: Parameter) -> Input:
        """Return the value of an input. A constant outside the parameter's range is clipped, with a fault added."""
        if isinstance(value, Bump) and parameter.kind != "normal":
            raise NotCarriedError("cannot be a normal")
        if not isinstance(value, float | tuple):
            return value  # type: ignore[return-value]
        low, high = parameter.hard
        numbers = value if isinstance(value, tuple) else (value,)
        if parameter.kind == "normal" and not any(numbers):
            raise NotCarriedError("is the zero vector, which has no direction")
        clipped = tuple(min(max(number, low), high) for number in numbers)
        if clipped != numbers:
            clipped_text = ", ".join(f"{number:g}" for number in clipped)
            number_text = ", ".join(f"{number:g}" for number in numbers)
            self.add_fault(attribute, f"{number_text} is outside [{low:g}, {high:g}]", f"{clipped_text} is taken")
        return (clipped[0], clipped[1], clipped[2]) if isinstance(value, tuple) else clipped[0]

    def _check_normal(self, source: OutputSource, attribute: Usd.Attribute, term: NodeValue) -> None:
        """Add faults of a normal map that is decoded as a colour or has no negative components.

        Raises NotCarriedError for a normal in world space.
        """
        if node_category(source.shader) not in _TANGENT_SPACE_SHADERS and not term.is_tangent_normal:
            hint = "only one of a normalmap or a bump, in tangent space, is supported"
            raise NotCarriedError(f"is a normal in world space; {hint}")
        if not isinstance(texture := term.leaf, Texture):
            return
        if texture.colorspace not in ("raw", "auto"):
            message = f"{texture.file.name} is decoded as {texture.colorspace}, but a normal map is data"
            self.add_fault(attribute, message, "it is carried as it stands; set inputs:sourceColorSpace to 'raw'")
        try:
            if is_uncentred_normal_map(texture):
                file = next(iter(udim_tiles(texture).values()), texture).file
                message = f"{file.name} holds 0 to 1, so no normal has a negative component"
                self.add_fault(attribute, message, "it is carried as it stands; set scale and bias of the texture")
        except TextureError as error:
            raise NotCarriedError(str(error)) from error

    def _check_displacement(self, attribute: Usd.Attribute, source: OutputSource) -> None:
        """Add a fault where a UsdPreviewSurface states a displacement that the material's outputs do not use."""
        prim = source.shader.GetPrim()
        while prim and not prim.IsA(UsdShade.Material):
            prim = prim.GetParent()
        if prim and not any(_is_connected(prim, name) for name in _DISPLACEMENT_TERMINALS):
            holder = self.network.follow(attribute)
            if isinstance(holder, OutputSource) or (holder is not None and holder.Get()):
                self.add_fault(attribute, "has no effect: outputs:displacement of the material is not connected")

    def _has_value(self, attribute: Usd.Attribute) -> bool:
        """Return whether an input has a value, directly or through inputs of the material."""
        holder = self.network.follow(attribute)
        return isinstance(holder, OutputSource) or bool(holder and holder.HasAuthoredValue())

    def _read_displacement(self, prim: Usd.Prim) -> Displacement | None:
        """Return the displacement of a material along the normal, in units of the file; None if it displaces nothing.

        Where a displacement cannot be carried over, a fault is added.
        """
        terminal = next(
            (prim.GetAttribute(name) for name in _DISPLACEMENT_TERMINALS if _is_connected(prim, name)), None
        )
        if terminal is None:
            return None
        try:
            source = self.network.follow(terminal)
            if not isinstance(source, OutputSource):
                raise NotCarriedError("" if source is None else "is not connected to a shader")
            kind = node_category(source.shader)
            if kind not in ("displacement", *_TANGENT_SPACE_SHADERS):
                raise NotCarriedError(f"{shader_id(source.shader) or 'no info:id'} is not supported")
            attribute = source.shader.GetPrim().GetAttribute("inputs:displacement")
            if attribute and attribute.GetTypeName() != Sdf.ValueTypeNames.Float:
                raise NotCarriedError("displaces by vectors; only heights along the normal are supported")
            height = self.reader.read_term(attribute, 1)
            factor = source.shader.GetPrim().GetAttribute("inputs:scale")
            scale = self.reader.read_term(factor, 1) if kind == "displacement" else None
            if height is not None and scale is not None:
                height = self.reader.terms.apply("{a} * {b}", {"a": height, "b": scale}, ("a", "b"))
            return None if height is None or height.numbers == (0.0,) else Displacement(_mask_source(height))
        except NotCarriedError as error:
            self.add_fault(terminal, error.fault, "nothing is displaced")
            return None


# The categories of surface shaders whose normals are in tangent space. These shaders have a displacement, too.
_TANGENT_SPACE_SHADERS = ("UsdPreviewSurface", "UsdPreviewSurface_surfaceshader")
_PREVIEW_MODELS = ("preview_surface", "materialx_preview_surface")
# The default of MaterialX's disney_principled that differs from our model's.
_PRINCIPLED_DEFAULTS: Mapping[str, Input] = {"baseColor": (0.16, 0.16, 0.16)}
_ZERO = NodeValue("0", 1, numbers=(0.0,))


def _is_connected(prim: Usd.Prim, name: str) -> bool:
    """Return whether a prim has an attribute of this name that is connected."""
    attribute = prim.GetAttribute(name)
    return bool(attribute and attribute.HasAuthoredConnections())


def _mask_source(term: NodeValue) -> Mask:
    """Return a value as a mask or a height, which must be a float; raises NotCarriedError for a bump map."""
    source = term.source()
    if not isinstance(source, Mask):
        raise NotCarriedError("is not a float")
    return source
