"""Draw the plot of Smits' section "Diffuse": the diffuse lobe's integral over incident angle and roughness.

Run ``python tests/brdf/plot_pixar_diffuse.py [picture]``; without a name it is
``docs/images/pixar_diffuse_integral.png``. "When the surface exhibits a lot of Fresnel behavior (roughness near 0) we
should have a little less energy in the diffuse lobe, and significantly less at grazing angles."
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lookdev.brdf.fresnel import fresnel_blend

_PICTURE = Path(__file__).parents[2] / "docs" / "images" / "pixar_diffuse_integral.png"


def diffuse_integral(degrees: ArrayLike, roughness: ArrayLike) -> NDArray[np.float64]:
    """Integrate PDiffuse times the cosine over the hemisphere, divided by pi.

    Parameters
    ----------
    degrees, roughness : (...)
        Incident angle, and roughness: reflectance is ``.05 (1 - rough)`` at normal incidence, ``1 - rough`` at
        grazing incidence.
    """
    smooth = np.expand_dims(1.0 - np.asarray(roughness, np.float64), -1)
    normal, grazing = 1.0 - 0.05 * smooth, 1.0 - smooth
    # The integrand, 2 F(cos) cos over cosines, is a polynomial of degree 6: four nodes are exact.
    x, weight = np.polynomial.legendre.leggauss(4)
    cos = 0.5 * (x + 1.0)
    hemisphere = sum(fresnel_blend(normal, grazing, c) * c * w for c, w in zip(cos, weight, strict=True))
    return (fresnel_blend(normal, grazing, np.cos(np.radians(degrees))) * hemisphere)[..., 0]


def main() -> None:
    """Write the picture."""
    from matplotlib.figure import Figure

    path = Path(sys.argv[1]) if len(sys.argv) > 1 else _PICTURE
    degrees, roughness = np.meshgrid(np.linspace(0.0, 90.0, 46), np.linspace(0.0, 1.0, 41))
    figure = Figure(figsize=(7.0, 5.2), layout="constrained")
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    integral = diffuse_integral(degrees, roughness)
    axes.plot_surface(degrees, roughness, integral, cmap="viridis", vmin=0.0, vmax=1.0, edgecolor="#00000040", lw=0.3)
    axes.set(xlabel="incident angle (degrees)", ylabel="roughness", zlim=(0.0, 1.0), xlim=(0, 90), ylim=(0, 1))
    axes.set_title("Diffuse lobe: integral over the hemisphere", fontsize=11)
    axes.view_init(elev=24.0, azim=-125.0)
    figure.savefig(path, dpi=85)


if __name__ == "__main__":
    main()
