"""The catalogue of the Explorer: the models, presets, files, kinds of plots and options that its page offers."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

from lookdev.brdf import MODELS, Model, Parameter
from lookdev.errors import LookError
from lookdev.material.library import LOOK_SUFFIXES, library_folders, read_library
from lookdev.plotting.curves import FRESNEL_RANGE
from lookdev.plotting.figure import SUBJECT_COLORS
from lookdev.plotting.kinds import KINDS
from lookdev.plotting.options import AXES, CHANNELS, SCALES, PlotOptions
from lookdev.studio.explorer.shading import live_parameters
from lookdev.studio.roots import MAX_UPLOAD_BYTES, Roots

MEASURED_SUFFIXES = (".binary", ".dat", ".bin")


def catalogue(roots: Roots, library: Path | None) -> dict[str, object]:
    """Return the data that a page needs before it shows the first surface, for JSON.

    `library` is a folder of presets, or None for the folders of `library_folders`. ``kinds`` has a record for each kind
    of plot: ``text`` describes the kind, ``uses`` are the options that it reads, ``most`` is the largest number of
    surfaces in a plot, and ``slow`` is whether the page first shows a draft of the plot.
    """
    return {
        "models": {name: _model(model) for name, model in MODELS.items()},
        "presets": presets(library),
        "looks": list(roots.list_files(LOOK_SUFFIXES)),
        "measured": list(roots.list_files(MEASURED_SUFFIXES)),
        "kinds": {
            name: {
                "text": kind.description,
                "uses": kind.option_names,
                "most": kind.max_subjects,
                "slow": kind.draft is not None,
            }
            for name, kind in KINDS.items()
        },
        "options": {option.name: option.default for option in fields(PlotOptions)},
        "choices": {"scale": SCALES, "angles": SCALES[:2], "axis": AXES, "channels": CHANNELS},
        "colors": SUBJECT_COLORS,
        "fresnelRange": FRESNEL_RANGE,
        "largestUpload": MAX_UPLOAD_BYTES,
    }


def presets(library: Path | None) -> list[dict[str, str]]:
    """Return a record for each preset of the library; an empty list if there is no library."""
    try:
        library_presets = read_library(library_folders(library)).presets
    except LookError:
        return []
    return [
        {"name": preset.name, "model": preset.model, "category": preset.category, "doc": preset.doc}
        for preset in library_presets
    ]


def _model(model: Model) -> dict[str, object]:
    """Return the record of a model, which includes the records of its parameters."""
    live = live_parameters(model.name)
    return {
        "title": model.title,
        "text": model.text,
        "delta": model.delta,
        "quoted": model.quote_source,
        "parameters": [_parameter(model, parameter, parameter.name in live) for parameter in model.parameters.values()],
    }


def _parameter(model: Model, parameter: Parameter, live: bool) -> dict[str, object]:
    """Return the record of a model's parameter.

    ``live`` is whether the parameter is a uniform of the page's shaders by default. ``stands`` is whether a value of
    the parameter is an abbreviation for values of other parameters.
    """
    return {
        "name": parameter.name,
        "kind": parameter.kind,
        "default": parameter.default,
        "hard": parameter.hard,
        "soft": parameter.soft,
        "unit": parameter.unit,
        "help": parameter.help,
        "quote": model.quotes.get(parameter.name, ""),
        "choices": parameter.choices,
        "follows": parameter.follows,
        "optional": parameter.optional,
        "live": live,
        "file": parameter.file is not None,
        "stands": parameter.expand is not None,
    }
