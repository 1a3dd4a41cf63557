"""The records `Model`, a reflectance model with all that the package knows of it, and `StackLayer`, a layer of a look.

Each model's file defines one `Model`. The renderers, checks, plots and documentation read these records.
"""

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
"""How a layer is combined with the layers beneath.

``"over"``: the layer covers them by its mask and presence. ``"transmit"``: the light that the layer transmits meets
them. ``"coat"``: the layer reflects light, which then does not reach them.
"""


@dataclass(frozen=True)
class StackLayer:
    """One layer of a look at some points: the name of its model, and the values of all parameters of the model.

    `mask` (...), in [0, 1], is how much of the layer there is. The mask of the base has no meaning, as nothing is
    beneath it. `name` is the layer's name for people.
    """

    model: str
    parameters: Parameters
    mask: Real = 1.0
    mode: Mode = "over"
    name: str = ""


@dataclass(frozen=True)
class Preview:
    """The approximation of a model by UsdPreviewSurface.

    `same` maps inputs of UsdPreviewSurface to the model's parameters with the same meaning. The parameter for
    ``opacity`` is the presence of a layer. `derived` is a function of all parameters (tokens, and float64 arrays () or
    (3,)) that returns the values of other inputs by name. Inputs that it leaves out have their defaults. Instead of
    ``ior``, the function returns ``f0``, the reflectance at normal incidence, which determines the index of refraction.
    """

    same: Mapping[str, str] = field(default_factory=dict)
    derived: Callable[[Parameters], dict[str, Real]] = lambda parameters: {}


@dataclass(frozen=True)
class Model:
    """A reflectance model.

    name
        The model's name in files and messages.
    title
        The short name for people.
    text
        A sentence that describes the model and names the publication.
    parameters
        The parameters by name, in the order of the documentation.
    bsdf
        Function of all parameters, by name, that returns the BSDF of one layer.
    combine
        Function of layers of this model, base first, that returns one BSDF. If a model has no such function, the masks
        blend the parameters of its layers.
    identifier
        The `info:id` of the model's UsdShade shader.
    energy
        Function of the tokens, by name, that returns an upper bound of the directional albedo. The bound is above 1 if
        the published model does not conserve energy. The bound holds if all normals are the shading normal, optional
        numbers have their defaults, and numbers whose default is at most 1 are at most 1.
    reciprocal
        Function of the tokens, by name, that returns the names of reciprocal lobes. Their f(wo, wi) is f(wi, wo) if all
        normals are the shading normal.
    modes
        The modes that a layer may have.
    reflectance
        Function of all parameters and of unit views (..., 3) above the horizon, for a model with mode ``"coat"``. It
        returns the directional albedo (...) of a layer, which is the share of light that the layers beneath do not
        receive.
    two_sided
        Whether the surface is thin, and scatters in the same way from both sides.
    probe
        Values of parameters at which checks and tests evaluate the model. Other parameters have their defaults. With
        these values, no lobe has share 0, and the surface is isotropic.
    preview
        The approximation by UsdPreviewSurface.
    delta
        Whether the model scatters along single directions only, and has no lobes.
    quotes, quote_source
        Verbatim quotations about parameters, by the parameter's name, and their publication and section.
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
        """Combine layers of this model, base first, into one BSDF; raise ModelError if they differ in a token."""
        return self.combine(layers) if self.combine else self.bsdf(self.blend(layers))

    def blend(self, layers: Sequence[StackLayer]) -> Parameters:
        """Blend the parameters of layers, base first, by their masks (Burley 2012, section 5.7).

        A blended value is exactly the upper layer's value where that layer's mask and presence are 1, and exactly the
        value beneath where that layer's mask is 0. If the model has a presence, the layers need not cover the whole
        surface. The weight of a layer is then its share of the part that they cover.

        Raises
        ------
        ModelError
            The layers differ in a token.
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
        """Return the defaults of the parameters that are optional numbers, by name."""
        optional = {name: parameter.default for name, parameter in self.parameters.items() if parameter.optional}
        return {name: default for name, default in optional.items() if isinstance(default, float)}

    def must_blend_separately(self, first: Parameters, second: Parameters) -> bool:
        """Return whether layers with these parameters differ in a token whose `agreement` is ``"apart"``."""
        return any(
            parameter.agreement == "apart" and first[name] != second[name]
            for name, parameter in self.parameters.items()
        )

    def forms(self) -> dict[str, tuple[str, ...]]:
        """Return the choices of each token that selects a form of the model, by the token's name."""
        return {
            parameter.name: parameter.choices
            for parameter in self.parameters.values()
            if parameter.choices and not parameter.expand
        }

    def tokens(self, values: Mapping[str, str]) -> dict[str, str]:
        """Return the values of all tokens of the model by name: those in `values`, and defaults for the others."""
        return {
            parameter.name: str(parameter.default)
            for parameter in self.parameters.values()
            if parameter.kind == "token"
        } | dict(values)

    def complete(self, constants: Mapping[str, object]) -> dict[str, Floats | str]:
        """Return the values of all parameters: `constants`, and defaults for the others (`parameters.complete`)."""
        return complete(self.name, self.parameters, constants)


_PRESENCE = "presence"


def _share_and_presence(below: Parameters, layer: StackLayer) -> tuple[Real, Real]:
    """Return the visible share (...) of a layer above one with parameters `below`, and their joint presence (...)."""
    coverage, presence_below = layer.mask * layer.parameters.get(_PRESENCE, 1.0), below.get(_PRESENCE, 1.0)
    if are_equal(presence_below, 1.0):
        return coverage, presence_below + 0.0 * coverage  # has the shape of the mask
    presence = coverage + (1.0 - coverage) * presence_below
    return np.where(presence > 0.0, coverage / np.where(presence > 0.0, presence, 1.0), 0.0), presence


def _blend(parameter: Parameter, below: Real | str, above: Real | str, mask: Real) -> Real | str:
    """Return the blend of a parameter's values in two layers; tokens must be equal."""
    if not isinstance(below, str) and not isinstance(above, str):
        return mix(below, above, mask if parameter.kind == "float" else np.expand_dims(mask, -1))
    if below != above:
        values = f"'{below}' below, '{above}' above"
        raise ModelError(f"layers disagree on '{parameter.name}': {values}; all layers of a stack must use the same")
    return below
