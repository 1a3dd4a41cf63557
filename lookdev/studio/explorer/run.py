"""`lookdev explore`: from words to a page that is served."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from lookdev.plotting.subject import LOOK, split_label
from lookdev.studio import Address
from lookdev.studio.explorer.app import UPLOAD, application
from lookdev.studio.explorer.surfaces import Surfaces
from lookdev.studio.roots import Roots
from lookdev.studio.server import serve_page

FIRST = ("disney:baseColor=.72/.12/.08,roughness=.35", "pixar:surfaceColor=.72/.12/.08,roughness=.35")
"""What a page shows that is asked for nothing: the two models of film, alike in colour and roughness."""


def explore(
    what: Sequence[str],
    folders: Sequence[Path],
    library: Path | None,
    address: Address,
    *,
    browser: bool,
    say: Callable[[str], None],
) -> None:
    """Serve the explorer until the program is interrupted; `say` is given what a user must know, such as the URL.

    Raises LookdevError where something of `what` is wrong, a folder is missing, or the address cannot be listened at.
    """
    with tempfile.TemporaryDirectory(prefix="lookdev-uploads-") as uploads:
        roots = Roots(Path(uploads))
        for folder in folders:
            roots.add(folder)
        surfaces = Surfaces(roots, library)
        first = [named_words(each, roots) for each in what]
        for words in first:
            surfaces.subject(words)
        serve_page(lambda: application(surfaces, first or FIRST), address, [UPLOAD], browser=browser, say=say)


def named_words(words: str, roots: Roots) -> str:
    """Return words of the command line with its files as roots, by their names."""
    label, rest = split_label(words)
    found = LOOK.fullmatch(rest)
    file = found["file"] if found else rest
    _, equals, path = file.partition(":file=")
    if equals:
        file = path.partition(",")[0]
    if Path(file).is_file():
        rest = rest.replace(file, roots.add(Path(file)), 1)
    return f"{label}={rest}" if label else rest
