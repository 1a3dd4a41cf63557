"""The reference renderer, in float64 NumPy, with which checks and tests compare Cycles.

- `render`: values of pixels
- `mesh`: an asset as a scene for `render`
- `albedo`: directional albedos of a surface
"""
