"""BSDF plug-ins for scenes of Mitsuba users (Jakob et al. 2022): one for each model, and one for looks.

The plug-in of a model has a name such as ``lookdev_disney``. The numbers of a plug-in are inputs of its kernels:
`mitsuba.traverse` lists these inputs, and they are differentiable. The densities of sampled directions are not
differentiated.

`mi` is Mitsuba in the user's current variant. A program is the code of a look, generated from its model
(`lookdev.mitsuba.programs`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from lookdev.brdf import MODELS, Parameter
from lookdev.codegen.program.look import generate_program, live_name, live_numbers, stated_constants
from lookdev.codegen.source import ProgramSource
from lookdev.errors import ModelError
from lookdev.material import Layer, Look
from lookdev.material.textures import image_file
from lookdev.material.usd import read_look
from lookdev.mitsuba.frozen import device_array
from lookdev.mitsuba.images import Images
from lookdev.mitsuba.programs import Evaluation, Program
from lookdev.mitsuba.types import UV, Bool, Color3f, Float, Mitsuba, Vector3f

if TYPE_CHECKING:
    from mitsuba import BSDF, Properties, Texture, TraversalCallback
    from mitsuba import SurfaceInteraction3f as Interaction

mi: Mitsuba = import_module("mitsuba")

_FILE, _PRIM, _VARIANT = "file", "prim", "variant_"  # names of properties of a look's BSDF; the last is a prefix


def model_bsdf(name: str, properties: Properties) -> BSDF:
    """Return the BSDF of a model, with the parameters of the model as properties.

    A property is a number, a colour or a texture of Mitsuba; for a parameter that is a token, it is a string. Raises
    ModelError where a parameter is unknown or outside its range.
    """
    parameters = MODELS[name].parameters
    values = {key: properties[key] for key in properties if key in parameters}
    if unknown := properties.unqueried():
        raise ModelError(f"{name}: no parameter '{unknown[0]}'; it has: {', '.join(parameters)}")
    textures = {key: value for key, value in values.items() if isinstance(value, mi.Texture)}
    inputs = {key: _constant(value, parameters[key]) for key, value in values.items()}
    look = Look(name, (Layer(name, name, inputs),))
    return _create_bsdf(
        properties, look, {live_name(0, key): (texture, parameters[key]) for key, texture in textures.items()}
    )


def look_bsdf(properties: Properties) -> BSDF:
    """Return the BSDF of a look in a USD file. Properties name the file, the prim, and the variant of each set.

    Raises
    ------
    LookError
        The look has faults; the message lists all of them.
    CodegenError
        The look needs something that a BSDF of Mitsuba lacks: primvars, two UV sets, delta directions.
    """
    if _FILE not in properties:
        raise ModelError(f"lookdev_look: no '{_FILE}'; the path of a USD file of a look would be right")
    file, prim = Path(str(properties[_FILE])), str(properties[_PRIM]) if _PRIM in properties else None
    sets = [key for key in properties if key.startswith(_VARIANT)]
    variants = {key.removeprefix(_VARIANT): str(properties[key]) for key in sets}
    if unknown := properties.unqueried():
        raise ModelError(f"lookdev_look: no '{unknown[0]}'; it has: {_FILE}, {_PRIM}, {_VARIANT}<set>")
    return _create_bsdf(properties, read_look(file, prim, variants), {})


def _constant(value: object, parameter: Parameter) -> Any:
    """Return the value of a property as an input of a layer; for a texture, return the parameter's default instead."""
    if isinstance(value, mi.Texture):
        return parameter.default if parameter.kind == "float" else tuple(np.broadcast_to(parameter.default, 3).tolist())
    if parameter.kind == "token":
        return str(value)
    numbers = np.array(value, dtype=np.float64).ravel()
    return float(numbers[0]) if parameter.kind == "float" else tuple(map(float, np.broadcast_to(numbers, 3)))


def _create_bsdf(properties: Properties, look: Look, textures: Mapping[str, tuple[Texture, Parameter]]) -> BSDF:
    """Return the BSDF of a look.

    The constants that the look's layers state are live inputs: the program takes them as arguments (see
    `stated_constants`). All other constants are numbers in the program. Textures of Mitsuba can replace live inputs.
    `textures` has these textures, with the parameters that they set, by the names of the live inputs.
    """
    live = stated_constants(look)
    source = generate_program(look, image_file, live=live)
    source.check_plugin(look.name)
    return _bsdf_class(mi.variant())(properties, look, source, live_numbers(look, live), textures)


