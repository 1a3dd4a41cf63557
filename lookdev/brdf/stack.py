"""Combine the layers of a look, of any models, into one BSDF.

The model of the base combines the base with the layers directly above it (`Model.stack`). This group ends below the
first layer that is of another model, is a coat, or differs in a token whose `Parameter.agreement` is ``"apart"``. From
this first layer upwards, the BSDFs of the single layers are blended, one by one, by their masks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import takewhile

from lookdev.brdf.lobes import Bsdf, Delta, Lobe
from lookdev.brdf.model import Mode, StackLayer
from lookdev.brdf.models import MODELS, model_named
from lookdev.brdf.vectors import Array, BooleanArray, Real
from lookdev.errors import ModelError


def stack_bsdf(layers: Sequence[StackLayer]) -> Bsdf:
    """Combine layers, base first, into one BSDF.

    Raises
    ------
    ModelError
        There are no layers; a model is unknown; layers that one model combines differ in a token; a model does not have
        the mode of its layer; or mode ``"transmit"`` is above a layer of another model.
    """
    if not layers:
        raise ModelError("a stack has no layers; a base would be right")
    for number, layer in enumerate(layers):
        if find_mode_conflict(layer.mode, [below.model for below in layers[: number + 1]]) is not None:
            models = " or ".join(model.title for model in MODELS.values() if layer.mode in model.modes)
            where = "only, here and beneath" if layer.mode == "transmit" else "only"
            raise ModelError(f"layer {number}: mode '{layer.mode}' needs {models} layers {where}")
    first, *others = split_by_combination(layers)
    bsdf = model_named(layers[0].model).stack(first)
    for (layer,) in others:
        combine = _coat if layer.mode == "coat" else _blend
        bsdf = combine(bsdf, model_named(layer.model).stack([layer]), layer)
    return bsdf


def split_by_combination(layers: Sequence[StackLayer]) -> list[Sequence[StackLayer]]:
    """Split layers into those that the base's model combines, and single layers that are blended one by one.

    The result has sequences of layers: the first begins with the base, and each of the others has one layer.
    """
    base, *others = layers
    model = model_named(base.model)
    alike = takewhile(
        lambda layer: (
            layer.model == base.model
            and layer.mode != "coat"
            and not model.must_blend_separately(base.parameters, layer.parameters)
        ),
        others,
    )
    count = 1 + len(list(alike))
    return [layers[:count], *([layer] for layer in layers[count:])]


def find_mode_conflict(mode: Mode, models: Sequence[str]) -> int | None:
    """Return the index of the lowest layer that excludes mode `mode` of the uppermost layer, or None if none does.

    `models` are the names of the models of all layers, base first. The model of the uppermost layer must have the mode.
    ``"transmit"`` also needs the same model in all layers beneath.
    """
    if mode not in model_named(models[-1]).modes:
        return len(models) - 1
    if mode != "transmit":
        return None
    return next((index for index, model in enumerate(models) if model != models[-1]), None)


def _blend(below: Bsdf, above: Bsdf, layer: StackLayer) -> Bsdf:
    """Return the blend of two BSDFs by the mask and presence of a layer; `above` is the layer's BSDF.

    f is ``mask * f_above + (1 - mask * presence_above) * f_below``, where f_above includes the presence.
    """
    covered = layer.mask * above.presence
    presence = 1.0 - (1.0 - covered) * (1.0 - below.presence)
    return _sum(below, lambda wo: 1.0 - covered, above, layer.mask, presence)


def _coat(below: Bsdf, above: Bsdf, layer: StackLayer) -> Bsdf:
    """Return the sum of a coat's BSDF, `above`, and the BSDF below, which is attenuated by what the coat reflects."""

    def beneath(wo: Array) -> Real:
        return 1.0 - layer.mask * above.presence * reflectance(layer, wo)

    return _sum(below, beneath, above, layer.mask, below.presence)


def reflectance(layer: StackLayer, wo: Array) -> Real:
    """Return the directional albedo (...) of a coat with mask and presence 1, for unit views (..., 3).

    The views are above the horizon (`Model.reflectance`).
    """
    albedo = model_named(layer.model).reflectance
    assert albedo is not None, "a model with mode coat has a reflectance"
    return albedo(layer.parameters, wo)


def _sum(below: Bsdf, weight_below: Callable[[Array], Real], above: Bsdf, weight: Real, presence: Real) -> Bsdf:
    """Return the sum of two BSDFs, with the given presence.

    `weight_below`, a function of the views, multiplies the lobes and deltas of `below`. `weight` multiplies the lobes
    and deltas of `above`.
    """

    def lobes(wo: Array) -> tuple[Lobe, ...]:
        parts = (below, weight_below(wo)), (above, weight)
        return tuple(lobe.blend(factor) for bsdf, factor in parts for lobe in bsdf.lobes(wo))

    def deltas(wo: Array, inside: BooleanArray) -> tuple[Delta, ...]:
        parts = (below, weight_below(wo)), (above, weight)
        return tuple(delta.blend(factor) for bsdf, factor in parts for delta in bsdf.deltas(wo, inside))

    return Bsdf(lobes, presence, below.two_sided or above.two_sided, deltas)
