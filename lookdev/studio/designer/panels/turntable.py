"""Requests of the panel that renders the job's turntables of the visible scene, and shows their pictures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response

from lookdev.studio.designer.routes import NO_STORE, Query, Routes, json_route, raw_route
from lookdev.studio.designer.session import Session
from lookdev.studio.designer.turntable import TurntableRuns


class TurntableRoutes(Routes):
    """Requests that start, cancel or describe a run of turntables of the visible scene, or get a picture of the run."""

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._turntable = TurntableRuns(lambda: session.document.job)

    @json_route("/turntable", "GET", "POST")
    def render_turntable(self, query: Query) -> Mapping[str, Any]:
        """Start or cancel a run, if ``do`` asks for it, and return the progress of the newest run."""
        if query.body.get("do") == "render":
            self._turntable.start(self.session.scene_with_lights, *self.document.scene_key)
        elif query.body.get("do") == "cancel":
            self._turntable.cancel()
        return self._turntable.describe()

    @raw_route("/turntable/{run:int}/{number:int}.png")
    async def send_turntable_picture(self, request: Request) -> Response:
        """Return the picture of a frame of a run, by the numbers of both."""
        file = self._turntable.picture(request.path_params["run"], request.path_params["number"])
        return PlainTextResponse("no such frame\n", 404) if file is None else FileResponse(file, headers=NO_STORE)

    def close(self) -> None:
        self._turntable.close()
