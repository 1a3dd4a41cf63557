"""The Designer's routes: its page and scripts, the shown scene and its buffers, edits, and saving."""

from __future__ import annotations

import json
import logging
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from threading import Thread
from typing import Any, TypeVar

import anyio.to_thread
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.websockets import WebSocket

from lookdev.errors import FaultsError, LookdevError, shortened
from lookdev.material.library import library_folders, read_library
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


@dataclass(frozen=True)
class Query:
    """A request of the page: its body, {} where it is no JSON object, and the parameters of its address."""

    body: Mapping[str, Any]
    parameters: Mapping[str, str]
    posted: bool

    def number(self, name: str) -> int:
        """Return a number of the body; raises LookdevError where it is none."""
        value = self.body.get(name)
        if not isinstance(value, int) or isinstance(value, bool):
            raise LookdevError(f"'{name}' is a number")
        return value


Method = TypeVar("Method", bound=Callable[..., Any])


def answers(path: str, *methods: str) -> Callable[[Method], Method]:
    """Register a method that answers requests with JSON, in a thread: from a `Query` to a mapping."""
    return _registered(path, methods, "answers")


def responds(path: str, *methods: str) -> Callable[[Method], Method]:
    """Register a method that responds to a request itself."""
    return _registered(path, methods, "responds")


def _registered(path: str, methods: tuple[str, ...], kind: str) -> Callable[[Method], Method]:
    def register(method: Method) -> Method:
        method.endpoint = (path, methods or ("GET",), kind)  # type: ignore[attr-defined]
        return method

    return register