@cache
def _bsdf_class(variant: str) -> Callable[..., BSDF]:
    """Return the BSDF class for the current variant, `variant`. Each variant has a base class of its own."""

    base: Any = mi.BSDF

    class LookBSDF(base):  # type: ignore[misc]
        """A BSDF that evaluates and samples by the program of a look. The methods are as in `mitsuba.BSDF`.

        `numbers` has the values of live inputs by name. A texture in `textures` replaces the number with its name.

        As in Mitsuba, `si` is the surface interaction, and `si.wi` is the direction to the viewer. The program calls
        this direction `wo`. The program's `wi` is the direction of the light, which Mitsuba calls `wo`.
        """

        def __init__(
            self,
            properties: Properties,
            look: Look,
            source: ProgramSource,
            numbers: Mapping[str, tuple[float, ...]],
            textures: Mapping[str, tuple[Texture, Parameter]],
        ) -> None:
            mi.BSDF.__init__(self, properties)
            self._title = look.name
            self._source = source
            tables = [device_array(mi.Float, np.load(table.path)) for table in source.tables]
            self._constants = [mi.Float(value) for value in source.constants]
            self._program = Program(source.operations, source.outputs, mi.Float, self._constants, tables)
            self._images = {image.name: Images(mi, image) for image in source.look_ups}
            self._textures = dict(textures)
            kinds = {name: mi.Float if len(value) == 1 else mi.Color3f for name, value in numbers.items()}
            self._numbers = {name: kinds[name](*value) for name, value in numbers.items() if name not in textures}
            flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
            components = [flags | mi.BSDFFlags.SpatiallyVarying]
            if source.transmits:
                components[0] |= mi.BSDFFlags.GlossyTransmission
            if source.see_through:
                components.append(mi.BSDFFlags.Null | mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide)
            self.m_components = components
            self.m_flags = components[0] | components[-1]

        def traverse(self, callback: TraversalCallback) -> None:
            inputs = self._numbers | {name: texture for name, (texture, _) in self._textures.items()}
            single_layer = len({name.partition("_")[0] for name in inputs}) == 1
            for name, value in inputs.items():
                parameter = name.partition("_")[2] if single_layer else name
                callback.put(parameter, value, mi.ParamFlags.Differentiable)

        def parameters_changed(self, keys: Sequence[str] = ()) -> None:
            pass

        def sample(
            self, context: object, si: Interaction, sample1: Float, sample2: UV, active: Bool | bool = True
        ) -> tuple[object, Color3f]:
            evaluation, flip = self._evaluation(si)
            wi = mi.Vector3f(*evaluation.values("wi", u1=dr.detach(sample2.x), u2=dr.detach(sample2.y)))
            wi = dr.detach(wi)
            bs = mi.BSDFSample3f()
            bs.wo = flip(wi)
            value, pdf = self._respond(evaluation, wi, active)
            bs.eta, bs.sampled_component, bs.pdf = 1.0, mi.UInt32(0), pdf
            below = wi.z < 0.0
            bs.sampled_type = dr.select(
                below, mi.UInt32(+mi.BSDFFlags.GlossyTransmission), mi.UInt32(+mi.BSDFFlags.GlossyReflection)
            )
            weight = dr.select(pdf > 0.0, value / dr.select(pdf > 0.0, pdf, 1.0), 0.0)
            if self._source.see_through:
                absent = 1.0 - mi.Float(evaluation.values("presence")[0])
                share = dr.detach(absent)
                passes = active & (sample1 < share)
                bs.wo = dr.select(passes, -si.wi, bs.wo)
                bs.pdf = dr.select(passes, share, bs.pdf)
                bs.sampled_component = dr.select(passes, 1, bs.sampled_component)
                bs.sampled_type = dr.select(passes, mi.UInt32(+mi.BSDFFlags.Null), bs.sampled_type)
                weight = dr.select(passes, mi.Color3f(absent / dr.select(share > 0.0, share, 1.0)), weight)
            return bs, weight & active

        def eval(self, context: object, si: Interaction, wo: Vector3f, active: Bool | bool = True) -> Color3f:
            return self.eval_pdf(context, si, wo, active)[0]

        def pdf(self, context: object, si: Interaction, wo: Vector3f, active: Bool | bool = True) -> Float:
            return self.eval_pdf(context, si, wo, active)[1]

        def eval_pdf(
            self, context: object, si: Interaction, wo: Vector3f, active: Bool | bool = True
        ) -> tuple[Color3f, Float]:
            evaluation, flip = self._evaluation(si)
            return self._respond(evaluation, flip(wo), active)

        def eval_null_transmission(self, si: Interaction, active: Bool | bool = True) -> Color3f:
            if not self._source.see_through:
                return mi.Color3f(0.0)
            return mi.Color3f(1.0 - self._evaluation(si)[0].values("presence")[0])

        def to_string(self) -> str:
            return f"LookBSDF[{self._title}: {', '.join((*self._numbers, *self._textures))}]"

        def _respond(self, evaluation: Evaluation, wi: Vector3f, active: Bool | bool) -> tuple[Color3f, Float]:
            """Return the BSDF times the cosine, and the pdf with which `sample` draws a direction from its lobes."""
            directions = {"wi_x": wi.x, "wi_y": wi.y, "wi_z": wi.z}
            value = mi.Color3f(*evaluation.values("value", **directions))
            pdf = mi.Float(evaluation.values("pdf", **directions)[0])
            if self._source.see_through:
                pdf *= mi.Float(evaluation.values("presence")[0])
            valid = active & (wi.z != 0.0) if self._source.transmits else active & (wi.z > 0.0)
            return value & valid, dr.detach(dr.select(valid, pdf, 0.0))

        def _evaluation(self, si: Any) -> tuple[Evaluation, Callable[[Vector3f], Vector3f]]:
            """Return the program at points, and a function that maps directions between two shading frames.

            The frames are Mitsuba's and the program's. The function maps both ways, as it is its own inverse. Where the
            surface is seen from behind, the program's frame is Mitsuba's frame, rotated by 180 degrees about the
            tangent. Elsewhere, both frames are equal.
            """
            turn = dr.select(si.wi.z < 0.0, mi.Float(-1.0), mi.Float(1.0))

            def flip(w: Vector3f) -> Vector3f:
                return mi.Vector3f(w.x, turn * w.y, turn * w.z)

            wo = flip(si.wi)
            mirrored = dr.dot(dr.cross(si.dp_du, si.dp_dv), si.sh_frame.n) < 0.0
            handedness = turn * dr.select(mirrored, mi.Float(-1.0), mi.Float(1.0))
            # `handed` is the symbol by which programs convert normals from the frame of the UVs to the shading frame.
            values = {"wo_x": wo.x, "wo_y": wo.y, "wo_z": wo.z, "handed": handedness}
            values["inside"] = dr.select(turn < 0.0, mi.Float(1.0), mi.Float(0.0))
            inputs: dict[str, Any] = {}

            def symbol(name: str) -> Any:
                """Return the value of a symbol: ``name[0]`` is a component, ``name_a`` the alpha of an image."""
                if name in values:
                    return values[name]
                source, _, index = name.partition("[")
                alpha = name.endswith("_a") and name[:-2] in self._images
                source = name[:-2] if alpha else source
                if source not in inputs:
                    inputs[source] = self._read(source, si)
                return inputs[source][3 if alpha else int(index[:-1])] if alpha or index else inputs[source]

            return Evaluation(self._program, symbol), flip

        def _read(self, source: str, si: Interaction) -> Any:
            """Return the values of an image, a texture, a live input or the UV set at points."""
            if source in self._images:
                return self._images[source].texels(si.uv, mi.Bool(True))
            if source in self._textures:
                texture, parameter = self._textures[source]
                low, high = parameter.hard
                value = texture.eval_1(si) if parameter.kind == "float" else texture.eval(si)
                return dr.clip(value, low, high)
            if source in self._numbers:
                return self._numbers[source]
            return si.uv  # the only other source

    return LookBSDF
