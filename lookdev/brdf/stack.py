"""Stacks of layers as one BSDF, whatever their models.

From the base up, layers of the base's model are combined by that model's rule. From the first layer of another model,
or coat, or that differs in a token by which layers are apart, on, evaluated BSDFs are blended by the masks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import takewhile

from lookdev.brdf.lobes import Bsdf, Delta, Lobe
from lookdev.brdf.model import Mode, StackLayer
from lookdev.brdf.models import MODELS, model_named
from lookdev.brdf.vectors import Array, Mask, Real
from lookdev.errors import ModelError


def stack_bsdf(layers: Sequence[StackLayer]) -> Bsdf:
    """Combine layers, base first, into one BSDF.

    Raises
    ------
    ModelError
        There is no layer; a model is unknown; layers that are combined differ in a token; a layer's mode is not one of
        its model, or a layer beneath is of another model.
    """
    if not layers:
        raise ModelError("a stack has no layers; a base would be right")
    for number, layer in enumerate(layers):
        if stranger(layer.mode, [each.model for each in layers[: number + 1]]) is not None:
            models = " or ".join(model.title for model in MODELS.values() if layer.mode in model.modes)
            where = "only, here and beneath" if layer.mode == "transmit" else "only"
            raise ModelError(f"layer {number}: mode '{layer.mode}' needs {models} layers {where}")
    first, *others = runs(layers)
    bsdf = model_named(layers[0].model).stack(first)
    for (layer,) in others:
        combine = _coat if layer.mode == "coat" else _blend
        bsdf = combine(bsdf, model_named(layer.model).stack([layer]), layer)
    return bsdf


def runs(layers: Sequence[StackLayer]) -> list[Sequence[StackLayer]]:
    """Split layers into those that one model combines: the base and those like it, then one by one."""
    base, *others = layers
    model = model_named(base.model)
    like = takewhile(
        lambda each: (
            each.model == base.model and each.mode != "coat" and not model.apart(base.parameters, each.parameters)
        ),
        others,
    )
    count = 1 + len(list(like))
    return [layers[:count], *([layer] for layer in layers[count:])]


def stranger(mode: Mode, models: Sequence[str]) -> int | None:
    """Return the index of the model that rules out the mode of the uppermost layer, or None.

    `models` are those of all layers, base first. A layer's model has its mode; ``"transmit"`` needs that model in all
    layers beneath, too.
    """
    if mode not in model_named(models[-1]).modes:
        return len(models) - 1
    if mode != "transmit":
        return None
    return next((index for index, each in enumerate(models) if each != models[-1]), None)


def _blend(below: Bsdf, above: Bsdf, layer: StackLayer) -> Bsdf:
    """Blend evaluated BSDFs: f is ``mask * f_above + (1 - mask) * f_below``."""
    covered = layer.mask * above.presence
    presence = 1.0 - (1.0 - covered) * (1.0 - below.presence)
    return _sum(below, lambda wo: 1.0 - covered, above, layer.mask, presence)


def _coat(below: Bsdf, above: Bsdf, layer: StackLayer) -> Bsdf:
    """Add a BSDF, and withhold from what is beneath the part of light that it reflects to the view."""

    def beneath(wo: Array) -> Real:
        return 1.0 - layer.mask * above.presence * reflectance(layer, wo)

    return _sum(below, beneath, above, layer.mask, below.presence)


def reflectance(layer: StackLayer, wo: Array) -> Real:
    """Return `Model.reflectance` of a layer in mode ``"coat"``, whole, for unit views (..., 3) above the horizon."""
    known = model_named(layer.model).reflectance
    assert known is not None, "a model with that mode has it"
    return known(layer.parameters, wo)


def _sum(below: Bsdf, weight_below: Callable[[Array], Real], above: Bsdf, weight: Real, presence: Real) -> Bsdf:
    def lobes(wo: Array) -> tuple[Lobe, ...]:
        parts = (below, weight_below(wo)), (above, weight)
        return tuple(lobe.blended(factor) for bsdf, factor in parts for lobe in bsdf.lobes(wo))

    def deltas(wo: Array, inside: Mask) -> tuple[Delta, ...]:
        parts = (below, weight_below(wo)), (above, weight)
        return tuple(delta.blended(factor) for bsdf, factor in parts for delta in bsdf.deltas(wo, inside))

    return Bsdf(lobes, presence, below.two_sided or above.two_sided, deltas)
