"""Variants of a look in the form of the command line."""

from __future__ import annotations

from collections.abc import Iterable

from lookdev.errors import LookdevError


def parse_variants(pairs: Iterable[str]) -> dict[str, str]:
    """Return the variant of each set from pairs ``SET=VARIANT``; LookdevError where one is not such a pair."""
    chosen = {}
    for pair in pairs:
        name, _, choice = pair.partition("=")
        if not (name and choice):
            raise LookdevError(f"--variants {pair}: SET=VARIANT is needed, for instance wear=dusty")
        chosen[name] = choice
    return chosen
