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
    """Requests that store, show, delete or get a snapshot. The body of a request that stores one is the picture."""

    upload_paths = ("/picture",)

    @raw_route("/picture", "POST")
    async def store_snapshot(self, request: Request) -> Response:
        """Store a snapshot with the picture in the body of the request."""
        content = bytearray()
        async for chunk in request.stream():
            content += chunk
            if len(content) > MAX_PICTURE_BYTES:
                break  # `Document.store_snapshot` refuses the picture, because it is too large

        def store() -> Mapping[str, Any]:
            self.document.store_snapshot(bytes(content))
            return self.session.answer_to_change()

        return await json_response(store)

    @json_route("/snapshots", "POST")
    def use_snapshot(self, query: Query) -> Mapping[str, Any]:
        """Go back to the snapshot with the number ``number``, or delete this snapshot.

        ``do`` is "show" or "drop". The answer is that of `Session.answer_to_change`.
        """
        match query.body.get("do"):
            case "show":
                return self.session.answer_to_change(self.document.show_snapshot(query.number("number")))
            case "drop":
                self.document.snapshots.drop(query.number("number"))
            case _:
                raise LookdevError("a snapshot is shown or dropped")
        return self.session.answer_to_change()

    @raw_route("/snapshots/{number:int}")
    async def send_snapshot(self, request: Request) -> Response:
        """Return the picture of a snapshot, by its number."""
        try:
            snapshot = self.document.snapshots[int(request.path_params["number"])]
        except LookdevError as error:
            return PlainTextResponse(f"{error}\n", 404)
        return Response(snapshot.picture, media_type="image/png", headers=NO_STORE)
