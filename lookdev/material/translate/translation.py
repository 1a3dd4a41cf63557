"""The record of a translation: a foreign shading model as layers of our models."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from math import inf
from typing import Any

from lookdev.brdf import Parameter, StackLayer
from lookdev.brdf.vectors import Parameters
from lookdev.material import Input

_NORMALS = {"Tworld": (1.0, 0.0, 0.0)}
"""The default of a vector by the input's ``defaultgeomprop``; without an entry here, it is the shading normal."""


class Reason(StrEnum):
    """Reasons of losses that several models share."""

    EMISSION = "surfaces emit no light"
    TANGENT = "the tangent is that of the UVs"
    ROTATION = "highlights are stretched along the tangent or across it"
    THIN_FILM = "thin films do not interfere"
    HUE_AT_GRAZING = "of coloured reflections, the hue ends at grazing views"
    SUBSURFACE = "light leaves where it enters, as from a diffuse surface of its colour"
    TRANSMISSION = "light passes as through a thin shell, and is not blurred"
    VOLUME = "what is inside does not absorb or scatter light"
    SHEEN = "its mean over all views is added to the diffuse colour"
    DIFFUSE_ROUGHNESS = "the diffuse colour is darker, by the mean over all views"


@dataclass(frozen=True)
class Loss:
    """The reason why an input that differs from its default is lost, wholly or in part.

    Nothing is lost where another input, which the input `needs`, is constantly 0 or black. With `unless_gray`, nothing
    is lost where the input is a constant colour without hue.
    """

    reason: str
    needs: str = ""
    unless_gray: bool = False


@dataclass(frozen=True)
class Translation:
    """A foreign shading model, and its translation to layers of our models.

    name, title
        The `Layer.model` of layers of this model, and a short name for messages.
    identifier
        The `info:id` of its shader node, of USD or of MaterialX.
    library
        The file of its definition among those of MaterialX's library of surface shaders.
    layers
        The function from all foreign parameters to layers, base first. A layer has the parameters that differ from its
        model's defaults, within their hard ranges. The base lies ``"over"`` the layers beneath; the others lie on the
        base. Code generation traces the function, which is plain NumPy.
    loss_reasons
        Why inputs are lost, by their names.
    overrides
        The parameters that differ from those of the definition, by name.
    """

    name: str
    title: str
    identifier: str
    library: str
    layers: Callable[[Parameters], list[StackLayer]]
    loss_reasons: Mapping[str, Loss]
    overrides: Mapping[str, Parameter] = field(default_factory=dict)

    @cached_property
    def parameters(self) -> Mapping[str, Parameter]:
        """The foreign inputs by name, from the definition of the node.

        Integers and booleans are tokens of their digits. A range without a limit is infinite. Normals are in the frame
        of tangent, bitangent and shading normal. Tangents are not read.
        """
        definition = self.identifier if self.identifier.startswith("ND_") else f"ND_{self.identifier}_surfaceshader"
        from lookdev.mtlx import library_inputs  # not at the top: it imports USD, and a job's worker starts first

        ports = library_inputs(self.library, definition)
        return {name: _read_parameter(name, port) for name, port in ports.items()} | dict(self.overrides)

    def losses(self, inputs: Mapping[str, Input]) -> Iterator[tuple[str, str]]:
        """Yield each input that is set and is lost, wholly or in part, with the reason; `inputs` are those set."""
        for name, value in inputs.items():
            loss = self.loss_reasons.get(name)
            if loss is None or value == self.parameters[name].default:
                continue
            needed = inputs.get(loss.needs, self.parameters[loss.needs].default) if loss.needs else 1.0
            hueless = loss.unless_gray and isinstance(value, tuple) and len(set(value)) == 1
            if needed not in (0.0, (0.0, 0.0, 0.0)) and not hueless:
                yield name, str(loss.reason)


def _read_parameter(name: str, port: Any) -> Parameter:
    """Return the record of an input of a definition of MaterialX."""
    kind, text = port.getType(), port.getValueString()
    if kind == "vector3":
        default = _NORMALS.get(port.getAttribute("defaultgeomprop"), (0.0, 0.0, 1.0))
        return Parameter(name, "normal", default, hard=(-1.0, 1.0), soft=(-1.0, 1.0))
    if kind in ("integer", "boolean"):
        choices = (port.getAttribute("enumvalues") or "0, 1").replace(" ", "").split(",")
        return Parameter(name, "token", {"false": "0"}.get(text, text), choices=tuple(choices))
    low, high = (port.getAttribute(end).partition(",")[0] for end in ("uimin", "uimax"))
    hard = float(low or -inf), float(high or inf)
    if kind == "float":
        return Parameter(name, "float", float(text or 0.0), hard)
    red, green, blue = map(float, text.split(","))
    return Parameter(name, "color", (red, green, blue), hard)
