"""Malformed inputs: each a right result or a clear message, never silence, a traceback, a hang or a crash."""

from __future__ import annotations

import random

import pytest
from cases import Outcome
from kinds import KINDS
from pool import outcomes

_SEED = 0


def _wrong(kind: str, seed: int, found: dict[int, Outcome]) -> str:
    return "\n\n".join(
        f"{outcome.title}: {outcome.outcome}, not {' or '.join(outcome.expected)}: {outcome.text[-1500:]}\n"
        f'python tests/fuzz/rerun.py "{kind}" {seed} {number}'
        for number, outcome in sorted(found.items())
        if not outcome.right
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_sample_of_malformed_inputs_is_clear(kind):
    numbers = random.Random(_SEED).sample(range(KINDS[kind].count), 60)
    found = outcomes(kind, _SEED, numbers)
    assert len(found) == 60
    assert not _wrong(kind, _SEED, found)


@pytest.mark.proof
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_all_malformed_inputs_are_clear(kind, seed):
    found = outcomes(kind, seed, range(KINDS[kind].count))
    assert len(found) == KINDS[kind].count
    assert not _wrong(kind, seed, found)
