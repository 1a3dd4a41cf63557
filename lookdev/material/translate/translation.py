"""The record of a translation: a foreign shading model as layers of our models."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from lookdev.brdf import Parameter, StackLayer
from lookdev.brdf.vectors import Parameters
from lookdev.material.look import Input


@dataclass(frozen=True)
class Translation:
    """A foreign shading model, and the layers that stand for it.

    name, title
        The `Layer.model` of a layer of this model, and the short name for readers.
    identifiers
        `info:id` of the shader nodes: in USD, and as node definitions of MaterialX.
    parameters
        The foreign inputs by name. Integers and booleans are tokens of their digits. A range without a limit is
        infinite. A normal is one of the frame of tangent, bitangent and shading normal, a tangent is not read.
    layers
        From all foreign parameters to layers, base first, each with the parameters that differ from its model's
        defaults, within their hard ranges. The base lies ``"over"`` what is beneath, the others lie on it. Plain NumPy,
        which code generation traces.
    losses
        From the inputs that are set to those that are not carried, or not wholly, each with the reason.
    """

    name: str
    title: str
    identifiers: tuple[str, ...]
    parameters: Mapping[str, Parameter]
    layers: Callable[[Parameters], list[StackLayer]]
    losses: Callable[[Mapping[str, Input]], Iterator[tuple[str, str]]]


@dataclass(frozen=True)
class Loss:
    """Why an input is not carried, or not wholly, where it is not its default.

    It loses nothing where the input that it `needs` is constantly 0 or black, or if it is `gray` and has no hue.
    """

    why: str
    needs: str = ""
    gray: bool = False


def losses_of(
    parameters: Mapping[str, Parameter], losses: Mapping[str, Loss]
) -> Callable[[Mapping[str, Input]], Iterator[tuple[str, str]]]:
    """Return `Translation.losses` by the names of inputs."""

    def found(inputs: Mapping[str, Input]) -> Iterator[tuple[str, str]]:
        for name, value in inputs.items():
            loss = losses.get(name)
            if loss is None or value == parameters[name].default:
                continue
            needed = inputs.get(loss.needs, parameters[loss.needs].default) if loss.needs else 1.0
            hueless = loss.gray and isinstance(value, tuple) and len(set(value)) == 1
            if needed not in (0.0, (0.0, 0.0, 0.0)) and not hueless:
                yield name, loss.why

    return found


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
"""Reasons that several models have."""


def tangent_parameter(name: str) -> Parameter:
    """Return a tangent, which is not read."""
    return Parameter(name, "normal", (1.0, 0.0, 0.0), hard=(-1.0, 1.0), soft=(-1.0, 1.0))
