"""The Designer's routes: its page and scripts, the shown scene and its buffers, edits, and saving."""

from __future__ import annotations

import json
import logging
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from functools import cache
from pathlib import Path
from threading import Thread
from typing import Any

import anyio.to_thread
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.websockets import WebSocket

from lookdev.errors import FaultsError, LookdevError, shortened
from lookdev.material.library import Library, library_folders, read_library
from lookdev.scene import Scene
from lookdev.studio.designer.document import Document
from lookdev.studio.designer.edits import parsed
from lookdev.studio.designer.exact import Exact
from lookdev.studio.designer.lights import Lights, setting_of
from lookdev.studio.designer.pictures import Pictures
from lookdev.studio.designer.snapshots import LARGEST
from lookdev.studio.designer.sources import ConflictError
from lookdev.studio.designer.turntable import Turntable
from lookdev.studio.scripts import Scripts

log = logging.getLogger("lookdev.studio")

STATIC = Path(__file__).parent / "static"
VIEWPORT = Path(__file__).parents[1] / "viewport" / "static"

PICTURE = "/picture"
"""Where the picture of a snapshot is sent: a body that is larger than others."""

_FRESH = {"cache-control": "no-store"}


def application(document: Document) -> Starlette:
    """Return the page of a document."""
    kept: list[
        Mapping[str, bytes]
    ] = []  # the buffers of the last two scenes: one may be fetched while the next is made

    exact, lights, turntable = Exact(), Lights(), Turntable(lambda: document.job)

    def lit() -> Scene:
        return lights.applied(document.chosen[1], document.scene)

    drawing = anyio.CapacityLimiter(1)

    @cache
    def library() -> Library:
        return read_library(library_folders())

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
            **document.status(),
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

    def answered(compiles: bool = False) -> Mapping[str, Any]:
        return {"compiles": compiles, **document.status()}

    async def edit(request: Request) -> Response:
        body = await _body(request)
        return await _answer(lambda: answered(document.edit(parsed(body))))

    async def status(request: Request) -> Response:
        return await _answer(document.status if "whole" in request.query_params else document.signs)

    async def stack(request: Request) -> Response:
        body = await _body(request)

        def arranged() -> Mapping[str, Any]:
            look = _number(body, "look")
            match body.get("op"):
                case "copy":
                    return {"text": document.copy(look, _number(body, "layer"))}
                case "preset":
                    words = str(body.get("name")), str(body.get("category"))
                    saved = document.save_preset(look, _number(body, "layer"), *words)
                    library.cache_clear()
                    return {"file": str(saved)}
                case "solo":
                    document.solo(look, None if body.get("layer") is None else _number(body, "layer"))
                    return answered(True)
            return answered(document.arrange(look, body))

        return await _answer(arranged)

    async def wear(request: Request) -> Response:
        body = await _body(request)
        return await _answer(lambda: answered(document.wear(body)))

    async def wearables(request: Request) -> Response:
        return await _answer(document.wearables)

    async def history(request: Request) -> Response:
        body = await _body(request)

        def stepped() -> Mapping[str, Any]:
            if not isinstance(body.get("redo"), bool):
                raise LookdevError("a step of the history has 'redo', true or false")
            return answered(document.undo(1 if body["redo"] else -1))

        return await _answer(stepped)

    async def disk(request: Request) -> Response:
        body = await _body(request)

        def done() -> Mapping[str, Any]:
            match body.get("do"):
                case "load":
                    return answered(document.reload())
                case "keep":
                    document.ignore()
                case "restore":
                    return answered(document.recover(take=True))
                case "discard":
                    document.recover(take=False)
                case _:
                    raise LookdevError("what is done about a file on disk is load, keep, restore or discard")
            return answered()

        return await _answer(done)

    async def snapshots(request: Request) -> Response:
        body = await _body(request)

        def done() -> Mapping[str, Any]:
            match body.get("do"):
                case "show":
                    return answered(document.show_snapshot(_number(body, "number")))
                case "drop":
                    document.snapshots.drop(_number(body, "number"))
                case _:
                    raise LookdevError("a snapshot is shown or dropped")
            return answered()

        return await _answer(done)

    async def picture(request: Request) -> Response:
        content = bytearray()
        async for chunk in request.stream():
            content += chunk
            if len(content) > LARGEST:
                break  # refused as too large

        def kept() -> Mapping[str, Any]:
            document.keep_snapshot(bytes(content))
            return answered()

        return await _answer(kept)

    async def snapshot(request: Request) -> Response:
        try:
            found = document.snapshots[int(request.path_params["number"])]
        except LookdevError as error:
            return PlainTextResponse(f"{error}\n", 404)
        return Response(found.picture, media_type="image/png", headers=_FRESH)

    async def presets(request: Request) -> Response:
        def listed() -> Mapping[str, Any]:
            found = library()
            rows = [
                {"name": each.name, "category": each.category, "model": each.model, "doc": each.doc}
                for each in found.presets
            ]
            return {"presets": rows, "faults": [str(fault) for fault in found.faults]}

        return await _answer(listed)

    async def thumb(request: Request) -> Response:
        name = request.path_params["name"]

        def drawn() -> bytes | None:
            # Plots take as long to import as the rest of the page.
            from lookdev.studio.designer.thumbnails import thumbnail

            found = next((each for each in library().presets if each.name == name), None)
            return thumbnail(found).read_bytes() if found else None

        try:
            picture = await anyio.to_thread.run_sync(drawn, limiter=drawing)
        except LookdevError as error:
            return PlainTextResponse(f"{error}\n", 404)
        if picture is None:
            return PlainTextResponse("no such preset\n", 404)
        return Response(picture, media_type="image/png", headers={"cache-control": "private, max-age=600"})

    async def images(request: Request) -> Response:
        look = request.query_params.get("look", "")
        return await _answer(lambda: {"images": document.images(int(look) if look.isdecimal() else -1)})

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
            wrong = not isinstance(look, int | None) or not isinstance(name, str | None)
            if wrong or (name is None and not isinstance(body.get("over"), bool)):
                raise LookdevError("what is saved has a look's number and a file's name, or 'over', true or false")
            files = document.save(look, name, over=body.get("over") is True)
            return {**answered(), "files": list(map(str, files))}

        return await _answer(saved)

    async def pictures(socket: WebSocket) -> None:
        await Pictures(socket, lit, exact).run()

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        # Made while the browser starts; a request says what is wrong with it.
        Thread(target=_tried, args=(document.view,), daemon=True).start()
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
            Route("/stack", stack, methods=["POST"]),
            Route("/wear", wear, methods=["POST"]),
            Route("/wearables", wearables),
            Route("/history", history, methods=["POST"]),
            Route("/disk", disk, methods=["POST"]),
            Route("/status", status),
            Route(PICTURE, picture, methods=["POST"]),
            Route("/snapshots", snapshots, methods=["POST"]),
            Route("/snapshots/{number:int}", snapshot),
            Route("/presets", presets),
            Route("/presets/{name}", thumb),
            Route("/images", images),
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


def _tried(make: Callable[[], Any]) -> None:
    with suppress(LookdevError, OSError):
        make()


def _number(body: Mapping[str, Any], name: str) -> int:
    found = body.get(name)
    if not isinstance(found, int) or isinstance(found, bool):
        raise LookdevError(f"'{name}' is a number")
    return found


async def _body(request: Request) -> Mapping[str, Any]:
    try:
        found = await request.json()
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError, ClientDisconnect):
        return {}
    return found if isinstance(found, dict) else {}


async def _answer(made: Callable[[], Mapping[str, Any]]) -> Response:
    """Return what a function makes in a thread of its own, or what a user must know of its failure."""
    try:
        return JSONResponse(await anyio.to_thread.run_sync(made), headers=_FRESH)
    except FaultsError as error:
        message = "; ".join(str(fault) for fault in error.faults)
    except ConflictError as error:
        return JSONResponse({"error": str(error), "conflict": list(map(str, error.files))}, 409, headers=_FRESH)
    except LookdevError as error:
        message = str(error)
    except OSError as error:
        message = f"{error.filename or 'a file'}: {error.strerror or error}"
    log.warning("refused: %s", shortened(message, 200))
    return JSONResponse({"error": message}, 422, headers=_FRESH)
