"""Generate code from the reflectance models: `trace` records a model's arithmetic as a graph, emitters write the code.

The emitters, one per target: `osl` for OSL shaders, `nodes` for Blender's shader nodes, `glsl` for the pages in the
browser, `program` for lists of operations, which Mitsuba and NumPy run.
"""
