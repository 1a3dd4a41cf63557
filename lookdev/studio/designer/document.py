"""What the Designer edits: the looks of a job, on its asset, under one of its rigs."""

from __future__ import annotations

import re
import shutil
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lookdev.brdf import MASK, MODELS, Parameter, complete_parameters
from lookdev.cache import atomic_path
from lookdev.codegen.glsl.look import look_functions
from lookdev.codegen.program.look import live_name
from lookdev.errors import LookdevError, ModelError, nearest_hint
from lookdev.job import Job, load_job, parse_job
from lookdev.job.scenes import JobScenes, job_scenes
from lookdev.material import Formula, Look, Texture
from lookdev.material.change import Value
from lookdev.material.library.edit import set_inputs
from lookdev.material.look import Bump, Layer, Primvar
from lookdev.material.textures import image_file
from lookdev.scene import Scene
from lookdev.studio.viewport import SceneView, sliders, view_scene

_SOURCE = re.compile(r"(?P<file>.+)<(?P<prim>/[^<>]*)>")
_FILE_NAME = re.compile(r"[\w][\w .-]{0,100}")

ASSET = """output = "."
asset = {{ {asset} }}
look = [{{ name = "own"{material} }}]
ibl = [{{ name = "courtyard", builtin = "courtyard" }}, {{ name = "studio", builtin = "studio" }}]
turntable = [{{ kind = "element", frames = 1 }}]
render = {{ resolution = [960, 720], background = "ibl" }}
"""


@dataclass(frozen=True)
class Edit:
    """Another constant of a parameter of a layer, numbered from the base, of a look; None: it is not stated."""

    look: int
    layer: int
    parameter: str
    value: Value | None


