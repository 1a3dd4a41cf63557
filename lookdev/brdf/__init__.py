"""Reflectance models in plain NumPy; `lookdev.codegen` traces them to generate code for every renderer.

A model is a record (`model.Model`) in the registry `models.MODELS`. The file of a model has its parameters and its
lobes. `mixture` sums and samples the lobes of a surface, `stack` combines layers.
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
