"""The viewport: a scene drawn in a browser by WebGL 2, its looks and lights as generated GLSL.

`view_scene` converts a `lookdev.scene.Scene` for the page: to plain data, and to buffers named by their content. The
modules in ``static/`` draw it. The picture has direct light with cast shadows; `SceneView.left_out` lists the effects
that it lacks.
"""

from lookdev.studio.viewport.view import SceneView, light_rows, slider_constants, view_scene

__all__ = ["SceneView", "light_rows", "slider_constants", "view_scene"]
