"""The document of the Designer: a job with its looks, and the visible scene, which is one of the job's scenes.

The routes of the page read and edit the document by the class `Document`. One lock protects all its state; the modules
that it imports do the work.
"""

from __future__ import annotations

import os
import re
import threading
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from lookdev.errors import LookdevError, ModelError, nearest_hint
from lookdev.job import Job
from lookdev.material import Look
from lookdev.material.library import LIBRARY_VARIABLE, library_folders
from lookdev.material.library.constants import set_inputs
from lookdev.material.library.fragments import copy_layer, save_preset
from lookdev.scene import Scene
from lookdev.studio.designer.edited_job import EditedJob, ParsedJob, shipped_lights
from lookdev.studio.designer.edits import Edit, check_value, shader_shape
from lookdev.studio.designer.history import EditState
from lookdev.studio.designer.looks import JobLooks, distinct_looks
from lookdev.studio.designer.operations import FileEdit, parse_operation
from lookdev.studio.designer.recovery import Recovery
from lookdev.studio.designer.rows import layer_rows
from lookdev.studio.designer.snapshots import Snapshots
from lookdev.studio.designer.sources import LookLocation, OpenedLook, images_below
from lookdev.studio.designer.workspace import Workspace
from lookdev.studio.viewport import SceneView, view_scene

_PRESET = re.compile(r"[a-z][a-z0-9_]{0,63}")  # a valid name of a preset


