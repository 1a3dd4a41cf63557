"""Evaluates models, and stacks of models, for given directions, in NumPy or inside Cycles.

`lookdev eval` uses this module, with lines of JSON as input and output. The checks at points and of stability use it
with arrays. The results of a case are f, the value of the BSDF, and pdf, the density of its samples.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from lookdev.arrays import Floats, Floats32
from lookdev.brdf import MASK, MODELS, Array, Bsdf, Mode, complete_parameters, evaluate, pdf, stack_bsdf
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.fresnel import conductor_fresnel
from lookdev.brdf.metal import INTERFACE
from lookdev.brdf.parameters import add_followers, as_numbers, complete, expand_tokens
from lookdev.brdf.vectors import Parameters
from lookdev.codegen.osl.points import generate_point_shader
from lookdev.codegen.points import PointLayer, point_cells, point_columns
from lookdev.errors import LookdevError, ModelError, WorkerError, nearest_hint, shorten
from lookdev.material.expression import ExpressionError
from lookdev.material.values import view_dependent_value
from lookdev.safe_text import TextError, parse_json

Evaluator = Literal["numpy", "cycles"]

_UNIT_TOLERANCE = 1e-4  # the length of a direction may deviate from 1 by less than this number
_PROCESS_TIMEOUT = 600.0  # seconds
_LAYER_KEYS = ("model", "params", "mask", "mode")
_FRESNEL = "fresnel"  # in place of a model: Fresnel's equations for a conductor


@dataclass(frozen=True)
class Batch:
    """n cases of one stack of layers. The cases differ only in their numbers and directions.

    Attributes
    ----------
    layers
        The stack, the base first.
    wo, wi : (n, 3)
        Unit directions to the viewer and to the light, in the frame whose z is the normal.
    numbers
        A dictionary for each layer. It has the values of the parameters, (n,) or (n, 3), by name, and the values of the
        mask, (n,), by the key ``"mask"``. Constants of the layer are left out.
    """

    layers: tuple[PointLayer, ...]
    wo: Floats
    wi: Floats
    numbers: tuple[dict[str, Floats], ...]

    def bsdf(self) -> Bsdf:
        """Return the BSDF of the stack, with arrays over the cases as parameters."""
        return _build_stack(self.layers, self.numbers, self.wo)

    def round_to_float32(self) -> Batch:
        """Return the cases with all numbers rounded to float32, as code in float32 reads them."""
        numbers = tuple({name: round_to_float32(values) for name, values in layer.items()} for layer in self.numbers)
        return Batch(self.layers, round_to_float32(self.wo), round_to_float32(self.wi), numbers)


def round_to_float32(values: Floats) -> Floats:
    """Return values rounded to float32, as float64."""
    return values.astype(np.float32).astype(np.float64)


def _build_stack(layers: Sequence[PointLayer], numbers: Sequence[Mapping[str, Floats]], wo: Array) -> Bsdf:
    """Return the BSDF of layers for directions `wo` (..., 3) to the viewer; `numbers` has the numbers of each layer."""
    # If the viewer is behind the surface, the normal is flipped to face the viewer: hence the absolute cosine.
    view = np.abs(wo[..., 2])
    return stack_bsdf([layer.stack_layer(varying, view) for layer, varying in zip(layers, numbers, strict=True)])


def evaluate_lines(lines: Iterable[str], backend: Evaluator) -> Iterator[str]:
    """Evaluate cases in lines of JSON, and yield the lines with the results.

    Parameters
    ----------
    lines
        One case in each line: ``{"model", "params", "wo", "wi"}``, or ``{"model": "stack", "layers", "wo", "wi"}`` with
        layers ``{"model", "params", "mask", "mode"}``, base first, or ``{"model": "fresnel", "params", "cosTheta"}``.
        Other keys and blank lines are preserved. The text of an expression of the view may replace a number.
    backend
        ``"numpy"``: the float64 reference; ``"cycles"``: the generated OSL inside Cycles, float32.

    Yields
    ------
    str
        The same lines in the same order, with `f` (three numbers, 1/sr) and `pdf` (1/sr), or with `F` for Fresnel's
        equations.

    Raises
    ------
    ModelError
        A line is not a case, or the backend cannot evaluate it; the message has the number of the line.
    """
    cases = [_parse_case(number, line, backend) for number, line in enumerate(lines, start=1)]
    run = {"numpy": evaluate_numpy, "cycles": evaluate_cycles}[backend]
    results: dict[int, tuple[list[float], float]] = {}
    for members, batch in _group_cases(cases):
        rows, densities = (array.tolist() for array in run(batch))
        results |= {index: (f, density) for index, f, density in zip(members, rows, densities, strict=True)}
    for index, case in enumerate(cases):
        if case is None:
            yield ""
        elif isinstance(case, _Reflectance):
            yield json.dumps(case.line | {"F": case.value})
        else:
            f, density = results[index]
            yield json.dumps(case.line | {"f": f, "pdf": density})


def parse_batches(lines: Iterable[str]) -> Iterator[Batch]:
    """Parse lines as in `evaluate_lines`, except lines of ``fresnel``; yield a batch for each stack of layers."""
    for _, batch in _group_cases([_parse_case(number, line, "numpy") for number, line in enumerate(lines, start=1)]):
        yield batch


def evaluate_numpy(batch: Batch) -> tuple[Floats, Floats]:
    """Evaluate cases in float64 NumPy; return f (n, 3) and pdf (n,), both in 1/sr."""
    bsdf = batch.bsdf()
    return evaluate(bsdf, batch.wo, batch.wi), pdf(bsdf, batch.wo, batch.wi)


def evaluate_cycles(
    batch: Batch, lobes: Sequence[str] | None = None, alter: Callable[[str], str] = lambda osl: osl
) -> tuple[Floats, Floats]:
    """Evaluate cases by generated OSL inside Cycles, in a separate process; return f (n, 3) and pdf (n,), in 1/sr.

    The values are computed in float32. `lobes` restricts the stack to some of its lobes. `alter` takes the shader's
    text and returns the text to run. If the process fails, a WorkerError has the last lines of its error stream.
    """
    table = point_table(batch)
    with tempfile.TemporaryDirectory(prefix="lookdev-eval-") as folder:
        request = Path(folder) / "request.npz"
        source = generate_point_shader(batch.layers, lobes)
        tables = json.dumps(
            [(binding.parameter, binding.file.digest, binding.file.suffix) for binding in source.tables]
        )
        osl = np.array(alter(source.osl))
        np.savez(request, osl=osl, tables=np.array(tables), cells=point_cells(batch.layers), table=table)
        command = [sys.executable, "-m", "lookdev.cycles", "--points", str(request)]
        process = subprocess.run(command, capture_output=True, text=True, timeout=_PROCESS_TIMEOUT, check=False)
        result = request.with_suffix(".result.npz")
        if process.returncode != 0 or not result.exists():
            lines = "\n".join(process.stderr.strip().splitlines()[-5:])
            raise WorkerError(f"evaluation inside Cycles failed (exit {process.returncode}):\n{lines}")
        with np.load(result, allow_pickle=False) as stored:
            return stored["f"].astype(np.float64), stored["pdf"].astype(np.float64)


def join_columns(values: tuple[Floats, Floats]) -> Floats:
    """Return f (n, 3) and pdf (n,) as one array (n, 4)."""
    return np.column_stack(values)


def point_table(batch: Batch) -> Floats32:
    """Return the directions and numbers of a batch as a table (n, columns), with the columns of `point_columns`."""
    columns: dict[str, Floats] = {}
    for prefix, vectors in (("wo", batch.wo), ("wi", batch.wi)):
        columns |= {f"{prefix}_{axis}": vectors[:, i] for i, axis in enumerate("xyz")}
    for number, numbers in enumerate(batch.numbers):
        for name, values in numbers.items():
            column = f"layer{number}_{name}"
            columns |= {f"{column}_{i}": values[:, i] for i in range(3)} if values.ndim == 2 else {column: values}
    return np.stack([columns[name] for name in point_columns(batch.layers)], axis=-1).astype(np.float32)


@dataclass(frozen=True)
class _Case:
    """A parsed line with a case: the object of the line, and the fields of a `Batch` for this case alone.

    The arrays have no axis of cases.
    """

    line: dict[str, object]
    layers: tuple[PointLayer, ...]
    numbers: tuple[dict[str, Floats], ...]
    wo: Floats
    wi: Floats


@dataclass(frozen=True)
class _Reflectance:
    """A parsed line of ``fresnel``: the object of the line, and the reflectance."""

    line: dict[str, object]
    value: float


def _parse_case(number: int, line: str, backend: Evaluator) -> _Case | _Reflectance | None:
    """Parse a line; return None if it is blank. `number` is the number of the line, for messages."""
    if not line.strip():
        return None
    try:
        case = parse_json(line, f"line {number}")
    except TextError as error:
        raise ModelError(str(error)) from None
    if not isinstance(case, dict):
        raise ModelError(f"line {number}: a JSON object with model, params, wo and wi would be right")
    needed: tuple[str, ...] = ("model", "layers" if case.get("model") == "stack" else "params", "wo", "wi")
    if case.get("model") == _FRESNEL:
        needed = "model", "params", "cosTheta"
    missing = [key for key in needed if key not in case]
    if missing:
        raise ModelError(f"line {number}: {', '.join(missing)} missing; {', '.join(needed)} are needed")
    try:
        if case["model"] == _FRESNEL:
            return _parse_fresnel(case, backend)
        if case["model"] == "stack":
            layers, numbers = _parse_stack(case["layers"])
        else:
            layer, values = _parse_layer(case["model"], case["params"])
            layers, numbers = (layer,), (values,)
        return _Case(case, layers, numbers, _parse_direction("wo", case["wo"]), _parse_direction("wi", case["wi"]))
    except LookdevError as error:
        raise ModelError(f"line {number}: {error}") from error


def _parse_fresnel(case: dict[str, object], backend: Evaluator) -> _Reflectance:
    """Evaluate Fresnel's equations for a line of ``fresnel``."""
    if backend != "numpy":
        raise ModelError(f"'{_FRESNEL}' is not a surface, so Cycles cannot render it; --backend numpy would be right")
    values: Parameters = complete(_FRESNEL, INTERFACE, _parse_object(case["params"]))
    cosine = as_numbers(case["cosTheta"])
    if cosine is None or cosine.shape or not 0.0 <= cosine <= 1.0:
        raise ModelError(f"cosTheta is {case['cosTheta']!r}; a number from 0 to 1 would be right")
    arguments = (values[name] for name in ("eta", "k", "externalIor", "polarisation"))
    return _Reflectance(case, float(np.asarray(conductor_fresnel(cosine, *arguments))))


