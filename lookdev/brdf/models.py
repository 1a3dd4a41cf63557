"""The registry of reflectance models, `MODELS`, which is the only list of them in the package."""

from __future__ import annotations

from collections.abc import Mapping

from lookdev.arrays import Floats
from lookdev.brdf.classic.ashikhmin_shirley import ASHIKHMIN_SHIRLEY
from lookdev.brdf.classic.lafortune import LAFORTUNE
from lookdev.brdf.classic.lambert import LAMBERT
from lookdev.brdf.classic.oren_nayar import OREN_NAYAR
from lookdev.brdf.classic.phong import BLINN_PHONG, MODIFIED_PHONG, PHONG
from lookdev.brdf.classic.torrance_sparrow import TORRANCE_SPARROW
from lookdev.brdf.classic.ward import WARD
from lookdev.brdf.delta import GLASS, MIRROR
from lookdev.brdf.disney import DISNEY
from lookdev.brdf.measured import MEASURED
from lookdev.brdf.model import Model
from lookdev.brdf.pixar import PIXAR
from lookdev.errors import ModelError, nearest_hint

MODELS: dict[str, Model] = {
    model.name: model
    for model in (
        DISNEY,
        PIXAR,
        MEASURED,
        MIRROR,
        GLASS,
        LAMBERT,
        OREN_NAYAR,
        PHONG,
        BLINN_PHONG,
        MODIFIED_PHONG,
        WARD,
        LAFORTUNE,
        TORRANCE_SPARROW,
        ASHIKHMIN_SHIRLEY,
    )
}
"""Every model by its name."""

CONTINUOUS_MODELS: dict[str, Model] = {name: model for name, model in MODELS.items() if not model.delta}
"""The models that have lobes, by name; the others scatter along single directions only."""


def model_named(name: str) -> Model:
    """Return the model `name`; raise ModelError if there is none."""
    if name not in MODELS:
        raise ModelError(f"unknown model '{name}' ({nearest_hint(name, list(MODELS))})")
    return MODELS[name]


def layer_shaders() -> dict[str, str]:
    """Return the name of each model by the identifier of its UsdShade shader; such a shader is a layer of a look."""
    return {model.identifier: name for name, model in MODELS.items()}


def complete_parameters(model: str, constants: Mapping[str, object]) -> dict[str, Floats | str]:
    """Return `Model.complete` of the model named `model`; raise ModelError if there is none."""
    return model_named(model).complete(constants)
