"""The reader of job files: it returns a `Job`, or raises an error with every fault of the file and its key."""

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
from lookdev.safe_text import TextError, has_text_path, parse_toml, read_text

KeyPath = tuple[str | int, ...]  # for example ("ibl", 1, "exposure")

_MAX_BYTES = 1 << 20  # the maximum size of a job file in bytes


def load_job(path: Path, rules: PathRules = ()) -> Job:
    """Read a job file, which is TOML; paths in it are relative to its folder, and absolute in the job.

    `rules` map paths of another machine to paths of this machine.

    Raises
    ------
    JobError
        The file has faults. The error has each of them with its key and, for an unknown key, the nearest known key.
    """
    if not has_text_path(path.absolute()):
        raise JobError([Fault(str(path.absolute()), "", "its path is not UTF-8", "rename it, or its folder")])
    try:
        text = read_text(path, _MAX_BYTES)
    except TextError as error:
        hint = "" if path.exists() else "'lookdev example' lists jobs to copy"
        raise JobError(replace(fault, hint=fault.hint or hint) for fault in error.faults) from None
    return parse_job(text, path, rules)


def parse_job(text: str, path: Path, rules: PathRules = ()) -> Job:
    """Read a job from `text`, the content of the file `path`; raise the errors of `load_job`."""
    try:
        data = _lists_to_tuples(parse_toml(text, path))
    except TextError as error:
        hint = "a job is TOML; 'lookdev inspect' lists what a USD file has" if path.suffix.startswith(".usd") else ""
        raise JobError(replace(fault, hint=fault.hint or hint) for fault in error.faults) from None
    faults = [*_duplicate_name_faults(data, str(path)), *_builtin_asset_faults(data, str(path))]
    try:
        job = Job.model_validate(data, context={"file": path.absolute(), "rules": rules})
    except ValidationError as error:
        details = error.errors(include_url=False)
        faults += [_fault_of_detail(detail, data, str(path)) for detail in details if not _is_consequence(detail)]
    if faults:
        raise JobError(faults)
    return job


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a job file, for editors."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **Job.model_json_schema()}


def _lists_to_tuples(value: Any) -> Any:
    """Return a value with tuples in place of TOML arrays; a strict pydantic model accepts no list for a tuple."""
    if isinstance(value, list):
        return tuple(_lists_to_tuples(item) for item in value)
    if isinstance(value, dict):
        return {key: _lists_to_tuples(item) for key, item in value.items()}
    return value


def _duplicate_name_faults(data: dict[str, Any], file: str) -> Iterator[Fault]:
    """Yield a fault for each name that an earlier table has; `LISTS` has the groups in which names are unique."""
    for keys in LISTS:
        first_tables: dict[str, str] = {}
        for key in keys:
            tables = data.get(key)
            for index, table in enumerate(tables if isinstance(tables, tuple) else ()):
                name = table.get("name", table.get("kind")) if isinstance(table, dict) else None
                if not isinstance(name, str):
                    continue
                table_key = f"{key}[{index}]"
                # Names become folders, and on many file systems "Gold" and "gold" are the same folder.
                first = first_tables.setdefault(name.casefold(), table_key)
                if first != table_key:
                    problem = f"'{name}' is already the name of {first}"
                    yield Fault(file, f"{table_key}.name", problem, "give each its own name")


def _builtin_asset_faults(data: dict[str, Any], file: str) -> Iterator[Fault]:
    """Yield the faults of looks that need an asset from a file, if the job has a built-in asset."""
    asset, looks = data.get("asset"), data.get("look")
    if not (isinstance(asset, dict) and "builtin" in asset and isinstance(looks, tuple)):
        return
    for index, look in enumerate(looks):
        if isinstance(look, dict) and not ("material" in look or "assign" in look):
            yield Fault(file, f"look[{index}].material", "is missing", "nothing is bound to a built-in asset")
        if isinstance(look, dict) and "layer" in look:
            problem = "has no meaning with a built-in asset"
            yield Fault(file, f"look[{index}].layer", problem, "a layer is composed over 'usd' of [asset]")


def _is_consequence(detail: ErrorDetails) -> bool:
    """Return whether an error is only a consequence of another error.

    In this case, the default of a key depends on a faulty key, or a list seems too short because of faulty items.
    """
    return detail["type"] == "default_factory_not_called" or (detail["type"] == "too_short" and bool(detail["input"]))


def _fault_of_detail(detail: ErrorDetails, data: dict[str, Any], file: str) -> Fault:
    """Return the fault of an error of pydantic, in the terms of a job file; `data` is the content of the file."""
    key_path = _key_path(detail["loc"], data)
    key = str(key_path[-1]) if key_path else ""
    kind, value, context = detail["type"], detail["input"], detail.get("ctx", {})
    hint = str(context.get("hint", ""))
    match kind:
        case "lookdev":
            problem = detail["msg"]
        case "extra_forbidden":
            problem, hint = "unknown key", nearest_hint(key, list(_table_fields(key_path[:-1])))
        case "missing":
            field = _table_fields(key_path[:-1]).get(key)  # None for a number in a list
            problem, hint = "is missing", (field and field.description) or ""
        case "model_type":
            problem, hint = "should be a table", f"write [{key}]" if len(key_path) == 1 else ""
        case "tuple_type":
            problem = "should be a list"
            tables = ".".join(part for part in key_path if isinstance(part, str))
            hint = f"write [[{tables}]]" if isinstance(value, dict) else f"write {key} = [{_format_value(value)}]"
        case "too_short" | "too_long":
            bound = f"at least {context['min_length']}" if kind == "too_short" else f"at most {context['max_length']}"
            problem = f"should have {bound} entries, not {context['actual_length']}"
        case "string_pattern_mismatch":
            problem, hint = f"'{value}' is not allowed here", PATTERNS[context["pattern"]]
        case "literal_error" if isinstance(value, str):
            problem = f"unknown value '{value}'"
            hint = nearest_hint(value, re.findall(r"'([^']*)'", context["expected"]))
        case _:
            message = detail["msg"].removeprefix("Input ")
            problem = f"{message[0].lower()}{message[1:]}, not {_format_value(value)}"
    return Fault(file, _format_key_path(key_path), problem, hint)


def _format_value(value: object) -> str:
    """Return a value as the file has it, shortened to 40 characters."""
    text = repr(value) if isinstance(value, float) else json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= 40 else f"{text[:37]}..."


def _key_path(location: KeyPath, data: Any) -> KeyPath:
    """Return the keys in a location of pydantic, without tags of unions, which are not in `data`."""
    key_path: list[str | int] = []
    for part in location:
        if isinstance(data, dict | None) and isinstance(part, str):
            data = data and data.get(part)  # None if the table is not in the file
        elif isinstance(data, tuple) and isinstance(part, int):
            data = data[part] if part < len(data) else None
        else:
            continue
        key_path.append(part)
    return tuple(key_path)


def _format_key_path(key_path: KeyPath) -> str:
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in key_path).removeprefix(".")


def _table_fields(key_path: KeyPath) -> dict[str, FieldInfo]:
    """Return the fields of the table at `key_path`; empty if a list of numbers is there."""
    model: Any = Job
    for part in key_path:
        if isinstance(part, str):
            annotation = model.model_fields[part].annotation
            model = get_args(annotation)[0] if get_args(annotation) else annotation
    fields: dict[str, FieldInfo] = getattr(model, "model_fields", {})
    return fields
