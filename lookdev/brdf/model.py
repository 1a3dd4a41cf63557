"""The record of a reflectance model, and of a layer that is made of one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from lookdev.brdf.lobes import Bsdf
from lookdev.brdf.parameters import Parameter, Value, complete
from lookdev.brdf.vectors import Array, Parameters, Real, mix, same
from lookdev.errors import ModelError

Mode = Literal["over", "transmit", "coat"]
"""How a layer lies on what is beneath: it covers it by mask and presence; what it transmits meets it; or it reflects,
and withholds that from it."""


@dataclass(frozen=True)
class StackLayer:
    """One layer: its model, all of the model's parameters, its mask (...) in [0, 1], and how it meets what is beneath.

    The mask of the base has no meaning: nothing is beneath it. `name` is for readers.
    """

    model: str
    parameters: Parameters
    mask: Real = 1.0
    mode: Mode = "over"
    name: str = ""


@dataclass(frozen=True)
class Preview:
    """A model's approximation by UsdPreviewSurface.

    `same` maps its inputs to the parameters that have the same meaning, ``opacity`` to the presence of a layer.
    `derived` computes other inputs where they are not the defaults, and ``f0``, the reflectance at normal incidence,
    for the index of refraction, from all parameters: tokens, and float64 arrays, () or (3,).
    """

    same: Mapping[str, str] = field(default_factory=dict)
    derived: Callable[[Parameters], dict[str, Real]] = lambda parameters: {}


@dataclass(frozen=True)
class Model:
    """A reflectance model.

    name, title, text
        The token in files and messages, the short name for readers, and a sentence with the publication.
    parameters
        By name, in the order in which they are documented.
    bsdf
        From all parameters to the surface of one layer.
    combine
        From layers of this model, base first, to one surface; None: their parameters are blended by the masks.
    identifier
        `info:id` of the UsdShade shader.
    energy
        From tokens, by name, to an upper bound of the directional albedo where no normal leans, optional numbers are at
        their defaults and no number whose default is at most 1 is above 1; the bound is above 1 where the published
        model does not conserve energy.
    reciprocal
        From tokens, by name, to the names of the lobes with f(wo, wi) = f(wi, wo) where no normal leans.
    modes
        How a layer may lie on others.
    reflectance
        In mode ``"coat"``: from all parameters and unit views (..., 3) above the horizon to the share of light, (...),
        that a layer withholds from what is beneath, its directional albedo.
    two_sided
        Whether the surface is thin and looks alike from both sides.
    probe
        Parameters, the rest at their defaults, for which no lobe has share 0 and the surface is isotropic.
    preview
        The approximation by UsdPreviewSurface.
    delta
        Whether it scatters along single directions alone, and has no lobes.
    quotes
        What a publication says of parameters, word by word, by their names; `quoted` is the publication and the place.
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
    probe: Mapping[str, Value] = field(default_factory=dict)
    preview: Preview = field(default_factory=Preview)
    delta: bool = False
    quotes: Mapping[str, str] = field(default_factory=dict)
    quoted: str = ""

    def stack(self, layers: Sequence[StackLayer]) -> Bsdf:
        """Combine layers of this model, base first, into one surface; tokens that differ raise ModelError."""
        return self.combine(layers) if self.combine else self.bsdf(self.blended(layers))

    def blended(self, layers: Sequence[StackLayer]) -> Parameters:
        """Blend the parameters of layers, base first, by their masks (Burley 2012, section 5.7).

        The result is exactly the upper layer's value where its mask is 1, exactly the value beneath where it is 0.
        Tokens that differ raise ModelError. Presence is coverage, as the mask is: each layer has weight by what is seen
        of it.
        """
        blended = dict(layers[0].parameters)
        for layer in layers[1:]:
            share, presence = _seen(blended, layer)
            for name, parameter in self.parameters.items():
                blended[name] = _blended(parameter, blended[name], layer.parameters[name], share)
            if _PRESENCE in self.parameters:
                blended[_PRESENCE] = presence
        return blended

    def options_left_out(self) -> dict[str, float]:
        """Return the defaults of optional numbers, by name."""
        optional = {name: each.default for name, each in self.parameters.items() if each.optional}
        return {name: default for name, default in optional.items() if isinstance(default, float)}

    def apart(self, one: Parameters, other: Parameters) -> bool:
        """Return whether layers with these parameters differ in a token by which they cannot be combined."""
        return any(
            parameter.among == "apart" and one[name] != other[name] for name, parameter in self.parameters.items()
        )

    def forms(self) -> dict[str, tuple[str, ...]]:
        """Return the choices of each token that chooses a form of the model, by name."""
        return {each.name: each.choices for each in self.parameters.values() if each.choices and not each.stands}

    def tokens(self, given: Mapping[str, str]) -> dict[str, str]:
        """Return all tokens of the model, by name: those that are given, and defaults."""
        return {each.name: str(each.default) for each in self.parameters.values() if each.kind == "token"} | dict(given)

    def complete(self, given: Mapping[str, object]) -> dict[str, Any]:
        """Return `lookdev.brdf.parameters.complete` of this model."""
        return complete(self.name, self.parameters, given)


_PRESENCE = "presence"


def _seen(below: Parameters, layer: StackLayer) -> tuple[Real, Real]:
    """Return the layer's share of what is there of it and of a layer below, and how much is there of both."""
    covered, beneath = layer.mask * layer.parameters.get(_PRESENCE, 1.0), below.get(_PRESENCE, 1.0)
    if same(beneath, 1.0):
        return covered, beneath + 0.0 * covered  # of the mask's shape
    presence = covered + (1.0 - covered) * beneath
    return np.where(presence > 0.0, covered / np.where(presence > 0.0, presence, 1.0), 0.0), presence


def _blended(parameter: Parameter, below: Any, above: Any, mask: Real) -> Any:
    if parameter.kind != "token":
        return mix(below, above, mask if parameter.kind == "float" else np.expand_dims(mask, -1))
    if below != above:
        values = f"'{below}' below, '{above}' above"
        raise ModelError(f"layers disagree on '{parameter.name}': {values}; all layers of a stack must use the same")
    return below
