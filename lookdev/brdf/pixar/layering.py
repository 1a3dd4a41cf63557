"""Layering of Pixar's model: partitions of light combined into one (Smits, "Layering").

"Layering is simply a matter of taking two (or more) sets of lobe weights and cone angles and normals along with a layer
weight for each layer and producing a single set." Weights are premultiplied by presence, as in compositing, so that
layers of presence 0 need no rule of their own.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lookdev.brdf.frames import ZENITH, Frame, Leaning, Upright
from lookdev.brdf.model import Mode
from lookdev.brdf.pixar.partition import FRONT, THROUGH, Partition, Term, family
from lookdev.brdf.vectors import Array, Real, normalize, same, scale


@dataclass(frozen=True)
class _Share:
    """One interaction's part of a lobe: weights, shape and frame, and the energy that weights shape and frame."""

    name: str
    term: Term
    frame: Frame
    energy: Array


def outcome(incoming: str, lobe: str) -> str:
    """Return the lobe of transmitted light that has met a lobe of the layer beneath (Smits, table in "Layering").

    It is on that lobe's side, and as blurred as the blurrier of the two.
    """
    side = FRONT if lobe in FRONT else THROUGH
    return side[max(THROUGH.index(incoming), side.index(lobe))]


def layer(above: Partition, below: Partition, mask: Real, mode: Mode) -> Partition:
    """Lay one partition on another, seen from the same direction, by a mask (...) in [0, 1].

    In mode ``"over"`` it is simple layering, A over B. In mode ``"transmit"``, what `above` transmits meets all six
    lobes of `below` instead of leaving on the other side.
    """
    uncovered = 1.0 - mask * above.presence
    shares = list(_scaled(above, FRONT, mask))
    shares += _scaled(below, (*FRONT, *THROUGH), uncovered)
    if mode == "over":
        shares += _scaled(above, THROUGH, mask)
    else:
        # Where `below` is absent, transmitted light leaves as without it.
        shares += _scaled(above, THROUGH, mask * below.absence)
        shares += _interactions(above, below, mask)
    names = (*FRONT, *THROUGH)
    absence = uncovered * below.absence
    terms = {name: _sum([share for share in shares if share.name == name]) for name in names}
    frames = {
        kind: _mean_frame([share for share in shares if family(share.name) == kind])
        for kind in ("diffuse", "highlight")
    }
    return Partition(above.wo, terms, frames, 1.0 - absence, absence)


def _scaled(partition: Partition, names: Sequence[str], weight: Real) -> Iterator[_Share]:
    for name in names:
        term = partition.terms[name]
        term = replace(term, normal=scale(term.normal, weight), grazing=scale(term.grazing, weight))
        yield _Share(name, term, partition.frames[family(name)], term.energy(partition.cosine(name)))


def _interactions(above: Partition, below: Partition, mask: Real) -> Iterator[_Share]:
    """Yield the 18 interactions of the transmitted lobes: one, three and five with each side, by what comes out."""
    for incoming in _scaled(above, THROUGH, mask):
        for name, term in below.terms.items():
            result = outcome(incoming.name, name)
            a, b = THROUGH.index(incoming.name), (FRONT if name in FRONT else THROUGH).index(name)
            cone = incoming.term.cone if b < a else np.maximum(incoming.term.cone, term.cone) if b == a else term.cone
            # The lobe beneath "replaces the direction": index of refraction and normal are its.
            made = Term(incoming.term.normal * term.normal, incoming.term.grazing * term.grazing, cone, term.bend)
            yield _Share(result, made, below.frames[family(result)], made.energy(below.cosine(result)))


def _sum(shares: Sequence[_Share]) -> Term:
    energies = [share.energy for share in shares]
    return Term(
        functools.reduce(operator.add, (share.term.normal for share in shares)),
        functools.reduce(operator.add, (share.term.grazing for share in shares)),
        _mean([share.term.cone for share in shares], energies),
        _mean([share.term.bend for share in shares], energies),
    )


def _mean(values: Sequence[Real], energies: Sequence[Array]) -> Real:
    """Average by energy, (...); where there is none, the value has no effect."""
    # Equal values, and lobes without energy, generate no code.
    kept = [(value, energy) for value, energy in zip(values, energies, strict=True) if not same(energy, 0.0)]
    kept = kept or list(zip(values, energies, strict=True))
    first, weight = kept[0]
    for value, energy in kept[1:]:
        total = weight + energy
        # Not by mix(): 1 minus a fraction near 1 cancels.
        if not same(first, value):
            first = first * _fraction(weight, total) + value * _fraction(energy, total)
        weight = total
    return first


def _fraction(part: Real, whole: Real) -> Array:
    return np.where(whole > 0.0, part / np.where(whole > 0.0, whole, 1.0), 0.5)


def _mean_frame(shares: Sequence[_Share]) -> Frame:
    """Average unit normals by energy; the shading normal where there is no energy."""
    kept = [share for share in shares if not same(share.energy, 0.0)]
    if not kept:
        return Upright()
    if all(same(share.frame.normal, kept[0].frame.normal) for share in kept):
        return kept[0].frame
    weighted = sum(
        (scale(share.frame.normal, share.energy) for share in kept[1:]), scale(kept[0].frame.normal, kept[0].energy)
    )
    # Divided by the total: energies may be as small as a weight is.
    total = sum((share.energy for share in kept[1:]), kept[0].energy)
    lit = np.expand_dims(total > 0.0, -1)
    return Leaning(normalize(np.where(lit, scale(weighted, 1.0 / np.where(total > 0.0, total, 1.0)), ZENITH)))
