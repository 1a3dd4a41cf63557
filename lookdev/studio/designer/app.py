"""The ASGI application of the Designer's page: the routes of its panels, its scene and buffers, and its scripts."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from threading import Thread
from typing import Any

import anyio.to_thread
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Mount

from lookdev.errors import LookdevError
from lookdev.studio.designer.document import Document
from lookdev.studio.designer.panels import PANELS
from lookdev.studio.designer.routes import Query, Routes, json_route, raw_route
from lookdev.studio.designer.session import Session
from lookdev.studio.scripts import Scripts

STATIC = Path(__file__).parent / "static"
VIEWPORT = Path(__file__).parents[1] / "viewport" / "static"

UPLOAD_PATHS = tuple(path for panel in PANELS if panel.routes for path in panel.routes.upload_paths)
"""The paths of requests that may have bodies larger than `MAX_BODY_BYTES`."""


class SceneRoutes(Routes):
    """Requests for the visible scene, its buffers and its status, and for the script that imports all panels."""

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._buffers: list[Mapping[str, bytes]] = []

    @json_route("/scene")
    def show_scene(self, query: Query) -> Mapping[str, Any]:
        """Return the visible scene, the choices of other scenes, and the status of the document."""
        document = self.document
        view = document.view()
        # Keep the buffers of the last two scenes: the page may fetch buffers of one while the next is computed.
        self._buffers[:] = [*self._buffers[-1:], view.buffers]
        look, rig = document.scene_key
        background = document.job.render.background
        return {
            **view.data,
            "choices": document.choices,
            "chosen": {"look": look, "rig": rig},
            "background": background if isinstance(background, str) else list(background),
            **document.status(),
        }

    @raw_route("/buffers/{name}")
    async def send_buffer(self, request: Request) -> Response:
        """Return the bytes of a buffer that the scene names."""
        name = request.path_params["name"]
        for buffers in reversed(self._buffers):
            if name in buffers:
                headers = {"cache-control": "private, max-age=31536000, immutable"}
                return Response(buffers[name], media_type="application/octet-stream", headers=headers)
        return PlainTextResponse("no such buffer\n", 404)

    @json_route("/choose", "POST")
    def choose(self, query: Query) -> Mapping[str, Any]:
        """Make another scene visible, by the names of its look and its rig."""
        self.document.choose(str(query.body.get("look")), str(query.body.get("rig")))
        return {}

    @json_route("/status")
    def report_status(self, query: Query) -> Mapping[str, Any]:
        """Return the whole status of the document, or without the parameter ``whole`` only its revision."""
        return self.document.status() if "whole" in query.parameters else self.document.revision_status()

    @raw_route("/panels.js")
    async def send_panels(self, request: Request) -> Response:
        """Return the script that imports all panels."""
        headers = {"cache-control": "no-cache"}
        return Response(panel_script(), media_type="text/javascript", headers=headers)


def panel_script() -> str:
    """Return the module of the page that imports the records of all panels, and exports them by name."""
    names = [panel.name for panel in PANELS]
    imports = [f'import {{ panel as {name} }} from "./{name}.js";\n' for name in names]
    return f"{''.join(imports)}export const panels = {{ {', '.join(names)} }};\n"


class DesignerApp:
    """The page of a document: its routes, and the ASGI application that `application` makes of them."""

    def __init__(self, document: Document) -> None:
        self._document = document
        session = Session(document)
        self._routes = [SceneRoutes(session), *(panel.routes(session) for panel in PANELS if panel.routes)]

    def application(self) -> Starlette:
        """Return the ASGI application: the routes of the scene and of all panels, and the scripts."""
        return Starlette(
            lifespan=self._lifespan,
            routes=[
                *(route for routes in self._routes for route in routes.list_routes()),
                Mount("/viewport", Scripts(directory=VIEWPORT)),
                Mount("/", Scripts(directory=STATIC, html=True)),
            ],
        )

    @asynccontextmanager
    async def _lifespan(self, app: Starlette) -> AsyncIterator[None]:
        # Compute the view while the browser starts; the first request reports its faults.
        Thread(target=_ignore_errors, args=(self._document.view,), daemon=True).start()
        try:
            yield
        finally:
            for routes in reversed(self._routes):
                await anyio.to_thread.run_sync(routes.close)


def _ignore_errors(compute: Callable[[], Any]) -> None:
    """Call a function for its effect on caches; its errors will be raised again, where they are reported."""
    with suppress(LookdevError, OSError):
        compute()
