"""The web pages of `lookdev explore` and `lookdev design`, and the local server that both use.

Each page has a folder with its scripts and the routes of its data: `explorer` and `designer`. `viewport` draws a scene
in the browser. Both pages use the other modules: `server` listens at an address and serves a page, `access` refuses
requests from other sites, `roots` finds the files that a page may read, `websocket` and `packets` send messages to a
page, and `scripts` sends its static files.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec

from lookdev.errors import LookdevError

__all__ = ["Address", "require_packages"]


@dataclass(frozen=True)
class Address:
    """The address at which the server listens; a `port` of None is the default port, or a free one if that is taken.

    Browsers may call the server by `host`, by ``localhost``, by the addresses of the loopback interface, and by the
    further host names `names`.
    """

    host: str = "127.0.0.1"
    port: int | None = None
    names: tuple[str, ...] = ()


def require_packages() -> None:
    """Raise LookdevError if a package that the pages need is not installed."""
    if missing := [name for name in ("starlette", "tomlkit", "uvicorn", "websockets") if find_spec(name) is None]:
        raise LookdevError(f"the page needs {' and '.join(missing)}: pip install 'lookdev[studio]'")
