"""Layering of Pixar's model: the partitions of several layers are combined into one (Smits, "Layering").

"Layering is simply a matter of taking two (or more) sets of lobe weights and cone angles and normals along with a layer
weight for each layer and producing a single set." A `Partition` is such a set, the division of light among six lobes.

Light meets the layers from the top down. Each lobe of such a layer contributes some energy to one of the six lobes of
the stack. The cone angle, the normal and the index of refraction of a lobe of the stack are means over its
contributions, weighted by energy.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce

import numpy as np

from lookdev.brdf.frames import ZENITH, Frame, TiltedFrame, UprightFrame
from lookdev.brdf.model import Mode
from lookdev.brdf.pixar.partition import (
    REFLECTED_LOBES,
    TRANSMITTED_LOBES,
    Metal,
    Partition,
    PartitionLobe,
    lobe_family,
)
from lookdev.brdf.vectors import TINY, Array, BooleanArray, Real, are_equal, normalize, scale

_LOBES = (*REFLECTED_LOBES, *TRANSMITTED_LOBES)


@dataclass(frozen=True)
class _Contribution:
    """A contribution to the lobe `name` of the stack.

    `term` has the weights, the cone and the index of refraction, `frame` has the normal. `energy` (...) is the weight
    of the contribution in means over contributions.
    """

    name: str
    term: PartitionLobe
    frame: Frame
    energy: Array

    def multiply(self, weight: Real) -> _Contribution:
        """Return the contribution of light that is multiplied by a weight (...)."""
        term = self.term.with_weights(lambda values: scale(values, weight), lambda values: scale(values, weight))
        return replace(self, term=term, energy=self.energy * weight)


def resulting_lobe(incoming: str, lobe: str) -> str:
    """Return the name of the lobe into which a layer's `lobe` scatters light that the lobe `incoming` transmits to it.

    The resulting lobe is on the side of `lobe`, and as blurred as the more blurred of both (Smits, "Layering").
    """
    side = REFLECTED_LOBES if lobe in REFLECTED_LOBES else TRANSMITTED_LOBES
    return side[max(TRANSMITTED_LOBES.index(incoming), side.index(lobe))]


def combine_partitions(layers: Sequence[tuple[Partition, Real, Mode]]) -> Partition:
    """Return the combined partition of layers, which are given, base first, by their partitions, masks and modes.

    All partitions are for the same views. Masks (...) are in [0, 1]. The mask of the base has no effect. Mode
    ``"over"`` is simple layering, A over B. In mode ``"transmit"``, the light that a layer transmits meets all six
    lobes of the layers beneath instead of leaving on the other side.
    """
    leaving: list[_Contribution] = []  # contributions of light that leaves the stack
    incoming: list[_Contribution] = []  # contributions of light that the layers above transmit to this one
    remaining: Real = 1.0  # the weight of the light that no layer above has met
    for number, (partition, mask, mode) in reversed([*enumerate(layers)]):
        mask = mask if number else 1.0
        contributions = [contribution.multiply(mask * remaining) for contribution in _contributions(partition)]
        contributions += [
            contribution.multiply(mask) for contribution in _interactions(_sum_contributions(incoming), partition)
        ]
        leaving_lobes = _LOBES if mode == "over" or not number else REFLECTED_LOBES
        passing_weight = 1.0 - mask * partition.presence
        leaving += [contribution for contribution in contributions if contribution.name in leaving_lobes]
        incoming = [contribution.multiply(passing_weight) for contribution in incoming]
        incoming += [contribution for contribution in contributions if contribution.name not in leaving_lobes]
        remaining = remaining * passing_weight
    leaving += incoming
    terms = _sum_contributions(leaving)
    refracted = [
        contribution
        for contribution in leaving
        if contribution.name in TRANSMITTED_LOBES and lobe_family(contribution.name) == "highlight"
    ]
    ior_minus_one = _mean(refracted, lambda term: term.ior_minus_one)
    for name in {contribution.name for contribution in refracted}:
        terms[name] = replace(terms[name], ior_minus_one=ior_minus_one)
    frames = {
        kind: _mean_frame([contribution for contribution in leaving if lobe_family(contribution.name) == kind])
        for kind in ("diffuse", "highlight")
    }
    return Partition(layers[0][0].wo, terms, frames, 1.0 - remaining)


def _contributions(partition: Partition) -> Iterator[_Contribution]:
    """Yield the contributions of a layer's six lobes for light that has met no layer above."""
    for name in _LOBES:
        term = partition.terms[name]
        yield _Contribution(name, term, partition.frames[lobe_family(name)], term.energy(partition.cosine(name)))


