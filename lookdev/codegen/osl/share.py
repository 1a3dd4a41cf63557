"""Programs that looks share: shaders whose texts differ in the looks' constants alone are compiled once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from lookdev.codegen.source import ShaderSource


def shared_programs(sources: Iterable[ShaderSource]) -> dict[ShaderSource, ShaderSource]:
    """Return, for each source, one that shares its program with all that have its text; what is equal stays constant.

    The picture is the same: a number is read where another stood in the code.
    """
    alike: dict[ShaderSource, list[ShaderSource]] = {}
    for source in dict.fromkeys(sources):
        alike.setdefault(replace(source, name="", digest="", constants=()), []).append(source)
    found: dict[ShaderSource, ShaderSource] = {}
    for group in alike.values():
        columns = zip(*(source.constants for source in group), strict=True)
        varying = tuple(place for place, column in enumerate(columns) if len(set(column)) > 1)
        found |= {source: replace(source, varying=varying) for source in group}
    return found
