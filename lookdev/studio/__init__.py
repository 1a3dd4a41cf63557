"""The web pages: a local server (`server`), its access control (`access`), the `websocket` of a page, files (`roots`).

Each page has a folder of its own, with its scripts and the routes of its data: `explorer` and `designer`.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec

from lookdev.errors import LookdevError

__all__ = ["Address", "require_packages"]


@dataclass(frozen=True)
class Address:
    """The address at which the server listens, and names of it for browsers, in addition to those of the loopback."""

    host: str = "127.0.0.1"
    port: int | None = None
    names: tuple[str, ...] = ()


def require_packages() -> None:
    """Raise LookdevError if a package that the pages need is not installed."""
    if missing := [name for name in ("starlette", "tomlkit", "uvicorn", "websockets") if find_spec(name) is None]:
        raise LookdevError(f"the page needs {' and '.join(missing)}: pip install 'lookdev[studio]'")
