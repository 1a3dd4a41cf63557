"""The Designer's routes: its page and scripts, the shown scene and its buffers, edits, and saving."""

from __future__ import annotations

import json
import logging
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import anyio.to_thread
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.websockets import WebSocket

from lookdev.errors import FaultsError, LookdevError, shortened
from lookdev.scene import Scene
from lookdev.studio.designer.document import Document, parsed
from lookdev.studio.designer.exact import Exact
from lookdev.studio.designer.lights import Lights, setting_of
from lookdev.studio.designer.pictures import Pictures
from lookdev.studio.designer.turntable import Turntable
from lookdev.studio.scripts import Scripts

log = logging.getLogger("lookdev.studio")

STATIC = Path(__file__).parent / "static"
VIEWPORT = Path(__file__).parents[1] / "viewport" / "static"

_FRESH = {"cache-control": "no-store"}


def application(document: Document) -> Starlette:
    """Return the page of a document."""
    kept: list[
        Mapping[str, bytes]
    ] = []  # the buffers of the last two scenes: one may be fetched while the next is made

    exact, lights, turntable = Exact(), Lights(), Turntable(document.job)

    def lit() -> Scene:
        return lights.applied(document.chosen[1], document.scene)

    def scene() -> Mapping[str, Any]:
        view = document.view()
        kept[:] = [*kept[-1:], view.buffers]
        look, rig = document.chosen
        background = document.job.render.background
        return {
            **view.data,
            "choices": document.choices,
            "chosen": {"look": look, "rig": rig},
            "background": background if isinstance(background, str) else list(background),
            "stacks": document.stacks(),
        }

    async def show(request: Request) -> Response:
        return await _answer(scene)

    async def buffer(request: Request) -> Response:
        name = request.path_params["name"]
        for buffers in reversed(kept):
            if name in buffers:
                headers = {"cache-control": "private, max-age=31536000, immutable"}
                return Response(buffers[name], media_type="application/octet-stream", headers=headers)
        return PlainTextResponse("no such buffer\n", 404)

    async def edit(request: Request) -> Response:
        body = await _body(request)
        return await _answer(lambda: {"compiles": document.edit(parsed(body)), "stacks": document.stacks()})

    async def choose(request: Request) -> Response:
        body = await _body(request)

        def chosen() -> Mapping[str, Any]:
            document.choose(str(body.get("look")), str(body.get("rig")))
            return {}

        return await _answer(chosen)

    async def light(request: Request) -> Response:
        body = await _body(request)

        def changed() -> Mapping[str, Any]:
            scene, rig = document.scene, document.chosen[1]
            if body.get("reset") is True:
                lights.reset(rig)
            elif request.method == "POST":
                lights.set(rig, scene, *setting_of(body))
            return lights.described(rig, scene)

        return await _answer(changed)

    async def turn(request: Request) -> Response:
        body = await _body(request)

        def changed() -> Mapping[str, Any]:
            if body.get("do") == "render":
                turntable.start(lit, *document.chosen)
            elif body.get("do") == "cancel":
                turntable.cancel()
            return turntable.described()

        return await _answer(changed)

    async def turned(request: Request) -> Response:
        file = turntable.picture(request.path_params["run"], request.path_params["number"])
        return PlainTextResponse("no such frame\n", 404) if file is None else FileResponse(file, headers=_FRESH)

    async def save(request: Request) -> Response:
        body = await _body(request)
        look, name = body.get("look"), body.get("name")

        def saved() -> Mapping[str, Any]:
            if not isinstance(look, int) or not isinstance(name, str | None):
                raise LookdevError("what is saved has the number of a look, and the name of a file or none")
            return {"file": str(document.save(look, name)), "stacks": document.stacks()}

        return await _answer(saved)

    async def pictures(socket: WebSocket) -> None:
        await Pictures(socket, lit, exact).run()

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        try:
            yield
        finally:
            await anyio.to_thread.run_sync(turntable.close)
            await anyio.to_thread.run_sync(exact.close)

    return Starlette(
        lifespan=lifespan,
        routes=[
            Route("/scene", show),
            Route("/buffers/{name}", buffer),
            Route("/edit", edit, methods=["POST"]),
            Route("/choose", choose, methods=["POST"]),
            Route("/save", save, methods=["POST"]),
            Route("/lights", light, methods=["GET", "POST"]),
            Route("/turntable", turn, methods=["GET", "POST"]),
            Route("/turntable/{run:int}/{number:int}.png", turned),
            WebSocketRoute("/exact", pictures),
            Mount("/viewport", Scripts(directory=VIEWPORT)),
            Mount("/", Scripts(directory=STATIC, html=True)),
        ],
    )


async def _body(request: Request) -> Mapping[str, Any]:
    try:
        found = await request.json()
    except (json.JSONDecodeError, UnicodeDecodeError):
        return {}
    return found if isinstance(found, dict) else {}


async def _answer(made: Callable[[], Mapping[str, Any]]) -> Response:
    """Return what a function makes in a thread of its own, or what a user must know of its failure."""
    try:
        return JSONResponse(await anyio.to_thread.run_sync(made), headers=_FRESH)
    except FaultsError as error:
        message = "; ".join(str(fault) for fault in error.faults)
    except LookdevError as error:
        message = str(error)
    log.warning("refused: %s", shortened(message, 200))
    return JSONResponse({"error": message}, 422, headers=_FRESH)
