"""Applies Blender's subdivision modifier to the cages of files (npz), and saves the points beside each.

A program of its own: it imports bpy.
"""

import sys

import bpy
import numpy as np

for file in sys.argv[1:]:
    cage = np.load(file)
    mesh = bpy.data.meshes.new("cage")
    faces = np.split(cage["corners"], np.cumsum(cage["sizes"])[:-1])
    mesh.from_pydata(cage["points"].tolist(), [], [face.tolist() for face in faces])
    # Blender keeps the square root of a tenth of a sharpness.
    pairs = np.sort(cage["edges"], axis=1).tolist()
    sharpness = {tuple(pair): value for pair, value in zip(pairs, cage["edge_sharpness"], strict=True)}
    creases = mesh.attributes.new("crease_edge", "FLOAT", "EDGE")
    for edge, crease in zip(mesh.edges, creases.data, strict=True):
        crease.value = (sharpness.get(tuple(sorted(edge.vertices)), 0.0) / 10.0) ** 0.5
    corners = mesh.attributes.new("crease_vert", "FLOAT", "POINT")
    for point, value in zip(cage["sharp_points"].tolist(), cage["point_sharpness"], strict=True):
        corners.data[point].value = (value / 10.0) ** 0.5
    thing = bpy.data.objects.new("cage", mesh)
    bpy.context.scene.collection.objects.link(thing)
    modifier = thing.modifiers.new("subdivision", "SUBSURF")
    modifier.levels = modifier.render_levels = int(cage["level"])
    modifier.quality = 10
    modifier.use_limit_surface = True
    modifier.boundary_smooth = str(cage["boundary"])
    refined = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    points = np.empty(3 * len(refined.vertices), np.float32)
    refined.vertices.foreach_get("co", points)
    np.save(file + ".npy", points.reshape(-1, 3))
