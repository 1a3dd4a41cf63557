"""The looks of a scene in the Designer with their edits, and the location of each look in a file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from lookdev.brdf import MODELS
from lookdev.errors import LookdevError, ModelError
from lookdev.material import Look
from lookdev.material.library.stack import LayerEntry, LookOutline
from lookdev.scene import Scene
from lookdev.studio.designer.edited_job import EditedJob, ParsedJob
from lookdev.studio.designer.history import EditState
from lookdev.studio.designer.sources import LookLocation, OpenedLook, SourceFiles

_SOURCE = re.compile(r"(?P<file>.+)<(?P<prim>/[^<>]*)>")  # `Look.source` of a look that was read from a file


def distinct_looks(scene: Scene) -> list[Look]:
    """Return the looks of a scene, each once; the index of a look is its number on the page."""
    return list({id(look): look for look in scene.looks}.values())


class JobLooks:
    """The looks of a job's scenes, and their locations, which stay the same while the job is edited."""

    def __init__(self, edited_job: EditedJob, sources: SourceFiles) -> None:
        self._edited_job = edited_job
        self._sources = sources
        # By the source and the variants of a look: its location, or the reason why it cannot be edited.
        self._locations: dict[tuple[str, tuple[tuple[str, str], ...]], LookLocation | str] = {}

    def location(self, parsed_job: ParsedJob, scene_key: tuple[str, str], number: int) -> LookLocation | str:
        """Return the location of a look, or the reason why it cannot be edited.

        `number` is the index of the look in `distinct_looks` of a scene. `scene_key` identifies the scene by the names
        of a look of the job and a rig. Raises ModelError if there is no look of this number.
        """
        scene = parsed_job.scenes.scenes[scene_key]
        looks = distinct_looks(scene)
        if not 0 <= number < len(looks):
            raise ModelError(f"there are {len(looks)} looks, none of number {number}")
        slot = next(path for path, slot_look in scene.look_of_slot.items() if slot_look is looks[number])
        variants = self._edited_job.variants(parsed_job, scene_key, slot)
        key = (looks[number].source, tuple(variants.items()))
        if key not in self._locations:
            self._locations[key] = self._locate(looks[number], variants)
        return self._locations[key]

    def open_look(self, parsed_job: ParsedJob, scene_key: tuple[str, str], number: int, state: EditState) -> OpenedLook:
        """Return a look with the edits of a state; raise LookError if the edited file has no valid look.

        A look that cannot be edited is returned as the job has it, with an outline of its layers.
        """
        location = self.location(parsed_job, scene_key, number)
        original = distinct_looks(parsed_job.scenes.scenes[scene_key])[number]
        if isinstance(location, str):
            entries = (LayerEntry(number, layer.name) for number, layer in enumerate(original.layers))
            return OpenedLook(original, LookOutline(tuple(entries), {}))
        opened = self._sources.open_look(location, state.files, state.variants.get(location.key, {}), original)
        return replace(opened, look=original) if opened.look.layers == original.layers else opened

    def _locate(self, look: Look, variants: Mapping[str, str]) -> LookLocation | str:
        """Return the location of a look, or the reason why it has none; the file alone must give the look's layers."""
        match = _SOURCE.fullmatch(look.source)
        if not match or not Path(match["file"]).is_file():
            return f"look '{look.name}' is not in a file"
        if foreign_layers := [layer for layer in look.layers if layer.model not in MODELS]:
            return f"look '{look.name}' is translated from {foreign_layers[0].model}: it has no layers of its own"
        file = Path(match["file"]).absolute()
        location = LookLocation(file, match["prim"], variants)
        try:
            self._sources.track(file)
            # The look is from the file on disk, which the Designer may have saved since `track` first read it.
            opened = self._sources.open_look(location, {file: file.read_bytes()}, {}, look)
        except LookdevError as error:
            return str(error)
        if opened.look.layers != look.layers:
            return f"look '{look.name}' is composed of several files: {file} alone is another look"
        return location
