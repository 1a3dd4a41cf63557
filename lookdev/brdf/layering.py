"""Layering by parameter blending (Burley 2012, section 5.7).

"Materials generally interpolate in a very intuitive way": a mask blends every parameter of the layer below with
that of the layer above, and one BRDF is evaluated. Tokens cannot be blended and must agree.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lookdev.brdf.parameters import Parameter
from lookdev.brdf.vectors import Parameters, Real, mix
from lookdev.errors import ModelError


def blend_parameters(
    parameters: Mapping[str, Parameter], below: Parameters, above: Parameters, mask: Real
) -> Parameters:
    """Blend two complete parameter sets: exactly `below` where the mask is 0, exactly `above` where it is 1.

    Parameters
    ----------
    parameters
        The model's parameters, whose kinds distinguish colours and normals (..., 3) from floats (...).
    below, above
        A value for every input.
    mask : (...)
        In [0, 1].

    Raises
    ------
    ModelError
        A token differs between the two.
    """
    blended = {}
    for name, parameter in parameters.items():
        lower, upper = below[name], above[name]
        if parameter.kind == "token":
            if lower != upper:
                raise ModelError(
                    f"layers disagree on '{name}': '{lower}' below, '{upper}' above; all layers of a stack "
                    "must use the same"
                )
            blended[name] = lower
        else:
            t = mask if parameter.kind == "float" else np.expand_dims(mask, -1)
            # With a constant mask of 1 nothing below is read any more.
            blended[name] = mix(lower, upper, t)
    return blended
