"""Requests of the panel of layers, which edits the stack of a look and the parameters of its layers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lookdev.studio.designer.edits import parse_edit
from lookdev.studio.designer.routes import Query, Routes, json_route


class LayerRoutes(Routes):
    """Requests that edit constants or the stack of layers, or list the images that masks may read."""

    @json_route("/edit", "POST")
    def edit(self, query: Query) -> Mapping[str, Any]:
        """Change a constant of a layer."""
        return self.session.answer_to_change(self.document.edit(parse_edit(query.body)))

    @json_route("/stack", "POST")
    def edit_stack(self, query: Query) -> Mapping[str, Any]:
        """Do the operation ``op`` on the stack of the look with number ``look``."""
        document, body, look = self.document, query.body, query.number("look")
        match body.get("op"):
            case "copy":
                return {"text": document.copy(look, query.number("layer"))}
            case "preset":
                name, category = str(body.get("name")), str(body.get("category"))
                file = document.save_preset(look, query.number("layer"), name, category)
                self.session.forget_library()
                return {"file": str(file)}
            case "solo":
                document.solo(look, None if body.get("layer") is None else query.number("layer"))
                return self.session.answer_to_change(True)
        return self.session.answer_to_change(document.edit_stack(look, body))

    @json_route("/images")
    def list_images(self, query: Query) -> Mapping[str, Any]:
        """Return the images below the folder of the look with number ``look``."""
        look = query.parameters.get("look", "")
        return {"images": self.document.images(int(look) if look.isdecimal() else -1)}
