"""Parameters of Fresnel's equations, and metals that reflect by them."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from lookdev.brdf.fresnel import conductor_fresnel
from lookdev.brdf.parameters import Parameter
from lookdev.brdf.vectors import Array, Parameters

INTERFACE: dict[str, Parameter] = {
    parameter.name: parameter
    for parameter in (
        Parameter("eta", "float", 1.5, (0.05, 10.0), (0.05, 5.0), help="Real part of the index of refraction."),
        Parameter("k", "float", 0.0, (0.0, 20.0), (0.0, 10.0), help="Imaginary part of the index of refraction."),
        Parameter("externalIor", "float", 1.0, (1.0, 4.0), (1.0, 2.0), help="Index from which light arrives."),
        Parameter("polarisation", "float", 0.5, help="0 all perpendicular to the plane of incidence, 1 all parallel."),
    )
}
"""Between a dielectric and what may be a conductor, for one wavelength."""

CONDUCTOR = "conductor"


def metal_parameters(among: Literal["apart", "own"]) -> tuple[Parameter, ...]:
    """Return the parameters of a model whose metal may be exact; `among` is that of the choice."""
    return (
        Parameter(
            "fresnel",
            "token",
            "schlick",
            choices=("schlick", CONDUCTOR),
            among=among,
            help="Of metals. schlick: as published. conductor: the exact curve of eta and k.",
        ),
        replace(INTERFACE["eta"], kind="color", default=(1.5, 1.5, 1.5)),
        replace(INTERFACE["k"], kind="color", default=(0.0, 0.0, 0.0)),
    )


def is_exact(p: Parameters) -> bool:
    """Return whether metals follow the exact curve."""
    return bool(p["fresnel"] == CONDUCTOR)


def metal_fresnel(p: Parameters, cos_theta: Array) -> Array:
    """Return the exact reflectance (..., 3) of a metal, in air and for unpolarised light, at a cosine (...)."""
    return conductor_fresnel(np.expand_dims(cos_theta, -1), p["eta"], p["k"])
