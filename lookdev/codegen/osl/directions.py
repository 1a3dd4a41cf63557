"""The numbers of directions drawn at a shading point, as the lobes of a look need them.

If every lobe is glossy, most of the variance of a shape with recesses is in light that other parts of it reflect. A
path that continues adds one sample of that light, whatever number of directions was drawn at its first hit. So the
first hit draws few directions, and paths cost less. Later hits draw more directions from the light, since few of these
fall into a narrow lobe. A broad lobe takes its direct light from all of them. Measured: docs/bench.md, "Recesses".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lookdev.brdf import Lobe

_DEFAULT = 4


@dataclass(frozen=True)
class Directions:
    """Numbers of directions drawn from the BSDF and from the light, at the first hit and after a bounce."""

    brdf: int
    ibl: int
    brdf_onward: int
    ibl_onward: int


def direction_counts(
    lobes: Sequence[Lobe], brdf: int | None, ibl: int | None, bounces: int, *, constant_light: bool
) -> Directions:
    """Return the numbers of directions; the lobes decide where `brdf` or `ibl`, the job's numbers, are None."""
    if not lobes:
        return Directions(1, 0, 1, 0)
    if constant_light:
        # Every direction is equally bright: samples of the light reduce no variance, even if a job sets some.
        return _counts_with_bounces(brdf or _DEFAULT, 0)
    if bounces > 0 and brdf is None and ibl is None and not any(lobe.broad or lobe.transmits for lobe in lobes):
        return Directions(2, 2, 1, 4)
    broad = bounces == 0 and all(lobe.broad for lobe in lobes)
    brdf = (0 if broad else _DEFAULT) if brdf is None else brdf
    ibl = _DEFAULT if ibl is None else ibl
    # Keep at least one sampling strategy.
    return _counts_with_bounces(brdf, ibl) if brdf + ibl else _counts_with_bounces(1, 0)


def _counts_with_bounces(brdf: int, ibl: int) -> Directions:
    """Return numbers of directions that are smaller after a bounce.

    Every path adds a sample there. A path continues only if a direction is drawn from the BSDF, so at least one is.
    """
    return Directions(brdf, ibl, max(1, brdf // 4), -(-ibl // 2))
