"""The ASGI application of the Explorer's page: scripts, catalogue, websocket, uploads, and plots as files."""

from __future__ import annotations

import json
import tempfile
from collections.abc import AsyncIterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from pathlib import Path

import anyio.to_thread
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.websockets import WebSocket

from lookdev.errors import LookdevError, shorten
from lookdev.plotting import PLOT_SUFFIXES, draw
from lookdev.studio.explorer.catalogue import catalogue
from lookdev.studio.explorer.channel import ExplorerConnection, parse_options
from lookdev.studio.explorer.frames import ExactFrames
from lookdev.studio.explorer.surfaces import Surfaces
from lookdev.studio.scripts import Scripts
from lookdev.studio.websocket import log

UPLOAD = "/upload"
STATIC = Path(__file__).parent / "static"
VIEWPORT = Path(__file__).parents[1] / "viewport" / "static"

# The media types of plots, by the suffix of the file.
_TYPES = {".png": "image/png", ".svg": "image/svg+xml", ".pdf": "application/pdf", ".csv": "text/csv; charset=utf-8"}


class ExplorerApp:
    """The Explorer's application, with its threads.

    `first` has the texts of the surfaces that a page shows if its URL has no state. The websocket of each page computes
    plots in `_threads`, and renders exact frames in `_rendering`.
    """

    def __init__(self, surfaces: Surfaces, first: Sequence[str]) -> None:
        self._surfaces = surfaces
        self._frames = ExactFrames()
        self._threads = ThreadPoolExecutor(4, thread_name_prefix="plot")
        self._rendering = ThreadPoolExecutor(8, thread_name_prefix="frame")  # all but one wait for their turn
        self._figures = ThreadPoolExecutor(1, thread_name_prefix="figure")  # matplotlib is not thread-safe
        self._start_data = json.dumps({**catalogue(surfaces.roots, surfaces.library), "first": list(first)})

    def application(self) -> Starlette:
        """Return the ASGI application."""
        return Starlette(
            routes=[
                Route("/start", self._send_start),
                WebSocketRoute("/talk", self._open_channel),
                Route(UPLOAD, self._store_upload, methods=["POST"]),
                Route("/save/{kind}.{suffix}", self._send_plot),
                Mount("/viewport", Scripts(directory=VIEWPORT)),
                Mount("/", Scripts(directory=STATIC, html=True)),
            ],
            lifespan=self._lifespan,
        )

    @asynccontextmanager
    async def _lifespan(self, app: Starlette) -> AsyncIterator[None]:
        try:
            yield
        finally:
            self._frames.close()
            for pool in (self._threads, self._rendering, self._figures):
                pool.shutdown(wait=False, cancel_futures=True)

    async def _send_start(self, request: Request) -> Response:
        """Return the catalogue, and the surfaces that a page without state shows."""
        return Response(self._start_data, media_type="application/json", headers={"cache-control": "no-store"})

    async def _open_channel(self, socket: WebSocket) -> None:
        """Serve the websocket of a page until the page is gone."""
        await ExplorerConnection(socket, self._surfaces, self._frames, self._threads, self._rendering).run()

    async def _store_upload(self, request: Request) -> Response:
        """Store the file in the body of a request, and return its name for the page."""
        name = request.query_params.get("name", "upload")
        try:
            stored_name = await self._surfaces.roots.upload(name, request.stream())
        except LookdevError as error:
            log.warning("refused the upload %s: %s", shorten(name, 80), shorten(str(error), 160))
            return JSONResponse({"error": f"{shorten(name, 80)}: {error}"}, 422)
        except ClientDisconnect:
            return PlainTextResponse("", 400)
        return JSONResponse({"name": stored_name})

    async def _send_plot(self, request: Request) -> Response:
        """Return a plot as a file to save; the URL has its kind, suffix, surfaces and options."""
        kind, suffix = request.path_params["kind"], f".{request.path_params['suffix']}"
        if suffix not in PLOT_SUFFIXES:
            return PlainTextResponse(f"one of {', '.join(PLOT_SUFFIXES)} would be right\n", 404)
        texts, options = request.query_params.getlist("s"), request.query_params.get("options", "{}")

        def draw_in_turn() -> bytes:
            return self._figures.submit(self._draw_plot, kind, suffix, texts, options).result()

        try:
            data = await anyio.to_thread.run_sync(draw_in_turn)
        except (LookdevError, ValueError, TypeError) as error:
            return PlainTextResponse(f"{error}\n", 422)
        headers = {"content-disposition": f'attachment; filename="{kind}{suffix}"', "cache-control": "no-store"}
        return Response(data, media_type=_TYPES[suffix], headers=headers)

    def _draw_plot(self, kind: str, suffix: str, texts: Sequence[str], options: str) -> bytes:
        """Return the bytes of a plot of the surfaces with `texts`, as a file with `suffix`; `options` are JSON."""
        plot = draw(kind, [self._surfaces.subject(surface) for surface in texts], parse_options(json.loads(options)))
        with tempfile.TemporaryDirectory(prefix="lookdev-plot-") as folder:
            file = Path(folder) / f"plot{suffix}"
            plot.write(file)
            return file.read_bytes()