def _interactions(incoming: Mapping[str, PartitionLobe], partition: Partition) -> Iterator[_Contribution]:
    """Yield the contributions of a layer's six lobes for light from the three lobes `incoming` of the layers above.

    There are 18 contributions. On each side, 1 belongs to the least blurred lobe, 3 to the next one, and 5 to the
    diffuse lobe.
    """
    for above, entering in incoming.items():
        for name, term in partition.terms.items():
            result = resulting_lobe(above, name)
            side = REFLECTED_LOBES if name in REFLECTED_LOBES else TRANSMITTED_LOBES
            blur_above, blur_beneath = TRANSMITTED_LOBES.index(above), side.index(name)
            cone = entering.cone if blur_above > blur_beneath else term.cone
            if blur_above == blur_beneath:
                cone = np.maximum(entering.cone, term.cone)
            # The lobe beneath "replaces the direction": index of refraction and normal are from the layer beneath.
            normal, grazing = partial(operator.mul, entering.normal), partial(operator.mul, entering.grazing)
            product = replace(term.with_weights(normal, grazing), cone=cone)
            yield _Contribution(
                result, product, partition.frames[lobe_family(result)], product.energy(partition.cosine(result))
            )


def _sum_contributions(contributions: Sequence[_Contribution]) -> dict[str, PartitionLobe]:
    """Return the sum of the contributions to each lobe, by the lobe's name."""
    terms = {}
    for name in _LOBES:
        lobe_contributions = [contribution for contribution in contributions if contribution.name == name]
        if lobe_contributions:
            terms[name] = PartitionLobe(
                reduce(operator.add, (contribution.term.normal for contribution in lobe_contributions)),
                reduce(operator.add, (contribution.term.grazing for contribution in lobe_contributions)),
                _mean(lobe_contributions, lambda term: term.cone),
                metals=_sum_metals(
                    [metal for contribution in lobe_contributions for metal in contribution.term.metals]
                ),
            )
    return terms


def _sum_metals(parts: Sequence[Metal]) -> tuple[Metal, ...]:
    """Return the metals of all contributions to a lobe; the weights of equal metals are summed."""
    sums: list[Metal] = []
    for part in parts:
        for index, metal in enumerate(sums):
            if are_equal(metal.eta, part.eta) and are_equal(metal.k, part.k):
                sums[index] = replace(metal, normal=metal.normal + part.normal, grazing=metal.grazing + part.grazing)
                break
        else:
            sums.append(part)
    return tuple(sums)


def _mean(contributions: Sequence[_Contribution], value: Callable[[PartitionLobe], Real]) -> Real:
    """Return the mean (...) of a value of the contributions' terms, weighted by energy.

    Where there is no energy, the mean has no effect, and is any of the values.
    """
    # No code is generated for equal values, nor for contributions whose energy is a constant 0.
    contributing = _contributions_with_energy(contributions)
    first = value((contributing or contributions)[0].term)
    if all(are_equal(value(contribution.term), first) for contribution in contributing):
        return first
    total, has_energy = _sum_energies(contributing)
    weighted = reduce(operator.add, (value(contribution.term) * contribution.energy for contribution in contributing))
    mean: Array = np.where(has_energy, weighted / total, first)
    return mean


def _mean_frame(contributions: Sequence[_Contribution]) -> Frame:
    """Return the frame about the mean normal of contributions, weighted by energy.

    Where there is no energy, the normal is the shading normal.
    """
    contributing = _contributions_with_energy(contributions)
    if not contributing:
        return UprightFrame()
    if all(are_equal(contribution.frame.normal, contributing[0].frame.normal) for contribution in contributing):
        return contributing[0].frame
    total, has_energy = _sum_energies(contributing)
    weighted = reduce(
        operator.add, (scale(contribution.frame.normal, contribution.energy) for contribution in contributing)
    )
    return TiltedFrame(normalize(np.where(np.expand_dims(has_energy, -1), scale(weighted, 1.0 / total), ZENITH)))


def _contributions_with_energy(contributions: Sequence[_Contribution]) -> list[_Contribution]:
    """Return the contributions whose energy is not a constant 0."""
    return [contribution for contribution in contributions if not are_equal(contribution.energy, 0.0)]


def _sum_energies(contributions: Sequence[_Contribution]) -> tuple[Array, BooleanArray]:
    """Return the sum (...) of energies, or 1 where it is 0, and the mask (...) of points with energy."""
    total = reduce(operator.add, (contribution.energy for contribution in contributions))
    has_energy = total > TINY * TINY
    return np.where(has_energy, total, 1.0), has_energy
