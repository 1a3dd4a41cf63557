"""Job file to `Job`, or every fault in it with its place."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

from pydantic import ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from lookdev.errors import Fault, JobError, nearest_hint
from lookdev.job.keys import PATTERNS
from lookdev.job.mapping import PathRules
from lookdev.job.schema import LISTS, Job
from lookdev.text import TextError, has_text_path, parse_toml, read_text

Place = tuple[str | int, ...]

_LARGEST = 1 << 20  # bytes of a job file


def load_job(path: Path, rules: PathRules = ()) -> Job:
    """Read a job file, TOML; paths in it are relative to its folder, and absolute in the job.

    `rules` state where the files of another machine are on this one.

    Raises
    ------
    JobError
        With every fault of the file: its key, what is wrong, and the nearest known key of an unknown one.
    """
    if not has_text_path(path.absolute()):
        raise JobError([Fault(str(path.absolute()), "", "its path is not UTF-8", "rename it, or its folder")])
    try:
        text = read_text(path, _LARGEST)
    except TextError as error:
        hint = "" if path.exists() else "'lookdev example' lists jobs to copy"
        raise JobError(replace(fault, hint=fault.hint or hint) for fault in error.faults) from None
    return parse_job(text, path, rules)


def parse_job(text: str, path: Path, rules: PathRules = ()) -> Job:
    """Read a job from `text` as the content of the file `path`; errors as `load_job`."""
    try:
        data = _frozen(parse_toml(text, path))
    except TextError as error:
        hint = "a job is TOML; 'lookdev inspect' lists what a USD file has" if path.suffix.startswith(".usd") else ""
        raise JobError(replace(fault, hint=fault.hint or hint) for fault in error.faults) from None
    faults = [*_duplicate_names(data, str(path)), *_bound_to_a_builtin(data, str(path))]
    try:
        job = Job.model_validate(data, context={"file": path.absolute(), "rules": rules})
    except ValidationError as error:
        details = error.errors(include_url=False)
        faults += [_fault(detail, data, str(path)) for detail in details if not _is_echo(detail)]
    if faults:
        raise JobError(faults)
    return job


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a job file, for editors."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **Job.model_json_schema()}


def _frozen(value: Any) -> Any:
    """Turn TOML arrays into tuples, the only sequence that a strict model accepts."""
    if isinstance(value, list):
        return tuple(_frozen(item) for item in value)
    if isinstance(value, dict):
        return {key: _frozen(item) for key, item in value.items()}
    return value


def _duplicate_names(data: dict[str, Any], file: str) -> Iterator[Fault]:
    for keys in LISTS:
        seen: dict[str, str] = {}
        for key in keys:
            tables = data.get(key)
            for index, table in enumerate(tables if isinstance(tables, tuple) else ()):
                name = table.get("name", table.get("kind")) if isinstance(table, dict) else None
                if not isinstance(name, str):
                    continue
                place = f"{key}[{index}]"
                # Names become files: "Gold" and "gold" are one folder on many file systems.
                first = seen.setdefault(name.casefold(), place)
                if first != place:
                    yield Fault(
                        file, f"{place}.name", f"'{name}' is already the name of {first}", "give each its own name"
                    )


def _bound_to_a_builtin(data: dict[str, Any], file: str) -> Iterator[Fault]:
    """Yield faults of looks that need an asset from a file, in a job with a built-in one."""
    asset, looks = data.get("asset"), data.get("look")
    if not (isinstance(asset, dict) and "builtin" in asset and isinstance(looks, tuple)):
        return
    for index, look in enumerate(looks):
        if isinstance(look, dict) and not ("material" in look or "assign" in look):
            yield Fault(file, f"look[{index}].material", "is missing", "nothing is bound to a built-in asset")
        if isinstance(look, dict) and "layer" in look:
            what = "has no meaning with a built-in asset"
            yield Fault(file, f"look[{index}].layer", what, "a layer is composed over 'usd' of [asset]")


def _is_echo(detail: ErrorDetails) -> bool:
    """Return whether a fault follows from another: a default of a faulty key, a list too short without faulty items."""
    return detail["type"] == "default_factory_not_called" or (detail["type"] == "too_short" and bool(detail["input"]))


def _fault(detail: ErrorDetails, data: dict[str, Any], file: str) -> Fault:
    place = _place(detail["loc"], data)
    key = str(place[-1]) if place else ""
    kind, value, context = detail["type"], detail["input"], detail.get("ctx", {})
    hint = str(context.get("hint", ""))
    match kind:
        case "lookdev":
            what = detail["msg"]
        case "extra_forbidden":
            what, hint = "unknown key", nearest_hint(key, list(_fields(place[:-1])))
        case "missing":
            field = _fields(place[:-1]).get(key)  # none for a number of a list
            what, hint = "is missing", (field and field.description) or ""
        case "model_type":
            what, hint = "should be a table", f"write [{key}]" if len(place) == 1 else ""
        case "tuple_type":
            what = "should be a list"
            tables = ".".join(part for part in place if isinstance(part, str))
            hint = f"write [[{tables}]]" if isinstance(value, dict) else f"write {key} = [{_shown(value)}]"
        case "too_short" | "too_long":
            bound = f"at least {context['min_length']}" if kind == "too_short" else f"at most {context['max_length']}"
            what = f"should have {bound} entries, not {context['actual_length']}"
        case "string_pattern_mismatch":
            what, hint = f"'{value}' is not allowed here", PATTERNS[context["pattern"]]
        case "literal_error" if isinstance(value, str):
            what = f"unknown value '{value}'"
            hint = nearest_hint(value, re.findall(r"'([^']*)'", context["expected"]))
        case _:
            message = detail["msg"].removeprefix("Input ")
            what = f"{message[0].lower()}{message[1:]}, not {_shown(value)}"
    return Fault(file, _dotted(place), what, hint)


def _shown(value: object) -> str:
    """Return a value as it is in the file, shortened."""
    text = repr(value) if isinstance(value, float) else json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= 40 else f"{text[:37]}..."


def _place(loc: Place, data: Any) -> Place:
    """Remove the tags of unions, which are not keys of the file, from a pydantic location."""
    place: list[str | int] = []
    for part in loc:
        if isinstance(data, dict | None) and isinstance(part, str):
            data = data and data.get(part)  # None in a table that is not in the file
        elif isinstance(data, tuple) and isinstance(part, int):
            data = data[part] if part < len(data) else None
        else:
            continue
        place.append(part)
    return tuple(place)


def _dotted(place: Place) -> str:
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in place).removeprefix(".")


def _fields(place: Place) -> dict[str, FieldInfo]:
    """Return the fields of the table at a place; a list of numbers has none."""
    model: Any = Job
    for part in place:
        if isinstance(part, str):
            annotation = model.model_fields[part].annotation
            model = get_args(annotation)[0] if get_args(annotation) else annotation
    fields: dict[str, FieldInfo] = getattr(model, "model_fields", {})
    return fields
