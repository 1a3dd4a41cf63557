"""Operations on the stack of layers of a look: each request of the page becomes a label and an edit of the look's file.

The label names the step in the history.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from lookdev.brdf import MODELS
from lookdev.errors import ModelError, shorten
from lookdev.material.expression import ExpressionKind
from lookdev.material.library import find_preset
from lookdev.material.library.arrange import enable_layer, move_layer, rename_layer, select_variant, set_mode
from lookdev.material.library.edit import add_layer, remove_layer, set_mask
from lookdev.material.library.fragments import duplicate_layer, paste_layer
from lookdev.material.library.parameters import set_source, unset_parameter
from lookdev.material.library.stack import LookOutline
from lookdev.studio.designer.rows import read_source
from lookdev.studio.designer.sources import LookLocation, OpenedLook

FileEdit = Callable[[Path], object]
"""A function that edits the file at a path; the Designer calls it with a hidden copy beside the look's file."""


def parse_operation(
    body: Mapping[str, Any],
    location: LookLocation,
    opened: OpenedLook,
    variants: Mapping[str, str],
    roots: Sequence[Path],
) -> tuple[str, FileEdit]:
    """Return the label and the edit of a request for a look; raise LookdevError if the request is not valid.

    In the request `body`, ``op`` names the operation. `location` is the location of the look, and `opened` the look
    with its outline. `variants` has the chosen variant of each of the look's sets. The look may read images in the
    folders `roots`.
    """
    parsed = _parse_stack_operation(body, location, opened.outline, variants)
    parsed = parsed or _parse_source_operation(body, location, opened, variants, list(roots))
    if parsed is None:
        raise ModelError("an edit of the stack has an op, a layer's number, and what the op needs")
    return parsed


def _parse_stack_operation(
    body: Mapping[str, Any], location: LookLocation, outline: LookOutline, variants: Mapping[str, str]
) -> tuple[str, FileEdit] | None:
    """Return the label and the edit of a request that changes layers or variants, or None for another request."""
    prim, name = location.prim, partial(_layer_name, outline)
    match body:
        case {"op": "add", "preset": str(preset)}:
            library_preset = find_preset(Path(preset).stem)
            return f"add {library_preset.name}", lambda file: add_layer(
                file, library_preset, prim=prim, variants=variants
            )
        case {"op": "remove", "layer": int(layer)}:
            return f"remove {name(layer)}", lambda file: remove_layer(file, str(layer), prim, variants)
        case {"op": "duplicate", "layer": int(layer)}:
            return f"duplicate {name(layer)}", lambda file: _move_above(
                file, duplicate_layer(file, str(layer), prim, variants), layer + 1, prim, variants
            )
        case {"op": "rename", "layer": int(layer), "name": str(new)}:
            new = new.strip()
            label = f"rename {name(layer)} to {shorten(new, 40)}"
            return label, lambda file: rename_layer(file, str(layer), new, prim, variants)
        case {"op": "move", "layer": int(layer), "to": int(to)}:
            return f"move {name(layer)}", lambda file: move_layer(file, str(layer), to, prim, variants)
        case {"op": "enable", "layer": int(layer), "enabled": bool(enabled)}:
            label = f"{'unmute' if enabled else 'mute'} {name(layer)}"
            return label, lambda file: enable_layer(file, str(layer), enabled, prim, variants)
        case {"op": "mode", "layer": int(layer), "mode": "over" | "transmit" as mode}:
            label = f"lay {name(layer)} {'over' if mode == 'over' else 'as a clear coat over'} what is beneath"
            return label, lambda file: set_mode(file, str(layer), mode, prim, variants)
        case {"op": "paste", "text": str(text)}:
            return "paste a layer", lambda file: paste_layer(file, text, prim, variants)
        case {"op": "variant", "set": str(set_name), "choice": str(choice)}:
            label = f"variant {set_name}: {choice}"
            return label, lambda file: select_variant(file, set_name, choice, prim)
    return None


def _parse_source_operation(
    body: Mapping[str, Any], location: LookLocation, opened: OpenedLook, variants: Mapping[str, str], roots: list[Path]
) -> tuple[str, FileEdit] | None:
    """Return the label and the edit of a request that changes a mask or a parameter, or None for another request."""
    prim, folder, name = location.prim, location.file.parent, partial(_layer_name, opened.outline)
    match body:
        case {"op": "mask", "layer": int(layer), "mask": str(text), "inputs": dict(inputs)}:
            mask = read_source(text, _nonempty_sources(inputs), folder, roots)
            return f"mask of {name(layer)}", lambda file: set_mask(file, str(layer), mask, prim, variants)
        case {
            "op": "source",
            "layer": int(layer),
            "parameter": str(parameter),
            "source": str(text),
            "inputs": dict(inputs),
        }:
            kind = _parameter_kind(opened, layer, parameter)
            source = read_source(text, _nonempty_sources(inputs), folder, roots, parameter, kind)
            return f"{name(layer)} {parameter}", lambda file: set_source(
                file, str(layer), parameter, source, prim, variants
            )
        case {"op": "unstate", "layer": int(layer), "parameter": str(parameter)}:
            label = f"{name(layer)} {shorten(parameter, 40)} back to its default"
            return label, lambda file: unset_parameter(file, str(layer), parameter, prim, variants)
    return None


def _layer_name(outline: LookOutline, layer: int) -> str:
    """Return the name of a layer by its number; raise ModelError if there is no such layer."""
    names = [entry.name for entry in outline.entries if entry.number == layer]
    if not names:
        raise ModelError(f"the look has no layer {shorten(str(layer), 20)}")
    return names[0]


def _parameter_kind(opened: OpenedLook, layer: int, parameter: str) -> ExpressionKind:
    """Return the type of the values of a layer's parameter: ``"color"`` or ``"float"``."""
    enabled = [entry.number for entry in opened.outline.entries if entry.enabled]
    model = opened.look.layers[enabled.index(layer)].model if layer in enabled else ""
    parameters = MODELS[model].parameters if model in MODELS else {}
    return "color" if parameter in parameters and parameters[parameter].kind == "color" else "float"


def _nonempty_sources(inputs: Mapping[Any, Any]) -> dict[str, str]:
    """Return the sources of an expression's inputs, by name, without those that the user left empty."""
    return {str(name): str(source) for name, source in inputs.items() if str(source).strip()}


def _move_above(file: Path, number: int, to: int, prim: str, variants: Mapping[str, str]) -> None:
    """Move the layer `number` so that its number is `to`; do nothing if it is already."""
    if to != number:
        move_layer(file, str(number), to, prim, variants)
