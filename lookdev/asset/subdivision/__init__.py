"""Subdivision surfaces: control cages refined to meshes on the limit surface, by the rules of OpenSubdiv and USD.

`batch` refines cages, `detail` says how often by their size in the frame. Below them: `cage` reads tags, `topology` has
half-edges and splits faces, `rules` moves points, `face_varying` gives UVs half-edges of their own, `refine` brings
these together, `limit` and `masks` go to the limit surface.

It is written here, in NumPy over all faces at once, since nothing that is maintained obeys all of the rules where the
arrays are needed, above every backend: no wheel of OpenSubdiv for these versions of Python is maintained, and Blender's
modifier, OpenSubdiv too, has neither loop nor holes nor boundary faces left out. docs/geometry.md has the comparison.
"""

from lookdev.asset.subdivision.batch import refine, refine_all
from lookdev.asset.subdivision.detail import Refinement, orbit_pixel, refinement_levels

__all__ = ["Refinement", "orbit_pixel", "refine", "refine_all", "refinement_levels"]
