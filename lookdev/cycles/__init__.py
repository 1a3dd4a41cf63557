"""The renderer on Blender's Cycles. It runs in a worker process, ``python -m lookdev.cycles``.

This is the only subpackage that imports bpy. `version` has every difference between Blender 4.5 and 5.2, `engine` runs
Cycles and returns pixels, `scene` builds Blender's data, `shaders` compiles generated OSL, `render` renders frames,
`points` evaluates BSDFs, and `__main__` communicates with the parent process.
"""
