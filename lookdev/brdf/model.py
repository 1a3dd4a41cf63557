"""The record of a reflectance model, and of a layer that is made of one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from lookdev.brdf.layering import blend_parameters
from lookdev.brdf.lobes import Bsdf
from lookdev.brdf.parameters import Parameter, Value
from lookdev.brdf.vectors import Parameters, Real
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
    """A model's likeness in UsdPreviewSurface.

    `same` maps its inputs to the parameters that have the same meaning, ``opacity`` to the presence of a layer.
    `derived` computes ``clearcoat``, ``clearcoatRoughness``, ``opacity`` and ``f0``, the reflectance at normal
    incidence, where they are not the defaults, from all parameters as float64 arrays, () or (3,).
    """

    same: Mapping[str, str] = field(default_factory=dict)
    derived: Callable[[Parameters], dict[str, Real]] = lambda parameters: {}


@dataclass(frozen=True)
class Model:
    """All that the program knows of a reflectance model.

    name, title, text
        The token in files and messages, the short name for readers, and a sentence with the publication.
    parameters
        By name, in the order in which they are documented.
    bsdf
        From all parameters to the surface of one layer.
    combine
        From layers of this model, base first, to one surface; None: their parameters are blended by the masks.
    identifier
        Of the UsdShade shader, `info:id`.
    energy
        From tokens, by name, to an upper bound of the directional albedo over all other parameters; above 1 where the
        published model does not conserve energy.
    modes
        How a layer may lie on layers of the same model.
    two_sided
        Whether the surface is thin and looks alike from both sides.
    probe
        Parameters, the rest at their defaults, with which every lobe is there and nothing is directed.
    preview
        The likeness in UsdPreviewSurface.
    """

    name: str
    title: str
    text: str
    parameters: Mapping[str, Parameter]
    bsdf: Callable[[Parameters], Bsdf]
    identifier: str
    energy: Callable[[Mapping[str, str]], float] = lambda tokens: 1.0
    combine: Callable[[Sequence[StackLayer]], Bsdf] | None = None
    modes: tuple[Mode, ...] = ("over",)
    two_sided: bool = False
    probe: Mapping[str, Value] = field(default_factory=dict)
    preview: Preview = field(default_factory=Preview)

    def stack(self, layers: Sequence[StackLayer]) -> Bsdf:
        """Combine layers of this model, base first, into one surface.

        Raises
        ------
        ModelError
            Layers differ in a token.
        """
        return self.combine(layers) if self.combine else self.bsdf(self.blended(layers))

    def blended(self, layers: Sequence[StackLayer]) -> Parameters:
        """Blend the parameters of layers, base first, by their masks.

        Raises
        ------
        ModelError
            Layers differ in a token.
        """
        parameters = layers[0].parameters
        for layer in layers[1:]:
            parameters = blend_parameters(self.parameters, parameters, layer.parameters, layer.mask)
        return parameters

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
                raise ModelError(
                    f"{self.name}: unknown parameter '{name}' ({nearest_hint(name, list(self.parameters))})"
                )
        return {
            name: _checked(self.name, parameter, given.get(name, parameter.default))
            for name, parameter in self.parameters.items()
        }


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
        wanted = "three numbers" if shape else "a number"
        raise ModelError(f"{place} is {value!r}; {wanted} would be right")
    low, high = parameter.hard
    if not np.all((array >= low) & (array <= high)):
        raise ModelError(f"{place} is {value!r}; its range is {low:g} to {high:g}")
    if parameter.kind == "normal" and not array.any():
        raise ModelError(f"{place} is {value!r}; a vector with a direction would be right")
    return array
