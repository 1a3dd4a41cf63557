"""The base class of the Designer's routes: methods that answer requests, and decorators that give them URL paths."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import anyio.to_thread
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Route, WebSocketRoute

from lookdev.errors import FaultsError, LookdevError, shorten
from lookdev.studio.designer.session import Session
from lookdev.studio.designer.sources import ConflictError

log = logging.getLogger("lookdev.studio")

NO_STORE = {"cache-control": "no-store"}
"""Headers of a response that a browser must not store."""


@dataclass(frozen=True)
class Query:
    """A request of the page: its JSON body, the parameters of its URL, and whether its method is POST (`posted`).

    The body is {} if it is not a JSON object.
    """

    body: Mapping[str, Any]
    parameters: Mapping[str, str]
    posted: bool

    def number(self, name: str) -> int:
        """Return the whole number with this name in the body; raise LookdevError if there is none."""
        value = self.body.get(name)
        if not isinstance(value, int) or isinstance(value, bool):
            raise LookdevError(f"'{name}' is a number")
        return value


Method = TypeVar("Method", bound=Callable[..., Any])
MakeRoute = Callable[[Callable[..., Any]], BaseRoute]  # makes a route of a bound method


class Routes:
    """The base class of a panel's routes: its methods answer requests of the page, and its attributes are their state.

    The decorators `json_route`, `raw_route` and `socket_route` give a method its path. `upload_paths` has the paths of
    requests whose bodies may be larger than `access.MAX_BODY_BYTES`.
    """

    upload_paths: ClassVar[tuple[str, ...]] = ()

    def __init__(self, session: Session) -> None:
        self.session = session
        self.document = session.document

    def close(self) -> None:
        """End the computations of the methods when the server ends."""

    def list_routes(self) -> Iterator[BaseRoute]:
        """Yield a route for each method that has a path."""
        for name, member in vars(type(self)).items():
            if (make_route := getattr(member, "make_route", None)) is not None:
                yield make_route(getattr(self, name))


def json_route(path: str, *methods: str) -> Callable[[Method], Method]:
    """Return a decorator of a method that maps a `Query` to a JSON object; requests for `path` call it in a thread.

    `methods` are the HTTP methods of the requests, GET by default. `{name}` in a path is a parameter.
    """

    def make_route(method: Callable[[Query], Mapping[str, Any]]) -> BaseRoute:
        async def respond(request: Request) -> Response:
            query = Query(await _json_body(request), request.query_params, request.method == "POST")
            return await json_response(lambda: method(query))

        return Route(path, respond, methods=list(methods or ("GET",)))

    return _attach_route(make_route)


def raw_route(path: str, *methods: str) -> Callable[[Method], Method]:
    """Return a decorator of an asynchronous method that maps Starlette's request for `path` to its response."""
    return _attach_route(lambda method: Route(path, method, methods=list(methods or ("GET",))))


def socket_route(path: str) -> Callable[[Method], Method]:
    """Return a decorator of an asynchronous method that serves the websockets of `path`."""
    return _attach_route(lambda method: WebSocketRoute(path, method))


def _attach_route(make_route: MakeRoute) -> Callable[[Method], Method]:
    """Return a decorator that stores `make_route` as an attribute of a method, where `Routes.list_routes` finds it."""

    def mark(method: Method) -> Method:
        method.make_route = make_route  # type: ignore[attr-defined]
        return method

    return mark


async def _json_body(request: Request) -> Mapping[str, Any]:
    """Return the JSON object in the body of a request; {} if there is none."""
    try:
        body = await request.json()
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError, ClientDisconnect):
        return {}
    return body if isinstance(body, dict) else {}


async def json_response(compute: Callable[[], Mapping[str, Any]]) -> Response:
    """Run a function in a thread, and return its result, or the message of its error, as a response in JSON."""
    try:
        return JSONResponse(await anyio.to_thread.run_sync(compute), headers=NO_STORE)
    except FaultsError as error:
        message = "; ".join(str(fault) for fault in error.faults)
    except ConflictError as error:
        return JSONResponse({"error": str(error), "conflict": list(map(str, error.files))}, 409, headers=NO_STORE)
    except LookdevError as error:
        message = str(error)
    except OSError as error:
        message = f"{error.filename or 'a file'}: {error.strerror or error}"
    log.warning("refused: %s", shorten(message, 200))
    return JSONResponse({"error": message}, 422, headers=NO_STORE)
