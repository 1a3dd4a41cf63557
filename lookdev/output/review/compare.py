"""Comparison of a frame with that of another version, beyond the difference that the noise of both explains."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lookdev.metrics import noise_ratio, relmse
from lookdev.output.review.pixels import Pixels

BEYOND = 3.0
"""z above which noise does not explain a pixel: 0.27 % of pixels exceed it by chance, where noise is Gaussian."""

SQUARE = 7
"""Side in pixels of the squares over which z is computed, here, and on the page by default."""

NOTICED = 0.003
"""Share of the asset's pixels beyond z = 3 above which a frame counts as changed."""


@dataclass(frozen=True)
class Comparison:
    """A frame against that of another version.

    `changed` are the parts of the digest that differ, as a plan names them. `relmse` is the relMSE of the frame against
    the other frame. `beyond` is the share of the asset's pixels with z above `BEYOND`; it is None where an error is not
    known. Both are None where the frames differ in size.
    """

    changed: tuple[str, ...]
    relmse: float | None = None
    beyond: float | None = None

    @property
    def visible(self) -> bool:
        """Whether pixels differ by more than noise explains; where noise is not known, whether they differ at all."""
        if self.beyond is not None:
            return self.beyond > NOTICED
        return self.relmse is None or self.relmse > 0.0


def compare_frames(new: Pixels, old: Pixels, header: Mapping[str, str], old_header: Mapping[str, str]) -> Comparison:
    """Compare a frame with that of another version by their pixels and headers."""
    changed = changed_parts(header, old_header)
    if new.alpha.shape != old.alpha.shape:
        return Comparison(changed)
    alpha = np.maximum(new.alpha, old.alpha)
    error = relmse(new.beauty, old.beauty, alpha)
    if new.error is None or old.error is None:
        return Comparison(changed, error)
    z = noise_ratio(new.beauty, old.beauty, new.error, old.error, SQUARE)
    covered = alpha > 0.0
    return Comparison(changed, error, float((z[covered] > BEYOND).mean()) if covered.any() else 0.0)


def changed_parts(header: Mapping[str, str], old: Mapping[str, str]) -> tuple[str, ...]:
    """Return the parts of the digest in which two headers differ: "look", "light", "camera" and so on."""
    prefix = "digest."
    keys = sorted({key for key in (*header, *old) if key.startswith(prefix)})
    parts = [key.removeprefix(prefix) for key in keys if header.get(key) != old.get(key)]
    names = tuple("light" if part == "ibl" else part for part in parts)
    return names or (("digest",) if header.get("digest") != old.get("digest") else ())
