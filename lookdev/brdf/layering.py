"""Layering by parameter blending (Burley 2012, section 5.7).

"Materials generally interpolate in a very intuitive way": a mask blends every parameter of the layer below with
that of the layer above, and one BRDF is evaluated. Tokens cannot be blended and must agree.
"""

from __future__ import annotations

from collections.abc import Mapping

from lookdev.brdf.vectors import Array, mix, mix_color
from lookdev.errors import ModelError


def blend_parameters(below: Mapping[str, Array], above: Mapping[str, Array], mask: Array) -> dict[str, Array]:
    """Blend two complete parameter sets: `below` where the mask is 0, `above` where it is 1.

    Raises
    ------
    ModelError
        A token differs between the two.
    """
    blended: dict[str, Array] = {}
    for name, lower in below.items():
        upper = above[name]
        if isinstance(lower, str):
            if lower != upper:
                raise ModelError(
                    f"layers disagree on '{name}': '{lower}' below, '{upper}' above; all layers of a stack "
                    "must use the same"
                )
            blended[name] = lower
        elif lower.shape == (3,) or upper.shape == (3,):
            blended[name] = mix_color(lower, upper, mask)
        else:
            blended[name] = mix(lower, upper, mask)
    return blended