class Document:
    """The scenes of a job, one of which is shown, and the looks as they are edited.

    Looks have the numbers that they have in the shown scene. All methods can be called by several threads.
    """

    def __init__(self, job: Job, scenes: JobScenes) -> None:
        self.job = job
        self._scenes = scenes
        self._lock = threading.RLock()
        self._edited: dict[int, Look] = {}
        self._values: dict[int, dict[tuple[int, str], Value | None]] = {}
        self.chosen = next(iter(scenes.scenes))

    @property
    def choices(self) -> dict[str, list[str]]:
        """The names of looks and of rigs."""
        looks, rigs = (list(dict.fromkeys(names)) for names in zip(*self._scenes.scenes, strict=True))
        return {"looks": looks, "rigs": rigs}

    def choose(self, look: str, rig: str) -> None:
        """Show another scene; raises LookdevError where the job has none of these names."""
        for kind, name in (("looks", look), ("rigs", rig)):
            if name not in self.choices[kind]:
                hint = nearest_hint(name, self.choices[kind])
                raise LookdevError(f"the job has no {kind[:-1]} '{name}' ({hint})")
        with self._lock:
            self.chosen = (look, rig)

    @property
    def _scene(self) -> Scene:
        return self._scenes.scenes[self.chosen]

    @property
    def _originals(self) -> list[Look]:
        return list({id(look): look for look in self._scene.looks}.values())

    @property
    def scene(self) -> Scene:
        """The shown scene, with its edited looks."""
        with self._lock:
            wears = {path: self._edited.get(id(look), look) for path, look in self._scene.wears.items()}
            return replace(self._scene, wears=wears)

    @property
    def looks(self) -> list[Look]:
        """The looks of the shown scene, edited, by their numbers."""
        with self._lock:
            return [self._edited.get(id(look), look) for look in self._originals]

    def view(self) -> SceneView:
        """Return the shown scene for the page."""
        return view_scene(self.scene, view=self.job.outputs.shown("png"))

    def edit(self, edit: Edit) -> bool:
        """Change a look; return whether its shaders change, not only a uniform of them.

        Raises ModelError where there is no such parameter, or it cannot have the value; then nothing changes.
        """
        with self._lock:
            original = self._look(edit.look)
            look = self._edited.get(id(original), original)
            if not 0 <= edit.layer < len(look.layers):
                raise ModelError(f"look '{look.name}' has {len(look.layers)} layers, none of number {edit.layer}")
            layer = look.layers[edit.layer]
            before = layer.mask if edit.parameter == "mask" else layer.inputs.get(edit.parameter)
            changed = _changed(layer, edit, base=original.layers[edit.layer])
            new = replace(look, layers=(*look.layers[: edit.layer], changed, *look.layers[edit.layer + 1 :]))
            compiles = not (isinstance(before, float | tuple) and isinstance(edit.value, float | tuple))
            if compiles:
                # Forms of a model that layers do not share, for instance, are only refused together.
                look_functions(new, image_file, sliders(new))
            self._edited[id(original)] = new
            self._values.setdefault(id(original), {})[edit.layer, edit.parameter] = edit.value
            return compiles

    def _look(self, number: int) -> Look:
        if not 0 <= number < len(self._originals):
            raise ModelError(f"there are {len(self._originals)} looks, none of number {number}")
        return self._originals[number]

    def unsaved(self, number: int) -> bool:
        """Return whether a look has edits that its file has not."""
        return bool(self._values.get(id(self._look(number))))

    def place(self, number: int) -> tuple[Path, str, dict[str, str]] | None:
        """Return the file, prim and variants of a look; None where no look in USD has it."""
        look = self._look(number)
        found = _SOURCE.fullmatch(look.source)
        if not found or any(layer.model not in MODELS for layer in look.layers):
            return None
        file, prim = Path(found["file"]), found["prim"]
        return (file, prim, _variants(self.job, self.chosen[0], file)) if file.is_file() else None

    def save(self, number: int, name: str | None = None) -> Path:
        """Write the edits of a look to its file, or to a new one of a name beside it; return the file.

        Raises
        ------
        LookError
            The file cannot be edited so.
        LookdevError
            The look is of no file, or the new file exists, or has no fitting name.
        """
        with self._lock:
            look, place = self._look(number), self.place(number)
            if place is None:
                raise LookdevError(f"look '{look.name}' is of no file of its own layers: it cannot be saved")
            file, prim, variants = place
            values = self._values.get(id(look), {})
            if removed := [parameter for (_, parameter), value in values.items() if value is None]:
                raise LookdevError(f"'{removed[0]}' is no longer stated: that cannot be saved yet; give it a value")
            stated = {key: value for key, value in values.items() if value is not None}
            if name is None:
                set_inputs(file, stated, prim, variants)
                self._values.pop(id(look), None)
                return file
            if not _FILE_NAME.fullmatch(name) or Path(name).suffix not in (".usda", ".usd", ".usdc"):
                raise LookdevError(f"'{name}' is no name of a file for a look: for instance {file.stem}_2.usda")
            target = file.with_name(name)
            if target.exists():
                raise LookdevError(f"{target} exists already; another name would be right")
            with atomic_path(target) as temporary:
                shutil.copy(file, temporary)
                set_inputs(temporary, stated, prim, variants)
            return target

    def stacks(self) -> list[dict[str, Any]]:
        """Return the layers of each look with their parameters, for the page."""
        with self._lock:
            return [
                {
                    "name": look.name,
                    "file": str(place[0]) if (place := self.place(number)) else "",
                    "unsaved": self.unsaved(number),
                    "layers": [_described(k, layer) for k, layer in enumerate(look.layers)],
                }
                for number, look in enumerate(self.looks)
            ]


def open_document(file: Path | None, builtin: str | None = None, material: Path | None = None) -> Document:
    """Open a job (.toml), or an asset in its own materials or in one.

    Raises
    ------
    JobError
        The job has faults.
    FaultsError
        The files of a job have, or the asset has.
    """
    if file is not None and file.suffix == ".toml":
        job = load_job(file)
    else:
        asset = f"builtin = {_quoted(str(builtin))}" if file is None else f"usd = {_quoted(str(file.absolute()))}"
        worn = f", material = {_quoted(str(material.absolute()))}" if material else ""
        text = ASSET.format(asset=asset, material=worn)
        job = parse_job(text, file.absolute() if file else Path.cwd() / str(builtin))
    return Document(job, job_scenes(job))


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _variants(job: Job, name: str, file: Path) -> dict[str, str]:
    """Return the variants in which a look of a job wears a material of a file."""
    look = next((each for each in job.look if each.name == name), None)
    if look is None:
        return {}
    given = [(look.material, look.variants), *((each.material, each.variants) for each in look.assign)]
    return next((dict(variants) for material, variants in given if material and material.samefile(file)), {})


