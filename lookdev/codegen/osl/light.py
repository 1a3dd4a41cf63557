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
    Runs at each shading point, with ``IBL_SAMPLES > 0``. ``n`` is the shading normal, ``seed`` the point's scramble.
    ``front_samples`` and ``back_samples`` are the numbers of directions for light from the viewer's side of the surface
    and, with ``TRANSMITS``, from the other side.
``sample``
    Draws sample ``number`` of the pixel, for the other side if ``back`` is 1. Sets ``wi``, ``radiance`` and, if the
    probability of the draw is not exactly the pdf, ``ratio``, the pdf over the probability. Numbers of a pixel count
    from 0, separately for front and back.
``density``
    Adds the pdf of ``wi`` at front and back, times the samples of each side, to ``density``, and sets ``radiance``.
``lookup``
    Sets ``radiance`` from ``wi``.
"""

from __future__ import annotations

from collections.abc import Sequence

from lookdev.codegen.osl.rig import rig_sections
from lookdev.codegen.templates import read_sections
from lookdev.errors import CodegenError
from lookdev.light import LIGHT_KINDS, Light, coded
from lookdev.light.lamps import CodedRig

SECTIONS = ("parameters", "functions", "setup", "sample", "density", "lookup")


def light_sections(lights: Sequence[Light]) -> dict[str, list[str]]:
    """Return the lines of each section of the lights, by its name in templates, ``light_NAME`` and ``rig_NAME``.

    Raises
    ------
    CodegenError
        The file of a kind lacks a section, or has an unknown one.
    """
    single = coded(lights)
    if single is None:
        return rig_sections(CodedRig.of(lights))
    osl = LIGHT_KINDS[single.kind].osl
    assert osl is not None, "a light that is coded has OSL"
    sections = read_sections(osl)
    if mismatched := sorted(sections.keys() ^ set(SECTIONS)):
        names = ", ".join(mismatched)
        raise CodegenError(f"{osl.name}: a light has sections {', '.join(SECTIONS)}; unknown or missing: {names}")
    constants = {"constants": ["#define RIG 0"], "samples": ["    int samples = int(control[2]);"]}
    return {
        **constants,
        "rig_setup": [],
        "rig_seen": [],
        "rig_arrive": [],
        **{f"light_{name}": code for name, code in sections.items()},
    }
