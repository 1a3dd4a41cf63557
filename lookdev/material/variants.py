"""Selections of variants: parsed from the command line, and expanded where ``"*"`` selects all variants of a set."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from lookdev.errors import LookdevError, LookError

MAX_COMBINATIONS = 1000
"""The largest number of combinations that ``"*"`` may expand to: in one look, and in all looks of a job."""


def parse_variants(pairs: Iterable[str]) -> dict[str, str]:
    """Return the variant of each set from pairs ``SET=VARIANT``; LookdevError for a text of another form."""
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
    """Return all selections in which a variant of its set replaces each ``"*"``.

    `choices` returns the variants of a set for the selection so far, in which sets that follow are still ``"*"``. A set
    may be inside a variant of another. Raises LookError, at `file` and `prim`, where a set is empty or there are too
    many combinations.
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
