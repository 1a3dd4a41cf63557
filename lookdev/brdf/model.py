"""The records of a reflectance model, and of a layer of a stack."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf.lobes import Bsdf
from lookdev.brdf.parameters import Parameter, ParameterValue, complete
from lookdev.brdf.vectors import Array, Parameters, Real, are_equal, mix
from lookdev.errors import ModelError

Mode = Literal["over", "transmit", "coat"]
"""How a layer combines with the layers beneath.

``"over"``: it covers them by mask and presence. ``"transmit"``: the light that it transmits meets them. ``"coat"``: it
reflects, and withholds the reflected light from them.
"""


@dataclass(frozen=True)
class StackLayer:
    """One layer: its model, all of the model's parameters, its mask (...) in [0, 1], and its mode.

    The mask of the base has no meaning, as nothing is beneath it. `name` is for readers.
    """

    model: str
    parameters: Parameters
    mask: Real = 1.0
    mode: Mode = "over"
    name: str = ""


@dataclass(frozen=True)
class Preview:
    """A model's approximation by UsdPreviewSurface.

    `same` maps inputs of UsdPreviewSurface to parameters of the same meaning; that of ``opacity`` is the presence of a
    layer.
    `derived` maps all parameters (tokens, and float64 arrays, () or (3,)) to the other inputs that differ from their
    defaults. Its ``f0``, the reflectance at normal incidence, determines the index of refraction.
    """

    same: Mapping[str, str] = field(default_factory=dict)
    derived: Callable[[Parameters], dict[str, Real]] = lambda parameters: {}


@dataclass(frozen=True)
class Model:
    """A reflectance model.

    name, title, text
        The token in files and messages, the short name for readers, and a sentence with the publication.
    parameters
        The parameters by name, in the order of the documentation.
    bsdf
        Function of all parameters that returns the surface of one layer.
    combine
        Function of layers of this model, base first, that returns one surface. Without it, the masks blend the layers'
        parameters.
    identifier
        `info:id` of the UsdShade shader.
    energy
        Function of the tokens, by name, that returns an upper bound of the directional albedo. It is above 1 where the
        published model does not conserve energy. The bound holds if all normals are the shading normal, optional
        numbers have their defaults, and numbers whose default is at most 1 are at most 1.
    reciprocal
        Function of the tokens, by name, that returns the names of the lobes with f(wo, wi) = f(wi, wo) where all
        normals are the shading normal.
    modes
        The modes that a layer may have.
    reflectance
        For mode ``"coat"``: function of all parameters and unit views (..., 3) above the horizon. It returns the
        directional albedo of a layer, (...), which is the share of light that the layers beneath do not receive.
    two_sided
        Whether the surface is thin and scatters alike from both sides.
    probe
        Parameters at which checks and tests evaluate the model, the rest at their defaults. No lobe has share 0, and
        the surface is isotropic.
    preview
        The approximation by UsdPreviewSurface.
    delta
        Whether the model scatters along single directions only, and has no lobes.
    quotes
        Verbatim quotations about parameters, by parameter; `quote_source` has the publication and the section.
    """

    name: str
    title: str
    text: str
    parameters: Mapping[str, Parameter]
    bsdf: Callable[[Parameters], Bsdf]
    identifier: str
    energy: Callable[[Mapping[str, str]], float] = lambda tokens: 1.0
    reciprocal: Callable[[Mapping[str, str]], tuple[str, ...]] = lambda tokens: ()
    combine: Callable[[Sequence[StackLayer]], Bsdf] | None = None
    modes: tuple[Mode, ...] = ("over",)
    reflectance: Callable[[Parameters, Array], Real] | None = None
    two_sided: bool = False
    probe: Mapping[str, ParameterValue] = field(default_factory=dict)
    preview: Preview = field(default_factory=Preview)
    delta: bool = False
    quotes: Mapping[str, str] = field(default_factory=dict)
    quote_source: str = ""

    def stack(self, layers: Sequence[StackLayer]) -> Bsdf:
        """Combine layers of this model, base first, into one surface; raises ModelError for tokens that differ."""
        return self.combine(layers) if self.combine else self.bsdf(self.blend(layers))

    def blend(self, layers: Sequence[StackLayer]) -> Parameters:
        """Blend the parameters of layers, base first, by their masks (Burley 2012, section 5.7).

        The result is exactly the upper layer's value where its mask is 1, and exactly the value beneath where it is 0.
        Presence is coverage, as the mask is: the weight of a layer is its visible share. Raises ModelError for tokens
        that differ.
        """
        blended = dict(layers[0].parameters)
        for layer in layers[1:]:
            share, presence = _share_and_presence(blended, layer)
            for name, parameter in self.parameters.items():
                blended[name] = _blend(parameter, blended[name], layer.parameters[name], share)
            if _PRESENCE in self.parameters:
                blended[_PRESENCE] = presence
        return blended

    def optional_defaults(self) -> dict[str, float]:
        """Return the defaults of optional numbers, by name."""
        optional = {name: parameter.default for name, parameter in self.parameters.items() if parameter.optional}
        return {name: default for name, default in optional.items() if isinstance(default, float)}

    def must_blend_separately(self, first: Parameters, second: Parameters) -> bool:
        """Return whether layers with these parameters differ in a token that the model cannot combine."""
        return any(
            parameter.agreement == "apart" and first[name] != second[name]
            for name, parameter in self.parameters.items()
        )

    def forms(self) -> dict[str, tuple[str, ...]]:
        """Return the choices of each token that selects a form of the model, by name."""
        return {
            parameter.name: parameter.choices
            for parameter in self.parameters.values()
            if parameter.choices and not parameter.expand
        }

    def tokens(self, values: Mapping[str, str]) -> dict[str, str]:
        """Return all tokens of the model by name: `values`, and the defaults of the rest."""
        return {
            parameter.name: str(parameter.default)
            for parameter in self.parameters.values()
            if parameter.kind == "token"
        } | dict(values)

    def complete(self, constants: Mapping[str, object]) -> dict[str, Floats | str]:
        """Return `lookdev.brdf.parameters.complete` of this model."""
        return complete(self.name, self.parameters, constants)


_PRESENCE = "presence"


def _share_and_presence(below: Parameters, layer: StackLayer) -> tuple[Real, Real]:
    """Return the layer's share of the coverage of both layers, and that coverage: the presence of the blend."""
    coverage, presence_below = layer.mask * layer.parameters.get(_PRESENCE, 1.0), below.get(_PRESENCE, 1.0)
    if are_equal(presence_below, 1.0):
        return coverage, presence_below + 0.0 * coverage  # has the shape of the mask
    presence = coverage + (1.0 - coverage) * presence_below
    return np.where(presence > 0.0, coverage / np.where(presence > 0.0, presence, 1.0), 0.0), presence


def _blend(parameter: Parameter, below: Real | str, above: Real | str, mask: Real) -> Real | str:
    if not isinstance(below, str) and not isinstance(above, str):
        return mix(below, above, mask if parameter.kind == "float" else np.expand_dims(mask, -1))
    if below != above:
        values = f"'{below}' below, '{above}' above"
        raise ModelError(f"layers disagree on '{parameter.name}': {values}; all layers of a stack must use the same")
    return below
