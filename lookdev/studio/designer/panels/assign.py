"""Requests of the panel that shows the look assigned to the picked part of the asset."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lookdev.studio.designer.routes import Query, Routes, json_route


class AssignRoutes(Routes):
    """The assignment of looks to parts, and the list of materials that can be assigned."""

    @json_route("/assign", "POST")
    def assign_look(self, query: Query) -> Mapping[str, Any]:
        """Assign a look to parts, or unassign it."""
        return self.session.answer_to_change(self.document.assign_look(query.body))

    @json_route("/materials")
    def list_materials(self, query: Query) -> Mapping[str, Any]:
        """Return the materials that can be assigned."""
        return self.document.list_materials()
