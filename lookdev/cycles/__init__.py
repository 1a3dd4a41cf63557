"""The renderer: the only subpackage that imports bpy; it runs in a process of its own (``python -m lookdev.cycles``).

`version` has every difference between Blender 4.5 and 5.2, `engine` runs Cycles and returns pixels, `scene` builds
Blender's data, `shaders` compiles generated OSL, `render` makes frames, `points` evaluates BSDFs, `__main__`
communicates with the parent process.
"""
