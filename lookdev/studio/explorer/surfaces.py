"""The surfaces of the Explorer: the page names each by a text, as `lookdev plot` reads it on the command line.

This module reads the texts. It returns the parameters of a surface, for the sliders of the page, and its values in
plots.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf import MODELS, Model, StackLayer
from lookdev.brdf.vectors import Parameters, are_equal
from lookdev.codegen.program.arrays import CompiledProgram, compile_layers
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.symbolic import symbol, symbols
from lookdev.errors import LookdevError
from lookdev.material import Input, Layer, Look
from lookdev.material.usd import read_look
from lookdev.plotting import PlotOptions, PlotSubject, kind_named, read_subject
from lookdev.plotting.figure import PlotValues
from lookdev.plotting.subject import LOOK_PATTERN, read_parameters, split_label
from lookdev.studio.roots import Roots

MAX_TEXT_LENGTH = 4000  # characters of the text of a surface
_CACHE_SIZE = 64  # largest number of cached subjects, and of cached programs


@dataclass(frozen=True)
class _LayersKey:
    """A hashable key of layers whose parameters are constants, without the values of one parameter.

    `moved_parameter` is the name of this parameter, or "". The user moves its slider, so one program is compiled for
    all its values. Each of `layers` has the model, the mode, the mask, and names and values of the other parameters.
    """

    layers: tuple[tuple[str, str, float, tuple[tuple[str, str | tuple[float, ...]], ...]], ...]
    moved_parameter: str

    @classmethod
    def of(cls, layers: Sequence[StackLayer], moved_parameter: str) -> _LayersKey:
        """Return the key of layers."""
        layer_keys = []
        for layer in layers:
            values = tuple(
                (name, value if isinstance(value, str) else tuple(np.ravel(value).tolist()))
                for name, value in layer.parameters.items()
                if name != moved_parameter
            )
            layer_keys.append((layer.model, layer.mode, float(np.asarray(layer.mask)), values))
        return cls(tuple(layer_keys), moved_parameter)


@lru_cache(maxsize=_CACHE_SIZE)
def _compile_layers_of(key: _LayersKey) -> CompiledProgram:
    """Return the compiled program of layers, whose parameter `key.moved_parameter` is an input of the program."""

    def make_layers(graph: Graph) -> list[StackLayer]:
        layers = []
        for name, mode, mask, values in key.layers:
            model = MODELS[name]
            numbers: dict[str, object] = {
                parameter: value if isinstance(value, str) else np.array(value if len(value) > 1 else value[0])
                for parameter, value in values
            }
            if moved := model.parameters.get(key.moved_parameter):
                names = [f"{moved.name}_{i}" for i in range(3)]
                numbers[moved.name] = symbol(graph, moved.name) if moved.kind == "float" else symbols(graph, names)
            layers.append(StackLayer(name, numbers, np.asarray(mask), mode))  # type: ignore[arg-type]
        return layers

    return compile_layers(make_layers)


def accelerate(subject: PlotSubject, moved_parameter: str = "") -> PlotSubject:
    """Return a subject whose BSDF f is evaluated by a compiled program.

    The program is the same for all values of the parameter with the name `moved_parameter`. Subjects of measured data
    would gain little, and subjects whose parameters change with the view cannot be compiled. All these, and subjects of
    delta lobes alone, are returned unchanged.
    """
    if not subject.layers or not subject.is_view_independent or subject.is_delta:
        return subject
    if any(parameter.file for layer in subject.layers for parameter in MODELS[layer.model].parameters.values()):
        return subject
    parameters = subject.parameters
    if parameters is None or moved_parameter not in parameters or isinstance(parameters[moved_parameter], str):
        moved_parameter = ""
    program = _compile_layers_of(_LayersKey.of(subject.layers, moved_parameter))
    numbers = {}
    if parameters is not None and moved_parameter:
        value = np.asarray(parameters[moved_parameter])
        names = [f"{moved_parameter}_{i}" for i in range(len(value))] if value.ndim else [moved_parameter]
        numbers = dict(zip(names, map(float, value.ravel()), strict=True))

    def f(wo: Floats, wi: Floats) -> Floats:
        return program.f(wo, wi, numbers)

    return replace(subject, evaluate_fast=f)


@dataclass
class Surfaces:
    """The surfaces that texts specify, with a cache of the newest subjects; `library` is a folder of presets.

    In a text, a file has the name by which `roots` finds it.
    """

    roots: Roots
    library: Path | None = None
    _subjects: dict[str, PlotSubject] = field(default_factory=dict)

    def subject(self, text: str, fresh: bool = False) -> PlotSubject:
        """Return the `PlotSubject` of a text; with `fresh`, read its files again. Raises what `read_subject` raises."""
        if len(text) > MAX_TEXT_LENGTH:
            raise LookdevError(f"a surface of {len(text)} characters; at most {MAX_TEXT_LENGTH} would be right")
        subject = None if fresh else self._subjects.get(text)
        if subject is None:
            subject = read_subject(text, self.library, self.roots.locate)
            self._subjects[text] = subject
            # Several threads may remove the same entry.
            for old in list(self._subjects)[:-_CACHE_SIZE]:
                self._subjects.pop(old, None)
        return subject

    def values(
        self, kind: str, text: str, options: PlotOptions, draft: bool = False, moved_parameter: str = ""
    ) -> PlotValues:
        """Return the values of a surface in a kind of plot, or with `draft` the values of a faster draft, if any.

        `moved_parameter` is the name of the parameter whose slider the user has moved last, or "" if there is none.
        """
        plot_kind = kind_named(kind)
        compute = plot_kind.draft if draft and plot_kind.draft else plot_kind.values
        return compute(accelerate(self.subject(text), moved_parameter), options)

    def describe(self, text: str) -> dict[str, object]:
        """Return the data of a surface that a page edits: label, base, model and all parameter values.

        ``base`` is the text before the parameters, a model or a preset. ``given`` has the values that the text states,
        by parameter; ``values`` has the values of all parameters; ``usual`` has the values of all parameters for a text
        that states none. ``editable`` is whether the page can change the parameters, ``delta`` whether the surface
        scatters along single directions only, and ``look`` whether the text names a look in a file.
        """
        label, rest = split_label(text, self.roots.locate)
        subject = self.subject(text, fresh=True)
        base, stated = rest, {}
        model = MODELS.get(subject.model)
        editable = model is not None and subject.is_view_independent
        if model is not None:
            if Path(base).suffix and ":" not in base and any(parameter.file for parameter in model.parameters.values()):
                (name,) = (parameter.name for parameter in model.parameters.values() if parameter.file)
                base, stated = model.name, {name: rest}
            elif _is_look(base):
                editable = False
            else:
                base, _, parameter_text = rest.partition(":")
                read_parameters(text, model, parameter_text, self.roots.locate)
                stated = dict(pair.split("=", 1) for pair in parameter_text.split(",") if pair)
        return {
            "words": text,
            "label": label,
            "base": base,
            "model": subject.model,
            "layers": [f"{layer.name or layer.model}" for layer in subject.layers],
            "editable": editable,
            "delta": subject.is_delta,
            "look": _is_look(rest),
            "given": {name.strip(): _parse_value(model, name.strip(), value.strip()) for name, value in stated.items()},
            "values": _values(model, subject),
            "usual": self._default_values(base, subject, model),
            "title": _title(subject, model),
        }

    def _default_values(self, base: str, subject: PlotSubject, model: Model | None) -> dict[str, object]:
        """Return the values that the parameters have if the text does not state them: the model's, or the preset's."""
        if model is None or subject.parameters is None:
            return {}
        if base == model.name:
            return {name: _plain_value(parameter.default) for name, parameter in model.parameters.items()}
        return _values(model, self.subject(base))

    def command(self, kind: str, surfaces: Sequence[str], options: PlotOptions) -> str:
        """Return the command line of `lookdev plot` that writes the same plot of surfaces."""
        option_names = kind_named(kind).option_names
        texts = [shlex.quote(self.roots.replace_names(subject)) for subject in surfaces]
        parts = ["lookdev", "plot", kind, *texts, "-o", f"{kind}.png"]
        for name, value in options.changed_options().items():
            if name in option_names:
                argument = f"{value:g}" if isinstance(value, float) else value
                parts += [f"--{name}"] if value is True else [f"--{name}", argument]
        return " ".join(map(str, parts))

    def look_file(self, text: str) -> Path | None:
        """Return the file of a look, or None if the text does not name a look in a file."""
        _, rest = split_label(text, self.roots.locate)
        match = LOOK_PATTERN.fullmatch(rest)
        return self.roots.locate(match["file"]) if match else None

    def look_to_render(self, text: str) -> Look:
        """Return the look of a surface for the renderer.

        If the text names a look in a file, and no layer of it, the look has its textures, too.
        """
        _, rest = split_label(text, self.roots.locate)
        if (match := LOOK_PATTERN.fullmatch(rest)) and match["layer"] is None:
            return replace(read_look(self.roots.locate(match["file"]), match["prim"]), name="explored")
        return self.look(text)

    def look(self, text: str, name: str = "explored") -> Look:
        """Return the look of a surface; its parameters are constants.

        Raises LookdevError if the parameters change with the view.
        """
        subject = self.subject(text)
        if not subject.is_view_independent:
            raise LookdevError(f"{text}: its parameters change with the view; only the renderer can show it")
        return look_from_layers(subject.layers, name)


def look_from_layers(layers: Sequence[StackLayer], name: str) -> Look:
    """Return a look of layers whose parameters are constants."""
    look_layers = []
    for number, layer in enumerate(layers):
        parameters = non_default_parameters(MODELS[layer.model], layer.parameters)
        mask = float(np.asarray(layer.mask)) if number else 1.0
        look_layers.append(Layer(layer.name or f"Layer{number}", layer.model, parameters, mask, layer.mode))
    return Look(name, tuple(look_layers))


def non_default_parameters(model: Model, parameters: Parameters) -> dict[str, Input]:
    """Return the values of parameters that differ from their default.

    If a parameter `follows` another parameter, its default is the other parameter's value.
    """
    stated: dict[str, Input] = {}
    for name, parameter in model.parameters.items():
        value = parameters[name]
        default = parameters[parameter.follows] if parameter.follows else parameter.default
        if isinstance(value, str):
            if value != default:
                stated[name] = value
        elif not are_equal(np.asarray(value), np.asarray(default, np.float64)):
            stated[name] = tuple(np.ravel(value).tolist()) if np.ndim(value) else float(value)
    return stated


def _is_look(text: str) -> bool:
    """Return whether a text names a look in a file."""
    return LOOK_PATTERN.fullmatch(text) is not None


def _parse_value(model: Model | None, name: str, text: str) -> str | float | list[float]:
    """Return the value of a parameter in a text; a colour with one number is grey."""
    if model is None or model.parameters[name].kind == "token":
        return text
    numbers = [float(number) for number in text.split("/")]
    if model.parameters[name].kind == "float":
        return numbers[0]
    return numbers if len(numbers) == 3 else numbers * 3


def _values(model: Model | None, subject: PlotSubject) -> dict[str, object]:
    """Return the values of a single layer's parameters, for JSON, without values that are paths of files."""
    parameters = model.parameters if model else {}
    return {
        name: _plain_value(value) for name, value in (subject.parameters or {}).items() if not parameters[name].file
    }


def _plain_value(value: object) -> object:
    """Return the value of a parameter for JSON: a text, a number or a list of numbers."""
    return value if isinstance(value, str) else np.asarray(value).tolist()


def _title(subject: PlotSubject, model: Model | None) -> str:
    """Return a description of a surface for the page, by its model or its layers."""
    if model is not None:
        return model.title
    return f"stack of {len(subject.layers)} layers" if subject.layers else "look"
