"""The routes of the Explorer: its page and scripts, its catalogue, its websocket, uploads, and plots as files."""

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
from lookdev.plotting import SUFFIXES, draw
from lookdev.studio.explorer.catalogue import catalogue
from lookdev.studio.explorer.channel import Channel, parse_options
from lookdev.studio.explorer.frames import Frames
from lookdev.studio.explorer.surfaces import Surfaces
from lookdev.studio.scripts import Scripts
from lookdev.studio.websocket import log

UPLOAD = "/upload"
STATIC = Path(__file__).parent / "static"
VIEWPORT = Path(__file__).parents[1] / "viewport" / "static"

_TYPES = {".png": "image/png", ".svg": "image/svg+xml", ".pdf": "application/pdf", ".csv": "text/csv; charset=utf-8"}


def application(surfaces: Surfaces, first: Sequence[str]) -> Starlette:
    """Return the application of the Explorer; a page whose URL has no state shows the surfaces `first`."""
    frames = Frames()
    threads = ThreadPoolExecutor(4, thread_name_prefix="plot")
    rendering = ThreadPoolExecutor(8, thread_name_prefix="frame")
    figures = ThreadPoolExecutor(1, thread_name_prefix="figure")  # matplotlib is not thread-safe
    start_data = json.dumps({**catalogue(surfaces.roots, surfaces.library), "first": list(first)})

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        try:
            yield
        finally:
            frames.close()
            for pool in (threads, rendering, figures):
                pool.shutdown(wait=False, cancel_futures=True)

    async def start(request: Request) -> Response:
        return Response(start_data, media_type="application/json", headers={"cache-control": "no-store"})

    async def open_channel(socket: WebSocket) -> None:
        await Channel(socket, surfaces, frames, threads, rendering).run()

    async def upload(request: Request) -> Response:
        name = request.query_params.get("name", "upload")
        try:
            stored_name = await surfaces.roots.upload(name, request.stream())
        except LookdevError as error:
            log.warning("refused the upload %s: %s", shorten(name, 80), shorten(str(error), 160))
            return JSONResponse({"error": f"{shorten(name, 80)}: {error}"}, 422)
        except ClientDisconnect:
            return PlainTextResponse("", 400)
        return JSONResponse({"name": stored_name})

    def write_plot(kind: str, suffix: str, words: Sequence[str], options: str) -> bytes:
        plot = draw(kind, [surfaces.subject(subject) for subject in words], parse_options(json.loads(options)))
        with tempfile.TemporaryDirectory(prefix="lookdev-plot-") as folder:
            file = Path(folder) / f"plot{suffix}"
            plot.write(file)
            return file.read_bytes()

    async def save(request: Request) -> Response:
        kind, suffix = request.path_params["kind"], f".{request.path_params['suffix']}"
        if suffix not in SUFFIXES:
            return PlainTextResponse(f"one of {', '.join(SUFFIXES)} would be right\n", 404)
        words, options = request.query_params.getlist("s"), request.query_params.get("options", "{}")

        def draw_in_turn() -> bytes:
            return figures.submit(write_plot, kind, suffix, words, options).result()

        try:
            data = await anyio.to_thread.run_sync(draw_in_turn)
        except (LookdevError, ValueError, TypeError) as error:
            return PlainTextResponse(f"{error}\n", 422)
        headers = {"content-disposition": f'attachment; filename="{kind}{suffix}"', "cache-control": "no-store"}
        return Response(data, media_type=_TYPES[suffix], headers=headers)

    return Starlette(
        routes=[
            Route("/start", start),
            WebSocketRoute("/talk", open_channel),
            Route(UPLOAD, upload, methods=["POST"]),
            Route("/save/{kind}.{suffix}", save),
            Mount("/viewport", Scripts(directory=VIEWPORT)),
            Mount("/", Scripts(directory=STATIC, html=True)),
        ],
        lifespan=lifespan,
    )
