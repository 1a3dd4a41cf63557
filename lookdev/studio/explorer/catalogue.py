"""What a page offers: models with their parameters, presets, files, kinds of plots and their options, as JSON."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

from lookdev.brdf import MODELS, Model, Parameter
from lookdev.errors import LookError
from lookdev.material.library import SUFFIXES, library_folders, read_library
from lookdev.plotting.curves import FRESNEL_RANGE
from lookdev.plotting.figure import COLORS
from lookdev.plotting.kinds import KINDS
from lookdev.plotting.options import AXES, CHANNELS, SCALES, Options
from lookdev.studio.explorer.shading import usually_live
from lookdev.studio.roots import LARGEST_UPLOAD, Roots

MEASURED_SUFFIXES = (".binary", ".dat", ".bin")


def catalogue(roots: Roots, library: Path | None) -> dict[str, Any]:
    """Return everything that a page needs before it shows the first surface."""
    return {
        "models": {name: _model(model) for name, model in MODELS.items()},
        "presets": presets(library),
        "looks": list(roots.listed(SUFFIXES)),
        "measured": list(roots.listed(MEASURED_SUFFIXES)),
        "kinds": {
            name: {"text": kind.text, "uses": kind.uses, "most": kind.most, "slow": kind.draft is not None}
            for name, kind in KINDS.items()
        },
        "options": {each.name: each.default for each in fields(Options)},
        "choices": {"scale": SCALES, "angles": SCALES[:2], "axis": AXES, "channels": CHANNELS},
        "colors": COLORS,
        "fresnelRange": FRESNEL_RANGE,
        "largestUpload": LARGEST_UPLOAD,
    }


def presets(library: Path | None) -> list[dict[str, str]]:
    """Return the presets of the library, none where there is none."""
    try:
        found = read_library(library_folders(library)).presets
    except LookError:
        return []
    return [{"name": each.name, "model": each.model, "category": each.category, "doc": each.doc} for each in found]


def _model(model: Model) -> dict[str, Any]:
    live = usually_live(model.name)
    return {
        "title": model.title,
        "text": model.text,
        "delta": model.delta,
        "quoted": model.quoted,
        "parameters": [_parameter(model, each, each.name in live) for each in model.parameters.values()],
    }


def _parameter(model: Model, each: Parameter, live: bool) -> dict[str, Any]:
    return {
        "name": each.name,
        "kind": each.kind,
        "default": each.default,
        "hard": each.hard,
        "soft": each.soft,
        "unit": each.unit,
        "help": each.help,
        "quote": model.quotes.get(each.name, ""),
        "choices": each.choices,
        "follows": each.follows,
        "optional": each.optional,
        "live": live,
        "file": each.file is not None,
        "stands": each.stands is not None,
    }
