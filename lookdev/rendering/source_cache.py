"""A cache on disk of the OSL sources of looks, so that a later run need not generate them again.

A source is the shader code generated from a look. `lookdev.rendering.scene` takes sources from here.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import replace

from pydantic import TypeAdapter, ValidationError

from lookdev.brdf import MODELS, Parameter
from lookdev.cache import code_digest, file_digest, load_cached, store_cached
from lookdev.codegen.setting import SourceSetting
from lookdev.codegen.source import GeneratedSource, ShaderSource
from lookdev.errors import TextureError
from lookdev.images import check_file
from lookdev.material import Bump, Look, Primvar, Texture
from lookdev.rendering.backends import Backend

_CACHE_FOLDER = "sources"
_SOURCE: TypeAdapter[ShaderSource] = TypeAdapter(ShaderSource)


def cached_source(
    backend: Backend, look: Look, setting: SourceSetting, light_code: tuple[object, ...]
) -> GeneratedSource:
    """Return ``backend.generate(look, setting)``, from the cache if it is there; raises what `generate` raises.

    The cache has only OSL sources, and only of looks without expressions, measured data and sets of texture tiles. Such
    a source depends on the look's values, the contents of the look's images, the setting, the lights and the code of
    the package. `light_code` has everything about the lights that the source depends on.
    """
    image_digests = None if backend.source is not ShaderSource or setting.resolve is not None else _image_digests(look)
    if image_digests is None:
        return backend.generate(look, setting)
    settings = setting.resolution, setting.sampling, setting.shadows, setting.space, setting.catching
    inputs = replace(look, source=""), *settings  # without the path of the look's own file, which affects no pixel
    # The digest is over the code of the whole package, because many subpackages contribute to a source.
    text = f"{code_digest()} {backend.name} {inputs!r} {image_digests} {light_code!r}"
    key = hashlib.sha256(text.encode()).hexdigest()
    if (value := load_cached(_CACHE_FOLDER, key)) is not None:
        try:
            source = _SOURCE.validate_python(value)
        except ValidationError:  # the stored value is not a source that this version of the code has written
            pass
        else:
            if all(file.is_whole() for file in (*(table.file for table in source.tables), *source.images)):
                return source
    generated = backend.generate(look, setting)
    store_cached(_CACHE_FOLDER, key, _SOURCE.dump_python(generated, mode="json"))  # type: ignore[arg-type]
    return generated


def _image_digests(look: Look) -> list[str] | None:
    """Return the digests of a look's images; None if the source depends on more than the look's values and images."""
    digests = []
    for layer in look.layers:
        parameters: Mapping[str, Parameter] = MODELS[layer.model].parameters if layer.model in MODELS else {}
        if any(parameter.file is not None for parameter in parameters.values()):
            return None
        for value in (*layer.inputs.values(), layer.mask):
            if isinstance(value, Texture | Bump):
                texture = value.height if isinstance(value, Bump) else value
                try:  # the file may be missing: that is an error only if the source reads it
                    check_file(texture.file, TextureError)
                    digests.append(file_digest(texture.file))
                except (TextureError, OSError):
                    return None
            elif not isinstance(value, Primvar) and not all(
                type(element) in (bool, int, float, str) for element in _elements(value)
            ):
                return None
    return digests


def _elements(value: object) -> Iterator[object]:
    """Yield the elements of a tuple, or any other value itself."""
    yield from value if isinstance(value, tuple) else (value,)