class Document:
    """The scenes of a job, one of which is visible, and the looks with their edits. Methods are thread-safe.

    A job has a scene for each pair of a look (a `[[look]]` of the job) and a rig. `scene_key` has the names of the
    visible look and rig. The look of a job assigns a `Look`, a stack of layers from a file, to each slot of the asset.
    A method's parameter `number` is the index of such a `Look` in `distinct_looks` of the visible scene.
    """

    def __init__(self, edited_job: EditedJob, recovery: Recovery | None = None) -> None:
        self.scene_key = next(iter(edited_job.parse({}).scenes.scenes))
        self.snapshots = Snapshots()
        self._edited_job = edited_job
        self._lock = threading.RLock()
        self._workspace = Workspace(recovery)
        self._workspace.sources.add(edited_job.file, edited_job.content)
        self._looks = JobLooks(edited_job, self._workspace.sources)
        # The location of the look that shows one layer alone (solo), and the number of this layer.
        self._solo: tuple[LookLocation, int] | None = None
        # The last result of `view`, after its inputs: the scene without edits of looks, and the visible looks.
        self._view: tuple[Scene, tuple[Look, ...], SceneView] | None = None
        self._revision = 0  # counts changes, for `revision_status`

    @property
    def _current_job(self) -> ParsedJob:
        """The job with its edits.

        If the job lacks the visible light, the light is one of the shipped lights, and is added to the job.
        """
        files = self._workspace.state.files
        job = self._edited_job.parse(files)
        return job if self.scene_key in job.scenes.scenes else self._edited_job.parse(files, self.scene_key[1])

    @property
    def job(self) -> Job:
        """The job with its edits."""
        with self._lock:
            return self._current_job.job

    @property
    def choices(self) -> dict[str, list[str]]:
        """The names of the job's ``looks`` and ``rigs``, and of the ``shipped`` lights that it lacks."""
        with self._lock:
            job = self._edited_job.parse(self._workspace.state.files)
        looks, rigs = (list(dict.fromkeys(names)) for names in zip(*job.scenes.scenes, strict=True))
        return {"looks": looks, "rigs": rigs, "shipped": [*shipped_lights(job.job)]}

    def choose(self, look: str, rig: str) -> None:
        """Show the scene of another look and rig; raise LookdevError if there is no look or light of these names."""
        with self._lock:
            choices = self.choices
            for kind, name, names in (
                ("look", look, choices["looks"]),
                ("rig", rig, [*choices["rigs"], *choices["shipped"]]),
            ):
                if name not in names:
                    raise LookdevError(f"the job has no {kind} '{name}' ({nearest_hint(name, names)})")
            before, self.scene_key = self.scene_key, (look, rig)
            try:
                self._scene  # noqa: B018  builds the scene, which can fail
            except LookdevError:
                self.scene_key = before
                raise
            self._revision += 1

    @property
    def _scene(self) -> Scene:
        """The visible scene with the edits of the job, but without the edits of looks."""
        return self._current_job.scenes.scenes[self.scene_key]

    @property
    def _originals(self) -> list[Look]:
        """The looks of the visible scene without their edits, by number."""
        return distinct_looks(self._scene)

    @property
    def scene(self) -> Scene:
        """The visible scene, with the edits of its looks."""
        with self._lock:
            edited = dict(zip(map(id, self._originals), self._visible_looks(), strict=True))
            return replace(
                self._scene, look_of_slot={path: edited[id(look)] for path, look in self._scene.look_of_slot.items()}
            )

    @property
    def looks(self) -> list[Look]:
        """The looks of the visible scene with their edits, by number; a solo layer does not change them."""
        with self._lock:
            return [self._open_look(number).look for number in range(len(self._originals))]

    def _visible_looks(self) -> list[Look]:
        """Return the looks as the viewport draws them: a look with a solo layer has only this layer, without mask."""
        looks = self.looks
        for number, look in enumerate(looks):
            index = self._solo_index(number)
            if index is not None:
                looks[number] = replace(look, layers=(replace(look.layers[index], mask=1.0, mode="over"),))
        return looks

    def view(self) -> SceneView:
        """Return the visible scene for the page."""
        with self._lock:
            scene = self.scene
            original, looks = self._scene, tuple(self._visible_looks())
            if self._view is None or self._view[0] is not original or self._view[1] != looks:
                self._view = original, looks, view_scene(scene, view=self.job.outputs.display_view("png"))
            return self._view[2]

    def location(self, number: int) -> LookLocation | None:
        """Return the location of a look, or None if the look cannot be edited."""
        location = self._location_or_reason(number)
        return location if isinstance(location, LookLocation) else None

    def _location_or_reason(self, number: int) -> LookLocation | str:
        """Return the location of a look, or the reason why it cannot be edited."""
        return self._looks.location(self._current_job, self.scene_key, number)

    def _open_look(self, number: int) -> OpenedLook:
        """Return a look with its edits, and the outline of its layers."""
        return self._looks.open_look(self._current_job, self.scene_key, number, self._workspace.state)

    def edit(self, edit: Edit) -> bool:
        """Change a constant of a look; return whether shaders change, or only the value of a uniform.

        Raises LookdevError, and changes nothing, if there is no such parameter, or it cannot have the value.
        """
        with self._lock:
            location = self._editable_location(edit.look)
            look = self._open_look(edit.look).look
            if not 0 <= edit.layer < len(look.layers):
                raise ModelError(f"look '{look.name}' has {len(look.layers)} layers, none of number {edit.layer}")
            layer = look.layers[edit.layer]
            value = check_value(layer, edit)
            values, variants = {(edit.layer, edit.parameter): value}, self._variants_of(location)
            label, gesture = f"{layer.name} {edit.parameter}", edit.gesture
            return self._edit_file(
                edit.look, label, lambda file: set_inputs(file, values, location.prim, variants), gesture
            )

    def edit_stack(self, number: int, body: Mapping[str, Any]) -> bool:
        """Apply an operation to the stack of layers of a look; return whether shaders change.

        `body` is the page's request, as `operations.parse_operation` reads it.
        """
        with self._lock:
            location = self._editable_location(number)
            if body.get("op") == "variant" and str(body.get("set")) in location.variants:
                return self._show_variant(number, location, str(body.get("set")), str(body.get("choice")))
            opened = self._open_look(number)
            label, edit = parse_operation(
                body, location, opened, self._variants_of(location), self._image_roots(location)
            )
            return self._edit_file(number, label, edit)

    def assign_look(self, body: Mapping[str, Any]) -> bool:
        """Assign a look to parts, or unassign it (`EditedJob.assign_look`); return whether shaders change.

        A request with a `preset` and a `file` first writes a new look; undo does not remove its file.
        """
        with self._lock:
            new_file = None
            if isinstance(preset := body.get("preset"), str):
                new_file = self._edited_job.create_look(preset, str(body.get("file")))
                body = {**body, "material": new_file.name}
            try:
                file, state = self._edited_job.file, self._workspace.state
                label, content = self._edited_job.assign_look(
                    self._current_job, self.scene_key[0], self._workspace.content(file), body
                )
                return self._push_state(label, replace(state, files={**state.files, file: content}))
            except LookdevError:
                if new_file is not None:
                    new_file.unlink(missing_ok=True)
                raise

    def list_materials(self) -> dict[str, Any]:
        """Return the materials that can be assigned to parts (`EditedJob.list_materials`)."""
        with self._lock:
            return self._edited_job.list_materials(self._current_job)

    def copy(self, number: int, layer: int) -> str:
        """Return a layer of a look as USD text, which another look can paste."""
        with self._lock:
            location = self._editable_location(number)
            with self._workspace.sources.copy_beside(location.file, self._workspace.content(location.file)) as file:
                return copy_layer(file, str(layer), location.prim, self._variants_of(location))

    def save_preset(self, number: int, layer: int, name: str, category: str) -> Path:
        """Write a layer as a preset of the first folder of the library; return the file."""
        with self._lock:
            location, folder = self._editable_location(number), library_folders()[0]
            target = folder / f"{name.strip()}.usda"
            if not _PRESET.fullmatch(name.strip()) or not os.access(folder, os.W_OK):
                hint = f"a folder of your own in ${LIBRARY_VARIABLE} would be right"
                message = f"{folder}: cannot be written; {hint}" if _PRESET.fullmatch(name.strip()) else ""
                raise LookdevError(message or f"'{name}' is not a name of a preset; red_rubber would be right")
            doc = f"{name.strip().replace('_', ' ').capitalize()}."
            with self._workspace.sources.copy_beside(location.file, self._workspace.content(location.file)) as file:
                save_preset(file, str(layer), target, category.strip(), doc, location.prim, self._variants_of(location))
            return target

    def solo(self, number: int, layer: int | None) -> None:
        """Show one layer of a look alone, or all layers; this is a setting of the view, and is not saved."""
        with self._lock:
            location = self._editable_location(number)
            if layer is not None and layer not in self._enabled_layers(number):
                raise ModelError(f"the look shows no layer {layer}: a muted one cannot be shown alone")
            self._solo = None if layer is None else (location, layer)
            self._revision += 1

    def _solo_index(self, number: int) -> int | None:
        """Return the index of the solo layer in a look, or None if the look has no solo layer."""
        if self._solo is None or self._location_or_reason(number) != self._solo[0]:
            return None
        enabled = self._enabled_layers(number)
        return enabled.index(self._solo[1]) if self._solo[1] in enabled else None

    def _enabled_layers(self, number: int) -> list[int]:
        """Return the numbers of a look's layers that are not muted; the numbers count muted layers, too."""
        return [entry.number for entry in self._open_look(number).outline.entries if entry.enabled]

    def undo(self, direction: int = -1) -> bool:
        """Undo (`direction` -1) or redo (1) a step; return whether shaders change."""
        with self._lock:
            before = self._scene, self._visible_looks()
            if self._workspace.history.step(direction) is None:
                raise LookdevError(f"there is nothing to {'undo' if direction < 0 else 'do again'}")
            return self._adopt_state(*before)

    def _editable_location(self, number: int) -> LookLocation:
        """Return the location of a look; raise LookdevError if the look cannot be edited."""
        location = self._location_or_reason(number)
        if isinstance(location, str):
            raise LookdevError(f"{location}: it cannot be edited here")
        return location

    def _variants_of(self, location: LookLocation) -> dict[str, str]:
        """Return the chosen variant of each set of a look: the page's own choice, else the job's."""
        return {**location.variants, **self._workspace.state.variants.get(location.key, {})}

    def _image_roots(self, location: LookLocation) -> list[Path]:
        """Return the folders whose images a look may read."""
        return list(dict.fromkeys([location.file.parent, self._edited_job.file.parent, Path.cwd()]))

    def _edit_file(self, number: int, label: str, edit: FileEdit, gesture: str = "") -> bool:
        """Edit the content of a look's file, as a step of the history with a label; return whether shaders change.

        Nothing changes if the edit fails, or if the new scene cannot be shown.
        """
        return self._push_state(label, self._workspace.apply_edit(self._editable_location(number).file, edit), gesture)

    def _show_variant(self, number: int, location: LookLocation, name: str, choice: str) -> bool:
        """Show the variant `choice` of the set `name` in place of the job's choice; the look's file does not change.

        Returns whether shaders change.
        """
        choices, _ = self._open_look(number).outline.variants.get(name, ((), ""))
        if choice not in choices:
            raise ModelError(f"variant set '{name}' has no variant '{choice}' ({nearest_hint(choice, list(choices))})")
        state = self._workspace.state
        variants = {**state.variants.get(location.key, {}), name: choice}
        return self._push_state(
            f"show variant {name}: {choice}", replace(state, variants={**state.variants, location.key: variants})
        )

    def _push_state(self, label: str, state: EditState, gesture: str = "") -> bool:
        """Add a step with a label to the history, and show the state to which it leads; return whether shaders change.

        If that fails, nothing changes. Steps of the same `gesture` are merged.
        """
        before, history = (self._scene, self._visible_looks()), self._workspace.history.copy()
        revision, scene_key = self._revision, self.scene_key
        self._workspace.history.push(label, state, gesture)
        try:
            return self._adopt_state(*before)
        except LookdevError:
            self._workspace.history, self._revision, self.scene_key = history, revision, scene_key
            raise

    def _adopt_state(self, scene: Scene, before: list[Look]) -> bool:
        """Show the present state and store it for recovery; return whether shaders change.

        `scene` is the visible scene before the change of state, without edits of its looks; `before` has the visible
        looks before the change, by number.
        """
        choices = self.choices
        if not self._has_scene(self.scene_key):
            self.scene_key = (choices["looks"][0], choices["rigs"][0])
        looks = self._visible_looks()
        compiles = self._scene is not scene or [shader_shape(look) for look in before] != [
            shader_shape(look) for look in looks
        ]
        if compiles:
            self.view()
        self._revision += 1
        self._workspace.store_unsaved(self.scene_key)
        return compiles

    def is_unsaved(self, number: int) -> bool:
        """Return whether a look has edits that its file lacks."""
        location = self.location(number)
        return location is not None and self._workspace.is_unsaved(location.file)

    def save(self, number: int | None = None, name: str | None = None, *, overwrite: bool = False) -> list[Path]:
        """Write all edited files, or the file of a look, and return the files that were written.

        With a `name`, write a new file instead, beside the file of the look, or beside the job.

        Raises
        ------
        ConflictError
            A file has changed on disk since it was read, and `overwrite` is false.
        LookdevError
            The look has no file, the new file exists, or its name is not valid.
        """
        with self._lock:
            if name is not None:
                file = self._edited_job.file if number is None else self._editable_location(number).file
                return [self._workspace.save_as(file, name)]
            saved = self._workspace.save(
                None if number is None else self._editable_location(number).file, overwrite=overwrite
            )
            self._revision += 1
            self._workspace.store_unsaved(self.scene_key)
            return saved

    def reload(self) -> bool:
        """Load files that other programs have changed, as a step that can be undone; return whether shaders change."""
        with self._lock:
            contents, state = self._workspace.changed_contents(), self._workspace.state
            compiles = self._push_state("load from disk", replace(state, files={**state.files, **contents}))
            self._workspace.accept(contents)
            self._workspace.store_unsaved(self.scene_key)
            return compiles

    def keep_edits(self) -> None:
        """Keep the edits of files that other programs have changed: they stay unsaved, and saving overwrites them."""
        with self._lock:
            self._workspace.accept_disk()
            self._revision += 1
            self._workspace.store_unsaved(self.scene_key)

    def recover(self, *, restore: bool) -> bool:
        """Restore the unsaved work of an earlier Designer, or discard it; return whether shaders change."""
        with self._lock:
            compiles, work = False, self._workspace.offered_work
            if restore and work is not None:
                state, before = self._workspace.recovered_state(), self.scene_key
                self.scene_key = work.visible if self._has_scene(work.visible) else before
                compiles = self._push_state("restore unsaved work", state) or before != self.scene_key
            self._workspace.forget_offer()
            self._revision += 1
            return compiles

    def _has_scene(self, scene_key: tuple[str, str]) -> bool:
        """Return whether there is a scene with these names of a look and a rig, shipped lights included."""
        choices, (look, rig) = self.choices, scene_key
        return look in choices["looks"] and rig in [*choices["rigs"], *choices["shipped"]]

    def store_snapshot(self, picture: bytes) -> None:
        """Store a picture of the visible scene, with the state of the looks."""
        with self._lock:
            self.snapshots.store(picture, self._workspace.state, self.scene_key)

    def show_snapshot(self, number: int) -> bool:
        """Go back to the state of a snapshot, as a step that can be undone; return whether shaders or scene change."""
        with self._lock:
            snapshot = self.snapshots[number]
            before, self.scene_key = self.scene_key, snapshot.visible
            try:
                return self._push_state(f"go back to {snapshot.name}", snapshot.state) or before != snapshot.visible
            except LookdevError:
                self.scene_key = before
                raise

    def images(self, number: int) -> list[str]:
        """Return the images below a look's folder, relative to it; masks may read them."""
        return images_below(self._editable_location(number).file.parent)

    def stacks(self) -> list[dict[str, Any]]:
        """Return the stack of each look for the page: its file, variants, and layers with their parameters."""
        with self._lock:
            return [self._stack(number) for number in range(len(self._originals))]

    def _stack(self, number: int) -> dict[str, Any]:
        """Return the stack of a look for the page; ``locked`` is the reason why it cannot be edited, or empty."""
        location, opened = self._location_or_reason(number), self._open_look(number)
        editable = isinstance(location, LookLocation)
        solo = self._solo[1] if self._solo is not None and self._solo_index(number) is not None else None
        folder = location.file.parent if isinstance(location, LookLocation) else None
        return {
            "name": self._originals[number].name,
            "file": str(location.file) if isinstance(location, LookLocation) else "",
            "locked": "" if editable else location,
            "unsaved": self.is_unsaved(number),
            "solo": solo,
            "variants": [
                {"set": name, "choices": choices, "chosen": choice, "by_job": editable and name in location.variants}  # type: ignore[union-attr]
                for name, (choices, choice) in opened.outline.variants.items()
            ],
            "layers": [*layer_rows(opened.look, opened.outline if editable else None, folder, solo)],
        }

    def status(self) -> dict[str, Any]:
        """Return the data of the page's panels: stacks, assignments, history, snapshots and work to recover."""
        with self._lock:
            return {
                **self.revision_status(),
                "stacks": self.stacks(),
                "job": {
                    **self._edited_job.describe_assignments(self._current_job, self.scene_key),
                    "unsaved": self._workspace.is_unsaved(self._edited_job.file),
                    "new": not self._workspace.sources.known_digest(self._edited_job.file),
                },
                "undoes": self._workspace.history.undo_label,
                "redoes": self._workspace.history.redo_label,
                "snapshots": self.snapshots.describe(),
                "recovery": self._workspace.describe_offer(),
            }

    def close(self) -> bool:
        """End recovery; return whether there is unsaved work, which the next Designer offers."""
        return self._workspace.close()

    def revision_status(self) -> dict[str, Any]:
        """Return the revision, and the files that other programs have changed.

        If either differs from the page's last status, the page requests a new one.
        """
        with self._lock:
            return {"revision": self._revision, "changed": list(map(str, self._workspace.sources.changed_files()))}
