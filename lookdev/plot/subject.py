"""What is plotted: a BSDF with constant parameters and a label, from the words of a command line.

``disney:roughness=.3,baseColor=.8/.2/.1`` is a model; ``red_plastic:roughness=.1`` a preset; ``look.usda:2`` a layer of
a look, ``look.usda@.5,.25`` its stack at texture coordinates, ``look.usda#/Paint`` a material of it; any other file
is measured. ``label=`` before any of these replaces what the legend shows.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lookdev.brdf import MODELS, Bsdf, Model, complete_parameters, model_named, stack_bsdf
from lookdev.brdf.measured import MEASURED
from lookdev.brdf.model import StackLayer
from lookdev.errors import LookdevError, LookError, ModelError, nearest_hint
from lookdev.material import Look, Primvar
from lookdev.material.library import SUFFIXES, find_preset, library_folders, read_library
from lookdev.material.library.edit import preset_look
from lookdev.material.look import depends_on_view
from lookdev.material.points import Floats, ImagePoints
from lookdev.material.usd import read_look
from lookdev.material.values import look_layers

_LABEL = re.compile(r"([^=:@#/]+)=(?=[^=:@#/]*(?:[:@#/.]|$))(.+)", re.DOTALL)
_LOOK = re.compile(
    rf"(?P<file>.+?(?:{'|'.join(map(re.escape, SUFFIXES))}))"
    r"(?:#(?P<prim>/[^:@]*))?(?::(?P<layer>[^@]+))?(?:@(?P<uv>.+))?"
)


@dataclass(frozen=True, eq=False)
class Subject:
    """A surface to plot: a label, and its BSDF.

    `model` and `parameters` are those of a single layer; a stack has none.
    """

    label: str
    bsdf: Bsdf
    model: str = ""
    parameters: Mapping[str, Any] | None = None

    @property
    def is_delta(self) -> bool:
        """Whether it scatters along single directions alone."""
        wo = np.array([0.0, 0.6, 0.8])
        return not self.bsdf.lobes(wo) and bool(self.bsdf.deltas(wo, np.asarray(False)))


@dataclass(frozen=True)
class _Point(ImagePoints):
    """One point of a surface, without primvars of its own, seen along a cosine."""

    at: tuple[float, float]
    cosine: Floats

    def uv(self, name: str) -> Floats:
        return np.array([self.at])

    def primvar(self, primvar: Primvar) -> Floats:
        return np.array([primvar.fallback], np.float64)

    def handedness(self) -> Floats:
        return np.ones(1)

    def view(self) -> Floats:
        return self.cosine


def read_subject(words: str, library: Path | None = None) -> Subject:
    """Return what words of the command line stand for.

    Raises
    ------
    ModelError, LookError, TextureError
        A parameter, a preset, a look or a file is wrong.
    LookdevError
        Nothing has that name.
    """
    named = None if Path(words).exists() else _LABEL.fullmatch(words)
    if named:
        return replace(read_subject(named[2], library), label=named[1].strip())
    if look := _LOOK.fullmatch(words):
        return _of_look(words, Path(look["file"]), look["prim"], look["layer"], look["uv"])
    name, _, rest = words.partition(":")
    if name in MODELS:
        return subject_of(*read_model(words), words)
    if Path(words).is_file():
        return subject_of(MEASURED, {"file": words}, Path(words).name)
    if Path(name).suffix:
        raise LookdevError(f"{words}: no such file; a look, a MERL binary or data of Ngan et al. would be right")
    return _of_preset(words, name, rest, library)


def read_model(words: str) -> tuple[Model, dict[str, Any]]:
    """Return the model that words such as ``disney:sheen=0`` name, and the parameters given; errors as above."""
    name, _, rest = words.partition(":")
    model = model_named(name)
    return model, _parameters(words, model, rest)


def subject_of(model: Model, given: Mapping[str, object], label: str) -> Subject:
    """Return a model with some of its parameters; a ModelError reports what is wrong with them."""
    parameters = model.complete(given)
    return Subject(label, model.bsdf(parameters), model.name, parameters)


def _parameters(words: str, model: Model, text: str) -> dict[str, Any]:
    given: dict[str, Any] = {}
    for pair in filter(None, text.split(",")):
        name, equals, value = pair.partition("=")
        name = name.strip()
        if not equals:
            raise ModelError(f"{words}: '{pair}' is no NAME=VALUE, for instance {next(iter(model.parameters))}=…")
        if name not in model.parameters:
            raise ModelError(f"{words}: {model.name} has no '{name}' ({nearest_hint(name, list(model.parameters))})")
        given[name] = _value(words, model.parameters[name].kind, name, value.strip())
    return given


def _value(words: str, kind: str, name: str, text: str) -> object:
    if kind == "token":
        return text
    try:
        numbers = [float(each) for each in text.split("/")]
    except ValueError:
        numbers = []
    if kind == "float" and len(numbers) == 1:
        return numbers[0]
    if kind == "color" and len(numbers) == 1:
        return (numbers[0],) * 3
    if kind != "float" and len(numbers) == 3:
        return tuple(numbers)
    right = "a number" if kind == "float" else "R/G/B or one number" if kind == "color" else "X/Y/Z"
    raise ModelError(f"{words}: {name} is '{text}'; {right} would be right")


def _of_preset(words: str, name: str, rest: str, library: Path | None) -> Subject:
    try:
        preset = find_preset(name, library)
    except LookError:
        known = [*MODELS, *(each.name for each in read_library(library_folders(library)).presets)]
        hint = nearest_hint(name, known) if nearest_hint(name, known).startswith("did") else "see lookdev materials"
        raise LookdevError(f"'{name}' is no model, no preset and no file ({hint})") from None
    (layer,) = _layers(preset_look(preset, name), (0.5, 0.5), np.ones(1))
    given = dict(layer.parameters) | {
        key: complete_parameters(layer.model, {key: value})[key]
        for key, value in _parameters(words, model_named(layer.model), rest).items()
    }
    return Subject(words, model_named(layer.model).bsdf(given), layer.model, given)


def _of_look(words: str, file: Path, prim: str | None, layer: str | None, at: str | None) -> Subject:
    look = read_look(file, prim)
    place = _place(words, at)
    label = words.replace(str(file), file.stem, 1)
    if layer is not None:
        names = [each.name for each in look.layers]
        if layer.isdigit() and int(layer) < len(names):
            number = int(layer)
        elif layer in names:
            number = names.index(layer)
        else:
            raise LookdevError(f"{words}: no layer '{layer}' ({nearest_hint(layer, names)}; or 0 to {len(names) - 1})")
        look = replace(look, layers=(replace(look.layers[number], mask=1.0, mode="over"),))
    if any(depends_on_view(source) for each in look.layers for source in (*each.inputs.values(), each.mask)):
        # The parameters are functions of the view, so the stack is made for each.
        def seen(wo: Any) -> Bsdf:
            return stack_bsdf(_layers(look, place, np.abs(np.asarray(wo)[..., 2]), squeezed=False))

        front = seen(np.array([[0.0, 0.0, 1.0]]))
        return Subject(label, replace(front, lobes=lambda wo: seen(wo).lobes(wo)))
    layers = _layers(look, place, np.ones(1))
    alone = {"model": layers[0].model, "parameters": layers[0].parameters} if len(layers) == 1 else {}
    return Subject(label, stack_bsdf(layers), **alone)  # type: ignore[arg-type]


def _layers(look: Look, place: tuple[float, float], cosine: Floats, squeezed: bool = True) -> list[StackLayer]:
    """Return the layers at a point; without a view, parameters are single numbers and colours."""

    def plain(value: Any) -> Any:
        return np.squeeze(np.asarray(value), 0) if np.ndim(value) and np.shape(value)[0] == 1 else value

    layers = look_layers(look, _Point(place, cosine))
    if not squeezed:
        return layers
    return [
        replace(each, parameters={name: plain(value) for name, value in each.parameters.items()}, mask=plain(each.mask))
        for each in layers
    ]


def _place(words: str, text: str | None) -> tuple[float, float]:
    if text is None:
        return 0.5, 0.5
    try:
        u, v = (float(each) for each in text.split(","))
    except ValueError:
        raise LookdevError(f"{words}: '@{text}' is no place; @U,V would be right, for instance @0.5,0.25") from None
    return u, v
