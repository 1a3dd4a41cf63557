"""The command `lookdev design`: it opens a job or an asset, and serves the Designer's page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from lookdev.asset import BUILTINS
from lookdev.errors import LookdevError, nearest_hint
from lookdev.studio import Address
from lookdev.studio.designer.app import UPLOAD_PATHS, DesignerApp
from lookdev.studio.designer.open_document import open_document
from lookdev.studio.server import serve_page


def design(source: str, material: Path | None, address: Address, *, browser: bool, say: Callable[[str], None]) -> None:
    """Serve the Designer until the program is interrupted; `source` is a job, an asset's file or a built-in asset.

    `material` is a look that covers an asset in place of its own materials. With `browser`, the browser opens the page.
    `say` receives messages for the user. Raises LookdevError if the file does not exist or has faults, or the server
    cannot listen at the address.
    """
    file = Path(source)
    if source not in BUILTINS and not file.exists():
        hint = nearest_hint(source, list(BUILTINS))
        raise LookdevError(f"{source}: no such job or asset, and no built-in asset of that name ({hint})")
    if material is not None and file.suffix == ".toml":
        raise LookdevError("--material goes with an asset: a job names its materials itself")
    if material is None and source in BUILTINS:
        raise LookdevError(f"'{source}' has no materials of its own: --material LOOK.usda would be right")
    document = open_document(
        None if source in BUILTINS else file, source if source in BUILTINS else None, material, recovers=True
    )
    try:
        serve_page(lambda: DesignerApp(document).application(), address, UPLOAD_PATHS, browser=browser, say=say)
    finally:
        if document.close():
            say("unsaved edits are kept: the same command offers them")
