"""Surfaces by the words of the command line: what a page edits of them, and their numbers in plots."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from lookdev.brdf import MODELS, Model, StackLayer
from lookdev.brdf.vectors import same
from lookdev.codegen.program.arrays import Compiled, compile_layers
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.symbolic import symbol, symbols
from lookdev.errors import LookdevError
from lookdev.material import Layer, Look
from lookdev.material.usd import read_look
from lookdev.plotting import Options, Subject, kind_named, read_subject
from lookdev.plotting.angles import Floats, Values
from lookdev.plotting.subject import LOOK, read_parameters, split_label
from lookdev.studio.roots import Roots

LONGEST_WORDS = 4000
_KEPT = 64


@dataclass(frozen=True)
class _Frozen:
    """Layers whose numbers are constants, but for those of one name, as a key."""

    layers: tuple[tuple[str, str, float, tuple[tuple[str, Any], ...]], ...]
    moving: str

    @classmethod
    def of(cls, layers: Sequence[StackLayer], moving: str) -> _Frozen:
        found = []
        for layer in layers:
            values = tuple(
                (name, value if isinstance(value, str) else tuple(np.ravel(value).tolist()))
                for name, value in layer.parameters.items()
                if name != moving
            )
            found.append((layer.model, layer.mode, float(np.asarray(layer.mask)), values))
        return cls(tuple(found), moving)


@lru_cache(maxsize=_KEPT)
def _compiled(frozen: _Frozen) -> Compiled:
    def make(graph: Graph) -> list[StackLayer]:
        layers = []
        for name, mode, mask, given in frozen.layers:
            model = MODELS[name]
            numbers: dict[str, Any] = {
                k: v if isinstance(v, str) else np.array(v if len(v) > 1 else v[0]) for k, v in given
            }
            if moving := model.parameters.get(frozen.moving):
                wide = [f"{moving.name}_{i}" for i in range(3)]
                numbers[moving.name] = symbol(graph, moving.name) if moving.kind == "float" else symbols(graph, wide)
            layers.append(StackLayer(name, numbers, np.asarray(mask), mode))  # type: ignore[arg-type]
        return layers

    return compile_layers(make)


def faster(subject: Subject, moving: str = "") -> Subject:
    """Return a subject whose f is that of a traced program, in which one parameter may change.

    What is a look-up of measured data gains little and is left as it is, as are views that change the parameters.
    """
    if not subject.layers or not subject.seen_alike or subject.is_delta:
        return subject
    if any(each.file for layer in subject.layers for each in MODELS[layer.model].parameters.values()):
        return subject
    known = subject.parameters
    if known is None or moving not in known or isinstance(known[moving], str):
        moving = ""
    program = _compiled(_Frozen.of(subject.layers, moving))
    numbers = {}
    if known is not None and moving:
        value = np.asarray(known[moving])
        numbers = (
            {f"{moving}_{i}": float(each) for i, each in enumerate(value)} if value.ndim else {moving: float(value)}
        )

    def f(wo: Floats, wi: Floats) -> Floats:
        return program.f(wo, wi, numbers)

    return replace(subject, faster=f)


@dataclass
class Surfaces:
    """Reads surfaces from words in which files have the names of `roots`, and keeps the last ones."""

    roots: Roots
    library: Path | None = None
    _known: dict[str, Subject] = field(default_factory=dict)

    def subject(self, words: str, fresh: bool = False) -> Subject:
        """Return what words stand for; `fresh`: files are read again. Raises LookdevError as `read_subject`."""
        if len(words) > LONGEST_WORDS:
            raise LookdevError(f"a surface of {len(words)} characters; at most {LONGEST_WORDS} would be right")
        known = None if fresh else self._known.get(words)
        if known is None:
            known = read_subject(words, self.library, self.roots.locate)
            self._known[words] = known
            # Of requests in several threads, some may remove what others have removed.
            for old in list(self._known)[:-_KEPT]:
                self._known.pop(old, None)
        return known

    def values(self, kind: str, words: str, options: Options, draft: bool = False, moving: str = "") -> Values:
        """Return the numbers of a surface in a plot; `moving` names the parameter that the next request may change."""
        chosen = kind_named(kind)
        function = chosen.draft if draft and chosen.draft else chosen.values
        return function(faster(self.subject(words), moving), options)

    def describe(self, words: str) -> dict[str, Any]:
        """Return what a page edits: the label, the words before parameters, the model, and all parameters' values.

        `given` has the parameters in the words, `usual` the values without them.
        """
        label, rest = split_label(words, self.roots.locate)
        subject = self.subject(words, fresh=True)
        base, given = rest, {}
        model = MODELS.get(subject.model)
        editable = model is not None and subject.seen_alike
        if model is not None:
            if Path(base).suffix and ":" not in base and any(each.file for each in model.parameters.values()):
                (name,) = (each.name for each in model.parameters.values() if each.file)
                base, given = model.name, {name: rest}
            elif _is_look(base):
                editable = False
            else:
                base, _, text = rest.partition(":")
                read_parameters(words, model, text, self.roots.locate)
                given = dict(pair.split("=", 1) for pair in text.split(",") if pair)
        return {
            "words": words,
            "label": label,
            "base": base,
            "model": subject.model,
            "layers": [f"{layer.name or layer.model}" for layer in subject.layers],
            "editable": editable,
            "delta": subject.is_delta,
            "look": _is_look(rest),
            "given": {name.strip(): _plain(model, name.strip(), value.strip()) for name, value in given.items()},
            "values": _values(model, subject),
            "usual": self._usual(base, subject, model),
            "title": _title(subject, model),
        }

    def _usual(self, base: str, subject: Subject, model: Model | None) -> dict[str, Any]:
        """Return the values of a surface whose parameters are not given."""
        if model is None or subject.parameters is None:
            return {}
        if base == model.name:
            return {name: _listed(each.default) for name, each in model.parameters.items()}
        return _values(model, self.subject(base))

    def command(self, kind: str, surfaces: Sequence[str], options: Options) -> str:
        """Return the command that makes a plot of surfaces."""
        uses = kind_named(kind).uses
        words = [shlex.quote(self.roots.path_words(each)) for each in surfaces]
        parts = ["lookdev", "plot", kind, *words, "-o", f"{kind}.png"]
        for name, value in options.given().items():
            if name in uses:
                parts += (
                    [f"--{name}"]
                    if value is True
                    else [f"--{name}", f"{value:g}" if isinstance(value, float) else value]
                )
        return " ".join(map(str, parts))

    def look_file(self, words: str) -> Path | None:
        """Return the file of a look, or None for what is no look of a file."""
        _, rest = split_label(words, self.roots.locate)
        found = LOOK.fullmatch(rest)
        return self.roots.locate(found["file"]) if found else None

    def rendered_look(self, words: str) -> Look:
        """Return the look that the renderer shows: of a file all of it, with its textures."""
        _, rest = split_label(words, self.roots.locate)
        if (found := LOOK.fullmatch(rest)) and found["layer"] is None:
            return replace(read_look(self.roots.locate(found["file"]), found["prim"]), name="explored")
        return self.look(words)

    def look(self, words: str, name: str = "explored") -> Look:
        """Return the look of a surface, its parameters constants.

        Raises LookdevError where they change with the view.
        """
        subject = self.subject(words)
        if not subject.seen_alike:
            raise LookdevError(f"{words}: its parameters change with the view; the renderer shows it, the browser not")
        return look_of(subject.layers, name)


def look_of(layers: Sequence[StackLayer], name: str) -> Look:
    """Return a look of layers of constants."""
    found = []
    for number, layer in enumerate(layers):
        given = changed(MODELS[layer.model], layer.parameters)
        mask = float(np.asarray(layer.mask)) if number else 1.0
        found.append(Layer(layer.name or f"Layer{number}", layer.model, given, mask, layer.mode))
    return Look(name, tuple(found))


def changed(model: Model, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters that are not at their defaults, plain values; a follower is given where it differs."""
    found: dict[str, Any] = {}
    for name, parameter in model.parameters.items():
        value = parameters[name]
        usual = parameters[parameter.follows] if parameter.follows else parameter.default
        if isinstance(value, str):
            if value != usual:
                found[name] = value
        elif not same(np.asarray(value), np.asarray(usual, np.float64)):
            found[name] = tuple(np.ravel(value).tolist()) if np.ndim(value) else float(value)
    return found


def _is_look(words: str) -> bool:
    return LOOK.fullmatch(words) is not None


def _plain(model: Model | None, name: str, text: str) -> Any:
    if model is None or model.parameters[name].kind == "token":
        return text
    numbers = [float(each) for each in text.split("/")]
    if model.parameters[name].kind == "float":
        return numbers[0]
    return numbers if len(numbers) == 3 else numbers * 3


def _values(model: Model | None, subject: Subject) -> dict[str, Any]:
    """Return the parameters of a single layer, but for the path of a file."""
    known = model.parameters if model else {}
    return {name: _listed(value) for name, value in (subject.parameters or {}).items() if not known[name].file}


def _listed(value: Any) -> Any:
    return value if isinstance(value, str) else np.asarray(value).tolist()


def _title(subject: Subject, model: Model | None) -> str:
    if model is not None:
        return model.title
    return f"stack of {len(subject.layers)} layers" if subject.layers else "look"
