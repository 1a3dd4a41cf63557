"""Pixar's reflection model for Wall-E and Up (Smits): the record `PIXAR`, and the combination of its layers.

A layer divides the incoming light among six lobes (`partition`). `layering` combines the divisions of several layers.
"""

from __future__ import annotations

from collections.abc import Sequence

from lookdev.brdf.frames import ZENITH
from lookdev.brdf.lobes import Bsdf
from lookdev.brdf.metal import is_exact
from lookdev.brdf.model import Model, Preview, StackLayer
from lookdev.brdf.pixar.layering import combine_partitions
from lookdev.brdf.pixar.parameters import PARAMETERS, QUOTES
from lookdev.brdf.pixar.partition import REFLECTED_LOBES, Partition, layer_color, layer_partition, partition_lobes
from lookdev.brdf.vectors import Array, Parameters, Real
from lookdev.errors import ModelError


def _combine(layers: Sequence[StackLayer]) -> Bsdf:
    """Return the BSDF of layers, base first (`Model.combine`)."""
    for layer in layers[1:]:
        if layer.parameters["energy"] != layers[0].parameters["energy"]:
            raise ModelError("layers disagree on 'energy'; all Pixar layers of a stack must use the same")

    def partition(wo: Array) -> Partition:
        partitions = [layer_partition(layer.parameters, wo) for layer in layers]
        if len(partitions) == 1:
            return partitions[0]
        return combine_partitions(
            [(part, layer.mask, layer.mode) for part, layer in zip(partitions, layers, strict=True)]
        )

    # Presence is the same from every direction.
    return Bsdf(lambda wo: partition_lobes(partition(wo)), partition(ZENITH).presence, two_sided=True)


def _preview(p: Parameters) -> dict[str, Real]:
    exact: dict[str, Real] = {"diffuseColor": layer_color(p)} if is_exact(p) else {}
    return exact | {"f0": 0.05 * p["normalScale"], "opacity": 1.0 - p["clear"] * (1.0 - p["metallic"])}


PIXAR = Model(
    name="pixar",
    title="Pixar",
    text="Pixar's reflection and transmission model for Wall-E and Up (Smits).",
    parameters=PARAMETERS,
    bsdf=lambda parameters: _combine([StackLayer("pixar", parameters)]),
    identifier="LookdevPixar",
    # docs/models.md has a case of the published model whose albedo is 1.87.
    energy=lambda tokens: 1.0 if tokens["energy"] == "conserving" else 2.0,
    reciprocal=lambda tokens: REFLECTED_LOBES if tokens["energy"] == "published" else (),
    combine=_combine,
    modes=("over", "transmit"),
    two_sided=True,
    probe={"roughness": 0.3, "clear": 0.5, "back": 0.5, "presence": 0.8},
    preview=Preview(
        {
            "diffuseColor": "surfaceColor",
            "metallic": "metallic",
            "roughness": "roughness",
            "opacity": "presence",  # a cut-out if it varies; a constant opacity is blended
        },
        _preview,
    ),
    quotes=QUOTES,
    quote_source="Smits, Reflection Model Design for Wall-E and Up",
)
