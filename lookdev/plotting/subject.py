"""Subjects of plots: a subject is a surface with a BSDF and a label, which an argument of the command line describes.

Functions call this argument `words`. ``disney:roughness=.3,baseColor=.8/.2/.1`` is a model with parameters, and
``red_plastic:roughness=.1`` is a preset with a parameter. ``look.usda:2`` is a layer of a look, ``look.usda@.5,.25``
its stack of layers at texture coordinates, and ``look.usda#/Paint`` one of the materials in its file. Any other file is
measured data. ``label=`` before any of these replaces the label in the legend.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf import MODELS, Array, Bsdf, Model, Real, complete_parameters, model_named, stack_bsdf
from lookdev.brdf.measured import MEASURED
from lookdev.brdf.model import StackLayer
from lookdev.brdf.parameters import ParameterValue
from lookdev.brdf.vectors import Parameters
from lookdev.errors import LookdevError, LookError, ModelError, nearest_hint
from lookdev.material import Look, depends_on_view
from lookdev.material.library import LOOK_SUFFIXES, find_preset, library_folders, read_library
from lookdev.material.library.edit import preset_look
from lookdev.material.points import SinglePoint
from lookdev.material.usd import read_look
from lookdev.material.values import look_layers

# A label ends at the first "=". A further "=" belongs to a parameter, and must follow one of ":@#/.".
_LABEL = re.compile(r"([^=:@#/]+)=(?=[^=:@#/]*(?:[:@#/.]|$))(.+)", re.DOTALL)
LOOK_PATTERN = re.compile(
    rf"(?P<file>.+?(?:{'|'.join(map(re.escape, LOOK_SUFFIXES))}))"
    r"(?:#(?P<prim>/[^:@]*))?(?::(?P<layer>[^@]+))?(?:@(?P<uv>.+))?"
)
"""Words that describe a look, without a label: ``FILE[#PRIM][:LAYER][@U,V]``."""


@dataclass(frozen=True, eq=False)
class PlotSubject:
    """A surface to plot: a label, its BSDF, and its layers, base first.

    `is_view_independent` is whether the parameters of the layers are the same for every view; if they are not, `layers`
    has the layers for a view along the normal. `evaluate_fast`, if there is one, returns the values (n, 3) of the BSDF
    for directions `wo` and `wi` (n, 3).
    """

    label: str
    bsdf: Bsdf
    layers: tuple[StackLayer, ...] = ()
    is_view_independent: bool = True
    evaluate_fast: Callable[[Floats, Floats], Floats] | None = None

    @property
    def model(self) -> str:
        """The model of a single layer; an empty string for a stack."""
        return self.layers[0].model if len(self.layers) == 1 else ""

    @property
    def parameters(self) -> Parameters | None:
        """All parameters of a single layer; None for a stack."""
        return self.layers[0].parameters if len(self.layers) == 1 else None

    @property
    def is_delta(self) -> bool:
        """Whether the surface scatters along single directions only."""
        if self.layers:
            return all(MODELS[layer.model].delta for layer in self.layers)
        wo = np.array([0.0, 0.6, 0.8])
        return not self.bsdf.lobes(wo) and bool(self.bsdf.deltas(wo, np.asarray(False)))


LocateFile = Callable[[str], Path]
"""A function that returns the path of a file that words name; it raises LookdevError if it must not be read."""


def read_subject(words: str, library: Path | None = None, locate: LocateFile = Path) -> PlotSubject:
    """Return the subject that words of the command line describe; `library` is a folder of presets.

    Raises
    ------
    ModelError, LookError, TextureError
        A parameter, a preset, a look or a file is wrong.
    LookdevError
        There is no model, preset or file of that name.
    """
    label, words = split_label(words, locate)
    subject = _read_unlabelled(words, library, locate)
    return replace(subject, label=label) if label else subject


def split_label(words: str, locate: LocateFile = Path) -> tuple[str, str]:
    """Return the label at the beginning of words, or an empty string, and the words without labels.

    If there are several labels, the first is returned.
    """
    match = None if _is_file(words, locate, folders=True) else _LABEL.fullmatch(words)
    if match is None:
        return "", words
    _, rest = split_label(match[2], locate)
    return match[1].strip(), rest


def _read_unlabelled(words: str, library: Path | None, locate: LocateFile) -> PlotSubject:
    """Return the subject of words without a label; raises as `read_subject` does."""
    if look := LOOK_PATTERN.fullmatch(words):
        return _look_subject(words, look["file"], locate(look["file"]), look["prim"], look["layer"], look["uv"])
    name, _, rest = words.partition(":")
    if name in MODELS:
        return model_subject(*read_model(words, locate), words)
    if _is_file(words, locate):
        return model_subject(MEASURED, {"file": str(locate(words))}, Path(words).name)
    if Path(name).suffix:
        raise LookdevError(f"{words}: no such file; a look, a MERL binary or data of Ngan et al. would be right")
    return _preset_subject(words, name, rest, library)


def _is_file(words: str, locate: LocateFile, folders: bool = False) -> bool:
    """Return whether words are the path of a file, or with `folders` of a file or a folder."""
    try:
        path = locate(words)
        return path.is_file() or (folders and path.exists())
    except (LookdevError, OSError, ValueError):
        return False


def read_model(words: str, locate: LocateFile = Path) -> tuple[Model, dict[str, ParameterValue]]:
    """Return the model in words such as ``disney:sheen=0``, and the parameters that they state.

    Raises as `read_subject` does.
    """
    name, _, rest = words.partition(":")
    model = model_named(name)
    return model, read_parameters(words, model, rest, locate)


def model_subject(model: Model, constants: Mapping[str, object], label: str) -> PlotSubject:
    """Return the subject of a model with the parameters `constants`, and others at their defaults.

    Raises ModelError if a parameter is wrong.
    """
    parameters = model.complete(constants)
    return PlotSubject(label, model.bsdf(parameters), (StackLayer(model.name, parameters),))


def read_parameters(words: str, model: Model, text: str, locate: LocateFile = Path) -> dict[str, ParameterValue]:
    """Parse a model's parameters from text such as ``roughness=.3,baseColor=.8/.2/.1``; `words` are for messages."""
    parameters: dict[str, ParameterValue] = {}
    for pair in filter(None, text.split(",")):
        name, equals, value = pair.partition("=")
        name = name.strip()
        if not equals:
            raise ModelError(f"{words}: '{pair}' is not NAME=VALUE, for instance {next(iter(model.parameters))}=…")
        if name not in model.parameters:
            raise ModelError(f"{words}: {model.name} has no '{name}' ({nearest_hint(name, list(model.parameters))})")
        parameter, text = model.parameters[name], value.strip()
        if parameter.file and text not in parameter.choices:
            text = str(locate(text))
        parameters[name] = _parse_value(words, parameter.kind, name, text)
    return parameters


def _parse_value(words: str, kind: str, name: str, text: str) -> ParameterValue:
    """Parse a parameter's value by the parameter's `kind`; `words` and `name` are for messages."""
    if kind == "token":
        return text
    try:
        numbers = [float(number) for number in text.split("/")]
    except ValueError:
        numbers = []
    if kind == "float" and len(numbers) == 1:
        return numbers[0]
    if kind == "color" and len(numbers) == 1:
        return (numbers[0],) * 3
    if kind != "float" and len(numbers) == 3:
        return numbers[0], numbers[1], numbers[2]
    right = "a number" if kind == "float" else "R/G/B or one number" if kind == "color" else "X/Y/Z"
    raise ModelError(f"{words}: {name} is '{text}'; {right} would be right")


def _preset_subject(words: str, name: str, rest: str, library: Path | None) -> PlotSubject:
    """Return the subject of a preset, with the parameters in the text `rest` in place of its own."""
    try:
        preset = find_preset(name, library)
    except LookError:
        names = [*MODELS, *(preset.name for preset in read_library(library_folders(library)).presets)]
        hint = nearest_hint(name, names) if nearest_hint(name, names).startswith("did") else "see lookdev materials"
        raise LookdevError(f"'{name}' is not a model, a preset or a file ({hint})") from None
    (layer,) = _layers_at(preset_look(preset, name), (0.5, 0.5), np.ones(1))
    parameters = dict(layer.parameters) | {
        key: complete_parameters(layer.model, {key: value})[key]
        for key, value in read_parameters(words, model_named(layer.model), rest).items()
    }
    return PlotSubject(words, model_named(layer.model).bsdf(parameters), (replace(layer, parameters=parameters),))


def _look_subject(
    words: str, file_text: str, file: Path, prim: str | None, layer: str | None, uv_text: str | None
) -> PlotSubject:
    """Return the subject of a look, or of one of its layers, from the groups of `LOOK_PATTERN`.

    `file_text` is the name of the file in the words, and `file` is its path.
    """
    look = read_look(file, prim)
    uv = _parse_uv(words, uv_text)
    label = words.replace(file_text, file.stem, 1)
    if layer is not None:
        names = [candidate.name for candidate in look.layers]
        if layer.isdigit() and int(layer) < len(names):
            number = int(layer)
        elif layer in names:
            number = names.index(layer)
        else:
            raise LookdevError(f"{words}: no layer '{layer}' ({nearest_hint(layer, names)}; or 0 to {len(names) - 1})")
        look = replace(look, layers=(replace(look.layers[number], mask=1.0, mode="over"),))
    layers = _layers_at(look, uv, np.ones(1))
    if any(
        depends_on_view(source) for candidate in look.layers for source in (*candidate.inputs.values(), candidate.mask)
    ):
        # The parameters are functions of the view, so each view has its own stack.
        def bsdf_for_view(wo: Array) -> Bsdf:
            return stack_bsdf(_layers_at(look, uv, np.abs(np.asarray(wo)[..., 2]), is_squeezed=False))

        upright_bsdf = bsdf_for_view(np.array([[0.0, 0.0, 1.0]]))
        bsdf = replace(upright_bsdf, lobes=lambda wo: bsdf_for_view(wo).lobes(wo))
        return PlotSubject(label, bsdf, tuple(layers), is_view_independent=False)
    return PlotSubject(label, stack_bsdf(layers), tuple(layers))


def _layers_at(look: Look, uv: tuple[float, float], cosine: Floats, is_squeezed: bool = True) -> list[StackLayer]:
    """Return the layers of a look at texture coordinates, for views with the cosines (n,) to the normal.

    With `is_squeezed`, which needs a single view, the values lose the axis of views.
    """

    def squeeze(value: Real) -> Real:
        """Return a value without its first axis if this axis has one entry."""
        return np.squeeze(np.asarray(value), 0) if np.ndim(value) and np.shape(value)[0] == 1 else value

    layers = look_layers(look, SinglePoint(cosine, uv))
    if not is_squeezed:
        return layers
    return [
        replace(
            layer,
            parameters={
                name: value if isinstance(value, str) else squeeze(value) for name, value in layer.parameters.items()
            },
            mask=squeeze(layer.mask),
        )
        for layer in layers
    ]


def _parse_uv(words: str, text: str | None) -> tuple[float, float]:
    """Return the texture coordinates in a text, by default the middle of the texture; `words` are for messages."""
    if text is None:
        return 0.5, 0.5
    try:
        u, v = (float(number) for number in text.split(","))
    except ValueError:
        raise LookdevError(
            f"{words}: '@{text}' is not a location; @U,V would be right, for instance @0.5,0.25"
        ) from None
    return u, v
