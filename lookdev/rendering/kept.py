"""Sources of looks that are kept in the cache: equal values and images are traced once, not in every run."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from pydantic import TypeAdapter, ValidationError

from lookdev.brdf import MODELS, Parameter
from lookdev.cache import code_digest, file_digest, keep, kept
from lookdev.codegen import ShaderSource, Source
from lookdev.codegen.setting import SourceSetting
from lookdev.errors import TextureError
from lookdev.images import check_file
from lookdev.material import Bump, Look, Primvar, Texture
from lookdev.rendering.backends import Backend

_ROOM = "sources"
_SOURCE: TypeAdapter[ShaderSource] = TypeAdapter(ShaderSource)


def kept_source(backend: Backend, look: Look, setting: SourceSetting, lit: tuple[object, ...]) -> Source:
    """Return ``backend.generate(look, setting)``, of the cache where it is known; errors as that.

    Only OSL is kept, of looks without expressions, measurements and sets of tiles: it depends on no more than the
    look's values, the contents of its images, the setting, what `lit` has of the lights, and the code.
    """
    read = None if backend.source is not ShaderSource or setting.resolve is not None else _contents(look)
    if read is None:
        return backend.generate(look, setting)
    settings = setting.resolution, setting.sampling, setting.shadows, setting.space, setting.catching
    given = replace(look, source=""), *settings
    # All code: a source contains what many rooms define.
    key = hashlib.sha256(f"{code_digest()} {backend.name} {given!r} {read} {lit!r}".encode()).hexdigest()
    if (value := kept(_ROOM, key)) is not None:
        try:
            source = _SOURCE.validate_python(value)
        except ValidationError:  # of no version of this code
            pass
        else:
            if all(file.is_whole() for file in (*(each.file for each in source.tables), *source.images)):
                return source
    made = backend.generate(look, setting)
    keep(_ROOM, key, _SOURCE.dump_python(made, mode="json"))  # type: ignore[arg-type]
    return made


def _contents(look: Look) -> list[str] | None:
    """Return the digests of a look's images; None where it depends on more than its values and these."""
    found = []
    for layer in look.layers:
        parameters: Mapping[str, Parameter] = MODELS[layer.model].parameters if layer.model in MODELS else {}
        if any(each.file is not None for each in parameters.values()):
            return None
        for value in (*layer.inputs.values(), layer.mask):
            if isinstance(value, Texture | Bump):
                texture = value.height if isinstance(value, Bump) else value
                try:  # one that reaches no pixel may be missing
                    check_file(texture.file, TextureError)
                    found.append(file_digest(texture.file))
                except (TextureError, OSError):
                    return None
            elif not isinstance(value, Primvar) and not all(
                type(each) in (bool, int, float, str) for each in _parts(value)
            ):
                return None
    return found


def _parts(value: Any) -> Iterator[Any]:
    yield from value if isinstance(value, tuple) else (value,)
