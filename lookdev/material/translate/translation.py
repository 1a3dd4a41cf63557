"""The record of a translation: a foreign shading model as layers of our models."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from lookdev.brdf import Parameter, StackLayer
from lookdev.brdf.vectors import Parameters
from lookdev.material.look import Input


@dataclass(frozen=True)
class Translation:
    """A foreign shading model, and its translation to layers of our models.

    name, title
        The `Layer.model` of layers of this model, and a short name for messages.
    identifiers
        The `info:id` of its shader nodes, of USD and of MaterialX.
    parameters
        The foreign inputs by name. Integers and booleans are tokens of their digits. A range without a limit is
        infinite. Normals are in the frame of tangent, bitangent and shading normal. Tangents are not read.
    layers
        The function from all foreign parameters to layers, base first. A layer has the parameters that differ from its
        model's defaults, within their hard ranges. The base lies ``"over"`` the layers beneath; the others lie on the
        base. Code generation traces the function, which is plain NumPy.
    losses
        The function from the inputs that are set to those that are lost, wholly or in part, each with the reason.
    """

    name: str
    title: str
    identifiers: tuple[str, ...]
    parameters: Mapping[str, Parameter]
    layers: Callable[[Parameters], list[StackLayer]]
    losses: Callable[[Mapping[str, Input]], Iterator[tuple[str, str]]]


@dataclass(frozen=True)
class Loss:
    """The reason why an input that differs from its default is lost, wholly or in part.

    Nothing is lost where the input that it `needs` is constantly 0 or black, or where a `gray` one has no hue.
    """

    why: str
    needs: str = ""
    gray: bool = False


def losses_of(
    parameters: Mapping[str, Parameter], losses: Mapping[str, Loss]
) -> Callable[[Mapping[str, Input]], Iterator[tuple[str, str]]]:
    """Return `Translation.losses` by the names of inputs."""

    def find_losses(inputs: Mapping[str, Input]) -> Iterator[tuple[str, str]]:
        for name, value in inputs.items():
            loss = losses.get(name)
            if loss is None or value == parameters[name].default:
                continue
            needed = inputs.get(loss.needs, parameters[loss.needs].default) if loss.needs else 1.0
            hueless = loss.gray and isinstance(value, tuple) and len(set(value)) == 1
            if needed not in (0.0, (0.0, 0.0, 0.0)) and not hueless:
                yield name, loss.why

    return find_losses


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
"""Reasons of losses that several models share."""


def tangent_parameter(name: str) -> Parameter:
    """Return the record of a tangent, which translations do not read."""
    return Parameter(name, "normal", (1.0, 0.0, 0.0), hard=(-1.0, 1.0), soft=(-1.0, 1.0))
