"""Materials of any shading model as looks: those that an asset binds, and those of a file that a job names.

A material of `lookdev` is read as any look: faults are errors. Of any other, the surface shader is a layer of its
translation (`lookdev.material.translate`), and what cannot be carried is listed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pxr import Sdf, Usd, UsdShade

from lookdev.brdf import MODELS, Parameter
from lookdev.errors import Fault, LookError, TextureError, close_hint
from lookdev.material.look import Bump, Displacement, Formula, Input, Layer, Look, Mask, Primvar, Texture
from lookdev.material.textures import image_header, udim_tiles
from lookdev.material.translate import TRANSLATIONS, foreign_shaders
from lookdev.material.usd import check_composition, find_material, read_found, read_material
from lookdev.material.usd.network import TERMINAL, Network, Source, shader_id
from lookdev.material.usd.nodes import NODES
from lookdev.material.usd.reader import Reader, category
from lookdev.material.usd.terms import Term, Unread
from lookdev.mtlx import NOTES
from lookdev.stage import Composed, open_stage, reading

GREY = Layer("Grey", "disney", {"baseColor": (0.18, 0.18, 0.18)})
"""The layer of a part whose material cannot be read."""

_SURFACES = ("outputs:mtlx:surface", "outputs:surface")
_DISPLACEMENTS = ("outputs:mtlx:displacement", "outputs:displacement")
_VOLUMES = ("outputs:mtlx:volume", "outputs:volume")
_MOST_LAYERS = 64


@dataclass(frozen=True)
class BoundLook:
    """A material as a look, and each input, node and connection that is not carried, with its place and reason."""

    look: Look
    lost: tuple[Fault, ...] = ()

    @property
    def titles(self) -> tuple[str, ...]:
        """The model of each layer, and of a translated one also what it is rendered as; or that it is grey."""
        if self.look.layers[0] is GREY:
            return ("neutral grey",)
        return tuple(_title(layer.model) for layer in self.look.layers)


def read_bound(composed: Composed, paths: Iterable[str]) -> dict[str, BoundLook]:
    """Read materials of a composed asset.

    Parameters
    ----------
    composed
        The asset. An image that is missing or unreadable, and that no fallback replaces, is an error unless its
        `missing` is "warn": then it is lost.
    paths
        Paths of materials; what cannot be read as one is grey, and says so in `BoundLook.lost`.

    Returns
    -------
    dict
        The looks by path.

    Raises
    ------
    LookError
        Images cannot be read, all of them are named; or a material of `lookdev` has faults.
    """
    stage, file = composed.stage, composed.composition.file
    looks: dict[str, BoundLook] = {}
    absent: dict[Fault, None] = {}
    with reading(file):
        for path in paths:
            prim = stage.GetPrimAtPath(path)
            terminal = prim.GetAttribute(TERMINAL) if prim else None
            if terminal and terminal.HasAuthoredConnections():
                looks[path] = BoundLook(read_material(file, stage, prim.GetPath()))
                continue
            material = _Material(file, path)
            try:
                look = material.read(prim)
            except Unread as unread:
                look = material.grey(str(unread))
            absent |= dict.fromkeys(material.reader.missing)
            looks[path] = BoundLook(look, material.lost)
    if absent and composed.composition.missing == "error":
        raise LookError(absent)
    return looks


def read_any_look(
    file: Path, prim: str | None = None, variants: Mapping[str, str] | None = None, name: str | None = None
) -> BoundLook:
    """Read a material of a file, of `lookdev` or of another model; parameters as `read_look`.

    The images of a material of `lookdev` are not opened. Raises LookError as `read_look` and `read_foreign`.
    """
    stage, network = open_stage(file), Network(file, opens_images=False)
    with reading(file):
        path = find_material(network, stage, prim, variants or {})
        if path is None or not is_foreign(stage.GetPrimAtPath(path)):
            return BoundLook(read_found(network, stage, path, name))
        if network.faults:
            raise LookError(network.faults)
        found = read_foreign(file, stage, path)
        return replace(found, look=replace(found.look, name=name or found.look.name))


def is_foreign(material: Usd.Prim) -> bool:
    """Return whether a material has no output of `lookdev`, but a surface of another model."""
    own = material.GetAuthoredPropertiesInNamespace("outputs:lookdev")
    return not own and any(_is_connected(material, name) for name in _SURFACES)


def read_foreign(file: Path, stage: Usd.Stage, path: Sdf.Path) -> BoundLook:
    """Read a material of another model, of an open stage, that somebody has chosen.

    Raises
    ------
    LookError
        It is not composed without errors, its surface shader cannot be read, or images cannot.
    """
    material, network = _Material(file, str(path)), Network(file)
    with reading(file):
        check_composition(network, stage, path)
        try:
            look = material.read(stage.GetPrimAtPath(path))
        except Unread as unread:
            network.fault(path, str(unread))
            raise LookError((*network.faults, *material.lost)) from unread
    if absent := (*network.faults, *material.reader.missing):
        raise LookError(dict.fromkeys(absent))
    return BoundLook(look, material.lost)


def _title(model: str) -> str:
    return MODELS[model].title if model in MODELS else f"{TRANSLATIONS[model].title} as {MODELS['disney'].title}"


class _Material:
    def __init__(self, file: Path, path: str) -> None:
        self.path = path
        self.network = Network(file)
        self.reader = Reader(self.network, NODES)

    @property
    def lost(self) -> tuple[Fault, ...]:
        """What is not carried, missing images last."""
        return (*self.network.faults, *dict.fromkeys(self.reader.missing))

    def grey(self, what: str) -> Look:
        """Return the look of a material that cannot be read, and note why."""
        self.network.fault(self.path, what, "its parts are grey")
        return Look(self.path.rpartition("/")[2], (GREY,), f"{self.network.file}<{self.path}>")

    def read(self, prim: Usd.Prim) -> Look:
        """Return the look of a material; raises Unread where it has no surface that can be read."""
        if not prim or not prim.IsA(UsdShade.Material):
            raise Unread("is no material")
        self._note_documents(prim)
        terminals = [name for name in _SURFACES if _is_connected(prim, name)]
        for name in _VOLUMES:
            if _is_connected(prim, name):
                self.network.fault(prim.GetAttribute(name), "volumes are not supported", "only surfaces are shown")
        for name in terminals:
            try:
                layers = self._surface(prim.GetAttribute(name), 0)
            except Unread as unread:
                self.network.fault(prim.GetAttribute(name), str(unread) or "cannot be read")
                continue
            displacement = self._displacement(prim)
            return Look(prim.GetName(), tuple(layers), f"{self.network.file}<{self.path}>", displacement)
        raise Unread(f"has no surface shader{' that can be read' if terminals else ''}")

    def _note_documents(self, prim: Usd.Prim) -> None:
        """Note what MaterialX documents hold that is not in the layers that stand for them."""
        for layer in dict.fromkeys(spec.layer for spec in prim.GetPrimStack()):
            for line in str(layer.customLayerData.get(NOTES, "")).splitlines():
                self.network.note(Fault(*line.split("\t")))

    def _surface(self, place: Usd.Attribute, depth: int) -> list[Layer]:
        """Return the layers of the shader that an input or a terminal is connected to; raises Unread."""
        source = self.network.follow(place)
        if not isinstance(source, Source):
            raise Unread("" if source is None else "is not connected to a shader")
        if depth == _MOST_LAYERS:
            raise Unread(f"more than {_MOST_LAYERS} shaders are connected in a row")
        kind = category(source.shader)
        if kind == "dot_surfaceshader":
            return self._surface(self._input(source, "in"), depth + 1)
        if kind == "mix_surfaceshader":
            return self._mixed(source, depth)
        identifier = shader_id(source.shader)
        if identifier == "ND_disney_principled":
            return [self._layer(source, "disney", MODELS["disney"].parameters, _PRINCIPLED)]
        if name := foreign_shaders().get(identifier):
            return [self._layer(source, name, TRANSLATIONS[name].parameters, {})]
        what = f"the surface shader <{source.path}> of {identifier or 'no info:id'} is not supported"
        titles = dict.fromkeys(each.title for each in TRANSLATIONS.values())
        raise Unread(f"{what}; {', '.join(titles)} are")

    @staticmethod
    def _input(source: Source, name: str) -> Usd.Attribute:
        attribute = source.shader.GetPrim().GetAttribute(f"inputs:{name}")
        if not attribute:
            raise Unread(f"<{source.path}> has no inputs:{name}")
        return attribute

    def _mixed(self, source: Source, depth: int) -> list[Layer]:
        """Return the layers of a mix of two surface shaders, the one over the other by a mask."""
        beneath = self._surface(self._input(source, "bg"), depth + 1)
        above = self._surface(self._input(source, "fg"), depth + 1)
        given = source.shader.GetPrim().GetAttribute("inputs:mix")
        mask = (self.reader.term(given, 1) if given else None) or _ZERO
        if len(above) > 1:  # a mixture cannot lie over others as one layer, so it lies beneath
            beneath, above = above, beneath
            mask = self.reader.terms.apply("1 - {mask}", {"mask": mask}, ("mask",))
        if len(above) > 1:
            raise Unread(f"<{source.path}> mixes two mixtures, which no stack of layers does")
        return [*beneath, replace(above[0], mask=_mask(mask))]

    def _layer(
        self, source: Source, model: str, parameters: Mapping[str, Parameter], defaults: Mapping[str, Input]
    ) -> Layer:
        inputs: dict[str, Input] = {}
        for each in source.shader.GetInputs():
            name, attribute = each.GetBaseName(), each.GetAttr()
            if name == "displacement" and model in _PREVIEWS:
                self._check_displacement(attribute, source)
            elif name in parameters:
                value = self._read_input(source, attribute, parameters[name])
                if value is not None:
                    inputs[name] = value
            elif self._is_given(attribute):
                what = f"is not carried: {shader_id(source.shader)} is read without it"
                self.network.fault(attribute, what, close_hint(name, list(parameters)))
        if model in TRANSLATIONS:
            for name, why in TRANSLATIONS[model].losses(inputs):
                self.network.fault(f"{source.path}.inputs:{name}", why)
        return Layer(source.shader.GetPrim().GetName(), model, {**defaults, **inputs})

    def _read_input(self, source: Source, attribute: Usd.Attribute, parameter: Parameter) -> Input | None:
        """Return the value of an input of a layer; None where it is not set or, with a note, not carried."""
        try:
            if parameter.kind == "token":
                return self._token(attribute, parameter)
            term = self.reader.term(attribute, 1 if parameter.kind == "float" else 3)
            if term is None:
                return None
            if parameter.kind == "normal":
                self._check_normal(source, attribute, term)
            return self._in_range(attribute, term.source(), parameter)
        except Unread as unread:
            default = parameter.default
            shown = ", ".join(f"{each:g}" for each in default) if isinstance(default, tuple) else default
            self.network.fault(attribute, f"is not carried{f': {unread}' if str(unread) else ''}", f"{shown} is taken")
            return None

    def _token(self, attribute: Usd.Attribute, parameter: Parameter) -> str | None:
        value = self.reader.plain(attribute)
        if value is None:
            return None
        text = f"{value[0]:g}" if isinstance(value, tuple) else str(value)
        if text not in parameter.choices:
            raise Unread(f"'{text:.40}' is none of {', '.join(parameter.choices)}")
        return text

    def _in_range(self, attribute: Usd.Attribute, value: Any, parameter: Parameter) -> Input:
        if isinstance(value, Bump) and parameter.kind != "normal":
            raise Unread("a normal is no value of it")
        if not isinstance(value, float | tuple):
            return value  # type: ignore[no-any-return]
        low, high = parameter.hard
        numbers = value if isinstance(value, tuple) else (value,)
        if parameter.kind == "normal" and not any(numbers):
            raise Unread("is the zero vector, which has no direction")
        clipped = tuple(min(max(number, low), high) for number in numbers)
        if clipped != numbers:
            taken = ", ".join(f"{number:g}" for number in clipped)
            shown = ", ".join(f"{number:g}" for number in numbers)
            self.network.fault(attribute, f"{shown} is outside [{low:g}, {high:g}]", f"{taken} is taken")
        return (clipped[0], clipped[1], clipped[2]) if isinstance(value, tuple) else clipped[0]

    def _check_normal(self, source: Source, attribute: Usd.Attribute, term: Term) -> None:
        """Note normal maps that are decoded as colours or lean one way; raises Unread for normals in world space."""
        if category(source.shader) not in _TANGENT_SPACE and not term.tangent:
            raise Unread(
                "is a normal in world space; only one of a normalmap or a bump, in tangent space, is supported"
            )
        if not isinstance(texture := term.leaf, Texture):
            return
        if texture.colorspace not in ("raw", "auto"):
            what = f"{texture.file.name} is decoded as {texture.colorspace}, but a normal map is data"
            self.network.fault(attribute, what, "it is carried as it stands; set inputs:sourceColorSpace to 'raw'")
        centred = all(abs(texture.bias[axis] + 0.5 * texture.scale[axis]) < 0.01 for axis in (0, 1))
        try:
            file = next(iter(udim_tiles(texture).values()), texture).file
            if not centred and image_header(file).unsigned:
                what = f"{file.name} holds 0 to 1, so no normal has a negative component"
                self.network.fault(attribute, what, "it is carried as it stands; set scale and bias of the texture")
        except TextureError as error:
            raise Unread(str(error)) from error

    def _check_displacement(self, attribute: Usd.Attribute, source: Source) -> None:
        prim = source.shader.GetPrim()
        while prim and not prim.IsA(UsdShade.Material):
            prim = prim.GetParent()
        if prim and not any(_is_connected(prim, name) for name in _DISPLACEMENTS):
            holder = self.network.follow(attribute)
            if isinstance(holder, Source) or (holder is not None and holder.Get()):
                self.network.fault(attribute, "has no effect: outputs:displacement of the material is not connected")

    def _is_given(self, attribute: Usd.Attribute) -> bool:
        """Return whether an input has a value, also through inputs of the material."""
        holder = self.network.follow(attribute)
        return isinstance(holder, Source) or bool(holder and holder.HasAuthoredValue())

    def _displacement(self, prim: Usd.Prim) -> Displacement | None:
        """Return the displacement of a material, in units of the file along the normal; None where there is none."""
        terminal = next((prim.GetAttribute(name) for name in _DISPLACEMENTS if _is_connected(prim, name)), None)
        if terminal is None:
            return None
        try:
            source = self.network.follow(terminal)
            if not isinstance(source, Source):
                raise Unread("" if source is None else "is not connected to a shader")
            kind = category(source.shader)
            if kind not in ("displacement", *_TANGENT_SPACE):
                raise Unread(f"{shader_id(source.shader) or 'no info:id'} is not supported")
            attribute = source.shader.GetPrim().GetAttribute("inputs:displacement")
            if attribute and attribute.GetTypeName() != Sdf.ValueTypeNames.Float:
                raise Unread("displaces by vectors; only heights along the normal are supported")
            height = self.reader.term(attribute, 1) if attribute else None
            factor = source.shader.GetPrim().GetAttribute("inputs:scale")
            scale = self.reader.term(factor, 1) if factor and kind == "displacement" else None
            if height is not None and scale is not None:
                height = self.reader.terms.apply("{a} * {b}", {"a": height, "b": scale}, ("a", "b"))
            return None if height is None or height.numbers == (0.0,) else Displacement(_mask(height))
        except Unread as unread:
            self.network.fault(
                terminal, f"is not carried{f': {unread}' if str(unread) else ''}", "nothing is displaced"
            )
            return None


_TANGENT_SPACE = ("UsdPreviewSurface", "UsdPreviewSurface_surfaceshader")
_PREVIEWS = tuple(
    each.name for each in TRANSLATIONS.values() if any("UsdPreviewSurface" in name for name in each.identifiers)
)
_PRINCIPLED: Mapping[str, Input] = {"baseColor": (0.16, 0.16, 0.16)}
_ZERO = Term("0", 1, numbers=(0.0,))


def _is_connected(prim: Usd.Prim, name: str) -> bool:
    attribute = prim.GetAttribute(name)
    return bool(attribute and attribute.HasAuthoredConnections())


def _mask(term: Term) -> Mask:
    source = term.source()
    if not isinstance(source, float | Texture | Primvar | Formula):
        raise Unread("is no float")
    return source
