"""Thumbnails of presets for the Designer: a sphere under the built-in dome ``studio``, by the float64 models.

They are cached. The key of the cache has the digests of the preset's file and of the code.
"""

from __future__ import annotations

import hashlib
import io
import threading
from pathlib import Path

import numpy as np
from matplotlib.image import imsave

from lookdev.cache import Content, cached_files, code_digest, file_digest
from lookdev.material.library import Preset
from lookdev.plotting.figure import encode_srgb
from lookdev.plotting.options import PlotOptions
from lookdev.plotting.solid import sphere_values
from lookdev.plotting.subject import read_subject

SIZE = 56
"""Side of a thumbnail, in pixels."""

_OPTIONS = PlotOptions(size=SIZE)
_lock = threading.Lock()  # one thumbnail at a time: the page and its picture come first


def thumbnail(preset: Preset) -> Path:
    """Return the file of a preset's thumbnail, a PNG with a transparent background.

    Raises LookdevError if the preset has faults, or the cache cannot be written.
    """
    packages = ("brdf", "light", "plotting", "material")
    key = hashlib.sha256(
        f"{code_digest(*packages)} {file_digest(preset.file)} {preset.prim} {SIZE}".encode()
    ).hexdigest()
    with _lock:
        return cached_files("thumbnails", key, lambda: (Content.store_bytes(_draw(preset), ".png"),))[0].path


def _draw(preset: Preset) -> bytes:
    """Return the thumbnail of a preset as PNG."""
    sphere = sphere_values(read_subject(preset.name, preset.file.parent), _OPTIONS)
    rgba = np.zeros((SIZE * SIZE, 4))
    rgba[sphere["pixel"], :3] = encode_srgb(np.asarray(sphere["dome"]), _OPTIONS)
    rgba[sphere["pixel"], 3] = 1.0
    # `sphere_values` begins with the lowest row, PNG with the highest.
    pixels = np.rint(255.0 * rgba).astype(np.uint8).reshape(SIZE, SIZE, 4)[::-1]
    stream = io.BytesIO()
    imsave(stream, pixels, format="png")
    return stream.getvalue()
