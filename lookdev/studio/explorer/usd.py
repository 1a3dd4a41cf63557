"""The look of a surface as USD text, which a user of the Explorer can copy."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from lookdev.brdf import MODELS
from lookdev.errors import LookdevError
from lookdev.material.library.edit import model_look
from lookdev.safe_text import read_text
from lookdev.studio.explorer.surfaces import Surfaces, non_default_parameters

_MAX_BYTES = 1 << 20  # largest file of a look, in bytes


def usd_text(surfaces: Surfaces, text: str) -> str:
    """Return the look of a surface as USD text: the text of its file, or a look of a model and its parameters.

    Raises LookdevError if the file is binary.
    """
    if file := surfaces.look_file(text):
        if file.suffix != ".usda":
            raise LookdevError(f"{file.name} is binary; 'usdcat {file.name}' writes it as text")
        return read_text(file, _MAX_BYTES)
    subject = surfaces.subject(text)
    if subject.parameters is None:
        raise LookdevError(f"{text}: is not a single layer")
    model = MODELS[subject.model]
    with tempfile.TemporaryDirectory(prefix="lookdev-copy-") as folder:
        file = Path(os.path.realpath(folder)) / "explored.usda"
        model_look(file, model, non_default_parameters(model, subject.parameters))
        return read_text(file, _MAX_BYTES)