def _parse_stack(stack: object) -> tuple[tuple[PointLayer, ...], tuple[dict[str, Floats], ...]]:
    """Return the layers of a stack, and the numbers of each layer including the mask."""
    if not isinstance(stack, list) or not stack:
        raise ModelError("layers must be a list of at least one layer, the base first")
    layers, numbers = [], []
    for number, layer_object in enumerate(stack):
        try:
            if not isinstance(layer_object, dict) or "model" not in layer_object:
                raise ModelError("an object with model, params, mask and mode would be right")
            for key in layer_object:
                if key not in _LAYER_KEYS:
                    raise ModelError(f"unknown key '{key}' ({nearest_hint(key, list(_LAYER_KEYS))})")
            mask, mode = layer_object.get("mask", 1.0), layer_object.get("mode", "over")
            if not isinstance(mask, str) and (
                isinstance(mask, bool) or not isinstance(mask, int | float) or not 0.0 <= mask <= 1.0
            ):
                raise ModelError(f"mask is {mask!r}; a number from 0 to 1 would be right")
            if mode not in get_args(Mode):
                raise ModelError(f"mode is {mode!r}; one of {', '.join(get_args(Mode))} would be right")
            layer, values = _parse_layer(layer_object["model"], layer_object.get("params", {}), mode, mask)
        except ModelError as error:
            raise ModelError(f"layer {number}: {error}") from error
        layers.append(layer)
        numbers.append(values)
    _build_stack(layers, numbers, ZENITH)  # raises ModelError if the layers do not combine
    return tuple(layers), tuple(numbers)


