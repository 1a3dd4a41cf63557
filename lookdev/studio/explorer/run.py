"""The command `lookdev explore`: it reads the surfaces of the command line, and serves the Explorer's page."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from lookdev.plotting.subject import LOOK_PATTERN, split_label
from lookdev.studio import Address
from lookdev.studio.explorer.app import UPLOAD, ExplorerApp
from lookdev.studio.explorer.surfaces import Surfaces
from lookdev.studio.roots import Roots
from lookdev.studio.server import serve_page

DEFAULT_SURFACES = ("disney:baseColor=.72/.12/.08,roughness=.35", "pixar:surfaceColor=.72/.12/.08,roughness=.35")
"""The surfaces if the command line states none: the two models of film, with the same colour and roughness."""


def explore(
    subjects: Sequence[str],
    folders: Sequence[Path],
    library: Path | None,
    address: Address,
    *,
    browser: bool,
    say: Callable[[str], None],
) -> None:
    """Serve the Explorer until the program is interrupted.

    `subjects` are texts of the first surfaces, as `lookdev plot` reads them. The page may open the files in `folders`;
    `library` is a folder of presets. With `browser`, the browser opens the page. `say` receives messages for the user,
    such as the URL. Raises LookdevError if one of `subjects` is wrong, a folder is missing, or the server cannot listen
    at the address.
    """
    with tempfile.TemporaryDirectory(prefix="lookdev-uploads-") as uploads:
        roots = Roots(Path(uploads))
        for folder in folders:
            roots.add(folder)
        surfaces = Surfaces(roots, library)
        first = [add_file_to_roots(text, roots) for text in subjects]
        for text in first:
            surfaces.subject(text)  # raises the error of a wrong text before the page is served
        start_surfaces = first or DEFAULT_SURFACES
        serve_page(
            lambda: ExplorerApp(surfaces, start_surfaces).application(), address, [UPLOAD], browser=browser, say=say
        )


def add_file_to_roots(text: str, roots: Roots) -> str:
    """Add the file in the text of a surface to the roots; return the text with the file's name in place of its path."""
    label, rest = split_label(text)
    match = LOOK_PATTERN.fullmatch(rest)
    file = match["file"] if match else rest
    _, equals, path = file.partition(":file=")
    if equals:
        file = path.partition(",")[0]
    if Path(file).is_file():
        rest = rest.replace(file, roots.add(Path(file)), 1)
    return f"{label}={rest}" if label else rest
