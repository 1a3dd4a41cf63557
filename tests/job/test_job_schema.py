"""The exported JSON Schema agrees with what is read."""

from typing import Any

import pytest
from pydantic import BaseModel

from lookdev.asset import BUILTINS
from lookdev.job import Job, json_schema
from lookdev.light import BUILTIN_LIGHTS
from lookdev.rendering.backends import job_backends
from lookdev.shipped import BUILTIN_RIGS

SCHEMA = json_schema()
TABLES: dict[str, dict[str, Any]] = {"Job": SCHEMA, **SCHEMA["$defs"]}


@pytest.mark.parametrize("table", TABLES)
def test_every_table_and_key_is_described_and_closed(table: str) -> None:
    schema = TABLES[table]
    assert schema["description"]
    assert schema["additionalProperties"] is False
    assert [key for key, value in schema["properties"].items() if not value.get("description")] == []


def test_a_job_needs_a_light_and_a_look() -> None:
    assert SCHEMA["anyOf"] == [{"required": ["ibl"]}, {"required": ["rig"]}]
    assert SCHEMA["properties"]["look"]["minItems"] == 1


CHOICES = {
    ("JobAsset", "builtin"): BUILTINS,
    ("JobIbl", "builtin"): BUILTIN_LIGHTS,
    ("JobRig", "builtin"): BUILTIN_RIGS,
    ("JobRender", "backend"): job_backends(),
}


def test_choices_are_the_names_of_registries() -> None:
    for (table, key), names in CHOICES.items():
        schema = TABLES[table]["properties"][key]
        assert schema.get("anyOf", [schema])[0]["enum"] == list(names), table


def test_models_are_frozen_and_strict() -> None:
    models: list[type[BaseModel]] = [Job]
    for model in models:
        assert model.model_config["frozen"]
        assert model.model_config["strict"]
        annotations = [field.annotation for field in model.model_fields.values()]
        models += [kind for kind in annotations if isinstance(kind, type) and issubclass(kind, BaseModel)]
    assert len(models) == 5  # Job, asset, camera, render, outputs
