"""Loads Mitsuba in the variant of a device. Only the first call imports Mitsuba and Dr.Jit."""

from __future__ import annotations

import importlib
import os
from functools import cache

from lookdev.errors import RenderError
from lookdev.mitsuba.types import Mitsuba
from lookdev.rendering.llvm import LLVM_VARIABLE, check_device, find_llvm

VARIANTS = {"cpu": "llvm_ad_rgb", "cuda": "cuda_ad_rgb"}
"""The variant of Mitsuba for each device. Its colours are linear Rec.709, its numbers float32."""


@cache
def load_mitsuba(device: str) -> Mitsuba:
    """Return Mitsuba in the variant of a device; raises RenderError where the device cannot be used."""
    check_device(device)
    if device == "cpu":
        os.environ[LLVM_VARIABLE] = find_llvm()
    mi: Mitsuba = importlib.import_module("mitsuba")
    try:
        mi.set_variant(VARIANTS[device])
        mi.Float(0.0, 1.0) + 1.0  # the first array starts the device
    except (ImportError, RuntimeError) as error:
        raise RenderError(f"Mitsuba does not render on device '{device}' here: {error}") from error
    return mi