def _parse_layer(
    model: object, params: object, mode: Mode = "over", mask: float | str = 1.0
) -> tuple[PointLayer, dict[str, Floats]]:
    """Return a layer without its numbers, and these numbers by name, including the mask if it is a number."""
    if not isinstance(model, str) or model not in MODELS:
        raise ModelError(f"unknown model '{model}' ({nearest_hint(str(model), [*MODELS, 'stack', _FRESNEL])})")
    params, declared = _parse_object(params), MODELS[model].parameters
    formulas = {
        name: value
        for name, value in add_followers(declared, params).items()
        if isinstance(value, str) and name in declared and declared[name].kind != "token"
    }
    expand_tokens(model, declared, params)  # raises ModelError if an expression replaces a parameter that a token sets
    parameters = complete_parameters(model, {name: value for name, value in params.items() if name not in formulas})
    tokens = {name: value for name, value in parameters.items() if isinstance(value, str)}
    # An optional number with its default is a constant: the generated code is then the same as without the number.
    defaults = MODELS[model].optional_defaults()
    constants = {
        name: default for name, default in defaults.items() if parameters[name] == default and name not in formulas
    }
    numbers = {
        name: value
        for name, value in parameters.items()
        if not isinstance(value, str) and name not in {*constants, *formulas}
    }
    if isinstance(mask, str):
        formulas["mask"] = mask
    else:
        numbers["mask"] = np.asarray(mask, dtype=np.float64)
    for name, text in formulas.items():
        try:
            view_dependent_value(text, MASK if name == "mask" else declared[name], ZENITH[2])
        except ExpressionError as error:
            raise ModelError(
                f"{model}.{name} is {shorten(text, 40)!r}, which is not an expression of the view: {error}"
            ) from error
    return PointLayer(model, tokens, mode, constants, formulas=formulas), numbers


