"""Parameters of Fresnel's equations, and metals that reflect by them.

`METAL_TABLE` has eta and k of metals by name; `lookdev.brdf.metal_fits` makes it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from lookdev.brdf.conductor import METALS
from lookdev.brdf.fresnel import conductor_fresnel
from lookdev.brdf.parameters import Parameter, Value
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

METAL_TABLE = Path(__file__).parent / "data" / "metal_indices.json"
"""The file of eta and k of metals by name, of each channel."""

CONDUCTOR = "conductor"


METAL_COLORS = ("nearest", "bands")
"""How the index of a channel follows from a metal's spectra."""

_NONE = "none"

OF_INDICES = {
    "eta": "the internal IOR (η_i) is the index of refraction of the material itself",
    "k": "the extinction coefficient (k) is effectively how conductive the material is",
    "externalIor": "the external IOR (η_o) is the index of refraction of the material the object is contained in.",
}
"""What Trent 2017, section 4, says of indices."""


@cache
def metal_table() -> Any:
    """Return what `METAL_TABLE` has: by metal and color, eta, k and the deviation of each channel."""
    return json.loads(METAL_TABLE.read_text())


def metal_index(name: str, color: str = METAL_COLORS[0]) -> dict[str, Value]:
    """Return eta and k of one of `METALS`, by one of `METAL_COLORS`."""
    entry = metal_table()[name][color]
    return {index: tuple(entry[index]) for index in ("eta", "k")}


def named_metal(**also: str) -> tuple[Parameter, ...]:
    """Return the parameters by which a model with eta and k takes metals by name; a metal stands for `also`, too."""

    def stands(tokens: Mapping[str, str]) -> Mapping[str, Value]:
        name = tokens["metal"]
        return {} if name == _NONE else {**also, **metal_index(name, tokens["metalColor"])}

    return (
        Parameter(
            "metal",
            "token",
            _NONE,
            choices=(_NONE, *METALS),
            help=f"Stands for {', '.join([*also, 'eta and k'])} of a metal.",
            among="own",
            stands=stands,
        ),
        Parameter(
            "metalColor",
            "token",
            METAL_COLORS[0],
            choices=METAL_COLORS,
            help="Of a metal by name. nearest: as its spectra reflect red, green, blue. bands: means over wavelengths.",
            among="own",
            stands=stands,
        ),
    )


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
        *named_metal(fresnel=CONDUCTOR),
    )


def is_exact(p: Parameters) -> bool:
    """Return whether metals follow the exact curve."""
    return bool(p["fresnel"] == CONDUCTOR)


def metal_fresnel(p: Parameters, cos_theta: Array) -> Array:
    """Return the exact reflectance (..., 3) of a metal, in air and for unpolarised light, at a cosine (...)."""
    return conductor_fresnel(np.expand_dims(cos_theta, -1), p["eta"], p["k"])
