"""What the Designer edits: a job, its looks, on its asset, under one of its rigs.

One class is all that is done under one lock; what it does is in the modules that it imports.
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
from lookdev.studio.designer.dressing import Dressing, Read, shipped_lights
from lookdev.studio.designer.edits import Edit, checked, shape_of
from lookdev.studio.designer.history import State
from lookdev.studio.designer.looks import Looks, looks_of
from lookdev.studio.designer.operations import Operation, operation
from lookdev.studio.designer.recovery import Recovery
from lookdev.studio.designer.rows import layer_rows
from lookdev.studio.designer.snapshots import Snapshots
from lookdev.studio.designer.sources import Opened, Place, images_below
from lookdev.studio.designer.workspace import Workspace
from lookdev.studio.viewport import SceneView, view_scene

_PRESET = re.compile(r"[a-z][a-z0-9_]{0,63}")


class Document:
    """The scenes of a job, one of which is shown, and the looks as they are edited.

    Looks have the numbers that they have in the shown scene. All methods can be called by several threads.
    """

    def __init__(self, dressing: Dressing, recovery: Recovery | None = None) -> None:
        self.chosen = next(iter(dressing.read({}).scenes.scenes))
        self.snapshots = Snapshots()
        self._dressing = dressing
        self._lock = threading.RLock()
        self._work = Workspace(recovery)
        self._work.sources.add(dressing.file, dressing.content)
        self._looks = Looks(dressing, self._work.sources)
        self._solo: tuple[Place, int] | None = None
        self._view: tuple[Scene, tuple[Look, ...], SceneView] | None = None
        self._revision = 0

    @property
    def _read(self) -> Read:
        """The job as it is edited, with the light that is shown."""
        files = self._work.state.files
        own = self._dressing.read(files)
        return own if self.chosen in own.scenes.scenes else self._dressing.read(files, self.chosen[1])

    @property
    def job(self) -> Job:
        """The job as it is edited."""
        with self._lock:
            return self._read.job

    @property
    def choices(self) -> dict[str, list[str]]:
        """The names of looks and of rigs of the job, and of the lights that ship beside them."""
        with self._lock:
            own = self._dressing.read(self._work.state.files)
        looks, rigs = (list(dict.fromkeys(names)) for names in zip(*own.scenes.scenes, strict=True))
        return {"looks": looks, "rigs": rigs, "shipped": [*shipped_lights(own.job)]}

    def choose(self, look: str, rig: str) -> None:
        """Show another scene; raises LookdevError where there is no look or light of these names."""
        with self._lock:
            choices = self.choices
            for kind, name, known in (
                ("look", look, choices["looks"]),
                ("rig", rig, [*choices["rigs"], *choices["shipped"]]),
            ):
                if name not in known:
                    raise LookdevError(f"the job has no {kind} '{name}' ({nearest_hint(name, known)})")
            before, self.chosen = self.chosen, (look, rig)
            try:
                self._scene  # noqa: B018
            except LookdevError:
                self.chosen = before
                raise
            self._revision += 1

    @property
    def _scene(self) -> Scene:
        return self._read.scenes.scenes[self.chosen]

    @property
    def _originals(self) -> list[Look]:
        return looks_of(self._scene)

    @property
    def scene(self) -> Scene:
        """The shown scene, with its edited looks."""
        with self._lock:
            shown = dict(zip(map(id, self._originals), self._shown(), strict=True))
            return replace(self._scene, wears={path: shown[id(look)] for path, look in self._scene.wears.items()})

    @property
    def looks(self) -> list[Look]:
        """The looks of the shown scene, edited, by their numbers; solo is a matter of the view."""
        with self._lock:
            return [self._opened(number).look for number in range(len(self._originals))]

    def _shown(self) -> list[Look]:
        """Return the looks as they are shown: of one with a solo layer, this layer alone and whole."""
        shown = self.looks
        for number, look in enumerate(shown):
            place = self._solo_place(number)
            if place is not None:
                shown[number] = replace(look, layers=(replace(look.layers[place], mask=1.0, mode="over"),))
        return shown

    def view(self) -> SceneView:
        """Return the shown scene for the page."""
        with self._lock:
            scene = self.scene
            read, shown = self._scene, tuple(self._shown())
            if self._view is None or self._view[0] is not read or self._view[1] != shown:
                self._view = read, shown, view_scene(scene, view=self.job.outputs.shown("png"))
            return self._view[2]

    def place(self, number: int) -> Place | None:
        """Return where a look is edited; None where it cannot be."""
        found = self._place(number)
        return found if isinstance(found, Place) else None

    def _place(self, number: int) -> Place | str:
        """Return the place of a look, or why it cannot be edited."""
        return self._looks.place(self._read, self.chosen, number)

    def _opened(self, number: int) -> Opened:
        return self._looks.opened(self._read, self.chosen, number, self._work.state)

    def edit(self, edit: Edit) -> bool:
        """Change a constant of a look; return whether shaders change, not only a uniform of them.

        Raises LookdevError where there is no such parameter, or it cannot have the value; then nothing changes.
        """
        with self._lock:
            place = self._editable(edit.look)
            look = self._opened(edit.look).look
            if not 0 <= edit.layer < len(look.layers):
                raise ModelError(f"look '{look.name}' has {len(look.layers)} layers, none of number {edit.layer}")
            layer = look.layers[edit.layer]
            value = checked(layer, edit)
            label = f"{layer.name} {edit.parameter}"
            values = {(edit.layer, edit.parameter): value}
            return self._apply(
                edit.look,
                label,
                lambda file: set_inputs(file, values, place.prim, self._variants_of(place)),
                edit.gesture,
            )

    def arrange(self, number: int, body: Mapping[str, Any]) -> bool:
        """Do what a page asks for to the stack of a look (`operations`); return whether shaders change."""
        with self._lock:
            place = self._editable(number)
            if body.get("op") == "variant" and str(body.get("set")) in place.variants:
                return self._show_variant(number, place, str(body.get("set")), str(body.get("choice")))
            opened = self._opened(number)
            label, edit = operation(body, place, opened, self._variants_of(place), self._roots(place))
            return self._apply(number, label, edit)

    def wear(self, body: Mapping[str, Any]) -> bool:
        """Dress parts as a page asks for (`Dressing.wear`), in the job; return whether shaders change.

        A request with a `preset` and a `file` makes a new look of them first, which stays.
        """
        with self._lock:
            made = None
            if isinstance(preset := body.get("preset"), str):
                made = self._dressing.create(preset, str(body.get("file")))
                body = {**body, "material": made.name}
            try:
                file, state = self._dressing.file, self._work.state
                label, content = self._dressing.wear(self._read, self.chosen[0], self._work.content(file), body)
                return self._push(label, replace(state, files={**state.files, file: content}))
            except LookdevError:
                if made is not None:
                    made.unlink(missing_ok=True)
                raise

    def wearables(self) -> dict[str, Any]:
        """Return what parts can wear (`Dressing.wearables`)."""
        with self._lock:
            return self._dressing.wearables(self._read)

    def copy(self, number: int, layer: int) -> str:
        """Return a layer as USD text."""
        with self._lock:
            place = self._editable(number)
            with self._work.sources.beside(place.file, self._work.content(place.file)) as file:
                return copy_layer(file, str(layer), place.prim, self._variants_of(place))

    def save_preset(self, number: int, layer: int, name: str, category: str) -> Path:
        """Write a layer as a preset of the first folder of the library; return the file."""
        with self._lock:
            place, folder = self._editable(number), library_folders()[0]
            target = folder / f"{name.strip()}.usda"
            if not _PRESET.fullmatch(name.strip()) or not os.access(folder, os.W_OK):
                hint = f"a folder of your own in ${LIBRARY_VARIABLE} would be right"
                wrong = f"{folder}: cannot be written; {hint}" if _PRESET.fullmatch(name.strip()) else ""
                raise LookdevError(wrong or f"'{name}' is no name of a preset: for instance red_rubber")
            doc = f"{name.strip().replace('_', ' ').capitalize()}."
            with self._work.sources.beside(place.file, self._work.content(place.file)) as file:
                save_preset(file, str(layer), target, category.strip(), doc, place.prim, self._variants_of(place))
            return target

    def solo(self, number: int, layer: int | None) -> None:
        """Show one layer of a look alone, or all of them: a matter of the view, which is not saved."""
        with self._lock:
            place = self._editable(number)
            if layer is not None and layer not in [e.number for e in self._opened(number).outline.entries if e.enabled]:
                raise ModelError(f"the look shows no layer {layer}: a muted one cannot be shown alone")
            self._solo = None if layer is None else (place, layer)
            self._revision += 1

    def _solo_place(self, number: int) -> int | None:
        """Return the place in a look of the layer that is shown alone."""
        if self._solo is None or self._place(number) != self._solo[0]:
            return None
        shown = [each.number for each in self._opened(number).outline.entries if each.enabled]
        return shown.index(self._solo[1]) if self._solo[1] in shown else None

    def undo(self, by: int = -1) -> bool:
        """Undo (-1) or redo (1) the last step; return whether shaders change."""
        with self._lock:
            before = self._scene, self._shown()
            if self._work.history.step(by) is None:
                raise LookdevError(f"there is nothing to {'undo' if by < 0 else 'do again'}")
            return self._adopted(*before)

    def _editable(self, number: int) -> Place:
        place = self._place(number)
        if isinstance(place, str):
            raise LookdevError(f"{place}: it cannot be edited here")
        return place

    def _variants_of(self, place: Place) -> dict[str, str]:
        return {**place.variants, **self._work.state.variants.get(place.key, {})}

    def _roots(self, place: Place) -> list[Path]:
        return list(dict.fromkeys([place.file.parent, self._dressing.file.parent, Path.cwd()]))

    def _apply(self, number: int, label: str, edit: Operation, gesture: str = "") -> bool:
        """Edit the content of a look's file; nothing changes where that fails, or the scene cannot be shown then."""
        return self._push(label, self._work.edited(self._editable(number).file, edit), gesture)

    def _show_variant(self, number: int, place: Place, name: str, choice: str) -> bool:
        """Show a variant that the job chooses: it is not in the look's file."""
        choices, _ = self._opened(number).outline.variants.get(name, ((), ""))
        if choice not in choices:
            raise ModelError(f"variant set '{name}' has no variant '{choice}' ({nearest_hint(choice, list(choices))})")
        state = self._work.state
        shown = {**state.variants.get(place.key, {}), name: choice}
        return self._push(
            f"show variant {name}: {choice}", replace(state, variants={**state.variants, place.key: shown})
        )

    def _push(self, label: str, state: State, gesture: str = "") -> bool:
        before, revision, history, chosen = (
            (self._scene, self._shown()),
            self._revision,
            self._work.history.copy(),
            self.chosen,
        )
        self._work.history.push(label, state, gesture)
        try:
            return self._adopted(*before)
        except LookdevError:
            self._work.history, self._revision, self.chosen = history, revision, chosen
            raise

    def _adopted(self, scene: Scene, before: list[Look]) -> bool:
        """Keep the present state, and make the view where shaders change, or what parts wear."""
        choices = self.choices
        if not self._has(self.chosen):
            self.chosen = (choices["looks"][0], choices["rigs"][0])
        shown = self._shown()
        compiles = self._scene is not scene or [shape_of(look) for look in before] != [shape_of(look) for look in shown]
        if compiles:
            self.view()
        self._revision += 1
        self._work.keep(self.chosen)
        return compiles

    def unsaved(self, number: int) -> bool:
        """Return whether the file of a look lacks edits."""
        place = self.place(number)
        return place is not None and self._work.unsaved(place.file)

    def save(self, number: int | None = None, name: str | None = None, *, over: bool = False) -> list[Path]:
        """Write the edited files, or that of a look; with a name a new one beside that, or beside the job.

        Returns what was written.

        Raises
        ------
        ConflictError
            A file was changed on disk since it was read, and is not written `over`.
        LookdevError
            The look is of no file, or the new file exists, or has no fitting name.
        """
        with self._lock:
            if name is not None:
                file = self._dressing.file if number is None else self._editable(number).file
                return [self._work.save_as(file, name)]
            saved = self._work.save(None if number is None else self._editable(number).file, over=over)
            self._revision += 1
            self._work.keep(self.chosen)
            return saved

    def reload(self) -> bool:
        """Take what others have written to files, in place of what is shown; a step that can be undone."""
        with self._lock:
            contents, state = self._work.on_disk(), self._work.state
            compiles = self._push("load from disk", replace(state, files={**state.files, **contents}))
            self._work.accept(contents)
            self._work.keep(self.chosen)
            return compiles

    def ignore(self) -> None:
        """Keep what is edited where files have changed on disk: it is unsaved, and saving writes over them."""
        with self._lock:
            self._work.ignore()
            self._revision += 1
            self._work.keep(self.chosen)

    def recover(self, *, take: bool) -> bool:
        """Take the unsaved work of a Designer that has ended, or discard it; return whether shaders change."""
        with self._lock:
            compiles, work = False, self._work.offered
            if take and work is not None:
                state, before = self._work.recovered(), self.chosen
                self.chosen = work.shown if self._has(work.shown) else before
                compiles = self._push("restore unsaved work", state) or before != self.chosen
            self._work.forget()
            self._revision += 1
            return compiles

    def _has(self, shown: tuple[str, str]) -> bool:
        choices = self.choices
        return shown[0] in choices["looks"] and shown[1] in [*choices["rigs"], *choices["shipped"]]

    def keep_snapshot(self, picture: bytes) -> None:
        """Keep a picture of what is shown, and the state of the looks."""
        with self._lock:
            self.snapshots.keep(picture, self._work.state, self.chosen)

    def show_snapshot(self, number: int) -> bool:
        """Go back to the looks of a snapshot, a step that can be undone; return whether the scene changes."""
        with self._lock:
            found = self.snapshots[number]
            before, self.chosen = self.chosen, found.chosen
            try:
                return self._push(f"go back to {found.name}", found.state) or before != found.chosen
            except LookdevError:
                self.chosen = before
                raise

    def images(self, number: int) -> list[str]:
        """Return images below a look's folder, relative to it, that masks may read."""
        return images_below(self._editable(number).file.parent)

    def stacks(self) -> list[dict[str, Any]]:
        """Return the layers of each look with their parameters, for the page."""
        with self._lock:
            return [self._stack(number) for number in range(len(self._originals))]

    def _stack(self, number: int) -> dict[str, Any]:
        place, opened = self._place(number), self._opened(number)
        editable = isinstance(place, Place)
        solo = self._solo[1] if self._solo is not None and self._solo_place(number) is not None else None
        folder = place.file.parent if isinstance(place, Place) else None
        return {
            "name": self._originals[number].name,
            "file": str(place.file) if isinstance(place, Place) else "",
            "locked": "" if editable else place,
            "unsaved": self.unsaved(number),
            "solo": solo,
            "variants": [
                {"set": name, "choices": choices, "chosen": chosen, "by_job": editable and name in place.variants}  # type: ignore[union-attr]
                for name, (choices, chosen) in opened.outline.variants.items()
            ],
            "layers": [*layer_rows(opened.look, opened.outline if editable else None, folder, solo)],
        }

    def status(self) -> dict[str, Any]:
        """Return what the page shows beside the picture: stacks, history, files, unsaved work that was found."""
        with self._lock:
            return {
                "revision": self._revision,
                "stacks": self.stacks(),
                "job": {
                    **self._dressing.worn(self._read, self.chosen),
                    "unsaved": self._work.unsaved(self._dressing.file),
                    "new": not self._work.sources.known(self._dressing.file),
                },
                "undoes": self._work.history.undoes,
                "redoes": self._work.history.redoes,
                "changed": [str(file) for file in self._work.sources.changed()],
                "snapshots": self.snapshots.listed(),
                "recovery": self._work.offer(),
            }

    def close(self) -> bool:
        """End; return whether there is unsaved work, which stays for the next time."""
        return self._work.close()

    def signs(self) -> dict[str, Any]:
        """Return by what a page sees that it must ask for the status."""
        with self._lock:
            return {"revision": self._revision, "changed": [str(file) for file in self._work.sources.changed()]}
