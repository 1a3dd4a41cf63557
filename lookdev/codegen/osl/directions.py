"""How many directions are drawn at a shading point, by what the lobes of a look need.

Where every lobe is glossy, most of the variance of a shape with recesses is in what other parts reflect: a path that
goes on adds one sample of that, however many directions were drawn where it began. So few are drawn at the first hit,
and paths cost less; where a path arrives, more of the light's are, since few of them fall into a narrow lobe. A broad
lobe takes its direct light from all of them. Measured: docs/bench.md, "Recesses".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lookdev.brdf import Lobe

_EACH = 4


@dataclass(frozen=True)
class Directions:
    """Numbers of directions drawn from the BSDF and from the light, at the first hit and after a bounce."""

    brdf: int
    ibl: int
    brdf_onward: int
    ibl_onward: int


def directions(
    lobes: Sequence[Lobe], brdf: int | None, ibl: int | None, bounces: int, *, constant_light: bool
) -> Directions:
    """Return the numbers of directions, chosen by the lobes where `brdf` or `ibl`, of a job, are None."""
    if not lobes:
        return Directions(1, 0, 1, 0)
    if constant_light:
        # Every direction is equally bright, so samples of the light reduce no variance, even where a job sets some.
        return _halved(brdf or _EACH, 0)
    if bounces > 0 and brdf is None and ibl is None and not any(lobe.broad or lobe.transmits for lobe in lobes):
        return Directions(2, 2, 1, 4)
    broad = bounces == 0 and all(lobe.broad for lobe in lobes)
    brdf = (0 if broad else _EACH) if brdf is None else brdf
    ibl = _EACH if ibl is None else ibl
    # Keep at least one sampling strategy.
    return _halved(brdf, ibl) if brdf + ibl else _halved(1, 0)


def _halved(brdf: int, ibl: int) -> Directions:
    """Return fewer directions after a bounce: every path adds a sample, and goes on while there is one of the BSDF."""
    return Directions(brdf, ibl, max(1, brdf // 4), -(-ibl // 2))
