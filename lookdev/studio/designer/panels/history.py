"""Requests of the panel of undo and redo."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lookdev.errors import LookdevError
from lookdev.studio.designer.routes import Query, Routes, json_route


class HistoryRoutes(Routes):
    """Requests that undo or redo a step of the history."""

    @json_route("/history", "POST")
    def step_history(self, query: Query) -> Mapping[str, Any]:
        """Redo a step if ``redo`` is true, else undo one."""
        redo = query.body.get("redo")
        if not isinstance(redo, bool):
            raise LookdevError("a step of the history has 'redo', true or false")
        return self.session.answer_to_change(self.document.undo(1 if redo else -1))
