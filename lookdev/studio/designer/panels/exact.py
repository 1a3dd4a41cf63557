"""The websocket of the panel that shows the exact picture."""

from __future__ import annotations

from starlette.websockets import WebSocket

from lookdev.studio.designer.exact import ExactRenderer
from lookdev.studio.designer.exact_socket import ExactPictureSocket
from lookdev.studio.designer.routes import Routes, socket_route
from lookdev.studio.designer.session import Session


class ExactRoutes(Routes):
    """The websocket on which the page receives exact pictures, and their renderer."""

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._exact = ExactRenderer()

    @socket_route("/exact")
    async def serve_pictures(self, socket: WebSocket) -> None:
        """Answer the requests of a page over its websocket until the page is gone."""
        await ExactPictureSocket(socket, self.session.scene_with_lights, self._exact).run()

    def close(self) -> None:
        self._exact.close()
