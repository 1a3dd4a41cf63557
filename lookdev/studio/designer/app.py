"""The routes of the Designer: its page and scripts, the visible scene and its buffers, edits, and saving."""

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

from lookdev.errors import FaultsError, LookdevError, shorten
from lookdev.material.library import library_folders, read_library
from lookdev.scene import Scene
from lookdev.studio.designer.document import Document
from lookdev.studio.designer.edits import parse_edit
from lookdev.studio.designer.exact import Exact
from lookdev.studio.designer.exact_socket import ExactPictures
from lookdev.studio.designer.lights import Lights, parse_setting
from lookdev.studio.designer.snapshots import LARGEST
from lookdev.studio.designer.sources import ConflictError
from lookdev.studio.designer.turntable import Turntable
from lookdev.studio.scripts import Scripts

log = logging.getLogger("lookdev.studio")

STATIC = Path(__file__).parent / "static"
VIEWPORT = Path(__file__).parents[1] / "viewport" / "static"

PICTURE = "/picture"
"""The route to which the page sends the picture of a snapshot, a body that is larger than others."""

_FRESH = {"cache-control": "no-store"}


@dataclass(frozen=True)
class Query:
    """A request of the page: its body, {} if that is not a JSON object, and the parameters of its URL."""

    body: Mapping[str, Any]
    parameters: Mapping[str, str]
    posted: bool

    def number(self, name: str) -> int:
        """Return a whole number in the body; raise LookdevError if the value is not one."""
        value = self.body.get(name)
        if not isinstance(value, int) or isinstance(value, bool):
            raise LookdevError(f"'{name}' is a number")
        return value


Method = TypeVar("Method", bound=Callable[..., Any])


def json_route(path: str, *methods: str) -> Callable[[Method], Method]:
    """Route requests to a method that maps a `Query` to a JSON object, and that runs in a thread."""
    return _route_decorator(path, methods, "json")


def raw_route(path: str, *methods: str) -> Callable[[Method], Method]:
    """Route requests to a method that returns the response."""
    return _route_decorator(path, methods, "raw")


def _route_decorator(path: str, methods: tuple[str, ...], kind: str) -> Callable[[Method], Method]:
    def register(method: Method) -> Method:
        method.endpoint = (path, methods or ("GET",), kind)  # type: ignore[attr-defined]
        return method

    return register


