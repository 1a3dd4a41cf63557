"""A surface as a look in USD, as text to copy."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from lookdev.brdf import MODELS
from lookdev.errors import LookdevError
from lookdev.material.library.edit import model_look
from lookdev.studio.explorer.surfaces import Surfaces, changed
from lookdev.text import read_text

_LARGEST = 1 << 20


def usd_text(surfaces: Surfaces, words: str) -> str:
    """Return the look of a surface: that of a model with its parameters, or the text of the look's own file.

    Raises LookdevError where the file is none of text.
    """
    if file := surfaces.look_file(words):
        if file.suffix != ".usda":
            raise LookdevError(f"{file.name} is binary; 'usdcat {file.name}' writes it as text")
        return read_text(file, _LARGEST)
    subject = surfaces.subject(words)
    if subject.parameters is None:
        raise LookdevError(f"{words}: is no single layer")
    model = MODELS[subject.model]
    with tempfile.TemporaryDirectory(prefix="lookdev-copy-") as folder:
        file = Path(os.path.realpath(folder)) / "explored.usda"
        model_look(file, model, changed(model, subject.parameters))
        return read_text(file, _LARGEST)
