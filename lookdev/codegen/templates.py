"""Read hand-written shader files: templates, which generated code completes, and files divided into sections.

The emitters of OSL and GLSL use this module.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.resources import files
from importlib.resources.abc import Traversable

from lookdev.errors import CodegenError

SHADERS = files("lookdev") / "shaders"


def expand_template(name: str, sections: Mapping[str, Sequence[str]]) -> str:
    """Return the text of the file `name` of `lookdev/shaders`, with its placeholders replaced.

    A line ``//@ NAME`` is replaced by the lines ``sections[NAME]``. A line ``//@ include FILE`` is replaced by that
    file, whose own placeholders are replaced, too.

    Raises
    ------
    CodegenError
        The template has a placeholder for a section that `sections` lacks.
    """
    lines: list[str] = []
    for line in (SHADERS / name).read_text(encoding="utf-8").splitlines():
        command = line.strip().removeprefix("//@ ").split() if line.strip().startswith("//@ ") else []
        if command[:1] == ["include"]:
            lines += expand_template(command[1], sections).splitlines()
        elif command:
            if command[0] not in sections:
                raise CodegenError(f"there is no section '{command[0]}' for the template {name}")
            lines += sections[command[0]]
        else:
            lines.append(line)
    return "\n".join(lines) + "\n"


def read_sections(osl: Traversable) -> dict[str, list[str]]:
    """Return the lines of each section of a file, by the section's name.

    A section begins after a line ``//@ section NAME``, and ends at the next such line. Lines before the first section
    are left out.
    """
    sections: dict[str, list[str]] = {}
    lines: list[str] = []
    for line in osl.read_text(encoding="utf-8").splitlines():
        if line.startswith("//@ section "):
            lines = sections.setdefault(line.removeprefix("//@ section ").strip(), [])
        else:
            lines.append(line)
    return sections
