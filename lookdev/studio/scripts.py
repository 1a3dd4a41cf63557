"""The pages' own files: HTML, scripts and styles."""

from __future__ import annotations

from typing import Any

from starlette.responses import Response
from starlette.staticfiles import StaticFiles


class Scripts(StaticFiles):
    """Static files that a browser requests anew each time; they are on this machine."""

    def file_response(self, *args: Any, **kwargs: Any) -> Response:
        response = super().file_response(*args, **kwargs)
        response.headers["cache-control"] = "no-cache"
        return response
