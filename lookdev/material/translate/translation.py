"""The class `Translation`: how a foreign shading model is translated to layers of our models, and what is lost."""

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
"""Defaults of inputs that are vectors, by the ``defaultgeomprop`` of MaterialX's definition.

They are in the frame of tangent, bitangent and shading normal. The default of any other vector is the shading normal.
"""


class Reason(StrEnum):
    """Why an input is lost in a translation: the reasons that several models share, as texts for users."""

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
    """Why and when an input of a foreign model is lost, wholly or in part, in its translation.

    An input with its default is not lost. `needs` names another input without which this one has no effect: nothing is
    lost where the other input is constantly 0 or black. With `unless_gray`, nothing is lost where this input is a
    constant grey.
    """

    reason: str
    needs: str = ""
    unless_gray: bool = False


@dataclass(frozen=True)
class Translation:
    """A foreign shading model, and its translation to layers of our models.

    name
        The name of the foreign model, as `Layer.model` has it.
    title
        A short name for messages.
    identifier
        The `info:id` of its shader node, of USD or of MaterialX.
    library
        The name of the file, in MaterialX's library of surface shaders, that defines the node.
    layers
        The function from all foreign parameters to layers of our models, base first. A layer has only the parameters
        that differ from its model's defaults, within their hard ranges. The base has mode ``"over"``; the others are
        coats on the base. The function is plain NumPy, which code generation traces.
    loss_reasons
        The losses of the translation, by the name of the input that is lost.
    overrides
        The parameters, by name, that differ from MaterialX's definition of the node.
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
        """The parameters of the foreign model by name, read from MaterialX's definition of the node.

        An integer or a boolean is a token, such as ``"0"`` or ``"1"``. A range without a limit is infinite. Normals are
        in the frame of tangent, bitangent and shading normal. Tangents are not read.
        """
        definition = self.identifier if self.identifier.startswith("ND_") else f"ND_{self.identifier}_surfaceshader"
        # The import is here, not at the top, because it loads USD. A job starts its worker before it loads USD.
        from lookdev.mtlx import library_inputs

        ports = library_inputs(self.library, definition)
        return {name: _read_parameter(name, port) for name, port in ports.items()} | dict(self.overrides)

    def losses(self, inputs: Mapping[str, Input]) -> Iterator[tuple[str, str]]:
        """Yield pairs (name, reason) for the inputs that are lost, wholly or in part; `inputs` has all set inputs."""
        for name, value in inputs.items():
            loss = self.loss_reasons.get(name)
            if loss is None or value == self.parameters[name].default:
                continue
            needed = inputs.get(loss.needs, self.parameters[loss.needs].default) if loss.needs else 1.0
            hueless = loss.unless_gray and isinstance(value, tuple) and len(set(value)) == 1
            if needed not in (0.0, (0.0, 0.0, 0.0)) and not hueless:
                yield name, str(loss.reason)


def _read_parameter(name: str, port: Any) -> Parameter:
    """Return the parameter for an input of a node definition of MaterialX, an object of MaterialX's API."""
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
