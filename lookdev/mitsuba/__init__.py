"""The second renderer: the models as published in Mitsuba 3 (Jakob et al. 2022), whose kernels Dr.Jit compiles.

A process of its own, ``python -m lookdev.mitsuba``, of the same protocol as `lookdev.cycles`. Of Mitsuba it uses the
scene that rays meet; shading, lights and the estimator are programs of this package, traced by Dr.Jit.

Imported by a program of a user of Mitsuba, it registers BSDFs for scenes of their own (`lookdev.mitsuba.plugins`), in
every variant that is set before or after.
"""

from __future__ import annotations

from functools import partial
from importlib.util import find_spec
from typing import Any


def _register(old: str | None, new: str | None) -> None:
    """Register the plug-ins in a variant, if its colours are three channels and its numbers arrays."""
    import mitsuba

    from lookdev.brdf import CONTINUOUS

    if new is None or new.startswith("scalar") or not new.endswith("_rgb"):
        return
    for name in CONTINUOUS:
        mitsuba.register_bsdf(f"lookdev_{name.replace('-', '_')}", partial(_of_model, name))
    mitsuba.register_bsdf("lookdev_look", _of_look)


def _of_model(name: str, properties: Any) -> Any:
    from lookdev.mitsuba.plugins import model_bsdf  # not at the top: the worker needs no plug-ins

    return model_bsdf(name, properties)


def _of_look(properties: Any) -> Any:
    from lookdev.mitsuba.plugins import look_bsdf

    return look_bsdf(properties)


if find_spec("mitsuba"):
    import mitsuba

    mitsuba.detail.add_variant_callback(_register)
    _register(None, mitsuba.variant())
