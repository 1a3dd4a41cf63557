"""The web page: a local server (`server`), who may talk to it (`access`) and how (`talk`), the files it may
read (`roots`), and rooms.

A room of the page is a folder of its own, with the routes of its data and its scripts: `explorer`, `designer`.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec

from lookdev.errors import LookdevError

__all__ = ["Address", "checked_packages"]


@dataclass(frozen=True)
class Address:
    """Where the server listens, and the names by which browsers may call it besides those of the loopback."""

    host: str = "127.0.0.1"
    port: int | None = None
    names: tuple[str, ...] = ()


def checked_packages() -> None:
    """Raise LookdevError where a package of the page is not installed."""
    if missing := [name for name in ("starlette", "tomlkit", "uvicorn", "websockets") if find_spec(name) is None]:
        raise LookdevError(f"the page needs {' and '.join(missing)}: pip install 'lookdev[studio]'")
