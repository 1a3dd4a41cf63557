"""`lookdev eval`: models at listed points, in NumPy or inside Cycles, JSON lines in and out."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lookdev.brdf import LOBES, PARAMETERS, complete_parameters, evaluate, pdf
from lookdev.codegen.surface import point_columns
from lookdev.errors import LookdevError, ModelError, WorkerError

Backend = Literal["numpy", "cycles"]
Floats = NDArray[np.float64]

_UNIT_TOLERANCE = 1e-4
_WORKER_PATIENCE = 600.0


@dataclass(frozen=True)
class Batch:
    """Cases of one model that share their tokens, as arrays: wo, wi (n, 3), each parameter (n,) or (n, 3)."""

    model: str
    tokens: dict[str, str]
    wo: Floats
    wi: Floats
    parameters: dict[str, Floats]


def evaluate_lines(lines: Iterable[str], backend: Backend) -> Iterator[str]:
    """Evaluate JSON lines.

    Parameters
    ----------
    lines
        One case a line: ``{"model", "params", "wo", "wi"}``; other keys are handed through. Blank lines are kept.
    backend
        ``"numpy"``: the float64 reference; ``"cycles"``: the generated OSL inside Cycles, float32.

    Yields
    ------
    str
        The same lines in the same order, with `f` (three numbers, 1/sr) and `pdf` (1/sr).

    Raises
    ------
    ModelError
        A line is no case; the message has its number.
    """
    cases = [_parse(number, line) for number, line in enumerate(lines, start=1)]
    run = {"numpy": evaluate_numpy, "cycles": evaluate_cycles}[backend]
    results: dict[int, tuple[list[float], float]] = {}
    for members, batch in _batches(cases):
        rows, densities = (array.tolist() for array in run(batch))
        results |= {index: (f, density) for index, f, density in zip(members, rows, densities, strict=True)}
    for index, case in enumerate(cases):
        if case is None:
            yield ""
        else:
            f, density = results[index]
            yield json.dumps(case["line"] | {"f": f, "pdf": density})


def evaluate_numpy(batch: Batch) -> tuple[Floats, Floats]:
    """Evaluate in float64 NumPy: f (n, 3) and pdf (n,)."""
    lobes = LOBES[batch.model](batch.parameters | batch.tokens)
    return evaluate(lobes, batch.wo, batch.wi), pdf(lobes, batch.wo, batch.wi)


def evaluate_cycles(batch: Batch, lobes: Sequence[str] = ()) -> tuple[Floats, Floats]:
    """Evaluate the generated OSL inside Cycles, in a process of its own.

    `lobes` restricts the model to some of its lobes. Values are float32.

    Raises
    ------
    WorkerError
        The process failed; the message holds the end of what it said.
    """
    columns: dict[str, Floats] = {}
    for prefix, vectors in (("wo", batch.wo), ("wi", batch.wi)):
        columns |= {f"{prefix}_{axis}": vectors[:, i] for i, axis in enumerate("xyz")}
    for name, values in batch.parameters.items():
        if values.ndim == 2:
            columns |= {f"p_{name}_{channel}": values[:, i] for i, channel in enumerate("rgb")}
        else:
            columns[f"p_{name}"] = values
    table = np.stack([columns[name] for name in point_columns(batch.model)], axis=-1).astype(np.float32)
    with tempfile.TemporaryDirectory(prefix="lookdev-eval-") as folder:
        request = Path(folder) / "request.npz"
        np.savez(
            request,
            model=np.array(batch.model),
            token_names=np.array(list(batch.tokens), dtype=np.str_),
            token_values=np.array(list(batch.tokens.values()), dtype=np.str_),
            lobes=np.array(list(lobes), dtype=np.str_),
            table=table,
        )
        command = [sys.executable, "-m", "lookdev.cycles", "--points", str(request)]
        process = subprocess.run(command, capture_output=True, text=True, timeout=_WORKER_PATIENCE, check=False)
        result = request.with_suffix(".result.npz")
        if process.returncode != 0 or not result.exists():
            words = "\n".join(process.stderr.strip().splitlines()[-5:])
            raise WorkerError(f"evaluation inside Cycles failed (exit {process.returncode}):\n{words}")
        with np.load(result, allow_pickle=False) as stored:
            return stored["f"].astype(np.float64), stored["pdf"].astype(np.float64)


def _parse(number: int, line: str) -> dict[str, Any] | None:
    if not line.strip():
        return None
    try:
        case = json.loads(line)
    except json.JSONDecodeError as error:
        raise ModelError(f"line {number}: not JSON: {error}") from error
    if not isinstance(case, dict):
        raise ModelError(f"line {number}: a JSON object with model, params, wo and wi would be right")
    missing = [key for key in ("model", "params", "wo", "wi") if key not in case]
    if missing:
        raise ModelError(f"line {number}: {', '.join(missing)} missing; model, params, wo and wi are needed")
    try:
        if not isinstance(case["params"], dict):
            raise ModelError("params must be an object of names and values")
        parameters = complete_parameters(case["model"], case["params"])
        directions = {name: _direction(name, case[name]) for name in ("wo", "wi")}
    except LookdevError as error:
        raise ModelError(f"line {number}: {error}") from error
    return {"line": case, "model": case["model"], "parameters": parameters, **directions}


def _direction(name: str, value: Any) -> Floats:
    try:
        vector = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        vector = np.empty(0)
    if vector.shape != (3,) or not abs(float(np.linalg.norm(vector)) - 1.0) < _UNIT_TOLERANCE:
        raise ModelError(f"{name} is {value!r}; a unit vector of three numbers would be right")
    return vector


def _batches(cases: list[dict[str, Any] | None]) -> Iterator[tuple[list[int], Batch]]:
    """Group cases by model and tokens: one array evaluation, one generated shader each."""
    groups: dict[tuple[str, tuple[tuple[str, str], ...]], list[int]] = {}
    for index, case in enumerate(cases):
        if case is not None:
            tokens = tuple((name, value) for name, value in case["parameters"].items() if isinstance(value, str))
            groups.setdefault((case["model"], tokens), []).append(index)
    for (model, tokens), members in groups.items():
        chosen = [case for index in members if (case := cases[index]) is not None]
        names = [name for name, parameter in PARAMETERS[model].items() if parameter.kind != "token"]
        yield (
            members,
            Batch(
                model,
                dict(tokens),
                np.stack([case["wo"] for case in chosen]),
                np.stack([case["wi"] for case in chosen]),
                {name: np.stack([case["parameters"][name] for case in chosen]) for name in names},
            ),
        )
