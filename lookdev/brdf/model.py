"""The record of a reflectance model, and of a layer that is made of one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from lookdev.brdf.lobes import Bsdf
from lookdev.brdf.parameters import Parameter, Value
from lookdev.brdf.vectors import Parameters, Real, mix
from lookdev.errors import ModelError, nearest_hint

Mode = Literal["over", "transmit"]


@dataclass(frozen=True)
class StackLayer:
    """One layer: its model, all of the model's parameters, its mask (...) in [0, 1], and how it meets what is beneath.

    The mask of the base has no meaning: nothing is beneath it.
    """

    model: str
    parameters: Parameters
    mask: Real = 1.0
    mode: Mode = "over"


@dataclass(frozen=True)
class Preview:
    """A model's approximation by UsdPreviewSurface.

    `same` maps its inputs to the parameters that have the same meaning, ``opacity`` to the presence of a layer.
    `derived` computes ``clearcoat``, ``clearcoatRoughness``, ``opacity`` and ``f0``, the reflectance at normal
    incidence, where they are not the defaults, from all parameters as float64 arrays, () or (3,).
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
        From tokens, by name, to an upper bound of the directional albedo where no normal leans and no number whose
        default is at most 1 is above 1; the bound is above 1 where the published model does not conserve energy.
    reciprocal
        From tokens, by name, to the names of the lobes with f(wo, wi) = f(wi, wo) where no normal leans.
    modes
        How a layer may lie on layers of the same model.
    two_sided
        Whether the surface is thin and looks alike from both sides.
    probe
        Parameters, the rest at their defaults, for which no lobe has share 0 and the surface is isotropic.
    preview
        The approximation by UsdPreviewSurface.
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
    two_sided: bool = False
    probe: Mapping[str, Value] = field(default_factory=dict)
    preview: Preview = field(default_factory=Preview)

    def stack(self, layers: Sequence[StackLayer]) -> Bsdf:
        """Combine layers of this model, base first, into one surface; tokens that differ raise ModelError."""
        return self.combine(layers) if self.combine else self.bsdf(self.blended(layers))

    def blended(self, layers: Sequence[StackLayer]) -> Parameters:
        """Blend the parameters of layers, base first, by their masks (Burley 2012, section 5.7).

        The result is exactly the upper layer's value where its mask is 1, exactly the value beneath where it is 0.
        Tokens that differ raise ModelError.
        """
        blended = dict(layers[0].parameters)
        for layer in layers[1:]:
            for name, parameter in self.parameters.items():
                blended[name] = _blended(parameter, blended[name], layer.parameters[name], layer.mask)
        return blended

    def complete(self, given: Mapping[str, object]) -> dict[str, Any]:
        """Check constant parameters and fill in the defaults.

        Floats become float64 scalars, colours and normals arrays of shape (3,), tokens stay strings.

        Raises
        ------
        ModelError
            A parameter is unknown, of the wrong type, not finite or outside its hard range.
        """
        for name in given:
            if name not in self.parameters:
                hint = nearest_hint(name, list(self.parameters))
                raise ModelError(f"{self.name}: unknown parameter '{name}' ({hint})")
        return {
            name: _checked(self.name, parameter, given.get(name, parameter.default))
            for name, parameter in self.parameters.items()
        }


def _blended(parameter: Parameter, below: Any, above: Any, mask: Real) -> Any:
    if parameter.kind != "token":
        return mix(below, above, mask if parameter.kind == "float" else np.expand_dims(mask, -1))
    if below != above:
        values = f"'{below}' below, '{above}' above"
        raise ModelError(f"layers disagree on '{parameter.name}': {values}; all layers of a stack must use the same")
    return below


def _checked(model: str, parameter: Parameter, value: object) -> Any:
    place = f"{model}.{parameter.name}"
    if parameter.kind == "token":
        if value not in parameter.choices:
            raise ModelError(f"{place} is {value!r}; one of {', '.join(parameter.choices)} would be right")
        return value
    shape = () if parameter.kind == "float" else (3,)
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.empty(0)
    if isinstance(value, (str, bool)) or array.shape != shape:
        raise ModelError(f"{place} is {value!r}; {'three numbers' if shape else 'a number'} would be right")
    low, high = parameter.hard
    if not np.all((array >= low) & (array <= high)):
        raise ModelError(f"{place} is {value!r}; its range is {low:g} to {high:g}")
    if parameter.kind == "normal" and not array.any():
        raise ModelError(f"{place} is {value!r}; a vector with a direction would be right")
    return array
