"""A light in the shader of a look: the OSL of its kind, by sections.

A kind's file is divided by lines ``//@ section NAME``, after a comment; `lookdev/shaders/surface.osl` includes each
section by ``//@ light_NAME``. Sections can read the shader's globals (``P`` is relative to the center of the asset's
bounding sphere), ``turn``, the rotation of the light about z in radians, and ``IBL_SAMPLES``, 0 where directions are
drawn from the BSDF alone: then no other macro or variable of sampling exists.

``parameters``
    Of the shader: their values are those of `LightCode`.
``functions``
    In front of the shader.
``setup``
    At each shading point, with ``IBL_SAMPLES > 0``. ``n`` is the shading normal, ``seed`` the point's scramble,
    ``front_samples`` and ``back_samples`` are the numbers of directions for light from the viewer's side of the surface
    and, with ``TRANSMITS``, from the other side.
``sample``
    Draws sample ``number`` of the pixel, for the other side where ``back`` is 1: sets ``wi``, ``radiance`` and, where
    the probability of the draw is not exactly the pdf, ``ratio``, the pdf over the probability. Numbers of a pixel are
    consecutive from 0, for front and back each.
``density``
    Adds the pdf of ``wi`` at front and back, times the samples of each, to ``density``; ``radiance`` is set.
``lookup``
    Sets ``radiance`` from ``wi``.
"""

from __future__ import annotations

from lookdev.errors import CodegenError
from lookdev.light import LIGHT_KINDS, Light

SECTIONS = ("parameters", "functions", "setup", "sample", "density", "lookup")


def light_sections(light: Light) -> dict[str, list[str]]:
    """Return the lines of each section of a light's kind, by its name in templates, ``light_NAME``.

    Raises
    ------
    CodegenError
        The kind's file lacks a section, or has an unknown one; or the kind has no file.
    """
    osl = LIGHT_KINDS[light.kind].osl
    if osl is None:
        raise CodegenError(f"a light of kind '{light.kind}' has no OSL; backend 'exact' cannot render it")
    sections: dict[str, list[str]] = {}
    lines: list[str] = []
    for line in osl.read_text(encoding="utf-8").splitlines():
        if line.startswith("//@ section "):
            lines = sections.setdefault(line.removeprefix("//@ section ").strip(), [])
        else:
            lines.append(line)
    if different := sorted(sections.keys() ^ set(SECTIONS)):
        names = ", ".join(different)
        raise CodegenError(f"{osl.name}: a light has sections {', '.join(SECTIONS)}; unknown or missing: {names}")
    return {f"light_{name}": lines for name, lines in sections.items()}
