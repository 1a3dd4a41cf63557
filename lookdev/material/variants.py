"""Selections of USD variants, as dicts from a variant set to its selected variant.

They are parsed from the command line. A set whose variant is ``"*"`` expands to one selection for each of its variants.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from lookdev.errors import LookdevError, LookError

MAX_COMBINATIONS = 1000
"""The largest number of selections that ``"*"`` may expand to: for one look, and for all looks of a job together."""


def parse_variants(pairs: Iterable[str]) -> dict[str, str]:
    """Return the selection that texts ``SET=VARIANT`` state; raises LookdevError for a text of another form."""
    variants = {}
    for pair in pairs:
        name, _, choice = pair.partition("=")
        if not (name and choice):
            raise LookdevError(f"--variants {pair}: SET=VARIANT is needed, for instance wear=dusty")
        variants[name] = choice
    return variants


def expand_wildcards(
    variants: Mapping[str, str], choices: Callable[[dict[str, str], str], Sequence[str]], file: str, prim: str = ""
) -> tuple[dict[str, str], ...]:
    """Return all selections that result if each ``"*"`` of a selection is replaced by a variant of its set.

    The sets are expanded in order. ``choices(selection, set)`` returns the variants of a set. In `selection`, the sets
    before this set are expanded, and later ones may still be ``"*"``. The variants can depend on the selection, because
    USD allows a set inside a variant of another set. Raises LookError, at `file` and `prim`, where a set has no
    variants or there are too many combinations.
    """
    selections = [dict(variants)]
    while (set_name := next((name for name, choice in selections[0].items() if choice == "*"), None)) is not None:
        variants_by_selection = [choices(selection, set_name) for selection in selections]
        if not all(variants_by_selection):
            raise LookError.at(file, prim, f"variant set '{set_name}' has no variants")
        selections = [
            {**selection, set_name: variant}
            for selection, set_variants in zip(selections, variants_by_selection, strict=True)
            for variant in set_variants
        ]
        if len(selections) > MAX_COMBINATIONS:
            count = f"{len(selections)} combinations of variants"
            message = f"'*' expands to {count}, at most {MAX_COMBINATIONS} would be right"
            raise LookError.at(file, prim, message, "name a variant of some of the sets")
    return tuple(selections)
