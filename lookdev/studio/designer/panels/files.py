"""Requests of the panel of files: saving, files that changed on disk, and unsaved work of an earlier Designer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lookdev.errors import LookdevError
from lookdev.studio.designer.routes import Query, Routes, json_route


class FileRoutes(Routes):
    """Requests that save files, and that settle a change on disk or the unsaved work of an earlier Designer."""

    @json_route("/save", "POST")
    def save(self, query: Query) -> Mapping[str, Any]:
        """Write all edited files, the file of a ``look``, or a new file ``name``.

        ``over`` is whether changes on disk are overwritten.
        """
        look, name, over = (query.body.get(key) for key in ("look", "name", "over"))
        is_wrong = not isinstance(look, int | None) or not isinstance(name, str | None)
        if is_wrong or (name is None and not isinstance(over, bool)):
            raise LookdevError("a request to save has a look's number and a file's name, or 'over', true or false")
        files = self.document.save(look, name, overwrite=over is True)
        return {**self.session.answer_to_change(), "files": list(map(str, files))}

    @json_route("/disk", "POST")
    def settle_change_on_disk(self, query: Query) -> Mapping[str, Any]:
        """Load files that have changed on disk, or keep their edits; restore or discard unsaved work."""
        match query.body.get("do"):
            case "load":
                return self.session.answer_to_change(self.document.reload())
            case "keep":
                self.document.keep_edits()
            case "restore":
                return self.session.answer_to_change(self.document.recover(restore=True))
            case "discard":
                self.document.recover(restore=False)
            case _:
                raise LookdevError("an action on a changed file is load, keep, restore or discard")
        return self.session.answer_to_change()
