"""Synthetic measurements of known models, made once."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

from lookdev.brdf import Bsdf, complete_parameters, model_named
from lookdev.brdf.measured.synthetic import write_synthetic

# Parameters of Disney's model, one file each; all but the last are isotropic.
MODELS: dict[str, Mapping[str, Any]] = {
    "plastic": {"baseColor": (0.5, 0.2, 0.1), "roughness": 0.35},
    "metal": {"baseColor": (0.9, 0.6, 0.3), "roughness": 0.3, "metallic": 1.0},
    "gloss": {"baseColor": (0.9, 0.6, 0.3), "roughness": 0.15, "metallic": 1.0},
    "cloth": {"baseColor": (0.1, 0.2, 0.5), "roughness": 0.9, "sheen": 1.0},
    "satin": {"baseColor": (0.5, 0.4, 0.1), "roughness": 0.6, "anisotropic": 0.7, "metallic": 0.8},
}


@cache
def _folder() -> Path:
    return Path(mkdtemp(prefix="lookdev-measured-"))


def known(name: str) -> Bsdf:
    """Return the model of which a file has the values."""
    return model_named("disney").bsdf(complete_parameters("disney", MODELS[name]))


@cache
def measured_file(name: str) -> Path:
    """Return a file of a model's values."""
    file = _folder() / f"{name}{'.dat' if 'anisotropic' in MODELS[name] else '.binary'}"
    write_synthetic(file, known(name))
    return file


def measured(file: Path | str, **parameters: Any) -> Bsdf:
    """Return the model of a file."""
    return model_named("measured").bsdf(complete_parameters("measured", {"file": str(file), **parameters}))


def view(degrees: float, azimuth: float = 0.4) -> Any:
    """Return a unit direction."""
    theta = np.radians(degrees)
    return np.array([np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)])