def _changed(layer: Layer, edit: Edit, base: Layer) -> Layer:
    """Return a layer with another constant; `base` is as its file has it."""
    name, value = edit.parameter, edit.value
    if name == "mask":
        if edit.layer == 0 or not isinstance(layer.mask, float):
            raise ModelError("the base has no mask" if edit.layer == 0 else "the mask has a texture or an expression")
        if not isinstance(value, float) or not 0.0 <= value <= 1.0:
            raise ModelError(f"a mask is a number from 0 to 1, not {value!r}")
        return replace(layer, mask=value)
    if layer.model not in MODELS:
        raise ModelError(f"layer '{layer.name}' is of {layer.model}, which is translated: it has no sliders")
    known = MODELS[layer.model].parameters
    if name not in known:
        raise ModelError(f"{layer.model} has no parameter '{name}' ({nearest_hint(name, list(known))})")
    if isinstance(layer.inputs.get(name), Texture | Primvar | Bump | Formula):
        raise ModelError(f"{layer.name}.{name} has a texture or an expression, not a constant")
    inputs = {key: each for key, each in layer.inputs.items() if key != name}
    if value is None:
        if name in base.inputs:
            raise ModelError(f"{layer.name}.{name} is stated by the look's file: give it another value")
        return replace(layer, inputs=inputs)
    checked = complete_parameters(layer.model, {name: value})[name]
    plain = checked if isinstance(checked, str) else np.asarray(checked).tolist()
    return replace(layer, inputs={**inputs, name: tuple(plain) if isinstance(plain, list) else plain})


def _described(number: int, layer: Layer) -> dict[str, Any]:
    """Return a layer for the page: its parameters in the model's order, and its mask."""
    rows = []
    if number > 0:
        rows.append(_row(number, MASK, layer.mask))
    if layer.model in MODELS:
        known = MODELS[layer.model].parameters.values()
        rows += [_row(number, each, layer.inputs.get(each.name)) for each in known if each.file is None]
    return {
        "name": layer.name,
        "own": layer.model in MODELS,
        "title": MODELS[layer.model].title if layer.model in MODELS else layer.model,
        "parameters": rows,
    }


def _row(number: int, parameter: Parameter, value: Any) -> dict[str, Any]:
    constant = isinstance(value, float | int | str | tuple)
    return {
        "name": parameter.name,
        "kind": parameter.kind,
        "default": parameter.default,
        "value": value if constant else None,
        "varies": "" if constant or value is None else next(_words(value)),
        "uniform": live_name(number, parameter.name) if isinstance(value, float | tuple) else "",
        "soft": parameter.soft,
        "hard": parameter.hard,
        "choices": parameter.choices,
        "help": parameter.help,
    }


def _words(value: Any) -> Iterator[str]:
    """Yield what gives a parameter that varies its value."""
    match value:
        case Texture():
            yield f"texture {value.file.name}, {value.channel}"
        case Bump():
            yield f"bump of {value.height.file.name}"
        case Primvar():
            yield f"primvar {value.name}"
        case Formula():
            yield f"expression {value.expression.text}"
    yield "varies"


def parsed(body: Mapping[str, Any]) -> Edit:
    """Return an edit of a page's request; raises ModelError where it is none."""
    match body:
        case {"look": int(look), "layer": int(layer), "parameter": str(parameter), "value": value}:
            if isinstance(value, list) and len(value) == 3 and all(isinstance(x, int | float) for x in value):
                return Edit(look, layer, parameter, tuple(float(x) for x in value))  # type: ignore[arg-type]
            if value is None or isinstance(value, str):
                return Edit(look, layer, parameter, value)
            if isinstance(value, int | float) and not isinstance(value, bool):
                return Edit(look, layer, parameter, float(value))
    raise ModelError("an edit has a look, a layer, a parameter, and a number, three numbers or a word as its value")
