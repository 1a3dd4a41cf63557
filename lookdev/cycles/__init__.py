"""The renderer: the only room that knows Blender. It lives in a process of its own (``python -m lookdev.cycles``).

`version` holds every difference between Blender 4.5 and 5.2, `engine` runs Cycles and hands back pixels, `scene`
builds what is rendered, `shaders` compiles generated OSL, `render` makes frames of it, `points` evaluates BRDFs,
`__main__` speaks with the parent process.
"""
