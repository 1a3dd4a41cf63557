"""Requests of the panel of snapshots, which are pictures of the page with the state of the looks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

from lookdev.errors import LookdevError
from lookdev.studio.designer.routes import NO_STORE, Query, Routes, json_response, json_route, raw_route
from lookdev.studio.designer.snapshots import MAX_PICTURE_BYTES


class SnapshotRoutes(Routes):
    """Requests that store a snapshot, whose picture is their body, and requests that show, drop or get a snapshot."""

    uploads = ("/picture",)

    @raw_route("/picture", "POST")
    async def store_snapshot(self, request: Request) -> Response:
        """Store a snapshot with the picture in the body of the request."""
        content = bytearray()
        async for chunk in request.stream():
            content += chunk
            if len(content) > MAX_PICTURE_BYTES:
                break  # `store_snapshot` refuses it as too large

        def store() -> Mapping[str, Any]:
            self.document.store_snapshot(bytes(content))
            return self.session.change_answer()

        return await json_response(store)

    @json_route("/snapshots", "POST")
    def use_snapshot(self, query: Query) -> Mapping[str, Any]:
        """Go back to the snapshot with number ``number``, or delete it."""
        match query.body.get("do"):
            case "show":
                return self.session.change_answer(self.document.show_snapshot(query.number("number")))
            case "drop":
                self.document.snapshots.drop(query.number("number"))
            case _:
                raise LookdevError("a snapshot is shown or dropped")
        return self.session.change_answer()

    @raw_route("/snapshots/{number:int}")
    async def send_snapshot(self, request: Request) -> Response:
        """Return the picture of a snapshot, by its number."""
        try:
            snapshot = self.document.snapshots[int(request.path_params["number"])]
        except LookdevError as error:
            return PlainTextResponse(f"{error}\n", 404)
        return Response(snapshot.picture, media_type="image/png", headers=NO_STORE)
