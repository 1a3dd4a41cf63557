"""Reflectance models in plain NumPy, which code generation traces into every other language.

A model is one record (`model.Model`) in one registry (`models.MODELS`); its file contains its parameters and lobes.
`mixture` combines lobes, `stack` combines layers. `split_by_combination` splits the layers of a stack into those that
one model combines, and those that are blended one by one. `find_mode_conflict` finds a layer that excludes a mode.
"""

from lookdev.brdf.lobes import Bsdf, Delta, Lobe
from lookdev.brdf.mixture import bsdf_for_views, evaluate, evaluate_cosine, evaluate_diffuse, pdf, sample
from lookdev.brdf.model import Mode, Model, StackLayer
from lookdev.brdf.models import CONTINUOUS_MODELS, MODELS, complete_parameters, layer_shaders, model_named
from lookdev.brdf.parameters import MASK, Parameter
from lookdev.brdf.stack import find_mode_conflict, reflectance, split_by_combination, stack_bsdf
from lookdev.brdf.vectors import Array, Real

__all__ = [
    "CONTINUOUS_MODELS",
    "MASK",
    "MODELS",
    "Array",
    "Bsdf",
    "Delta",
    "Lobe",
    "Mode",
    "Model",
    "Parameter",
    "Real",
    "StackLayer",
    "bsdf_for_views",
    "complete_parameters",
    "evaluate",
    "evaluate_cosine",
    "evaluate_diffuse",
    "find_mode_conflict",
    "layer_shaders",
    "model_named",
    "pdf",
    "reflectance",
    "sample",
    "split_by_combination",
    "stack_bsdf",
]
