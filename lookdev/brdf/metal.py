"""The parameters of models with metals that reflect by Fresnel's equations: eta, k, and metals by name.

A metal's index of refraction is eta + ik. Models use one eta and k for each of red, green and blue. The file
`METAL_TABLE_FILE` has these numbers for each of `lookdev.brdf.conductor.METALS`. `lookdev.brdf.metal_fits` makes it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Literal, TypedDict

import numpy as np

from lookdev.brdf.conductor import METALS
from lookdev.brdf.fresnel import conductor_fresnel
from lookdev.brdf.parameters import Parameter, ParameterValue, parameters_by_name, token_parameter
from lookdev.brdf.vectors import Array, Parameters

INTERFACE = parameters_by_name(
    Parameter("eta", "float", 1.5, (0.05, 10.0), (0.05, 5.0), help="Real part of the index of refraction."),
    Parameter("k", "float", 0.0, (0.0, 20.0), (0.0, 10.0), help="Imaginary part of the index of refraction."),
    Parameter("externalIor", "float", 1.0, (1.0, 4.0), (1.0, 2.0), help="Index from which light arrives."),
    Parameter("polarisation", "float", 0.5, help="0 all perpendicular to the plane of incidence, 1 all parallel."),
)
"""The parameters, at one wavelength, of an interface between a dielectric and another dielectric or a conductor."""

METAL_TABLE_FILE = Path(__file__).parent / "data" / "metal_indices.json"
"""The file with eta and k of each channel, by the name of the metal (`MetalEntry`)."""

CONDUCTOR = "conductor"
"""The token of the parameter ``"fresnel"`` for the exact Fresnel term."""

METAL_COLORS = ("nearest", "bands")
"""The ways to derive the eta and k of a channel from a metal's spectra (`lookdev.brdf.metal_fits`)."""

_NO_METAL = "none"

INDEX_QUOTES = {
    "eta": "the internal IOR (η_i) is the index of refraction of the material itself",
    "k": "the extinction coefficient (k) is effectively how conductive the material is",
    "externalIor": "the external IOR (η_o) is the index of refraction of the material the object is contained in.",
}
"""Quotations from Trent, A. 2017. Rendering Notes, section 4, by parameter."""


class MetalIndex(TypedDict):
    """The eta and k of each channel of a metal.

    `deviation` is, for each channel, the largest difference of the reflectance by eta and k from the reflectance of the
    metal's spectra (`lookdev.brdf.metal_fits`).
    """

    eta: list[float]
    k: list[float]
    deviation: list[float]


class MetalEntry(TypedDict):
    """The data of a metal: a `MetalIndex` for each of `METAL_COLORS`.

    `outside` has two numbers: the most by which the metal's colour in Rec.709 is below 0, and above 1.
    """

    nearest: MetalIndex
    bands: MetalIndex
    outside: list[float]


@cache
def metal_table() -> dict[str, MetalEntry]:
    """Return the data of `METAL_TABLE_FILE`, by the name of the metal."""
    table: dict[str, MetalEntry] = json.loads(METAL_TABLE_FILE.read_text())
    return table


def metal_index(name: str, color: str = METAL_COLORS[0]) -> dict[str, ParameterValue]:
    """Return the parameters ``"eta"`` and ``"k"`` of one of `METALS`; `color` is one of `METAL_COLORS`."""
    entry = metal_table()[name]
    index = {"nearest": entry["nearest"], "bands": entry["bands"]}[color]
    (eta, k) = ((red, green, blue) for red, green, blue in (index["eta"], index["k"]))
    return {"eta": eta, "k": k}


def named_metal(**other_tokens: str) -> tuple[Parameter, ...]:
    """Return the parameters that select a metal by name, ``"metal"`` and ``"metalColor"``.

    They are abbreviations (`Parameter.expand`): a metal's name expands to values of eta and k, and to `other_tokens`,
    which are values of other parameters. Each layer of a stack may have another metal (`Parameter.agreement`).
    """

    def expand_tokens(tokens: Mapping[str, str]) -> Mapping[str, ParameterValue]:
        name = tokens["metal"]
        return {} if name == _NO_METAL else {**other_tokens, **metal_index(name, tokens["metalColor"])}

    return (
        token_parameter(
            "metal",
            (_NO_METAL, *METALS),
            f"Stands for {', '.join([*other_tokens, 'eta and k'])} of a metal.",
            agreement="own",
            expand=expand_tokens,
        ),
        token_parameter(
            "metalColor",
            METAL_COLORS,
            "How a metal gets eta and k of red, green, blue. nearest: by its reflectance. "
            "bands: by means of its spectra.",
            agreement="own",
            expand=expand_tokens,
        ),
    )


def metal_parameters(agreement: Literal["apart", "own"]) -> tuple[Parameter, ...]:
    """Return the parameters of a model whose metals can have the exact Fresnel term.

    `agreement` states how layers may differ in the parameter ``"fresnel"`` (`Parameter.agreement`).
    """
    return (
        token_parameter(
            "fresnel",
            ("schlick", CONDUCTOR),
            "Of metals. schlick: as published. conductor: the exact curve of eta and k.",
            agreement=agreement,
        ),
        replace(INTERFACE["eta"], kind="color", default=(1.5, 1.5, 1.5)),
        replace(INTERFACE["k"], kind="color", default=(0.0, 0.0, 0.0)),
        *named_metal(fresnel=CONDUCTOR),
    )


def is_exact(p: Parameters) -> bool:
    """Return whether parameters choose the exact Fresnel term of eta and k for metals."""
    return bool(p["fresnel"] == CONDUCTOR)


def metal_fresnel(p: Parameters, cos_theta: Array) -> Array:
    """Return the exact reflectance (..., 3) of a metal in air for unpolarised light, at a cosine (...)."""
    return conductor_fresnel(np.expand_dims(cos_theta, -1), p["eta"], p["k"])
