"""Stacks of layers as one BSDF, whatever their models.

From the base up, a layer of the same model as all beneath it is combined with them as the model says: Disney's
parameters are blended (`layering`), Pixar's partitions of light are combined (`pixar_layering`). From the first layer
of another model on, evaluated BSDFs are blended by the masks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from lookdev.brdf.closures import Closure
from lookdev.brdf.disney import disney_bsdf
from lookdev.brdf.disney_parameters import DISNEY_PARAMETERS
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.layering import blend_parameters
from lookdev.brdf.lobes import Bsdf, Directions, Lobe
from lookdev.brdf.pixar import Partition, layer_partition, partition_lobes
from lookdev.brdf.pixar_layering import Mode, layer
from lookdev.brdf.vectors import Array, scale
from lookdev.errors import ModelError


@dataclass(frozen=True)
class StackLayer:
    """One layer: its model, all of the model's parameters, its mask (...) in [0, 1], and how it meets what is beneath.

    The mask of the base has no meaning: nothing is beneath it.
    """

    model: str
    parameters: Mapping[str, Array]
    mask: Array = 1.0
    mode: Mode = "over"


def stack_bsdf(layers: Sequence[StackLayer]) -> Bsdf:
    """Combine layers, base first, into one BSDF.

    Raises
    ------
    ModelError
        There is no layer; layers that are combined differ in a token; mode ``"transmit"`` where a layer, or one
        beneath it, is not Pixar's.
    """
    if not layers:
        raise ModelError("a stack has no layers; a base would be right")
    for number, each in enumerate(layers):
        if each.mode == "transmit" and any(one.model != "pixar" for one in layers[: number + 1]):
            raise ModelError(f"layer {number}: mode 'transmit' needs Pixar layers only, here and beneath")
    first = layers[0].model
    count = next((number for number, each in enumerate(layers) if each.model != first), len(layers))
    bsdf = _MODELS[first](layers[:count])
    for each in layers[count:]:
        bsdf = _blend(bsdf, _MODELS[each.model]([each]), each.mask)
    return bsdf


def _disney(layers: Sequence[StackLayer]) -> Bsdf:
    parameters = dict(layers[0].parameters)
    for each in layers[1:]:
        parameters = blend_parameters(DISNEY_PARAMETERS, parameters, each.parameters, each.mask)
    return disney_bsdf(parameters)


def _pixar(layers: Sequence[StackLayer]) -> Bsdf:
    for each in layers[1:]:
        if each.parameters["energy"] != layers[0].parameters["energy"]:
            raise ModelError("layers disagree on 'energy'; all Pixar layers of a stack must use the same")

    def partition(wo: Array) -> Partition:
        combined = layer_partition(layers[0].parameters, wo)
        for each in layers[1:]:
            combined = layer(layer_partition(each.parameters, wo), combined, each.mask, each.mode)
        return combined

    def lobes(wo: Array) -> tuple[Lobe, ...]:
        return partition_lobes(partition(wo))

    # The same from every direction.
    return Bsdf(lobes, partition(ZENITH).presence, two_sided=True)


_MODELS: dict[str, Callable[[Sequence[StackLayer]], Bsdf]] = {"disney": _disney, "pixar": _pixar}


def _blend(below: Bsdf, above: Bsdf, mask: Array) -> Bsdf:
    """Blend evaluated BSDFs: f is ``mask * f_above + (1 - mask) * f_below``."""
    covered = mask * above.presence

    def lobes(wo: Array) -> tuple[Lobe, ...]:
        return (
            *(_weighted(lobe, 1.0 - covered) for lobe in below.lobes(wo)),
            *(_weighted(lobe, mask) for lobe in above.lobes(wo)),
        )

    presence = 1.0 - (1.0 - covered) * (1.0 - below.presence)
    return Bsdf(lobes, presence, below.two_sided or above.two_sided)


def _weighted(lobe: Lobe, weight: Array) -> Lobe:
    def evaluate(d: Directions) -> Array:
        return scale(lobe.evaluate(d), weight)

    def closures() -> tuple[Closure, ...]:
        return tuple(replace(each, weight=scale(each.weight, weight)) for each in lobe.closures())

    return replace(lobe, share=lobe.share * weight, evaluate=evaluate, closures=closures)
