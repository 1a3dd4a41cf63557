"""What is plotted: a BSDF with constant parameters and a label, from the words of a command line.

``disney:roughness=.3,baseColor=.8/.2/.1`` is a model; ``red_plastic:roughness=.1`` a preset; ``look.usda:2`` a layer of
a look, ``look.usda@.5,.25`` its stack at texture coordinates, ``look.usda#/Paint`` a material of it; any other file
is measured. ``label=`` before any of these replaces what the legend shows.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
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
LOOK = re.compile(
    rf"(?P<file>.+?(?:{'|'.join(map(re.escape, SUFFIXES))}))"
    r"(?:#(?P<prim>/[^:@]*))?(?::(?P<layer>[^@]+))?(?:@(?P<uv>.+))?"
)


@dataclass(frozen=True, eq=False)
class Subject:
    """A surface to plot: a label, its BSDF, and the layers that it is made of, base first, as they are seen from above.

    `model` and `parameters` are those of a single layer; a stack has none. `faster` computes the same f as the BSDF for
    directions (n, 3).
    """

    label: str
    bsdf: Bsdf
    layers: tuple[StackLayer, ...] = ()
    seen_alike: bool = True
    faster: Callable[[Floats, Floats], Floats] | None = None

    @property
    def model(self) -> str:
        """The model of the only layer, or an empty string."""
        return self.layers[0].model if len(self.layers) == 1 else ""

    @property
    def parameters(self) -> Mapping[str, Any] | None:
        """All parameters of the only layer."""
        return self.layers[0].parameters if len(self.layers) == 1 else None

    @property
    def is_delta(self) -> bool:
        """Whether it scatters along single directions alone."""
        if self.layers:
            return all(MODELS[layer.model].delta for layer in self.layers)
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


Locate = Callable[[str], Path]
"""Finds the file of a name in words; raises LookdevError where it may not be read."""


def read_subject(words: str, library: Path | None = None, locate: Locate = Path) -> Subject:
    """Return what words of the command line stand for.

    Raises
    ------
    ModelError, LookError, TextureError
        A parameter, a preset, a look or a file is wrong.
    LookdevError
        Nothing has that name.
    """
    label, words = split_label(words, locate)
    subject = _read(words, library, locate)
    return replace(subject, label=label) if label else subject


def split_label(words: str, locate: Locate = Path) -> tuple[str, str]:
    """Return the label before words, or an empty string, and the rest."""
    named = None if _is_file(words, locate, folders=True) else _LABEL.fullmatch(words)
    if named is None:
        return "", words
    _, rest = split_label(named[2], locate)
    return named[1].strip(), rest


def _read(words: str, library: Path | None, locate: Locate) -> Subject:
    if look := LOOK.fullmatch(words):
        return _of_look(words, look["file"], locate(look["file"]), look["prim"], look["layer"], look["uv"])
    name, _, rest = words.partition(":")
    if name in MODELS:
        return subject_of(*read_model(words, locate), words)
    if _is_file(words, locate):
        return subject_of(MEASURED, {"file": str(locate(words))}, Path(words).name)
    if Path(name).suffix:
        raise LookdevError(f"{words}: no such file; a look, a MERL binary or data of Ngan et al. would be right")
    return _of_preset(words, name, rest, library)


def _is_file(words: str, locate: Locate, folders: bool = False) -> bool:
    try:
        place = locate(words)
        return place.is_file() or (folders and place.exists())
    except (LookdevError, OSError, ValueError):
        return False


def read_model(words: str, locate: Locate = Path) -> tuple[Model, dict[str, Any]]:
    """Return the model that words such as ``disney:sheen=0`` name, and the parameters given; errors as above."""
    name, _, rest = words.partition(":")
    model = model_named(name)
    return model, read_parameters(words, model, rest, locate)


def subject_of(model: Model, given: Mapping[str, object], label: str) -> Subject:
    """Return a model with some of its parameters; a ModelError reports what is wrong with them."""
    parameters = model.complete(given)
    return Subject(label, model.bsdf(parameters), (StackLayer(model.name, parameters),))


def read_parameters(words: str, model: Model, text: str, locate: Locate = Path) -> dict[str, Any]:
    """Return the parameters of a model that text as ``roughness=.3,baseColor=.8/.2/.1`` gives; words are for errors."""
    given: dict[str, Any] = {}
    for pair in filter(None, text.split(",")):
        name, equals, value = pair.partition("=")
        name = name.strip()
        if not equals:
            raise ModelError(f"{words}: '{pair}' is no NAME=VALUE, for instance {next(iter(model.parameters))}=…")
        if name not in model.parameters:
            raise ModelError(f"{words}: {model.name} has no '{name}' ({nearest_hint(name, list(model.parameters))})")
        parameter, text = model.parameters[name], value.strip()
        if parameter.file and text not in parameter.choices:
            text = str(locate(text))
        given[name] = _value(words, parameter.kind, name, text)
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
        for key, value in read_parameters(words, model_named(layer.model), rest).items()
    }
    return Subject(words, model_named(layer.model).bsdf(given), (replace(layer, parameters=given),))


def _of_look(words: str, named: str, file: Path, prim: str | None, layer: str | None, at: str | None) -> Subject:
    look = read_look(file, prim)
    place = _place(words, at)
    label = words.replace(named, file.stem, 1)
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
        above = tuple(_layers(look, place, np.ones(1)))
        return Subject(label, replace(front, lobes=lambda wo: seen(wo).lobes(wo)), above, seen_alike=False)
    layers = _layers(look, place, np.ones(1))
    return Subject(label, stack_bsdf(layers), tuple(layers))


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