class DesignerApp:
    """The application of a document's page."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._exact, self._lights = Exact(), Lights()
        self._turntable = Turntable(lambda: document.job)
        self._buffers: list[Mapping[str, bytes]] = []
        self._library = cache(lambda: read_library(library_folders()))
        self._drawing = anyio.CapacityLimiter(1)

    def application(self) -> Starlette:
        """Return the ASGI application: routed methods, scripts, and the websocket of exact pictures."""
        routes = []
        for name, member in vars(type(self)).items():
            if (endpoint := getattr(member, "endpoint", None)) is not None:
                path, methods, kind = endpoint
                method = getattr(self, name)
                respond = method if kind == "raw" else partial(_respond, method)
                routes.append(Route(path, respond, methods=list(methods)))
        return Starlette(
            lifespan=self._lifespan,
            routes=[
                *routes,
                WebSocketRoute("/exact", self._serve_pictures),
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
            await anyio.to_thread.run_sync(self._turntable.close)
            await anyio.to_thread.run_sync(self._exact.close)

    async def _serve_pictures(self, socket: WebSocket) -> None:
        await ExactPictures(socket, self._scene_with_lights, self._exact).run()

    def _scene_with_lights(self) -> Scene:
        """Return the visible scene, with the page's settings of its lights."""
        return self._lights.apply(self._document.scene_key[1], self._document.scene)

    def _change_answer(self, compiles: bool = False) -> Mapping[str, Any]:
        """Return the answer to a change of the document; `compiles` says whether the viewport needs new shaders."""
        return {"compiles": compiles, **self._document.status()}

    # The scene

    @json_route("/scene")
    def show_scene(self, query: Query) -> Mapping[str, Any]:
        document = self._document
        view = document.view()
        # Keep the buffers of the last two scenes: the page may fetch one while the next is computed.
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
        name = request.path_params["name"]
        for buffers in reversed(self._buffers):
            if name in buffers:
                headers = {"cache-control": "private, max-age=31536000, immutable"}
                return Response(buffers[name], media_type="application/octet-stream", headers=headers)
        return PlainTextResponse("no such buffer\n", 404)

    @json_route("/choose", "POST")
    def choose(self, query: Query) -> Mapping[str, Any]:
        self._document.choose(str(query.body.get("look")), str(query.body.get("rig")))
        return {}

    @json_route("/status")
    def report_status(self, query: Query) -> Mapping[str, Any]:
        return self._document.status() if "whole" in query.parameters else self._document.revision_status()

    # Edits

    @json_route("/edit", "POST")
    def edit(self, query: Query) -> Mapping[str, Any]:
        return self._change_answer(self._document.edit(parse_edit(query.body)))

    @json_route("/stack", "POST")
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
                return self._change_answer(True)
        return self._change_answer(document.edit_stack(look, body))

    @json_route("/wear", "POST")
    def assign_look(self, query: Query) -> Mapping[str, Any]:
        return self._change_answer(self._document.assign_look(query.body))

    @json_route("/wearables")
    def list_materials(self, query: Query) -> Mapping[str, Any]:
        return self._document.list_materials()

    @json_route("/history", "POST")
    def step_history(self, query: Query) -> Mapping[str, Any]:
        redo = query.body.get("redo")
        if not isinstance(redo, bool):
            raise LookdevError("a step of the history has 'redo', true or false")
        return self._change_answer(self._document.undo(1 if redo else -1))

    # Files

    @json_route("/save", "POST")
    def save(self, query: Query) -> Mapping[str, Any]:
        look, name, over = (query.body.get(key) for key in ("look", "name", "over"))
        is_wrong = not isinstance(look, int | None) or not isinstance(name, str | None)
        if is_wrong or (name is None and not isinstance(over, bool)):
            raise LookdevError("a request to save has a look's number and a file's name, or 'over', true or false")
        files = self._document.save(look, name, over=over is True)
        return {**self._change_answer(), "files": list(map(str, files))}

    @json_route("/disk", "POST")
    def settle_change_on_disk(self, query: Query) -> Mapping[str, Any]:
        document = self._document
        match query.body.get("do"):
            case "load":
                return self._change_answer(document.reload())
            case "keep":
                document.keep_edits()
            case "restore":
                return self._change_answer(document.recover(restore=True))
            case "discard":
                document.recover(restore=False)
            case _:
                raise LookdevError("an action on a changed file is load, keep, restore or discard")
        return self._change_answer()

    @json_route("/images")
    def list_images(self, query: Query) -> Mapping[str, Any]:
        look = query.parameters.get("look", "")
        return {"images": self._document.images(int(look) if look.isdecimal() else -1)}

    # Snapshots

    @raw_route(PICTURE, "POST")
    async def store_snapshot(self, request: Request) -> Response:
        content = bytearray()
        async for chunk in request.stream():
            content += chunk
            if len(content) > LARGEST:
                break  # refused as too large

        def store() -> Mapping[str, Any]:
            self._document.store_snapshot(bytes(content))
            return self._change_answer()

        return await _answer(store)

    @json_route("/snapshots", "POST")
    def use_snapshot(self, query: Query) -> Mapping[str, Any]:
        match query.body.get("do"):
            case "show":
                return self._change_answer(self._document.show_snapshot(query.number("number")))
            case "drop":
                self._document.snapshots.drop(query.number("number"))
            case _:
                raise LookdevError("a snapshot is shown or dropped")
        return self._change_answer()

    @raw_route("/snapshots/{number:int}")
    async def send_snapshot(self, request: Request) -> Response:
        try:
            snapshot = self._document.snapshots[int(request.path_params["number"])]
        except LookdevError as error:
            return PlainTextResponse(f"{error}\n", 404)
        return Response(snapshot.picture, media_type="image/png", headers=_FRESH)

    # Presets

    @json_route("/presets")
    def list_presets(self, query: Query) -> Mapping[str, Any]:
        library = self._library()
        rows = [
            {"name": preset.name, "category": preset.category, "model": preset.model, "doc": preset.doc}
            for preset in library.presets
        ]
        return {"presets": rows, "faults": [str(fault) for fault in library.faults]}

    @raw_route("/presets/{name}")
    async def send_thumbnail(self, request: Request) -> Response:
        name = request.path_params["name"]

        def draw() -> bytes | None:
            # Not at the top: plots take as long to import as the rest of the page.
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

    @json_route("/lights", "GET", "POST")
    def set_light(self, query: Query) -> Mapping[str, Any]:
        scene, rig = self._document.scene, self._document.scene_key[1]
        if query.body.get("reset") is True:
            self._lights.reset(rig)
        elif query.posted:
            self._lights.set(rig, scene, *parse_setting(query.body))
        return self._lights.describe(rig, scene)

    @json_route("/turntable", "GET", "POST")
    def render_turntable(self, query: Query) -> Mapping[str, Any]:
        if query.body.get("do") == "render":
            self._turntable.start(self._scene_with_lights, *self._document.scene_key)
        elif query.body.get("do") == "cancel":
            self._turntable.cancel()
        return self._turntable.describe()

    @raw_route("/turntable/{run:int}/{number:int}.png")
    async def send_turntable_picture(self, request: Request) -> Response:
        file = self._turntable.picture(request.path_params["run"], request.path_params["number"])
        return PlainTextResponse("no such frame\n", 404) if file is None else FileResponse(file, headers=_FRESH)


async def _respond(answer: Callable[[Query], Mapping[str, Any]], request: Request) -> Response:
    query = Query(await _body(request), request.query_params, request.method == "POST")
    return await _answer(lambda: answer(query))


def _ignore_errors(compute: Callable[[], Any]) -> None:
    with suppress(LookdevError, OSError):
        compute()


async def _body(request: Request) -> Mapping[str, Any]:
    try:
        body = await request.json()
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError, ClientDisconnect):
        return {}
    return body if isinstance(body, dict) else {}


async def _answer(compute: Callable[[], Mapping[str, Any]]) -> Response:
    """Return the result of a function that runs in a thread, or its error, as a response in JSON."""
    try:
        return JSONResponse(await anyio.to_thread.run_sync(compute), headers=_FRESH)
    except FaultsError as error:
        message = "; ".join(str(fault) for fault in error.faults)
    except ConflictError as error:
        return JSONResponse({"error": str(error), "conflict": list(map(str, error.files))}, 409, headers=_FRESH)
    except LookdevError as error:
        message = str(error)
    except OSError as error:
        message = f"{error.filename or 'a file'}: {error.strerror or error}"
    log.warning("refused: %s", shorten(message, 200))
    return JSONResponse({"error": message}, 422, headers=_FRESH)
