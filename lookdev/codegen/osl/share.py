"""Programs that looks share: shaders whose texts differ only in the looks' constants are compiled once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from lookdev.codegen.source import ShaderSource


def shared_programs(sources: Iterable[ShaderSource]) -> dict[ShaderSource, ShaderSource]:
    """Return, for each source, an equivalent one that shares its program with all sources of the same text.

    Constants that are equal in all these sources stay constants. The picture does not change: the shader reads a number
    that was a literal in its code.
    """
    by_text: dict[ShaderSource, list[ShaderSource]] = {}
    for source in dict.fromkeys(sources):
        by_text.setdefault(replace(source, name="", digest="", constants=()), []).append(source)
    shared: dict[ShaderSource, ShaderSource] = {}
    for members in by_text.values():
        columns = zip(*(source.constants for source in members), strict=True)
        varying = tuple(index for index, column in enumerate(columns) if len(set(column)) > 1)
        shared |= {source: replace(source, varying=varying) for source in members}
    return shared
