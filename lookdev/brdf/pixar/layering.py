"""Layering of Pixar's model: partitions of light combined into one (Smits, "Layering").

"Layering is simply a matter of taking two (or more) sets of lobe weights and cone angles and normals along with a layer
weight for each layer and producing a single set." Light meets the layers from the top down. Each lobe that it meets
contributes to one lobe of the stack, with an energy, by which cone angles, normals and indices of refraction are
averaged: once, over all contributions.
"""

from __future__ import annotations

import operator
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce

import numpy as np

from lookdev.brdf.frames import ZENITH, Frame, Leaning, Upright
from lookdev.brdf.model import Mode
from lookdev.brdf.pixar.partition import FRONT, THROUGH, Metal, Partition, Term, family
from lookdev.brdf.vectors import TINY, Array, Mask, Real, normalize, same, scale

_LOBES = (*FRONT, *THROUGH)


@dataclass(frozen=True)
class _Share:
    """A contribution to a lobe: weights, shape and frame, and the energy (...) that weights shape and frame."""

    name: str
    term: Term
    frame: Frame
    energy: Array

    def scaled(self, weight: Real) -> _Share:
        """Return the contribution of a weight (...) of the light."""
        term = self.term.changed(lambda each: scale(each, weight), lambda each: scale(each, weight))
        return replace(self, term=term, energy=self.energy * weight)


def outcome(incoming: str, lobe: str) -> str:
    """Return the lobe of transmitted light that has met a lobe of the layer beneath (Smits, table in "Layering").

    It is on that lobe's side, and as blurred as the blurrier of the two.
    """
    side = FRONT if lobe in FRONT else THROUGH
    return side[max(THROUGH.index(incoming), side.index(lobe))]


def compose(layers: Sequence[tuple[Partition, Real, Mode]]) -> Partition:
    """Combine partitions, base first, seen from the same direction, with masks (...) in [0, 1] and modes.

    In mode ``"over"`` it is simple layering, A over B. In mode ``"transmit"``, what a layer transmits meets all six
    lobes of those beneath instead of leaving on the other side. The base has no mask.
    """
    final: list[_Share] = []
    incoming: list[_Share] = []  # transmitted by the layers above
    unmet: Real = 1.0  # weight of the light that no layer above has met
    for number, (partition, mask, mode) in reversed([*enumerate(layers)]):
        mask = mask if number else 1.0
        met = [share.scaled(mask * unmet) for share in _own(partition)]
        met += [share.scaled(mask) for share in _interactions(_terms(incoming), partition)]
        leaving = _LOBES if mode == "over" or not number else FRONT
        passing = 1.0 - mask * partition.presence
        final += [share for share in met if share.name in leaving]
        incoming = [share.scaled(passing) for share in incoming]
        incoming += [share for share in met if share.name not in leaving]
        unmet = unmet * passing
    final += incoming
    terms = _terms(final)
    bent = [share for share in final if share.name in THROUGH and family(share.name) == "highlight"]
    bend = _mean([share.term.bend for share in bent], [share.energy for share in bent])
    terms |= {share.name: replace(terms[share.name], bend=bend) for share in bent}
    frames = {
        kind: _mean_frame([share for share in final if family(share.name) == kind]) for kind in ("diffuse", "highlight")
    }
    return Partition(layers[0][0].wo, terms, frames, 1.0 - unmet)


def _own(partition: Partition) -> Iterator[_Share]:
    for name in _LOBES:
        term = partition.terms[name]
        yield _Share(name, term, partition.frames[family(name)], term.energy(partition.cosine(name)))


def _interactions(incoming: Mapping[str, Term], partition: Partition) -> Iterator[_Share]:
    """Yield the 18 interactions of the transmitted lobes: one, three and five with each side, by what comes out."""
    for above, entering in incoming.items():
        for name, term in partition.terms.items():
            result = outcome(above, name)
            a, b = THROUGH.index(above), (FRONT if name in FRONT else THROUGH).index(name)
            cone = entering.cone if b < a else np.maximum(entering.cone, term.cone) if b == a else term.cone
            # The lobe beneath "replaces the direction": index of refraction and normal are its.
            normal, grazing = partial(operator.mul, entering.normal), partial(operator.mul, entering.grazing)
            made = replace(term.changed(normal, grazing), cone=cone)
            yield _Share(result, made, partition.frames[family(result)], made.energy(partition.cosine(result)))


def _terms(shares: Sequence[_Share]) -> dict[str, Term]:
    """Sum contributions to each lobe."""
    terms = {}
    for name in _LOBES:
        mine = [share for share in shares if share.name == name]
        if mine:
            terms[name] = Term(
                reduce(operator.add, (share.term.normal for share in mine)),
                reduce(operator.add, (share.term.grazing for share in mine)),
                _mean([share.term.cone for share in mine], [share.energy for share in mine]),
                metals=_metals([metal for share in mine for metal in share.term.metals]),
            )
    return terms


def _metals(parts: Sequence[Metal]) -> tuple[Metal, ...]:
    """Sum what the same metal reflects."""
    sums: list[Metal] = []
    for part in parts:
        known = next((n for n, each in enumerate(sums) if same(each.eta, part.eta) and same(each.k, part.k)), None)
        if known is None:
            sums.append(part)
        else:
            whole = sums[known]
            sums[known] = replace(whole, normal=whole.normal + part.normal, grazing=whole.grazing + part.grazing)
    return tuple(sums)


def _mean(values: Sequence[Real], energies: Sequence[Array]) -> Real:
    """Average by energy, (...); where there is none, the value has no effect."""
    # Equal values, and contributions without energy, generate no code.
    kept = [(value, energy) for value, energy in zip(values, energies, strict=True) if not same(energy, 0.0)]
    if not kept or all(same(value, kept[0][0]) for value, _ in kept):
        return kept[0][0] if kept else values[0]
    total, lit = _total([energy for _, energy in kept])
    weighted = reduce(operator.add, (value * energy for value, energy in kept))
    mean: Array = np.where(lit, weighted / total, kept[0][0])
    return mean


def _mean_frame(shares: Sequence[_Share]) -> Frame:
    """Average unit normals by energy; the shading normal where there is no energy."""
    kept = [share for share in shares if not same(share.energy, 0.0)]
    if not kept:
        return Upright()
    if all(same(share.frame.normal, kept[0].frame.normal) for share in kept):
        return kept[0].frame
    total, lit = _total([share.energy for share in kept])
    weighted = reduce(operator.add, (scale(share.frame.normal, share.energy) for share in kept))
    return Leaning(normalize(np.where(np.expand_dims(lit, -1), scale(weighted, 1.0 / total), ZENITH)))


def _total(energies: Sequence[Array]) -> tuple[Array, Mask]:
    """Return the sum of energies, 1 where there is none, and where there is some."""
    total = reduce(operator.add, energies)
    lit = total > TINY * TINY
    return np.where(lit, total, 1.0), lit