class DesignerApp:
    """The requests of the page of a document."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._exact, self._lights = Exact(), Lights()
        self._turntable = Turntable(lambda: document.job)
        self._buffers: list[Mapping[str, bytes]] = []
        self._library = cache(lambda: read_library(library_folders()))
        self._drawing = anyio.CapacityLimiter(1)

    def application(self) -> Starlette:
        """Return the server of the page: each registered method, its scripts, and the channel of exact pictures."""
        routes = []
        for name, member in vars(type(self)).items():
            if (endpoint := getattr(member, "endpoint", None)) is not None:
                path, methods, kind = endpoint
                method = getattr(self, name)
                respond = method if kind == "responds" else partial(_respond, method)
                routes.append(Route(path, respond, methods=list(methods)))
        return Starlette(
            lifespan=self._lifespan,
            routes=[
                *routes,
                WebSocketRoute("/exact", self._pictures),
                Mount("/viewport", Scripts(directory=VIEWPORT)),
                Mount("/", Scripts(directory=STATIC, html=True)),
            ],
        )

    @asynccontextmanager
    async def _lifespan(self, app: Starlette) -> AsyncIterator[None]:
        # The view is made while the browser starts; a request reports its faults.
        Thread(target=_try, args=(self._document.view,), daemon=True).start()
        try:
            yield
        finally:
            await anyio.to_thread.run_sync(self._turntable.close)
            await anyio.to_thread.run_sync(self._exact.close)

    async def _pictures(self, socket: WebSocket) -> None:
        await Pictures(socket, self._lit_scene, self._exact).run()

    def _lit_scene(self) -> Scene:
        """Return the shown scene, with the lights as the page has set them."""
        return self._lights.applied(self._document.chosen[1], self._document.scene)

    def _changed(self, compiles: bool = False) -> Mapping[str, Any]:
        """Return the answer to a change of the document; `compiles`: the viewport needs other programs."""
        return {"compiles": compiles, **self._document.status()}

    # The scene

    @answers("/scene")
    def show_scene(self, query: Query) -> Mapping[str, Any]:
        document = self._document
        view = document.view()
        # Those of the last two scenes: one may be fetched while the next is made.
        self._buffers[:] = [*self._buffers[-1:], view.buffers]
        look, rig = document.chosen
        background = document.job.render.background
        return {
            **view.data,
            "choices": document.choices,
            "chosen": {"look": look, "rig": rig},
            "background": background if isinstance(background, str) else list(background),
            **document.status(),
        }

    @responds("/buffers/{name}")
    async def send_buffer(self, request: Request) -> Response:
        name = request.path_params["name"]
        for buffers in reversed(self._buffers):
            if name in buffers:
                headers = {"cache-control": "private, max-age=31536000, immutable"}
                return Response(buffers[name], media_type="application/octet-stream", headers=headers)
        return PlainTextResponse("no such buffer\n", 404)

    @answers("/choose", "POST")
    def choose(self, query: Query) -> Mapping[str, Any]:
        self._document.choose(str(query.body.get("look")), str(query.body.get("rig")))
        return {}

    @answers("/status")
    def report_status(self, query: Query) -> Mapping[str, Any]:
        return self._document.status() if "whole" in query.parameters else self._document.signs()

    # Edits

    @answers("/edit", "POST")
    def edit(self, query: Query) -> Mapping[str, Any]:
        return self._changed(self._document.edit(parsed(query.body)))

    @answers("/stack", "POST")
    def edit_stack(self, query: Query) -> Mapping[str, Any]:
        document, body, look = self._document, query.body, query.number("look")
        match body.get("op"):
            case "copy":
                return {"text": document.copy(look, query.number("layer"))}
            case "preset":
                name, category = str(body.get("name")), str(body.get("category"))
                file = document.save_preset(look, query.number("layer"), name, category)
                self._library.cache_clear()
                return {"file": str(file)}
            case "solo":
                document.solo(look, None if body.get("layer") is None else query.number("layer"))
                return self._changed(True)
        return self._changed(document.arrange(look, body))

    @answers("/wear", "POST")
    def assign_look(self, query: Query) -> Mapping[str, Any]:
        return self._changed(self._document.wear(query.body))

    @answers("/wearables")
    def list_materials(self, query: Query) -> Mapping[str, Any]:
        return self._document.wearables()

    @answers("/history", "POST")
    def step_history(self, query: Query) -> Mapping[str, Any]:
        redo = query.body.get("redo")
        if not isinstance(redo, bool):
            raise LookdevError("a step of the history has 'redo', true or false")
        return self._changed(self._document.undo(1 if redo else -1))

    # Files

    @answers("/save", "POST")
    def save(self, query: Query) -> Mapping[str, Any]:
        look, name, over = (query.body.get(key) for key in ("look", "name", "over"))
        wrong = not isinstance(look, int | None) or not isinstance(name, str | None)
        if wrong or (name is None and not isinstance(over, bool)):
            raise LookdevError("what is saved has a look's number and a file's name, or 'over', true or false")
        files = self._document.save(look, name, over=over is True)
        return {**self._changed(), "files": list(map(str, files))}

    @answers("/disk", "POST")
    def settle_change_on_disk(self, query: Query) -> Mapping[str, Any]:
        document = self._document
        match query.body.get("do"):
            case "load":
                return self._changed(document.reload())
            case "keep":
                document.ignore()
            case "restore":
                return self._changed(document.recover(take=True))
            case "discard":
                document.recover(take=False)
            case _:
                raise LookdevError("what is done about a file on disk is load, keep, restore or discard")
        return self._changed()

    @answers("/images")
    def list_images(self, query: Query) -> Mapping[str, Any]:
        look = query.parameters.get("look", "")
        return {"images": self._document.images(int(look) if look.isdecimal() else -1)}

    # Snapshots

    @responds(PICTURE, "POST")
    async def keep_snapshot(self, request: Request) -> Response:
        content = bytearray()
        async for chunk in request.stream():
            content += chunk
            if len(content) > LARGEST:
                break  # refused as too large

        def keep() -> Mapping[str, Any]:
            self._document.keep_snapshot(bytes(content))
            return self._changed()

        return await _answer(keep)

    @answers("/snapshots", "POST")
    def use_snapshot(self, query: Query) -> Mapping[str, Any]:
        match query.body.get("do"):
            case "show":
                return self._changed(self._document.show_snapshot(query.number("number")))
            case "drop":
                self._document.snapshots.drop(query.number("number"))
            case _:
                raise LookdevError("a snapshot is shown or dropped")
        return self._changed()

    @responds("/snapshots/{number:int}")
    async def send_snapshot(self, request: Request) -> Response:
        try:
            snapshot = self._document.snapshots[int(request.path_params["number"])]
        except LookdevError as error:
            return PlainTextResponse(f"{error}\n", 404)
        return Response(snapshot.picture, media_type="image/png", headers=_FRESH)

    # Presets

    @answers("/presets")
    def list_presets(self, query: Query) -> Mapping[str, Any]:
        library = self._library()
        rows = [
            {"name": preset.name, "category": preset.category, "model": preset.model, "doc": preset.doc}
            for preset in library.presets
        ]
        return {"presets": rows, "faults": [str(fault) for fault in library.faults]}

    @responds("/presets/{name}")
    async def send_thumbnail(self, request: Request) -> Response:
        name = request.path_params["name"]

        def draw() -> bytes | None:
            # Plots take as long to import as the rest of the page.
            from lookdev.studio.designer.thumbnails import thumbnail

            preset = next((preset for preset in self._library().presets if preset.name == name), None)
            return thumbnail(preset).read_bytes() if preset else None

        try:
            picture = await anyio.to_thread.run_sync(draw, limiter=self._drawing)
        except LookdevError as error:
            return PlainTextResponse(f"{error}\n", 404)
        if picture is None:
            return PlainTextResponse("no such preset\n", 404)
        return Response(picture, media_type="image/png", headers={"cache-control": "private, max-age=600"})

    # Lights and turntables

    @answers("/lights", "GET", "POST")
    def set_light(self, query: Query) -> Mapping[str, Any]:
        scene, rig = self._document.scene, self._document.chosen[1]
        if query.body.get("reset") is True:
            self._lights.reset(rig)
        elif query.posted:
            self._lights.set(rig, scene, *setting_of(query.body))
        return self._lights.described(rig, scene)

    @answers("/turntable", "GET", "POST")
    def render_turntable(self, query: Query) -> Mapping[str, Any]:
        if query.body.get("do") == "render":
            self._turntable.start(self._lit_scene, *self._document.chosen)
        elif query.body.get("do") == "cancel":
            self._turntable.cancel()
        return self._turntable.described()

    @responds("/turntable/{run:int}/{number:int}.png")
    async def send_turntable_picture(self, request: Request) -> Response:
        file = self._turntable.picture(request.path_params["run"], request.path_params["number"])
        return PlainTextResponse("no such frame\n", 404) if file is None else FileResponse(file, headers=_FRESH)


async def _respond(answer: Callable[[Query], Mapping[str, Any]], request: Request) -> Response:
    query = Query(await _body(request), request.query_params, request.method == "POST")
    return await _answer(lambda: answer(query))


def _try(make: Callable[[], Any]) -> None:
    with suppress(LookdevError, OSError):
        make()


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
