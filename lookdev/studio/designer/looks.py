"""The looks of a shown scene as they are edited: where each is, and what its file has now."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from lookdev.brdf import MODELS
from lookdev.errors import LookdevError, ModelError
from lookdev.material import Look
from lookdev.material.library.stack import Entry, Outline
from lookdev.scene import Scene
from lookdev.studio.designer.dressing import Dressing, Read
from lookdev.studio.designer.history import State
from lookdev.studio.designer.sources import Opened, Place, Sources

_SOURCE = re.compile(r"(?P<file>.+)<(?P<prim>/[^<>]*)>")


def looks_of(scene: Scene) -> list[Look]:
    """Return the looks of a scene by the numbers that the page gives them."""
    return list({id(look): look for look in scene.looks}.values())


class Looks:
    """Places of looks, which stay while the job is edited; a scene is `chosen` of a job that was read."""

    def __init__(self, dressing: Dressing, sources: Sources) -> None:
        self._dressing = dressing
        self._sources = sources
        self._places: dict[tuple[str, tuple[tuple[str, str], ...]], Place | str] = {}

    def place(self, read: Read, chosen: tuple[str, str], number: int) -> Place | str:
        """Return the place of a look, or why it cannot be edited; raises ModelError where there is no such look."""
        scene = read.scenes.scenes[chosen]
        looks = looks_of(scene)
        if not 0 <= number < len(looks):
            raise ModelError(f"there are {len(looks)} looks, none of number {number}")
        slot = next(path for path, worn in scene.wears.items() if worn is looks[number])
        variants = self._dressing.variants(read, chosen, slot)
        key = (looks[number].source, tuple(variants.items()))
        if key not in self._places:
            self._places[key] = self._placed(looks[number], variants)
        return self._places[key]

    def opened(self, read: Read, chosen: tuple[str, str], number: int, state: State) -> Opened:
        """Return a look as a state has it; raises LookError where it is none."""
        place, original = self.place(read, chosen, number), looks_of(read.scenes.scenes[chosen])[number]
        if isinstance(place, str):
            entries = (Entry(number, layer.name) for number, layer in enumerate(original.layers))
            return Opened(original, Outline(tuple(entries), {}))
        opened = self._sources.opened(place, state.files, state.variants.get(place.key, {}), original)
        return replace(opened, look=original) if opened.look.layers == original.layers else opened

    def _placed(self, look: Look, variants: Mapping[str, str]) -> Place | str:
        found = _SOURCE.fullmatch(look.source)
        if not found or not Path(found["file"]).is_file():
            return f"look '{look.name}' is of no file"
        if foreign := [layer for layer in look.layers if layer.model not in MODELS]:
            return f"look '{look.name}' is translated from {foreign[0].model}: it has no layers of its own"
        file = Path(found["file"]).absolute()
        place = Place(file, found["prim"], variants)
        try:
            self._sources.take(file)
            # The job's look is read from disk, which may have been saved to since the file was first read.
            opened = self._sources.opened(place, {file: file.read_bytes()}, {}, look)
        except LookdevError as error:
            return str(error)
        if opened.look.layers != look.layers:
            return f"look '{look.name}' is composed of several files: {file} alone is another look"
        return place
