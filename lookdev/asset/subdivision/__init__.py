"""Refines control cages to meshes on the limit surface of subdivision, by the rules of OpenSubdiv and USD.

A level is a number of refinements. `detail` chooses the level of each cage by the cage's size in the frame, and `batch`
refines the cages. They use these modules: `cage` reads tags, `topology` has half-edges and splits faces, `rules`
computes the points of the next level, `face_varying` gives UVs half-edges of their own, `refine` combines these,
`limit` and `masks` compute the limit surface.

The implementation processes all faces at once, with NumPy. No maintained library follows all of the rules and returns
arrays for all backends. No wheel of OpenSubdiv is maintained for these versions of Python. Blender's modifier, which is
based on OpenSubdiv, supports neither `loop` nor holes nor the omission of boundary faces. docs/geometry.md compares
the libraries.
"""

from lookdev.asset.subdivision.batch import refine, refine_all
from lookdev.asset.subdivision.detail import Refinement, orbit_pixel_size, refinement_levels

__all__ = ["Refinement", "orbit_pixel_size", "refine", "refine_all", "refinement_levels"]