def _parse_object(params: object) -> dict[str, object]:
    if not isinstance(params, dict):
        raise ModelError("params must be an object of names and values")
    return params


def _parse_direction(name: str, value: object) -> Floats:
    vector = as_numbers(value)
    if vector is None or vector.shape != (3,) or not abs(float(np.linalg.norm(vector)) - 1.0) < _UNIT_TOLERANCE:
        raise ModelError(f"{name} is {value!r}; a unit vector of three numbers would be right")
    return vector


def _group_cases(cases: Sequence[_Case | _Reflectance | None]) -> Iterator[tuple[list[int], Batch]]:
    """Group the cases with equal layers; yield the indices of each group's cases, and the cases as one batch.

    A batch is evaluated at once, by arrays or by one shader.
    """
    groups: dict[str, list[int]] = {}
    for index, case in enumerate(cases):
        if isinstance(case, _Case):
            groups.setdefault(repr(case.layers), []).append(index)
    for members in groups.values():
        group = [case for index in members if isinstance(case := cases[index], _Case)]
        first = group[0]
        numbers = tuple(
            {name: np.stack([case.numbers[i][name] for case in group]) for name in first.numbers[i]}
            for i in range(len(first.layers))
        )
        wo, wi = np.stack([case.wo for case in group]), np.stack([case.wi for case in group])
        yield members, Batch(first.layers, wo, wi, numbers)
