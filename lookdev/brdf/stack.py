"""Stacks of layers as one BSDF, whatever their models.

From the base up, layers of the base's model are combined by that model's rule. From the first layer of another model
on, evaluated BSDFs are blended by the masks.
"""

from __future__ import annotations

from collections.abc import Sequence

from lookdev.brdf.lobes import Bsdf, Lobe
from lookdev.brdf.model import Mode, StackLayer
from lookdev.brdf.models import MODELS, model_named
from lookdev.brdf.vectors import Array, Real
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
            raise ModelError(f"layer {number}: mode '{layer.mode}' needs {models} layers only, here and beneath")
    first, *others = runs(layers)
    bsdf = model_named(layers[0].model).stack(first)
    for (layer,) in others:
        bsdf = _blend(bsdf, model_named(layer.model).stack([layer]), layer.mask)
    return bsdf


def runs(layers: Sequence[StackLayer]) -> list[Sequence[StackLayer]]:
    """Split layers into those that one model combines: the base and those like it, then one by one."""
    first = layers[0].model
    count = next((number for number, each in enumerate(layers) if each.model != first), len(layers))
    return [layers[:count], *([layer] for layer in layers[count:])]


def stranger(mode: Mode, models: Sequence[str]) -> int | None:
    """Return the index of the model that rules out the mode of the uppermost layer, or None.

    `models` are those of all layers, base first. Any layer may lie ``"over"`` any other; in another mode a layer and
    all beneath it are of one model, which has that mode.
    """
    if mode == "over":
        return None
    if mode not in model_named(models[-1]).modes:
        return len(models) - 1
    return next((index for index, each in enumerate(models) if each != models[-1]), None)


def _blend(below: Bsdf, above: Bsdf, mask: Real) -> Bsdf:
    """Blend evaluated BSDFs: f is ``mask * f_above + (1 - mask) * f_below``."""
    covered = mask * above.presence

    def lobes(wo: Array) -> tuple[Lobe, ...]:
        parts = (below, 1.0 - covered), (above, mask)
        return tuple(lobe.blended(weight) for bsdf, weight in parts for lobe in bsdf.lobes(wo))

    presence = 1.0 - (1.0 - covered) * (1.0 - below.presence)
    return Bsdf(lobes, presence, below.two_sided or above.two_sided)
