"""The reference renderer: image values in float64 NumPy, to compare Cycles with.

`shapes` has the geometry, exact instead of tessellated; `render` the paths of light over it.
"""
