"""Routes of the page's server: methods of a class, each with a decorator that has its path."""

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
"""Headers of a response that a browser requests anew each time."""


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
MakeRoute = Callable[[Callable[..., Any]], BaseRoute]


class Routes:
    """A class of methods that answer requests of the page, and their state.

    The decorators `json_route`, `raw_route` and `socket_route` give a method its path. `uploads` are the paths of
    requests whose bodies may be larger than others.
    """

    uploads: ClassVar[tuple[str, ...]] = ()

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
    """Route requests to a method that maps a `Query` to a JSON object, and that runs in a thread."""

    def make_route(method: Callable[[Query], Mapping[str, Any]]) -> BaseRoute:
        async def respond(request: Request) -> Response:
            query = Query(await _json_body(request), request.query_params, request.method == "POST")
            return await json_response(lambda: method(query))

        return Route(path, respond, methods=list(methods or ("GET",)))

    return _attach_route(make_route)


def raw_route(path: str, *methods: str) -> Callable[[Method], Method]:
    """Route requests to a method that returns the response."""
    return _attach_route(lambda method: Route(path, method, methods=list(methods or ("GET",))))


def socket_route(path: str) -> Callable[[Method], Method]:
    """Route websockets to a method that serves them."""
    return _attach_route(lambda method: WebSocketRoute(path, method))


def _attach_route(make_route: MakeRoute) -> Callable[[Method], Method]:
    def mark(method: Method) -> Method:
        method.make_route = make_route  # type: ignore[attr-defined]
        return method

    return mark


async def _json_body(request: Request) -> Mapping[str, Any]:
    try:
        body = await request.json()
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError, ClientDisconnect):
        return {}
    return body if isinstance(body, dict) else {}


async def json_response(compute: Callable[[], Mapping[str, Any]]) -> Response:
    """Return the result of a function that runs in a thread, or its error, as a response in JSON."""
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
