"""The second renderer: Mitsuba 3 (Jakob et al. 2022) with the models as published; Dr.Jit compiles its kernels.

``python -m lookdev.mitsuba`` is a worker process with the same protocol as `lookdev.cycles`. Mitsuba only intersects
rays with the scene. Shading, lights and the path tracer are code of this package, which Dr.Jit traces.

Mitsuba and Dr.Jit define their array types once for each variant, such as ``llvm_ad_rgb``. In this package, `mi` is
Mitsuba in the variant of the device, and a "variant's array" is an array of such a type. Most functions compute on
arrays with one element for each ray, hit or sample.

A Mitsuba user may import this package in a program. The import then registers BSDFs for the user's scenes
(`lookdev.mitsuba.plugins`), in every variant that is set before or afterwards.
"""

from __future__ import annotations

from functools import partial
from importlib.util import find_spec


def _register_plugins(old: str | None, new: str | None) -> None:
    """Register the BSDFs in the variant `new`, if its colours are RGB and its numbers are arrays.

    The signature is that of Mitsuba's callbacks, which also get the variant before.
    """
    import mitsuba

    from lookdev.brdf import CONTINUOUS_MODELS

    if new is None or new.startswith("scalar") or not new.endswith("_rgb"):
        return
    for name in CONTINUOUS_MODELS:
        mitsuba.register_bsdf(f"lookdev_{name.replace('-', '_')}", partial(_create_model_bsdf, name))
    mitsuba.register_bsdf("lookdev_look", _create_look_bsdf)


def _create_model_bsdf(name: str, properties: mitsuba.Properties) -> mitsuba.BSDF:
    """Return the BSDF of a model, by the model's name."""
    from lookdev.mitsuba.plugins import model_bsdf  # imported here, as the worker needs no plug-ins

    return model_bsdf(name, properties)


def _create_look_bsdf(properties: mitsuba.Properties) -> mitsuba.BSDF:
    """Return the BSDF of a look in a USD file, which the properties name."""
    from lookdev.mitsuba.plugins import look_bsdf

    return look_bsdf(properties)


if find_spec("mitsuba"):
    import mitsuba

    mitsuba.detail.add_variant_callback(_register_plugins)
    _register_plugins(None, mitsuba.variant())
