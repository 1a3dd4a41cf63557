"""Draw the plot of Smits' section "Diffuse": the diffuse lobe's integral over incident angle and roughness.

``python tests/brdf/plot_pixar_diffuse.py`` writes ``docs/images/pixar_diffuse_integral.png``. "When the surface
exhibits a lot of Fresnel behavior (roughness near 0) we should have a little less energy in the diffuse lobe, and
significantly less at grazing angles."
"""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from lookdev.arrays import Floats

_PICTURE = Path(__file__).parents[2] / "docs" / "images" / "pixar_diffuse_integral.png"


def diffuse_integral(degrees: ArrayLike, roughness: ArrayLike) -> Floats:
    """Return the integral of PDiffuse times the cosine over the hemisphere, divided by pi, (...).

    Reflectance is ``.05 (1 - rough)`` at normal incidence, ``1 - rough`` at grazing incidence. The cosine-weighted mean
    of (1 - cos)^5 is 1/21.
    """
    grazing = np.asarray(roughness, np.float64)
    normal = 0.95 + 0.05 * grazing
    schlick = (1.0 - np.cos(np.radians(degrees))) ** 5
    return (normal + (grazing - normal) * schlick) * (20.0 * normal + grazing) / 21.0


if __name__ == "__main__":
    from matplotlib.figure import Figure

    degrees, roughness = np.meshgrid(np.linspace(0.0, 90.0, 46), np.linspace(0.0, 1.0, 41))
    figure = Figure(figsize=(7.0, 5.2), layout="constrained")
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    integral = diffuse_integral(degrees, roughness)
    axes.plot_surface(degrees, roughness, integral, cmap="viridis", vmin=0.0, vmax=1.0, edgecolor="#00000040", lw=0.3)
    axes.set(xlabel="incident angle (degrees)", ylabel="roughness", zlim=(0.0, 1.0), xlim=(0, 90), ylim=(0, 1))
    axes.set_title("Diffuse lobe: integral over the hemisphere", fontsize=11)
    axes.view_init(elev=24.0, azim=-125.0)
    figure.savefig(_PICTURE, dpi=85)
