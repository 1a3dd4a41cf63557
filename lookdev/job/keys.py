"""Types for the schema of job files: names, paths, numbers with ranges, the base class of tables, and validators."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationInfo,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from lookdev.errors import nearest_hint
from lookdev.job.mapping import map_path
from lookdev.output.color import BUILT_IN, SHIPPED

# Names become folders and file names: they have no separator, and no leading dot, which marks temporary files.
NAME = r"^[A-Za-z0-9_-][A-Za-z0-9._-]*$"
PRIM_PATH = r"^(/[^/\s]+)+$"
PATTERNS: dict[str, str] = {
    NAME: "letters, digits, '_', '-' and '.', which is not the first",
    PRIM_PATH: "an absolute prim path, like '/Paint'",
}
"""The patterns of strings. The value of each is the hint that the user gets for a string that does not match."""


T = TypeVar("T")


def key_error(problem: str, hint: str = "") -> PydanticCustomError:
    """Return the error that the validator of a key raises; `hint` states what would be right."""
    return PydanticCustomError("lookdev", "{problem}", {"problem": problem, "hint": hint})


@dataclass(frozen=True)
class OneOf:
    """An annotation of a name in a registry. `names` is called when a job is validated, and returns all names."""

    names: Callable[[], Iterable[str]]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self._validate_name, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return handler(schema) | {"enum": list(self.names())}

    def _validate_name(self, name: str) -> str:
        names = list(self.names())
        if name not in names:
            raise key_error(f"unknown value '{name}'", nearest_hint(name, names))
        return name


def _resolve_path(value: object, info: ValidationInfo[dict[str, Any]]) -> Path:
    """Return the absolute path of a path in the job: map it to this machine, and resolve it from the job's folder."""
    if not isinstance(value, str) or not value or "\0" in value:
        raise key_error("should be a path in quotes")
    return Path(os.path.normpath(info.context["file"].parent / map_path(value, info.context.get("rules", ()))))


def default_config() -> str:
    """Return the OpenColorIO config in ``$OCIO``, or without this variable the config that ships.

    A relative path in ``$OCIO`` is resolved from the working folder.
    """
    config = os.environ.get("OCIO") or SHIPPED
    return config if _is_config_name(config) else str(Path(config).absolute())


def _is_config_name(value: str) -> bool:
    """Return whether a value names a config that ships or is built into OpenColorIO, and is not a path."""
    return value == SHIPPED or value.startswith(BUILT_IN)


def _resolve_config(value: object, info: ValidationInfo[dict[str, Any]]) -> object:
    if not isinstance(value, str) or _is_config_name(value):
        return value
    return str(_resolve_path(value, info))


def _readable_file(*suffixes: str) -> AfterValidator:
    """Return the validator of a readable file with one of the suffixes."""

    def check(path: Path) -> Path:
        if path.suffix.lower() not in suffixes:
            raise key_error(f"'{path.name}' is of no known kind", f"known: {', '.join(suffixes)}")
        if not (os.access(path, os.R_OK) and path.is_file()):
            raise key_error(f"no readable file {path}", "paths are relative to the job file")
        return path

    return AfterValidator(check)


def _check_folder(path: Path) -> Path:
    """Return the path of a folder that need not exist; raise a key error if it, or an ancestor, is not a folder."""
    try:
        nearest = next(ancestor for ancestor in (path, *path.parents) if ancestor.exists())
    except OSError as error:  # the file system refuses the name
        raise key_error(f"cannot be a folder: {error.strerror}") from None
    if not nearest.is_dir():
        raise key_error(f"{nearest} is not a folder", "name a folder; it is made if it does not exist")
    return path


JobPath = Annotated[Path, BeforeValidator(_resolve_path)]
JobFolder = Annotated[JobPath, AfterValidator(_check_folder)]
USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
MATERIAL_SUFFIXES = (*USD_SUFFIXES, ".mtlx")
UsdFile = Annotated[JobPath, _readable_file(*USD_SUFFIXES)]
MaterialFile = Annotated[JobPath, _readable_file(*MATERIAL_SUFFIXES)]
IblFile = Annotated[JobPath, _readable_file(".exr", ".hdr")]
OcioConfig = Annotated[str, Field(min_length=1), BeforeValidator(_resolve_config)]
PrimPath = Annotated[str, Field(pattern=PRIM_PATH)]
MaterialPrim = Annotated[
    PrimPath | None, Field(description="The material's prim; default: the file's default prim, or its only material.")
]
KeyName = Annotated[str, Field(pattern=NAME, max_length=100)]
Text = Annotated[str, Field(min_length=1)]
Degrees = Annotated[float, Field(ge=-36000.0, le=36000.0)]
Exposure = Annotated[float, Field(ge=-30.0, le=30.0)]


def key(default: T, description: str) -> T:
    """Return the pydantic field of a key that a table may omit."""
    return Field(default=default, description=description)


class JobTable(BaseModel):
    """A table of the job file."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False)


def reject_key(word: Literal["without", "beside"], other: str, hint: str) -> Callable[[Any, ValidationInfo], Any]:
    """Return the validator of a key that has no meaning without, or beside, the key `other`, declared before it."""

    def check(value: Any, info: ValidationInfo) -> Any:
        # If `other` has a fault, it is absent from info.data, and counts as given.
        if (info.data.get(other, ...) is None) == (word == "without"):
            raise key_error(f"has no meaning {word} '{other}'", hint)
        return value

    return check


def alternative_to(other: str) -> AfterValidator:
    """Return the validator of a key; a table must have exactly one of this key and the key `other`, declared before."""

    def check(value: str | None, info: ValidationInfo) -> str | None:
        # If `other` has a fault, it is absent from info.data, and counts as given.
        if (value is None) == (info.data.get(other, ...) is None):
            raise key_error(f"give exactly one of '{other}' and '{info.field_name}'")
        return value

    return AfterValidator(check)
