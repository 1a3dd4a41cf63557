"""Requests of the dialogs that choose a preset: the presets of the library, and their thumbnails."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import anyio.to_thread
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

from lookdev.errors import LookdevError
from lookdev.studio.designer.routes import Query, Routes, json_route, raw_route
from lookdev.studio.designer.session import Session


class PresetRoutes(Routes):
    """Requests for the list of presets and for their thumbnails, which are drawn one at a time."""

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._draw_limiter = anyio.CapacityLimiter(1)

    @json_route("/presets")
    def list_presets(self, query: Query) -> Mapping[str, Any]:
        """Return a record of each preset, and the faults of files in the library."""
        library = self.session.library()
        rows = [
            {"name": preset.name, "category": preset.category, "model": preset.model, "doc": preset.doc}
            for preset in library.presets
        ]
        return {"presets": rows, "faults": [str(fault) for fault in library.faults]}

    @raw_route("/presets/{name}")
    async def send_thumbnail(self, request: Request) -> Response:
        """Return the thumbnail of a preset, by its name."""
        name = request.path_params["name"]

        def draw() -> bytes | None:
            # Not at the top: plots take as long to import as the rest of the page.
            from lookdev.studio.designer.thumbnails import thumbnail

            preset = next((preset for preset in self.session.library().presets if preset.name == name), None)
            return thumbnail(preset).read_bytes() if preset else None

        try:
            picture = await anyio.to_thread.run_sync(draw, limiter=self._draw_limiter)
        except LookdevError as error:
            return PlainTextResponse(f"{error}\n", 404)
        if picture is None:
            return PlainTextResponse("no such preset\n", 404)
        return Response(picture, media_type="image/png", headers={"cache-control": "private, max-age=600"})
