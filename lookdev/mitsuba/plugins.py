"""Models and looks as BSDFs of Mitsuba 3 (Jakob et al. 2022), for scenes of its users: ``lookdev_disney``, ...

A plug-in's numbers are inputs of its kernels, seen by `mitsuba.traverse` and differentiable; the densities that
directions are drawn with are not differentiated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np

from lookdev.brdf import MODELS, Parameter
from lookdev.codegen import ProgramSource
from lookdev.codegen.program.look import generate_program, live_name, live_numbers, stated
from lookdev.errors import ModelError
from lookdev.material import Layer, Look
from lookdev.material.textures import image_file
from lookdev.material.usd import read_look
from lookdev.mitsuba.frozen import held
from lookdev.mitsuba.images import Images
from lookdev.mitsuba.programs import Place, Program

mi: Any = import_module("mitsuba")  # what a variant has is not in its annotations

_FILE, _PRIM, _VARIANT = "file", "prim", "variant_"


def model_bsdf(name: str, properties: Any) -> Any:
    """Return the BSDF of a model: its parameters are numbers, colours or textures of Mitsuba, tokens are texts.

    Raises ModelError where a parameter is unknown or outside its range.
    """
    parameters = MODELS[name].parameters
    given = {key: properties[key] for key in properties if key in parameters}
    if unknown := properties.unqueried():
        raise ModelError(f"{name}: no parameter '{unknown[0]}'; it has: {', '.join(parameters)}")
    textures = {key: each for key, each in given.items() if isinstance(each, mi.Texture)}
    inputs = {key: _constant(each, parameters[key]) for key, each in given.items()}
    look = Look(name, (Layer(name, name, inputs),))
    return _bsdf(properties, look, {live_name(0, key): (each, parameters[key]) for key, each in textures.items()})


def look_bsdf(properties: Any) -> Any:
    """Return the BSDF of a look of a USD file.

    Raises
    ------
    LookError
        Every fault of the look.
    CodegenError
        It needs what a BSDF of Mitsuba has not: primvars, two UV sets, single directions.
    """
    if _FILE not in properties:
        raise ModelError(f"lookdev_look: no '{_FILE}'; the path of a USD file of a look would be right")
    file, prim = Path(str(properties[_FILE])), str(properties[_PRIM]) if _PRIM in properties else None
    sets = [key for key in properties if key.startswith(_VARIANT)]
    variants = {key.removeprefix(_VARIANT): str(properties[key]) for key in sets}
    if unknown := properties.unqueried():
        raise ModelError(f"lookdev_look: no '{unknown[0]}'; it has: {_FILE}, {_PRIM}, {_VARIANT}<set>")
    return _bsdf(properties, read_look(file, prim, variants), {})


def _constant(value: Any, parameter: Parameter) -> Any:
    """Return an input of a layer; of a texture, a number in its place."""
    if isinstance(value, mi.Texture):
        return parameter.default if parameter.kind == "float" else tuple(np.broadcast_to(parameter.default, 3).tolist())
    if parameter.kind == "token":
        return str(value)
    numbers = np.array(value, dtype=np.float64).ravel()
    return float(numbers[0]) if parameter.kind == "float" else tuple(map(float, np.broadcast_to(numbers, 3)))


def _bsdf(properties: Any, look: Look, textures: Mapping[str, tuple[Any, Parameter]]) -> Any:
    live = stated(look)
    source = generate_program(look, image_file, live=live)
    source.check_plugin(look.name)
    return _class(mi.variant())(properties, look, source, live_numbers(look, live), textures)


@cache
def _class(variant: str) -> Any:
    """Return the class of the current variant."""

    class LookBSDF(mi.BSDF):  # type: ignore[misc]
        """The program of a look."""

        def __init__(
            self,
            properties: Any,
            look: Look,
            source: ProgramSource,
            numbers: Mapping[str, tuple[float, ...]],
            textures: Mapping[str, tuple[Any, Parameter]],
        ) -> None:
            mi.BSDF.__init__(self, properties)
            self._title = look.name
            self._source = source
            tables = [held(mi.Float, np.load(each.path)) for each in source.tables]
            self._constants = [mi.Float(value) for value in source.constants]
            self._program = Program(source.operations, source.outputs, mi.Float, self._constants, tables)
            self._images = {each.name: Images(mi, each) for each in source.look_ups}
            self._textures = dict(textures)
            kinds = {name: mi.Float if len(each) == 1 else mi.Color3f for name, each in numbers.items()}
            self._numbers = {n: kinds[n](*each) for n, each in numbers.items() if n not in textures}
            flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
            components = [flags | mi.BSDFFlags.SpatiallyVarying]
            if source.transmits:
                components[0] |= mi.BSDFFlags.GlossyTransmission
            if source.see_through:
                components.append(mi.BSDFFlags.Null | mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide)
            self.m_components = components
            self.m_flags = components[0] | components[-1]

        def traverse(self, callback: Any) -> None:
            inputs = self._numbers | {name: texture for name, (texture, _) in self._textures.items()}
            alone = len({name.partition("_")[0] for name in inputs}) == 1
            for name, value in inputs.items():
                shown = name.partition("_")[2] if alone else name
                callback.put(shown, value, mi.ParamFlags.Differentiable)

        def parameters_changed(self, keys: Any = ()) -> None:
            pass

        def sample(self, context: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> tuple[Any, Any]:
            place, side = self._place(si)
            drawn = mi.Vector3f(*place.values("wi", u1=dr.detach(sample2.x), u2=dr.detach(sample2.y)))
            drawn = dr.detach(drawn)
            bs = mi.BSDFSample3f()
            bs.wo = side(drawn)
            value, pdf = self._respond(place, drawn, active)
            bs.eta, bs.sampled_component, bs.pdf = 1.0, mi.UInt32(0), pdf
            below = drawn.z < 0.0
            bs.sampled_type = dr.select(
                below, mi.UInt32(+mi.BSDFFlags.GlossyTransmission), mi.UInt32(+mi.BSDFFlags.GlossyReflection)
            )
            weight = dr.select(pdf > 0.0, value / dr.select(pdf > 0.0, pdf, 1.0), 0.0)
            if self._source.see_through:
                absent = 1.0 - mi.Float(place.values("presence")[0])
                share = dr.detach(absent)
                passes = active & (sample1 < share)
                bs.wo = dr.select(passes, -si.wi, bs.wo)
                bs.pdf = dr.select(passes, share, bs.pdf)
                bs.sampled_component = dr.select(passes, 1, bs.sampled_component)
                bs.sampled_type = dr.select(passes, mi.UInt32(+mi.BSDFFlags.Null), bs.sampled_type)
                weight = dr.select(passes, mi.Color3f(absent / dr.select(share > 0.0, share, 1.0)), weight)
            return bs, weight & active

        def eval(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(context, si, wo, active)[0]

        def pdf(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(context, si, wo, active)[1]

        def eval_pdf(self, context: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
            place, side = self._place(si)
            return self._respond(place, side(wo), active)

        def eval_null_transmission(self, si: Any, active: Any = True) -> Any:
            if not self._source.see_through:
                return mi.Color3f(0.0)
            return mi.Color3f(1.0 - self._place(si)[0].values("presence")[0])

        def to_string(self) -> str:
            return f"LookBSDF[{self._title}: {', '.join((*self._numbers, *self._textures))}]"

        def _respond(self, place: Place, wi: Any, active: Any) -> tuple[Any, Any]:
            """Return the BSDF times the cosine, and the density of what is drawn and not passed."""
            given = {"wi_x": wi.x, "wi_y": wi.y, "wi_z": wi.z}
            value = mi.Color3f(*place.values("value", **given))
            pdf = mi.Float(place.values("pdf", **given)[0])
            if self._source.see_through:
                pdf *= mi.Float(place.values("presence")[0])
            met = active & (wi.z != 0.0) if self._source.transmits else active & (wi.z > 0.0)
            return value & met, dr.detach(dr.select(met, pdf, 0.0))

        def _place(self, si: Any) -> tuple[Place, Callable[[Any], Any]]:
            """Return the program at places, and what turns directions of Mitsuba's frame into its own, and back.

            Seen from behind, the frame is turned by half about its tangent.
            """
            turn = dr.select(si.wi.z < 0.0, mi.Float(-1.0), mi.Float(1.0))

            def side(w: Any) -> Any:
                return mi.Vector3f(w.x, turn * w.y, turn * w.z)

            wo = side(si.wi)
            mirrored = dr.dot(dr.cross(si.dp_du, si.dp_dv), si.sh_frame.n) < 0.0
            handed = turn * dr.select(mirrored, mi.Float(-1.0), mi.Float(1.0))
            known = {"wo_x": wo.x, "wo_y": wo.y, "wo_z": wo.z, "handed": handed, "hand": handed}
            known["inside"] = dr.select(turn < 0.0, mi.Float(1.0), mi.Float(0.0))
            read: dict[str, Any] = {}

            def symbol(name: str) -> Any:
                if name in known:
                    return known[name]
                source, _, index = name.partition("[")
                alpha = name.endswith("_a") and name[:-2] in self._images
                source = name[:-2] if alpha else source
                if source not in read:
                    read[source] = self._read(source, si)
                return read[source][3 if alpha else int(index[:-1])] if alpha or index else read[source]

            return Place(self._program, symbol), side

        def _read(self, source: str, si: Any) -> Any:
            if source in self._images:
                return self._images[source].texels(si.uv, mi.Bool(True))
            if source in self._textures:
                texture, parameter = self._textures[source]
                low, high = parameter.hard
                value = texture.eval_1(si) if parameter.kind == "float" else texture.eval(si)
                return dr.clip(value, low, high)
            if source in self._numbers:
                return self._numbers[source]
            return si.uv  # the only other attribute

    return LookBSDF
