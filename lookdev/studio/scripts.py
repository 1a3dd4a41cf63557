"""The static files of the pages: HTML, scripts and styles."""

from __future__ import annotations

import os

from starlette.responses import Response
from starlette.staticfiles import PathLike, StaticFiles
from starlette.types import Scope


class Scripts(StaticFiles):
    """Static files; a browser asks the server before it uses a cached copy of a file.

    The server is usually on the browser's machine, so this request costs little.
    """

    def file_response(
        self, full_path: PathLike, stat_result: os.stat_result, scope: Scope, status_code: int = 200
    ) -> Response:
        response = super().file_response(full_path, stat_result, scope, status_code)
        response.headers["cache-control"] = "no-cache"
        return response
